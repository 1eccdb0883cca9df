"""Which reflectance describes a material best: Phong's lobe, or microfacets where they win.

All are fitted alike, to the same samples. Microfacets win where they predict samples clearly better
that the fit has not seen: of other texels, and of the other half of the film. Then the lights move
once more, for a lobe of the wrong shape pulls them away.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ..samples.observations import Observations
from ..threads import thread_count
from .evidence import EXPLAINED_LEAST, Z_LEAST, Evidence, highlight_color, weigh_evidence
from .fit_samples import choose_texels, collect
from .fit_state import FitState, huber_scale
from .gloss_fit import center, eliminate_gloss, highlights, move_lights, predict
from .joint import FIRST_ALPHA, Material
from .lights import Light
from .microfacet import BECKMANN, GGX, NAMES, PHONG, Gloss, Microfacets
from .phong import lamps

SHAPES = {
    PHONG: np.geomspace(1, 2048, 12),
    GGX: np.geomspace(0.015, 0.8, 11),
    BECKMANN: np.geomspace(0.015, 0.8, 11),
}
"""Tried at first; then the best is interpolated."""
WORTHWHILE = 1.0
"""dB by which microfacets must predict unseen samples better than Phong's lobe."""
ROUNDS = 5
"""Of elimination and a step of the lights, at most, once it is known which model describes what."""
STILL = 1e-3
"""Change of a light's angles (radians), ln gain and κ below which the rounds end."""


@dataclass(frozen=True)
class Models:
    """microfacets : one per material, None where Phong's lobe stays
    materials, lights : Phong's numbers and the lights, as they are under the models chosen
    notes : what is to be said
    """

    microfacets: list[Microfacets | None]
    materials: list[Material]
    lights: list[Light]
    notes: list[str]


