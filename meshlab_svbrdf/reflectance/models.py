"""Which reflectance describes a material best: Phong's lobe, or microfacets where they win.

All are fitted alike, to the same samples. Microfacets win where they predict samples clearly better
that the fit has not seen: of other texels, and of the other half of the film. Then the lights move
once more, for a lobe of the wrong shape pulls them away.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ..samples.observations import Observations
from ..threads import thread_count
from .evidence import EXPLAINED_LEAST, Z_LEAST, Evidence, highlight_color
from .fit_samples import choose_texels, collect, flat_limits
from .fit_state import FitState
from .gloss_fit import move_lights
from .joint import FIRST_ALPHA, Material, affordable
from .lights import Light
from .microfacet import BECKMANN, GGX, NAMES, PHONG, Gloss, Microfacets
from .model_fit import SHAPES, compare, first_half, fit_kind, noise_of, refit, unexplained

TRIAL, FINAL = 16, 4
"""One sample in so many of the joint fit's decides, and one in so many is fitted in the end."""
WORTHWHILE = 1.0
"""dB by which microfacets must predict unseen samples better than Phong's lobe."""
ROUGHEST = 0.75
"""Of the roughest tried, from which on it is no highlight but shading."""
ROUNDS = 8
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
    samples: int = 750_000,
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
    alpha = np.array([m.alpha if m.observed else FIRST_ALPHA for m in materials])
    limits = flat_limits(alpha, curvature, footprint)
    most = affordable(samples, lights)

    with ThreadPoolExecutor(thread_count()) as pool:

        def gather(one_in: int) -> tuple[FitState, FitState]:
            """Samples to fit, and samples of other texels to judge by."""
            first, other = (
                choose_texels(material, counts, turn, limits, most // one_in, offset)[0]
                for offset in (0, 1)
            )
            states = [
                FitState(observations, collect(observations, texels, material[texels]), count, pool)
                for texels in (first, np.setdiff1d(other, first))
            ]
            for state in states:
                state.light(lights)
            return states[0], states[1]

        fitted, test = gather(TRIAL)
        if not len(fitted.samples) or not len(test.samples):
            return kept
        known = np.array([m.observed for m in materials])
        names = list(range(count) if ids is None else ids)
        final = None
        best, least = kept, np.inf
        for start_lights in _starts(lights):
            for state in (fitted, test):
                state.light(start_lights)
            phong, better, wins = _try_all(fitted, test, censoring)
            # Ask again whether they win, now by all of the film and under the lights as they move
            while wins.any():
                final = final or gather(FINAL)
                start = _where(wins, better, _where(known, phong, _none(count)))
                found, sure, rest = _conclude(*final, kept, phong, start, censoring, names)
                if sure[wins].all():
                    best, least = (found, rest) if rest < least else (best, least)
                    break
                wins &= sure
    return best


def _starts(lights: list[Light]) -> list[list[Light]]:
    """The lights, and the same as compact ones where any is long or wide: a lobe of the wrong shape
    may have made them so."""
    if not any(light.bar.any() for light in lights):
        return [lights]
    return [lights, [replace(light, bar=np.zeros(3), breadth=0.0) for light in lights]]


def _try_all(fitted: FitState, test: FitState, censoring: bool) -> tuple[Gloss, Gloss, np.ndarray]:
    """Phong's lobes, the better kind of microfacets, and where these win, (M,) bool.

    Each is fitted to one half of the film, and judged by the other half of other texels.
    """
    seen, unseen = first_half(fitted.samples.offsets), ~first_half(test.samples.offsets)
    tried = {kind: fit_kind(fitted, kind, seen, censoring) for kind in SHAPES}
    phong = tried[PHONG][0]
    better = _where(tried[GGX][1] < tried[BECKMANN][1], tried[GGX][0], tried[BECKMANN][0])
    gain, evidence = compare(test, phong, better, noise_of(fitted), unseen)
    smooth, *_, rough = SHAPES[GGX]
    inside = (better.shape > 1.01 * smooth) & (better.shape < ROUGHEST * rough)
    return phong, better, inside & _wins(gain, evidence)


def _conclude(
    fitted: FitState, test: FitState, kept: Models, phong: Gloss, start: Gloss, censoring: bool,
    ids: Iterable[int],
) -> tuple[Models, np.ndarray, float]:  # fmt: skip
    """Fit all of the film, let the lights move, and say what came of it.

    The lights that leave least unexplained of the test's samples are taken. Also returned: where
    the models chosen win in the end, (M,) bool: over Phong's lobe under these lights, and over
    Phong's lobe under the lights that it had; and what they leave of the test's samples.

    phong : every material as Phong's lobe; start : the models chosen
    """
    # What Phong's lobes leave under the lights that suit them
    for _round in range(2):
        phong = refit(fitted, kept.lights, phong, censoring)
    before = unexplained(test, kept.lights, _where(start.kind >= 0, phong, start))
    found = [(kept.lights, refit(fitted, kept.lights, start, censoring))]
    for lights in _starts(kept.lights):
        gloss = refit(fitted, lights, start, censoring)
        for _round in range(ROUNDS):
            lights, change = move_lights(fitted, lights, gloss)
            gloss = refit(fitted, lights, gloss, censoring)
            if change < STILL:
                break
        found.append((lights, gloss))
    lights, gloss = min(found, key=lambda each: unexplained(test, *each).sum())
    gloss = refit(fitted, lights, gloss, censoring)
    noise = noise_of(fitted)
    for _round in range(2):
        phong = refit(fitted, lights, phong, censoring)
    after = unexplained(test, lights, gloss)
    test.light(lights)
    gain, evidence = compare(test, phong, gloss, noise, np.ones(len(test.samples), bool))
    chosen = [
        Microfacets(
            int(gloss.kind[m]), float(gloss.facing[m]), float(gloss.grazing[m]),
            float(gloss.shape[m]), highlight_color(evidence[m]), float(gain[m]), float(noise[m]),
        ) if start.kind[m] in (GGX, BECKMANN) else None
        for m in range(len(kept.materials))
    ]  # fmt: skip
    renewed = [
        replace(m, rho_s=float(phong.facing[k]), alpha=float(phong.shape[k])) if m.observed else m
        for k, m in enumerate(kept.materials)
    ]
    notes = [
        f"material {name}: {NAMES[f.kind]} predicts {f.gain_db:.1f} dB better"
        for name, f in zip(ids, chosen, strict=True)
        if f is not None
    ]
    better = (after < before) & (after.sum() < before.sum())
    sure = better & _wins(gain, evidence)
    return Models(chosen, renewed, lights, notes), sure, float(after.sum())


def _none(count: int) -> Gloss:
    return Gloss(np.full(count, -1), np.zeros(count), np.zeros(count), np.ones(count))


def _where(condition: np.ndarray, one: Gloss, other: Gloss) -> Gloss:
    return Gloss(*(np.where(condition, a, b) for a, b in zip(one, other, strict=True)))


def _wins(gain: np.ndarray, evidence: list[Evidence]) -> np.ndarray:
    """Where it is worthwhile and the highlights are there at all, (M,) bool."""
    there = [e.z > Z_LEAST and e.explained > EXPLAINED_LEAST for e in evidence]
    return (gain >= WORTHWHILE) & np.array(there)


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
