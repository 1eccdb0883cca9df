"""The environment map: the object is the probe of its own light (paper §5, eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import kernel
from ..samples.observations import (
    Observations,
    fill_visibility,
    mirror_direction,
    sample_luminance,
    sample_quality,
    visibility,
)
from .directions import pixel
from .threshold import LuminanceStatistics


@dataclass(frozen=True)
class EnvironmentMap:
    """Where the light comes from, (H, 2H) float64 each (`directions` has the convention).

    radiance : excess luminance over the threshold, 0..100, unclipped: the lights are found in it
    probability : the same, normalised and clipped to [0, 1] (paper §5)
    weight : Σ q·V of the samples that fall there; 0 where nothing mirrors
    """

    radiance: np.ndarray
    probability: np.ndarray
    weight: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        return self.weight > 0


@kernel
def _accumulate(block, view, texel, threshold, amount, weight, count):
    """texel : (B,), those of the block"""
    height = amount.shape[0]
    coefficients = np.empty(36, np.float32)
    for i in range(len(texel)):
        t = texel[i]
        has = fill_visibility(view, t, coefficients)
        for j in range(block.offsets[i], block.offsets[i + 1]):
            x, y, z = mirror_direction(view, t, block.frame[j])
            qv = sample_quality(block, j) * visibility(has, coefficients, x, y, z)
            row, col = pixel(x, y, z, height)
            weight[row, col] += qv
            count[row, col] += 1
            excess = sample_luminance(block, view, j) - threshold[t]
            if excess > 0:
                amount[row, col] += excess * qv


def environment_map(
    observations: Observations,
    statistics: LuminanceStatistics,
    *,
    height: int = 128,
    samples: int = 2_000_000,
    normalisation: str = "weight",
    scale: str = "quantile",
    progress=lambda done, total: None,
) -> EnvironmentMap:
    """Accumulate (Y − t)·V(r)·q along the mirror directions of samples above the threshold (eq. 2).

    Parameters
    ----------
    height : rows of the map
    samples : about how many to use; evenly spaced texels are taken until there are enough
    normalisation : "weight" divides a pixel by Σ q·V of all its samples, "count" by how many fall
        there (the paper's letter; light error .65° against .51°)
    scale : "quantile" sets 1 at the 99.9th percentile of the pixels that have samples, "max" at the
        largest (the letter; one noisy pixel sets the scale)
    """
    stride = max(1, int(statistics.samples.sum() // samples))
    chosen = np.arange(0, len(statistics.threshold), stride)
    chosen = chosen[statistics.threshold[chosen] >= 0]

    def work(block, own):
        sums = np.zeros((2, height, 2 * height)), np.zeros((height, 2 * height), np.int64)
        _accumulate(
            block, observations.view, chosen[own], statistics.threshold,
            sums[0][0], sums[0][1], sums[1],
        )  # fmt: skip
        return sums

    amount, weight = sums = np.zeros((2, height, 2 * height))
    count = np.zeros((height, 2 * height), np.int64)
    for own_sums, own_count in observations.store.map_texels(work, chosen, progress):
        sums += own_sums
        count += own_count
    divisor = {"weight": weight, "count": count}[normalisation]
    radiance = np.divide(amount, divisor, out=np.zeros_like(amount), where=divisor > 0)
    seen = radiance[weight > 0]
    top = 0.0 if not len(seen) else np.quantile(seen, 0.999) if scale == "quantile" else seen.max()
    probability = np.clip(radiance / top, 0, 1) if top > 0 else (radiance > 0).astype(float)
    return EnvironmentMap(radiance, probability, weight)