def choose_models(
    observations: Observations,
    material: np.ndarray,
    materials: list[Material],
    lights: list[Light],
    turn: np.ndarray,
    footprint: float,
    *,
    samples: int = 6_000_000,
    curvature: float = 0.8,
    censoring: bool = True,
    ids: np.ndarray | None = None,
    **_: object,
) -> Models:
    """Fit microfacets to every material, and keep them where they win.

    Parameters
    ----------
    material : (T,) int32, -1 for none; materials, lights : what the joint fit with Phong found
    turn, footprint, samples, curvature, censoring, ids : see `joint.fit`
    """
    count = len(materials)
    kept = Models([None] * count, materials, lights, [])
    if not lights or count == 0:
        return kept
    counts = observations.store.counts()
    shiny = np.sqrt([m.alpha if m.observed else FIRST_ALPHA for m in materials])
    limits = curvature / shiny / (2 * footprint) if curvature > 0 else shiny + np.inf
    # Spend no more on rows of points than on single ones
    budget = max(samples * len(lights) // (16 * len(lamps(lights, 1.0).gain)), samples // 64)

    with ThreadPoolExecutor(thread_count()) as pool:

        def gather(offset: int, without: np.ndarray) -> FitState:
            texels, _ = choose_texels(material, counts, turn, limits, budget, offset)
            texels = np.setdiff1d(texels, without)
            taken = collect(observations, texels, material[texels])
            state = FitState(observations, taken, count, pool)
            state.light(lights)
            return state

        fitted = gather(0, np.zeros(0, np.int64))
        test = gather(1, fitted.samples.texel)
        if not len(fitted.samples) or not len(test.samples):
            return kept
        # Fit each to one half of the film, judge it by the other half of other texels
        seen, unseen = first_half(fitted.samples.offsets), ~first_half(test.samples.offsets)
        tried = {kind: _fit(fitted, kind, seen, censoring) for kind in SHAPES}
        phong, noise = tried[PHONG][0], huber_noise(fitted)
        better = _where(tried[GGX][1] < tried[BECKMANN][1], tried[GGX][0], tried[BECKMANN][0])
        gain, evidence = _compare(test, phong, better, noise, unseen)
        wins = (gain >= WORTHWHILE) & np.array([_holds(e) for e in evidence])
        if not wins.any():
            return kept

        # Fit all of the film, and move the lights
        observed = np.array([m.observed for m in materials])
        start = _where(wins, better, _where(observed, phong, _none(count)))
        everything = np.ones(len(fitted.samples), bool)
        stay = _refit(fitted, lights, start, everything, censoring)
        new, gloss = lights, stay
        for _round in range(ROUNDS):
            new, change = move_lights(fitted, new, gloss)
            gloss = _refit(fitted, new, gloss, everything, censoring)
            if change < STILL:
                break
        before, after = (_rest(test, at, with_) for at, with_ in ((lights, stay), (new, gloss)))
        if after < before:
            lights = new
        else:
            gloss = _refit(fitted, lights, stay, everything, censoring)
        noise = huber_noise(fitted)

        # Say what came of it, and Phong's numbers under the same lights
        every = _where(observed, phong, _none(count))
        for _round in range(2):
            every = _refit(fitted, lights, every, everything, censoring)
        test.light(lights)
        gain, evidence = _compare(
            test, _where(observed, every, phong), gloss, noise, np.ones(len(test.samples), bool)
        )
    found = [
        Microfacets(
            int(gloss.kind[m]), float(gloss.facing[m]), float(gloss.grazing[m]),
            float(gloss.shape[m]), highlight_color(evidence[m]), float(gain[m]), float(noise[m]),
        ) if wins[m] else None
        for m in range(count)
    ]  # fmt: skip
    renewed = [
        replace(m, rho_s=float(every.facing[k]), alpha=float(every.shape[k])) if m.observed else m
        for k, m in enumerate(materials)
    ]
    names = range(count) if ids is None else ids
    notes = [
        f"material {name}: {NAMES[f.kind]} predicts {f.gain_db:.1f} dB better"
        for name, f in zip(names, found, strict=True)
        if f is not None
    ]
    return Models(found, renewed, lights, notes)


def described(
    materials: list[Material], microfacets: list[Microfacets | None]
) -> tuple[Gloss, np.ndarray]:
    """What kernels read of the models chosen, and the highlights' colours (M, 3)."""
    rows, colors = [], []
    for phong, other in zip(materials, microfacets, strict=True):
        if other is None:
            lobe = (phong.rho_s, phong.alpha) if phong.observed else (0.0, 1.0)
            rows.append((PHONG, lobe[0], 0.0, lobe[1]))
        else:
            rows.append((other.kind, other.facing, other.grazing, other.roughness))
        colors.append(phong.color if other is None else other.color)
    kind, *others = np.array(rows, np.float64).reshape(-1, 4).T.copy()
    return Gloss(kind.astype(np.int64), *others), np.array(colors, np.float64).reshape(-1, 3)


def first_half(offsets: np.ndarray) -> np.ndarray:
    """(N,) bool: the first half of each texel's samples, which are in the film's order."""
    counts = np.diff(offsets)
    place = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
    return 2 * place < np.repeat(counts, counts)


def huber_noise(state: FitState) -> np.ndarray:
    """(M,) robust standard deviation of the state's residuals."""
    return huber_scale(state.samples, state.residual, state.weight, state.materials) / 1.68 * 1.48


def _none(count: int) -> Gloss:
    return Gloss(np.full(count, -1), np.zeros(count), np.zeros(count), np.ones(count))


def _where(condition: np.ndarray, one: Gloss, other: Gloss) -> Gloss:
    return Gloss(*(np.where(condition, a, b) for a, b in zip(one, other, strict=True)))


def _fit(state: FitState, kind: int, seen: np.ndarray, censoring: bool) -> tuple[Gloss, np.ndarray]:
    """All materials as one kind, from nothing; and what it leaves of the samples seen, (M,)."""
    s = state.samples
    state.weight = np.where(s.clipped | ~seen, 0, s.quality).astype(np.float32)
    kinds = np.full(state.materials, kind)
    grid = SHAPES[kind]
    rests = [eliminate_gloss(state, kinds, np.full(state.materials, x))[:, 2] for x in grid]
    shape = grid[np.argmin(rests, axis=0)]
    step = float(np.log(grid[1] / grid[0])) / 2
    for _ in range(2):
        gloss, rest = _interpolate(state, kinds, shape, step)
        predict(state, gloss)
        _weigh(state, seen, censoring)
        shape, step = gloss.shape, step / 3
    return gloss, rest


def _interpolate(
    state: FitState, kind: np.ndarray, shape: np.ndarray, step: float
) -> tuple[Gloss, np.ndarray]:
    """The shapes at the least residual near some, by a parabola in ln shape; and that residual."""
    left, middle, right = (
        eliminate_gloss(state, kind, shape * np.exp(x))[:, 2] for x in (-step, 0.0, step)
    )
    bend = left - 2 * middle + right
    shift = np.divide(left - right, 2 * bend, out=np.sign(left - right), where=bend > 0)
    shape = shape * np.exp(step * np.clip(shift, -1, 1))
    facing, grazing, rest = eliminate_gloss(state, kind, shape).T
    return Gloss(kind, facing, grazing, shape), rest


def _weigh(state: FitState, seen: np.ndarray, censoring: bool) -> None:
    state.reweigh(censoring)
    state.weight[~seen] = 0


def _refit(
    state: FitState, lights: list[Light], gloss: Gloss, seen: np.ndarray, censoring: bool
) -> Gloss:
    """The same kinds under other lights; leaves the state's weights and residuals by them."""
    state.light(lights)
    predict(state, gloss)
    _weigh(state, seen, censoring)
    gloss, _ = _interpolate(state, gloss.kind, gloss.shape, 0.1)
    predict(state, gloss)
    _weigh(state, seen, censoring)
    return gloss


def _rest(test: FitState, lights: list[Light], gloss: Gloss) -> float:
    """What the highlights of some lights leave of samples that no fit has seen."""
    test.light(lights)
    s = test.samples
    weight = np.where(s.clipped, 0, s.quality)
    error = center(s.luminance - highlights(test, gloss, test.rays, test.gains), weight, s.offsets)
    own = np.repeat(gloss.kind[s.material] >= 0, np.diff(s.offsets))
    return float((weight * error**2)[own].sum())


def _compare(
    test: FitState, phong: Gloss, other: Gloss, noise: np.ndarray, unseen: np.ndarray
) -> tuple[np.ndarray, list[Evidence]]:
    """By how many dB the other predicts each material better (M,), where either shows a highlight;
    and what speaks for the other."""
    s = test.samples
    weight = np.where(s.clipped | ~unseen, 0, s.quality).astype(np.float32)
    specular = [highlights(test, gloss, test.rays, test.gains) for gloss in (phong, other)]
    errors = [center(s.luminance - x, weight, s.offsets) for x in specular]
    top = np.maximum.reduceat(np.maximum(*specular) * (weight > 0), s.offsets[:-1])
    shows = np.repeat(top > 3 * noise[s.material], np.diff(s.offsets))
    owner = np.repeat(s.material, np.diff(s.offsets))
    rests = [
        np.bincount(owner[shows], (weight * e**2)[shows], test.materials) + 1e-30 for e in errors
    ]
    evidence = weigh_evidence(
        s, weight, specular[1], errors[1].astype(np.float32), noise, test.chunks
    )
    return 10 * np.log10(rests[0] / rests[1]), evidence


def _holds(evidence: Evidence) -> bool:
    """Whether the highlights are there at all."""
    return evidence.z > Z_LEAST and evidence.explained > EXPLAINED_LEAST
