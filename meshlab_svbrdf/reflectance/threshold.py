"""The luminance threshold that parts diffuse from specular samples (paper §5)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..jit import kernel
from ..samples.observations import (
    Observations,
    View,
    color,
    longest,
    relative_luminance,
)
from ..samples.store import Block

MINIMUM_SAMPLES = 8
"""Texels with fewer samples are unobserved, where nothing else is asked for."""


@dataclass(frozen=True)
class LuminanceStatistics:
    """Per texel, (T,) float32, luminance 0..100; NaN where unobserved.

    threshold : μ + mean |Y − μ|, an upper bound of the median
    mean, minimum : of the luminance
    color : (T, 3), the mean colour, linear 0..100
    samples : (T,) int32, how many samples were good enough
    """

    threshold: np.ndarray
    mean: np.ndarray
    minimum: np.ndarray
    color: np.ndarray
    samples: np.ndarray

    @property
    def observed(self) -> np.ndarray:
        return np.isfinite(self.threshold)


@kernel
def _threshold(block, view, cut, least, threshold, mean, minimum, rgb, samples):
    """cut : quality, 0..127"""
    ys = np.empty(longest(block.offsets, 0, block.stop - block.first), np.float32)
    for i in range(block.stop - block.first):
        red, green, blue, total, low, n = 0.0, 0.0, 0.0, 0.0, np.float32(np.inf), 0
        for j in range(block.offsets[i], block.offsets[i + 1]):
            if block.value[j, 3] & 127 >= cut:
                r, g, b = color(block, view, j)
                y = relative_luminance(r, g, b)
                red, green, blue, total = red + r, green + g, blue + b, total + y
                low = min(low, y)
                ys[n] = y
                n += 1
        samples[i] = n
        if n < least:
            continue
        mu, deviation = total / n, 0.0
        for j in range(n):
            deviation += abs(ys[j] - mu)
        threshold[i], mean[i], minimum[i] = mu + deviation / n, mu, low
        rgb[i, 0], rgb[i, 1], rgb[i, 2] = red / n, green / n, blue / n


def luminance_threshold(
    observations: Observations, minimum_quality: float = 0.1, progress=lambda done, total: None,
    minimum_samples: int = MINIMUM_SAMPLES,
) -> LuminanceStatistics:  # fmt: skip
    """Per texel t = μ + mean |Y − μ| over the samples with quality ≥ `minimum_quality` (paper §5).

    Texels with fewer than `minimum_samples` of these are unobserved.
    Since |μ − m| ≤ E|X − m| ≤ E|X − μ|, t bounds the median m from above.
    """
    cut = int(np.rint(minimum_quality * 127))
    work = partial(_block_statistics, observations.view, cut, minimum_samples)
    return LuminanceStatistics(*observations.store.rows(work, progress))


def _block_statistics(view: View, cut: int, least: int, block: Block) -> tuple[np.ndarray, ...]:
    """The fields of `LuminanceStatistics` for a block's texels."""
    count = block.stop - block.first
    threshold, mean, minimum = (np.full(count, np.nan, np.float32) for _ in range(3))
    rgb, samples = np.full((count, 3), np.nan, np.float32), np.zeros(count, np.int32)
    _threshold(block, view, cut, least, threshold, mean, minimum, rgb, samples)
    return threshold, mean, minimum, rgb, samples
