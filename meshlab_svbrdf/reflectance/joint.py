"""The joint estimator: materials, lights and diffuse colour from the same samples.

y_ij = D_i + ρ_m φ_ij(α_m), φ_ij = Σ_k g_k V_ik (l_ik·r_ij)₊^α. Rounds of: eliminate D exactly for
ρs and α, weigh the samples by their residuals, let clipped samples count as lower bounds, and take
one Gauss-Newton step on the lights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ..blocks import resting
from ..samples.observations import Observations
from ..threads import thread_count
from .blur_fit import fit_blur
from .elimination import ALPHAS, Profile
from .evidence import Evidence, highlight_color, verdict
from .fit_samples import choose_texels, collect, flat_limits
from .fit_state import FitState, huber_scale
from .light_refinement import refine_lights
from .lights import Light
from .long_lamps import fit_lengths
from .phong import lamps

FIRST_ALPHA = 100.0
"""Shininess that texels are flat enough for at least; the first rounds know no better."""
FARTHEST = 0.01
"""κ below which a light is far: it stands a hundred radii away."""
WEAKEST = 0.05
"""Of the strongest gain, below which a light is none."""
RENEWED = 2
"""The round before which all texels are chosen, since it is known how flat they must be; the rounds
before make do with a quarter, and are left out where the materials are known about."""
SETTLE = 1
"""Rounds later it is decided which lights there are, and which of them are far."""
STILL = 1e-3
"""Change of ln ρs and ln α below which the rounds end."""
SURE = 0.1
"""Of the error of ρs, the change that does not keep them going either."""


@dataclass(frozen=True)
class Material:
    """One material's reflectance; luminance units, 0..100.

    rho_s, alpha : as seen under lights of gain 1 (a lamp's size widens the lobe); NaN if unobserved
    observed : whether the samples determine them; reason : if not, why
    z, width, explained : the evidence: ρ over its error, the interval of ln α, explained variance
    color : (3,) of the highlight, luminance 1; (1, 1, 1) is white
    noise : robust standard deviation of the residuals, 0..100
    """

    rho_s: float
    alpha: float
    observed: bool
    reason: str = ""
    z: float = 0.0
    width: float = np.inf
    explained: float = 0.0
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    texels: int = 0
    noise: float = np.nan


@dataclass(frozen=True)
class JointFit:
    """Lights and materials, and what the rounds did."""

    lights: list[Light]
    materials: list[Material]
    rounds: list[dict]
    notes: list[str]


def fit(
    observations: Observations,
    material: np.ndarray,
    lights: list[Light],
    turn: np.ndarray,
    footprint: float,
    *,
    rounds: int = 10,
    samples: int = 750_000,
    near: bool = True,
    long: bool = True,
    censoring: bool = True,
    curvature: float = 0.8,
    lens: bool = False,
    known: dict | None = None,
    ids: np.ndarray | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> JointFit:
    """Fit lights and materials.

    Parameters
    ----------
    material : (T,) int32, -1 for none
    lights : first guesses, from the environment map
    turn : (T,) how fast the normal turns, radians per radius
    footprint : a pixel's size on the object, in radii
    rounds : at most, of elimination, weights and Gauss-Newton; κ is free from the second on. They
        end when no ρs or α moves by more than .1 %, or a tenth of its error
    near, long, censoring : near lights; long lamps; clipped samples as lower bounds
    curvature : c of "twice the normal's turn per pixel < c/√α"; 0 takes every texel
    lens : find how far lens, motion and registration blur highlights beyond what pixels do
    known : about what the materials are: the last of the rounds of the fit that found the lights
    ids : (M,) what the materials are called in notes
    """
    count = int(material.max(initial=-1)) + 1
    notes: list[str] = []
    history: list[dict] = []
    if not lights or count == 0:
        why = "no light was found" if not lights else "there is no material"
        return JointFit([], [Material(np.nan, np.nan, False, why)] * count, [], [why])
    counts = observations.store.counts()
    rho, alpha, blur = np.zeros(count), np.full(count, FIRST_ALPHA), 1.0
    renew = RENEWED
    if known is not None:
        rho, alpha, renew = np.array(known["rho_s"]), np.array(known["alpha"]), 0
    settle = renew + SETTLE

    def gather(
        pool: ThreadPoolExecutor,
        budget: int,
        without: Sequence[int] | np.ndarray = (),
    ) -> FitState:
        limits = flat_limits(np.maximum(alpha, FIRST_ALPHA), curvature, footprint)
        left = counts
        if len(without):
            left = resting(counts.copy())
            left[np.asarray(without, np.int64)] = 0
        chosen, lacking = choose_texels(material, left, turn, limits, budget)
        named = [int(ids[m]) for m in lacking] if ids is not None else lacking
        note = f"materials {named} are curved nearly everywhere: their gloss is less certain"
        if lacking and not len(without) and note not in notes:
            notes.append(note)
        taken = collect(observations, chosen, material[chosen]).blurred(blur)
        return FitState(observations, taken, count, pool)

    def renewed(pool: ThreadPoolExecutor) -> FitState:
        state = gather(pool, samples)
        state.light(lights)
        state.predict(rho, alpha)
        state.reweigh(censoring)
        return state

    most, samples = samples, affordable(samples, lights)
    with ThreadPoolExecutor(thread_count()) as pool:
        state = gather(pool, samples // 4) if renew else renewed(pool)
        free, error = np.full(len(lights), near), np.zeros(len(lights))
        for r in range(rounds):
            state.light(lights)
            if 0 < r == renew:
                state = renewed(pool)
            # Find ρs and α of every material under the present lights
            profiles = state.profiles(None if renew and r in (0, renew) else alpha)
            rho = np.array([p.rho_s for p in profiles])
            alpha = np.array([p.alpha for p in profiles])
            # Weigh the samples by their residuals, then move the lights
            state.predict(rho, alpha)
            state.reweigh(use_clipped=censoring and (r > 0 or not renew))
            history.append({"rho_s": rho.tolist(), "alpha": alpha.tolist()})
            if r > settle and _converged(history[-2], history[-1], state.evidence()):
                break
            if r < rounds - 1:
                usable = np.where([p.at_end for p in profiles], 0.0, rho)
                loose = free & (r > 0 or not renew)
                lights, error = refine_lights(
                    lights, state.samples, state.weight, state.residual, state.position, state.rays,
                    state.gains, state.lamps, usable, alpha, state.chunks, near=loose,
                )  # fmt: skip
            if r == min(settle, rounds - 1):
                lights, free = _settle(lights, free, error, notes)
                if long:
                    few = gather(pool, samples // 4)
                    lights = fit_lengths(lights, _trial(few, lights, rho, alpha))
                    before, samples = samples, affordable(most, lights)
                    if samples != before:
                        state = renewed(pool)
                if lens and observations.shape is not None:
                    few = gather(pool, samples // 2)
                    blur = fit_blur(_blurred(few, lights, rho, alpha))
                    state.samples = state.samples.blurred(blur)
                    if blur > 1:
                        notes.append(f"frames are blurred, {blur:.1f} times what pixels do")
            progress(r + 1, rounds)
        # Take the whole profiles, which tell how certain α is
        profiles = state.profiles()
        rho = np.array([p.rho_s for p in profiles])
        alpha = np.array([p.alpha for p in profiles])
        state.predict(rho, alpha)
        # Judge by texels that the fit has not used whether it explains anything
        test = gather(pool, samples, without=state.samples.texel)
        test.light(lights)
        test.predict(rho, alpha)
        noise = huber_scale(state.samples, state.residual, state.weight, count) / 1.68 * 1.48
        evidence = test.evidence(noise)
    materials = [
        _judge(p, e, s, int((material == m).sum()))
        for m, (p, e, s) in enumerate(zip(profiles, evidence, noise, strict=True))
    ]
    if not any(m.observed for m in materials):
        notes.append("no gloss is observed, so nothing shows where the lights are")
        lights = []
    return JointFit(lights, materials, history, notes)


def affordable(samples: int, lights: list[Light]) -> int:
    """How many samples to take: no more is spent on rows of points than on single ones."""
    points = len(lamps(lights, 1.0).gain)
    return max(samples * len(lights) // points, samples // 8)


def _trial(
    few: FitState, lights: list[Light], rho: np.ndarray, alpha: np.ndarray
) -> Callable[[list[Light]], float]:
    """What is left unexplained under other lights, with the weights of these."""
    few.light(lights)
    few.predict(rho, alpha)
    few.reweigh(True)

    def unexplained(lights: list[Light]) -> float:
        few.light(lights)
        return float(sum(p.rss.min() for p in few.profiles()))

    return unexplained


def _blurred(
    few: FitState, lights: list[Light], rho: np.ndarray, alpha: np.ndarray
) -> Callable[[float], float]:
    """What is left unexplained under more blur, with the weights of this."""
    few.light(lights)
    few.predict(rho, alpha)
    few.reweigh(True)
    samples = few.samples

    def unexplained(times: float) -> float:
        few.samples = samples.blurred(times)
        return float(sum(p.rss.min() for p in few.profiles(alpha)))

    return unexplained


def _converged(before: dict, after: dict, evidence: list[Evidence]) -> bool:
    """Whether no material's ρs or α has moved (materials without a lobe stay at 0)."""
    old, new = (np.array([h["rho_s"], h["alpha"]]) for h in (before, after))
    little = [max(STILL, SURE / max(e.z, SURE)) for e in evidence]
    return bool(np.all(np.abs(new - old) <= little * np.abs(old)))


def _settle(
    lights: list[Light], free: np.ndarray, error: np.ndarray, notes: list[str]
) -> tuple[list[Light], np.ndarray]:
    """Drop lights that turned out to be none; let those be far whose distance does not show."""
    strongest = max(light.gain for light in lights)
    kept = [k for k, light in enumerate(lights) if light.gain >= WEAKEST * strongest]
    if len(kept) < len(lights):
        notes.append(f"{len(lights) - len(kept)} lights dropped: no highlight is theirs")
    near = np.array([lights[k].curvature >= max(FARTHEST, 2 * error[k]) for k in kept])
    mean = np.exp(np.mean([np.log(lights[k].gain) for k in kept]))
    settled = [
        replace(lights[k], gain=lights[k].gain / mean, curvature=lights[k].curvature * n)
        for k, n in zip(kept, near, strict=True)
    ]
    return settled, free[kept] & near


def _judge(fitted: Profile, evidence: Evidence, noise: float, texels: int) -> Material:
    """One material's result, with the reason where it is unobserved."""
    inside = np.flatnonzero(fitted.rss <= fitted.rss.min() + 4 * noise**2)
    width = float(np.log(ALPHAS[inside[-1]] / ALPHAS[inside[0]]))
    reason = verdict(fitted.rho_s, fitted.at_end, evidence, width)
    observed = not reason
    return Material(
        fitted.rho_s if observed else np.nan, fitted.alpha if observed else np.nan,
        observed, reason,
        float(evidence.z), width, float(evidence.explained),
        highlight_color(evidence) if observed else (1.0, 1.0, 1.0), texels, float(noise),
    )  # fmt: skip
