"""Whether the light stayed as it was: texels seen early and late must look alike.

Lamps that change make the sides of the object that face them brighter or darker. Gloss, seen from
elsewhere, changes texels too, all those of one side alike where the later cameras stand higher; but
it changes them from frame to frame as well. So a texel counts the more, the more alike its samples
of each half are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .gains import Groups, some_logs
from .observations import Observations

LEAST_SAMPLES = 4  # of a texel, on each side of a split
LEAST_TEXELS = 100
ROUNDS = 5
SCALE = 2.0
"""Robust standard deviations of a residual at which its weight is a half."""
SURE = 0.02
"""Of ln brightness: no texel's change is held to be surer, for 8 bits tell no more."""


class Steadiness(NamedTuple):
    """Of ln brightness of texels on one side of a split over the other

    sides : from the first to the second half of the frames, how much one side of the object gained
        on the other: range, from 10 to 90 % of the texels, of what is linear in their normals
    turns : from every other frame to those between, which the same light has lit: robust standard
        deviation, what noise and gloss do to a texel
    """

    sides: float
    turns: float


def light_steadiness(observations: Observations, gain: np.ndarray) -> Steadiness | None:
    """How the object's sides change from the first half of the frames to the second.

    A frame's own brightness, `gain` (F,), is divided out first: only light from elsewhere remains.
    None where too few texels are seen in both halves.
    """
    logs, texel, frame = some_logs(observations)
    value = logs[:, 1] - np.log(gain)[frame]
    halves = _changes(value, texel, frame * 2 >= len(gain))
    turns = _changes(value, texel, frame % 2 == 1)
    if halves is None or turns is None:
        return None
    seen, change, unsure = halves
    sides = np.quantile(_along(observations.view.normal[seen], change, unsure), [0.1, 0.9])
    return Steadiness(float(np.ptp(sides)), _deviation(turns[1]))


def _changes(
    value: np.ndarray, texel: np.ndarray, late: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Texels with enough samples on both sides, how their median changes across, and how far the
    samples of each side differ."""
    there, own = np.unique(texel, return_inverse=True)
    count, group = 2 * len(there), 2 * own + late
    samples = np.bincount(group, minlength=count).reshape(-1, 2).min(1)
    seen = np.flatnonzero(samples >= LEAST_SAMPLES)
    if len(seen) < LEAST_TEXELS:
        return None
    groups = Groups(group, count)
    median = groups.median(value)
    spread = 1.4826 * groups.median(np.abs(value - median[group])).reshape(-1, 2)[seen]
    early, later = median.reshape(-1, 2)[seen].T
    return there[seen], later - early, np.hypot(*spread.T)


def _along(normal: np.ndarray, change: np.ndarray, unsure: np.ndarray) -> np.ndarray:
    """The part of `change` (N,), each known up to `unsure` (N,), that is linear in `normal` (N, 3),
    by reweighted least squares."""
    deviation = np.hypot(unsure, SURE)
    basis = np.column_stack([np.ones(len(normal)), normal])
    root = 1 / deviation
    for _ in range(ROUNDS):
        found = basis @ np.linalg.lstsq(basis * root[:, None], change * root, rcond=None)[0]
        left = (change - found) / deviation
        scale = SCALE * _deviation(left)
        root = 1 / (deviation * np.hypot(1, left / max(scale, 1e-9)))
    return found


def _deviation(values: np.ndarray) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values))))
