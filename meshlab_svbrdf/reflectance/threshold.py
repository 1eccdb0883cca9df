"""The luminance threshold that parts diffuse from specular samples (paper §5)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..jit import inner, kernel
from ..power import FAST
from ..ranks import smallest
from ..samples.observations import (
    Observations,
    View,
    longest,
)
from ..samples.store import Block
from .rows import luminances, read_row

MINIMUM_SAMPLES = 8
"""Texels with fewer samples are unobserved, where nothing else is asked for."""
FEWEST_SAMPLES = 4
"""With so few a texel may be judged, where there are not many frames (docs/sequences.md)."""


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


@inner
def _keep(quality, cut, red, green, blue):
    """Move the colours of good enough samples to the front; how many they are."""
    kept = 0
    for j in range(len(quality)):
        kept += 1 if quality[j] >= cut else 0
    if kept == len(quality):
        return kept
    n = 0
    for j in range(len(quality)):
        if quality[j] >= cut:
            red[n], green[n], blue[n] = red[j], green[j], blue[j]
            n += 1
    return n


@inner(fastmath=FAST)
def _total(n, red, green, blue, y):
    r, g, b, total = 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        r, g, b, total = r + red[j], g + green[j], b + blue[j], total + y[j]
    return r, g, b, total


@inner(fastmath=FAST)
def _deviation(y, mu):
    total = 0.0
    for j in range(len(y)):
        total += abs(y[j] - mu)
    return total / len(y)


@kernel
def _threshold(block, view, cut, least, threshold, mean, minimum, rgb, samples):
    """cut : quality, 0..1"""
    rows = np.empty((6, longest(block.offsets, 0, block.stop - block.first)), np.float32)
    for i in range(block.stop - block.first):
        first = block.offsets[i]
        n = block.offsets[i + 1] - first
        red, green, blue, quality, y = rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n], rows[4]
        read_row(block, view, first, n, red, green, blue, quality, rows[5])
        n = _keep(quality, cut, red, green, blue)
        samples[i] = n
        if n < least:
            continue
        luminances(n, red, green, blue, y)
        r, g, b, total = _total(n, red, green, blue, y)
        mu = total / n
        threshold[i], mean[i] = mu + _deviation(y[:n], mu), mu
        minimum[i] = smallest(y[:n])
        rgb[i, 0], rgb[i, 1], rgb[i, 2] = r / n, g / n, b / n


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
    quality = np.float32(cut) / np.float32(127)
    _threshold(block, view, quality, least, threshold, mean, minimum, rgb, samples)
    return threshold, mean, minimum, rgb, samples
