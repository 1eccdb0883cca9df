"""Lights that the environment map does not show: found in what the fitted ones leave unexplained.

The map averages all texels, so that a lamp mirrored mostly by matte ones is faint in it. Once every
material's lobe is known, each direction can be asked what a lamp there would explain: with e the
residuals and φ = ρ (l·r)^α, each texel's diffuse term eliminated, a lamp of gain g = N/Q takes N²/Q
from the residual sum of squares, N = Σ_i Σ_j w φ̃ ẽ and Q = Σ_i Σ_j w φ̃².
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..geometry.visibility import spread_directions
from ..jit import kernel
from ..samples.observations import Observations, View, fill_visibility, visibility
from ..threads import thread_count
from .fit_samples import choose_texels, collect, flat_limits
from .fit_state import FitState
from .joint import FIRST_ALPHA, JointFit, fit
from .light_evidence import hear
from .lights import Light

DIRECTIONS = 1500
"""Tried: five degrees apart."""
WIDE_ENOUGH = 60.0
"""α that lobes are widened to, so that none falls between two directions, nor between the places
where texels see a near lamp."""
APART = np.radians(15)
"""From the lights known: nearer residuals are those of their own shape."""
CLEAR = 5.0
"""N over its standard error, texels taken as independent."""
FAINTEST = 0.08
"""Of the strongest gain, below which there is no lamp: what lobes unlike Phong's leave
around a lamp looks like one of up to a thirtieth."""
WORTHWHILE = 0.01
"""Share of what is left unexplained that a missed lamp would take away."""
AGREED = 0.7
"""Share of the texels that should show a missed lamp and are explained better with it."""
MOST = 4
"""Missed lights looked for."""


@dataclass(frozen=True)
class Residue:
    """What a lamp in each of some directions (A, 3) would explain; (A,) float64 each.

    gain : N/Q; share : N²/Q over the residual sum of squares; z : N over its standard error
    """

    direction: np.ndarray
    gain: np.ndarray
    share: np.ndarray
    z: np.ndarray


@kernel
def _correlate(
    first, stop, view, texel, offsets, material, mirror, w, residual, directions, rho, alpha, sums
):  # fmt: skip
    """Add N, Q and Σ N_i² of the texels first..stop to sums (A, 3); returns Σ w ẽ²."""
    coefficients = np.empty(36, np.float32)
    total = 0.0
    for i in range(first, stop):
        m, t = material[i], texel[i]
        if not rho[m] > 0:
            continue
        sw, se, see = 0.0, 0.0, 0.0
        for j in range(offsets[i], offsets[i + 1]):
            sw += w[j]
            se += w[j] * residual[j]
            see += w[j] * residual[j] ** 2
        if sw <= 0:
            continue
        total += see - se * se / sw
        has = fill_visibility(view, t, coefficients)
        least = np.exp(-6.0 / alpha[m])
        for a in range(len(directions)):
            x, y, z = directions[a, 0], directions[a, 1], directions[a, 2]
            if view.normal[t, 0] * x + view.normal[t, 1] * y + view.normal[t, 2] * z <= 0:
                continue
            sp, spe, spp = 0.0, 0.0, 0.0
            for j in range(offsets[i], offsets[i + 1]):
                cos = x * mirror[j, 0] + y * mirror[j, 1] + z * mirror[j, 2]
                if cos > least:
                    p = np.exp(alpha[m] * np.log(min(cos, 1.0)))
                    sp += w[j] * p
                    spe += w[j] * p * residual[j]
                    spp += w[j] * p * p
            if spp > 0:
                seen = rho[m] * visibility(
                    has, coefficients, np.float32(x), np.float32(y), np.float32(z)
                )
                n = seen * (spe - sp * se / sw)
                sums[a, 0] += n
                sums[a, 1] += seen * seen * (spp - sp * sp / sw)
                sums[a, 2] += n * n
    return total


def search(state: FitState, view: View, rho: np.ndarray, alpha: np.ndarray) -> Residue:
    """Ask every direction what a lamp there would explain of the state's residuals.

    rho, alpha : (M,) of the materials, ρ 0 or NaN where one is to be left out
    """
    directions = spread_directions(DIRECTIONS)
    wide = np.minimum(np.nan_to_num(alpha, nan=1.0), WIDE_ENOUGH)
    strength = np.nan_to_num(rho) * wide / np.maximum(np.nan_to_num(alpha, nan=1.0), 1.0)
    samples = state.samples

    def work(first, stop):
        sums = np.zeros((DIRECTIONS, 3))
        total = _correlate(
            first, stop, view, samples.texel, samples.offsets, samples.material, samples.mirror,
            state.weight, state.residual, directions, strength, wide, sums,
        )  # fmt: skip
        return sums, total

    parts = state.chunks(work)
    n, q, square = sum(p[0] for p in parts).T
    total = sum(p[1] for p in parts)
    gain = np.divide(n, q, out=np.zeros_like(n), where=q > 1e-9 * max(float(q.max()), 1e-300))
    z = np.divide(n, np.sqrt(square), out=np.zeros_like(n), where=square > 0)
    return Residue(directions, gain, gain * n / max(total, 1e-300), z)


def brightest(residue: Residue, lights: list[Light]) -> Light | None:
    """The lamp that would explain most, apart from the lights known; None where none is clear."""
    known = np.array([light.direction for light in lights])
    apart = (residue.direction @ known.T).max(1) < np.cos(APART)
    least = FAINTEST * max(light.gain for light in lights)
    usable = apart & (residue.z > CLEAR) & (residue.gain > least) & (residue.share > WORTHWHILE)
    if not usable.any():
        return None
    k = int(np.argmax(np.where(usable, residue.share, -1)))
    return Light(residue.direction[k], np.eye(2) * 0.1**2, gain=float(residue.gain[k]))


def complete_lights(
    observations: Observations,
    material: np.ndarray,
    lights: list[Light],
    turn: np.ndarray,
    footprint: float,
    *,
    samples: int = 750_000,
    curvature: float = 0.8,
    **options,
) -> tuple[list[Light], dict | None, list[str]]:
    """Refine the lights on few samples, and add those that the samples show beside them.

    One at a time: the direction that would explain most of what is left is fitted together with the
    others, and kept if most of the texels that should show it agree.

    Parameters
    ----------
    material, lights, turn, footprint, samples, curvature, options : see `joint.fit`

    Returns
    -------
    lights : refined; as given where no material's gloss is observed
    known : what the materials are about, for `joint.fit`; None where no gloss is observed
    notes : what was added
    """

    def fitted(guess: list[Light]) -> JointFit:
        return fit(
            observations, material, guess, turn, footprint, samples=samples // 2,
            curvature=curvature, **options,
        )  # fmt: skip

    found = fitted(lights) if lights else JointFit([], [], [], [])
    if not found.lights:
        return lights, None, []
    added = 0
    with ThreadPoolExecutor(thread_count()) as pool:
        state = _others(observations, material, found, turn, footprint, samples, curvature, pool)
        while added < MOST:
            rho, alpha, _ = _lobes(found)
            candidate = brightest(search(state, observations.view, rho, alpha), found.lights)
            if candidate is None:
                break
            trial = fitted([*found.lights, candidate])
            if len(trial.lights) <= len(found.lights):
                break
            state = _others(
                observations, material, trial, turn, footprint, samples, curvature, pool
            )
            if not hear(state, len(trial.lights), *_lobes(trial)).share[-1] > AGREED:
                break
            found, added = trial, added + 1
    note = f"{added} lights added that the environment map does not show"
    return found.lights, found.rounds[-1], [note] if added else []


def _lobes(found: JointFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ρ, α and the noise of the materials, (M,) each."""
    rho, alpha, noise = np.array([(m.rho_s, m.alpha, m.noise) for m in found.materials]).T
    return rho, alpha, noise


def _others(
    observations: Observations, material: np.ndarray, found: JointFit, turn: np.ndarray,
    footprint: float, samples: int, curvature: float, pool: ThreadPoolExecutor,
) -> FitState:  # fmt: skip
    """A few texels that the fit has hardly used, with what it leaves unexplained of them."""
    rho, alpha, _ = _lobes(found)
    rho, alpha = np.nan_to_num(rho), np.nan_to_num(alpha, nan=1.0)
    limits = flat_limits(np.maximum(alpha, FIRST_ALPHA), curvature, footprint)
    counts = observations.store.counts()
    chosen, _ = choose_texels(material, counts, turn, limits, samples // 8, offset=1)
    taken = collect(observations, chosen, material[chosen])
    state = FitState(observations, taken, len(rho), pool)
    state.light(found.lights)
    for _ in range(2):
        state.predict(rho, alpha)
        state.reweigh(True)
    return state
