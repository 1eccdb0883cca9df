"""The sheen of a material under light from everywhere: what has no lamp's highlights to fit.

Polished metal in a room mirrors the room. ln y_ij = a_i + s_i ℓ(r_ij), ℓ(r) = Σ_k c_k Y_k(r): a
texel's luminance is its level times the light that comes along the mirror direction, blurred to
35 harmonics. The level is eliminated for each texel. What the mesh lacks (embossing, hammer marks)
shows in the samples, so each texel's normal is searched; and its strength s_i, for dirt has less.
All of it is kept only where it predicts frames that it has not seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..geometry.harmonics import COEFFICIENTS, basis
from ..samples.observations import Observations
from .directions import octahedral_directions
from .sheen_search import (
    Gathered,
    gather,
    gather_block,
    level_color,
    search,
    tilts,
    unexplained,
    weigh,
)
from .threshold import MINIMUM_SAMPLES

SIGMAS = np.radians([24, 12, 6, 0])
"""Priors tried of the mesh normals' error: standard deviation, radians; the most pliable first."""
WORTHWHILE = 0.1
"""Share of the variance of ln y in unseen frames that sheen must take away."""
ROUNDS = 4
CELLS = 128  # of the octahedral table of ℓ along a side
RUNS = 16  # the frames are parted into, every other one of which judges
QUIET = 1e-3  # the least noise of ln y: an eighth of a code
SMOOTH = 1e-3  # weight of the Laplacian of ℓ, against a coefficient's own share in the samples


@dataclass(frozen=True)
class Sheen:
    """What came of it.

    coefficients : (36,) of ℓ in the basis of geometry/harmonics, world directions; the mean of
        s ℓ over the samples is 0, so that levels are what the texels show on average
    strength : (T,) float32, s; NaN where there is no sheen; normal : (T, 3) float32, unit
    level : (T, 3) float32, linear RGB 0..100, the colour without the sheen; NaN as strength is
    gains : (M,) share of the variance of ln y that sheen takes from unseen frames; NaN if not tried
    sigma : the prior chosen for the normals, radians
    """

    coefficients: np.ndarray
    strength: np.ndarray
    normal: np.ndarray
    level: np.ndarray
    gains: np.ndarray
    sigma: float


def harmonic_table(coefficients: np.ndarray) -> np.ndarray:
    """ℓ of the cells' directions in an octahedral map, (128, 128) float32."""
    rays = octahedral_directions(CELLS).reshape(-1, 3)
    return (basis(rays) @ coefficients).reshape(CELLS, CELLS).astype(np.float32)


def fit_harmonics(
    samples: Gathered, weight: np.ndarray, normal: np.ndarray, strength: np.ndarray
) -> np.ndarray:
    """ℓ of least squares, (36,), each texel's level eliminated; mean s ℓ of the samples 0."""
    counts = np.diff(samples.offsets)
    texel = np.repeat(np.arange(len(counts)), counts)
    n, v = normal[texel], samples.ray
    mirror = 2 * np.einsum("nd,nd->n", n, v)[:, None] * n - v
    columns = basis(mirror)[:, 1:] * strength[texel, None]
    weighted = columns * weight[:, None]
    # Eliminate the levels from the normal equations
    starts = samples.offsets[:-1]
    w, wy = (np.add.reduceat(x, starts, dtype=float) for x in (weight, weight * samples.y))
    w = np.maximum(w, 1e-12)
    sums = np.add.reduceat(weighted, starts)
    power = weighted.T @ columns - (sums / w[:, None]).T @ sums
    product = weighted.T @ samples.y - (sums / w[:, None]).T @ wy
    degree = np.floor(np.sqrt(np.arange(1, COEFFICIENTS)))
    penalty = SMOOTH * np.trace(power) / len(power) * degree * (degree + 1) / 2
    found = np.linalg.solve(power + np.diag(penalty), product)
    shift = -(sums.sum(0) @ found) / max(strength @ w, 1e-6)
    return np.concatenate([[shift * np.sqrt(4 * np.pi)], found])


