"""The steps by which reflectance models are fitted to the same samples, and compared."""

from __future__ import annotations

import numpy as np

from .evidence import Evidence, weigh_evidence
from .fit_state import FitState, huber_scale
from .gloss_fit import center, eliminate_gloss, highlights, predict
from .lights import Light
from .microfacet import BECKMANN, GGX, PHONG, Gloss

SHAPES = {
    PHONG: np.geomspace(1, 2048, 12),
    GGX: np.geomspace(0.015, 0.8, 11),
    BECKMANN: np.geomspace(0.015, 0.8, 11),
}
"""Tried at first; then the best is interpolated."""


def first_half(offsets: np.ndarray) -> np.ndarray:
    """(N,) bool: the first half of each texel's samples, which are in the film's order."""
    counts = np.diff(offsets)
    place = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
    return 2 * place < np.repeat(counts, counts)


def noise_of(state: FitState) -> np.ndarray:
    """(M,) robust standard deviation of the state's residuals."""
    return huber_scale(state.samples, state.residual, state.weight, state.materials) / 1.68 * 1.48


def fit_kind(
    state: FitState, kind: int, seen: np.ndarray, censoring: bool
) -> tuple[Gloss, np.ndarray]:
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
        state.reweigh(censoring)
        state.weight[~seen] = 0
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
    facing, grazing, rest = eliminate_gloss(state, kind, shape).T.copy()
    return Gloss(kind, facing, grazing, shape), rest


def refit(state: FitState, lights: list[Light], gloss: Gloss, censoring: bool) -> Gloss:
    """The same kinds under other lights; leaves the state's weights and residuals by them."""
    state.light(lights)
    predict(state, gloss)
    state.reweigh(censoring)
    gloss, _ = _interpolate(state, gloss.kind, gloss.shape, 0.1)
    predict(state, gloss)
    state.reweigh(censoring)
    return gloss


def unexplained(test: FitState, lights: list[Light], gloss: Gloss) -> np.ndarray:
    """What the highlights of some lights leave of samples that no fit has seen, (M,); 0 of
    materials that are not described."""
    test.light(lights)
    s = test.samples
    weight = np.where(s.clipped, 0, s.quality)
    error = center(s.luminance - highlights(test, gloss, test.rays, test.gains), weight, s.offsets)
    owner = np.repeat(s.material, np.diff(s.offsets))
    rest = np.bincount(owner, weight * error**2, test.materials)
    return np.where(gloss.kind >= 0, rest, 0.0)


def compare(
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
