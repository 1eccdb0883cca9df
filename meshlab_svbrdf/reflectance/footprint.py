"""How much of the surface a texel's samples cover: the frames' pixels, laid on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..geometry.tangents import tangents
from ..jit import kernel
from ..ranks import quantile
from ..samples.observations import Observations, View, sample_luminance, sample_quality
from ..samples.store import Block

SPREAD = 1 / 12 + 1 / 6
"""Pixels², variance per axis of what a sample averages over: a pixel is a box (1/12), and between
two of them bilinear weights spread a sample by a (1 − a), which is 1/6 on average."""
STEEPEST = 0.1
"""Cosine of the steepest view: beyond it a pixel would cover without end."""
STEP = 1.48 / np.sqrt(2)
"""Standard deviation of normal noise over the median step between two samples."""
LOOKED_AT = 32
"""Samples of a texel, evenly spaced, from which on no more are looked at."""


@kernel
def _footprints(block, view, pixel, out, noise):
    steps = np.empty(2 * LOOKED_AT, np.float32)
    for i in range(block.stop - block.first):
        t = block.first + i
        nx, ny, nz = view.normal[t, 0], view.normal[t, 1], view.normal[t, 2]
        ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
        aa, ab, bb, weight = 0.0, 0.0, 0.0, 0.0
        first, last = block.offsets[i], block.offsets[i + 1] - 1
        n, stride, count = last + 1 - first, max(1, (last + 1 - first) // LOOKED_AT), 0
        seen, luminance = -1, np.float32(0)
        for j in range(first, last + 1, stride):
            f = block.frame[j]
            vx = view.eyes[f, 0] - view.position[t, 0]
            vy = view.eyes[f, 1] - view.position[t, 1]
            vz = view.eyes[f, 2] - view.position[t, 2]
            length2 = vx * vx + vy * vy + vz * vz
            height = vx * nx + vy * ny + vz * nz
            if not (height > 0 and height * height > STEEPEST * STEEPEST * length2):
                height = STEEPEST * np.sqrt(length2)
            # Stretch the pixel by 1/cos towards where the view is tilted
            a = (vx * ax + vy * ay + vz * az) / height
            b = (vx * bx + vy * by + vz * bz) / height
            w = sample_quality(block, j)
            area = w * length2 * pixel[f] * pixel[f]
            aa += area * (1.0 + a * a)
            ab += area * a * b
            bb += area * (1.0 + b * b)
            weight += w
            # Take the noise from neighbours in time: highlights pass slowly
            if j < last:
                before = luminance if seen == j else sample_luminance(block, view, j)
                seen, luminance = j + 1, sample_luminance(block, view, j + 1)
                steps[count] = abs(luminance - before)
                count += 1
        if weight > 0.0:
            out[i, 0], out[i, 1], out[i, 2] = aa / weight, ab / weight, bb / weight
        if count > 0:
            noise[i] = STEP * quantile(steps[:count], 0.5) / np.sqrt(n)


@dataclass(frozen=True)
class Footprints:
    """What the frames' pixels cover at each texel, and how certain their mean is.

    covariance : (T, 3) float32, aa, ab and bb of a symmetric 2×2 matrix in the texel's `tangents`,
        in the mesh's units squared: the mean square of a pixel's side on the surface. A frame's
        pixel seen at the angle θ counts with (distance/f)² across the tilt and that over cos²θ
        along it; the frames weigh by the samples' quality. 0 where there are no samples.
    noise : (T,) float32, standard error of a mean of the samples' luminance, 0..100; 0 for one
    """

    covariance: np.ndarray
    noise: np.ndarray


def covering(observations: Observations) -> Callable[[Block], tuple[np.ndarray, np.ndarray]]:
    """What gives the fields of `Footprints` for a block's texels."""
    return partial(_block_footprints, observations.view, observations.pixel)


def _block_footprints(view: View, pixel: np.ndarray, block: Block) -> tuple[np.ndarray, np.ndarray]:
    count = block.stop - block.first
    covariance, noise = np.zeros((count, 3), np.float32), np.zeros(count, np.float32)
    _footprints(block, view, pixel, covariance, noise)
    return covariance, noise


def footprints(observations: Observations) -> Footprints:
    """Those of all texels."""
    return Footprints(*observations.store.rows(covering(observations)))