def _learn(
    samples: Gathered, weight: np.ndarray, own: np.ndarray, noise: float, sigma: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients, normals and strengths that explain some texels, in turns."""
    candidates = tilts(sigma)
    normal, strength = own.copy(), np.ones(len(own), np.float32)
    coefficients = fit_harmonics(samples, weight, normal, strength)
    for _ in range(ROUNDS):
        table = harmonic_table(coefficients)
        search(samples, weight, own, table, candidates, sigma, noise, normal, strength)
        strength /= max(float(np.median(strength)), 1e-3)
        coefficients = fit_harmonics(samples, weight, normal, strength)
    return coefficients, normal, strength


def _parted(observations: Observations) -> np.ndarray:
    """Every other run of frames, (F,) bool: neighbours in time share their errors."""
    order = np.lexsort((observations.order, observations.sequence))
    run = np.empty(len(order), np.int64)
    run[order] = np.arange(len(order)) * RUNS // max(len(order), 1)
    return run % 2 == 0


def find_sheen(
    observations: Observations,
    material: np.ndarray,
    tried: np.ndarray,
    *,
    trial_texels: int = 4_000,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Sheen | None:
    """The sheen of the materials that are `tried`, where it predicts frames that it has not seen.

    Parameters
    ----------
    material : (T,) int32, -1 for none; tried : (M,) bool
    trial_texels : about how many texels to learn ℓ from, and to judge by

    Returns
    -------
    None where it does so for no material
    """
    counts = observations.store.counts()
    wanted = (material >= 0) & (counts >= 2 * MINIMUM_SAMPLES)
    wanted[wanted] = tried[material[wanted]]
    some = np.flatnonzero(wanted)[:: max(1, int(wanted.sum()) // trial_texels)]
    if len(some) < 100:
        return None
    samples, own = gather(observations, some), observations.view.normal[some]
    everything = np.ones(len(observations.sequence), bool)
    weight, test = (np.empty(len(samples.y), np.float32) for _ in range(2))
    noise = _spread(samples)

    # Learn from every other run of frames, and see what that explains in the others
    half = _parted(observations)
    weigh(samples, half, noise, weight)
    weigh(samples, ~half, noise, test)
    best, sigma, gains = 0.0, 0.0, np.full(len(tried), np.nan)
    for trial in SIGMAS:
        coefficients, normal, strength = _learn(samples, weight, own, noise, trial)
        model = (normal, strength, harmonic_table(coefficients))
        if trial == SIGMAS[0] and _explained(samples, weight, weight, *model)[0] < WORTHWHILE:
            return None
        gain, before, after = _explained(samples, weight, test, *model)
        if gain > best:
            best, sigma = gain, float(trial)
            top, bottom = (np.bincount(material[some], v, len(tried)) for v in (after, before))
            gains = 1 - np.divide(top, bottom, out=np.full(len(tried), np.nan), where=bottom > 0)
    kept = gains >= WORTHWHILE
    if not kept.any():
        return None

    # Learn from all frames, and search the normals of all texels
    own_kept = kept[material[some]]
    samples = gather(observations, some[own_kept])
    weight = np.empty(len(samples.y), np.float32)
    weigh(samples, everything, noise, weight)
    coefficients, _, _ = _learn(samples, weight, own[own_kept], noise, sigma)
    table, candidates = harmonic_table(coefficients), tilts(sigma)
    out_normal = observations.view.normal.copy()
    out_strength = np.full(len(counts), np.nan, np.float32)
    level = np.full((len(counts), 3), np.nan, np.float32)

    def work(block):
        here = np.arange(block.first, block.stop)
        here = here[(material[here] >= 0) & (counts[here] > 0)]
        here = here[kept[material[here]]]
        own_samples = gather_block(block, observations, here)
        w = np.empty(len(own_samples.y), np.float32)
        weigh(own_samples, everything, noise, w)
        normal, strength = np.empty((len(here), 3), np.float32), np.empty(len(here), np.float32)
        colors = np.empty((len(here), 3))
        search(
            own_samples, w, observations.view.normal[here], table, candidates, sigma, noise,
            normal, strength,
        )  # fmt: skip
        level_color(own_samples, w, normal, strength, table, colors)
        out_normal[here], out_strength[here], level[here] = normal, strength, colors

    observations.store.map(work, progress)
    return Sheen(coefficients, out_strength, out_normal, level, gains, sigma)


def _explained(
    samples: Gathered, weight: np.ndarray, test: np.ndarray,
    normal: np.ndarray, strength: np.ndarray, table: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray]:  # fmt: skip
    """Share of the squared error of constants that the model takes away; both errors per texel."""
    before, after = (np.empty(len(samples.offsets) - 1) for _ in range(2))
    unexplained(samples, weight, test, normal, strength, table, before, after)
    plain = float(before.sum())
    return (1 - float(after.sum()) / plain if plain > 0 else 0.0), before, after


def _spread(samples: Gathered) -> float:
    """Robust standard deviation of ln luminance about the texels' medians."""
    away = [
        np.abs(samples.y[a:b] - np.median(samples.y[a:b]))
        for a, b in zip(samples.offsets[:-1], samples.offsets[1:], strict=True)
        if b > a
    ]
    return max(float(1.4826 * np.median(np.concatenate(away))), QUIET)
