"""Whether the light stayed as it was: texels seen early and late must look alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .gains import Groups, some_logs
from .observations import Observations

LEAST_SAMPLES = 4  # of a texel, on each side of a split
LEAST_TEXELS = 100


class Steadiness(NamedTuple):
    """Robust standard deviations over texels of ln brightness on one side of a split over the other

    halves : of the first and the second half of the frames
    turns : of every other frame, which the same light has lit: what noise and gloss do
    """

    halves: float
    turns: float


def light_steadiness(observations: Observations, gain: np.ndarray) -> Steadiness | None:
    """How much more texels change from the first half of the frames to the second than by chance.

    A frame's own brightness, `gain` (F,), is divided out first: only light from elsewhere remains.
    None where too few texels are seen in both halves.
    """
    logs, texel, frame = some_logs(observations)
    value = logs[:, 1] - np.log(gain)[frame]
    halves = _spread(value, texel, frame * 2 >= len(gain))
    turns = _spread(value, texel, frame % 2 == 1)
    return None if halves is None or turns is None else Steadiness(halves, turns)


def _spread(value: np.ndarray, texel: np.ndarray, late: np.ndarray) -> float | None:
    group, count = 2 * texel + late, 2 * int(texel.max(initial=-1)) + 2
    enough = np.bincount(group, minlength=count).reshape(-1, 2).min(1) >= LEAST_SAMPLES
    if enough.sum() < LEAST_TEXELS:
        return None
    early, later = Groups(group, count).median(value).reshape(-1, 2)[enough].T
    change = later - early
    return float(1.4826 * np.median(np.abs(change - np.median(change))))
