"""D as sharp as the surface, not as the pixels: their footprint taken out again.

A sample is a mean over its pixel, and over four of them where it is interpolated: both are facts of
any camera, whatever blur its lens adds. The mean of a texel's samples is therefore B = K D, K a
Gaussian of the frames' mean footprint. D ← D + g (B − K D), a few times, undoes it; the gain g
goes to 0 where B − K D is no more than the noise of B.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ..geometry.tangents import tangents
from ..geometry.texels import Texels
from ..threads import thread_count
from .footprint import SPREAD

REACH = 4
"""Texels around one that may blur into it; finer textures are sharpened less."""
CUT = 9.0
"""Square of the Mahalanobis distance beyond which nothing blurs in."""
ROUNDS = 8
NOISE = 5.0
"""Standard errors of B at which the gain is a half."""
DARKER = 0.2
"""Of B, the least that D may be: beside a bright edge rounds could overshoot to black."""


@njit(cache=True, nogil=True)
def _row(t, position, normal, row, col, covariance, index, columns, weights):
    """The texels that blur into t, and how much (not normalised); returns how many."""
    height, width = index.shape
    nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
    ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
    aa, ab, bb = SPREAD * covariance[t, 0], SPREAD * covariance[t, 1], SPREAD * covariance[t, 2]
    determinant = aa * bb - ab * ab
    if not determinant > 0.0:
        return 0
    n = 0
    for r in range(max(row[t] - REACH, 0), min(row[t] + REACH + 1, height)):
        for c in range(max(col[t] - REACH, 0), min(col[t] + REACH + 1, width)):
            u = index[r, c]
            if u < 0 or not covariance[u, 0] > 0.0:
                continue
            if normal[u, 0] * nx + normal[u, 1] * ny + normal[u, 2] * nz <= 0.0:
                continue
            x = position[u, 0] - position[t, 0]
            y = position[u, 1] - position[t, 1]
            z = position[u, 2] - position[t, 2]
            a, b = x * ax + y * ay + z * az, x * bx + y * by + z * bz
            off = x * nx + y * ny + z * nz
            d2 = (bb * a * a - 2.0 * ab * a * b + aa * b * b) / determinant + off * off / (aa + bb)
            if d2 < CUT:
                columns[n], weights[n] = u, np.exp(-0.5 * d2)
                n += 1
    return n


@njit(cache=True, nogil=True)
def _count(first, stop, position, normal, row, col, covariance, index, counts):
    columns, weights = np.empty((2 * REACH + 1) ** 2, np.int32), np.empty((2 * REACH + 1) ** 2)
    for t in range(first, stop):
        counts[t] = _row(t, position, normal, row, col, covariance, index, columns, weights)


@njit(cache=True, nogil=True)
def _fill(
    first, stop, position, normal, row, col, covariance, index, offsets, all_columns, all_weights
):
    columns, weights = np.empty((2 * REACH + 1) ** 2, np.int32), np.empty((2 * REACH + 1) ** 2)
    for t in range(first, stop):
        n = _row(t, position, normal, row, col, covariance, index, columns, weights)
        total = weights[:n].sum()
        for k in range(n):
            all_columns[offsets[t] + k] = columns[k]
            all_weights[offsets[t] + k] = weights[k] / total


def blur_kernel(texels: Texels, covariance: np.ndarray) -> csr_array:
    """K, (T, T): rows sum to 1, and are empty where there are no samples.

    covariance : (T, 3), from `footprints`. Charts that lie side by side do not blur into each
    other: distances are those on the surface. A chart's border blurs with its own side only.
    """
    count = len(texels)
    counts = np.zeros(count, np.int64)
    edges = np.linspace(0, count, 65).astype(int)
    images = [np.full(size, -1, np.int32) for size in texels.sizes]
    for number, image in enumerate(images):
        own = np.flatnonzero(texels.texture == number)
        image[texels.row[own], texels.col[own]] = own
    # Lay the textures below one another, out of each other's reach
    widest = max(size[1] for size in texels.sizes)
    padded = [np.pad(i, ((0, REACH), (0, widest - i.shape[1])), constant_values=-1) for i in images]
    tops = np.cumsum([0, *(len(image) for image in padded[:-1])])
    index = np.concatenate(padded)
    row = (texels.row + tops[texels.texture]).astype(np.int32)
    where = (texels.position, texels.normal, row, texels.col, covariance, index)
    with ThreadPoolExecutor(thread_count()) as pool:
        list(pool.map(lambda a, b: _count(a, b, *where, counts), edges[:-1], edges[1:]))
        offsets = np.concatenate([[0], np.cumsum(counts)])
        columns = np.empty(offsets[-1], np.int32)
        weights = np.empty(offsets[-1], np.float32)
        list(
            pool.map(
                lambda a, b: _fill(a, b, *where, offsets, columns, weights), edges[:-1], edges[1:]
            )
        )
    return csr_array((weights, columns, offsets), shape=(count, count))


def sharpen(
    texels: Texels, blurred: np.ndarray, covariance: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """D of which `blurred` is what the frames' pixels show, (T, 3) float32.

    Parameters
    ----------
    blurred : (T, 3) linear RGB, NaN where unobserved: it stays so
    covariance : (T, 3), see `footprint.footprints`
    noise : (T,) standard error of `blurred`
    """
    known = np.isfinite(blurred).all(1) & (covariance[:, 0] > 0)
    kernel = blur_kernel(texels, np.where(known[:, None], covariance, 0).astype(np.float32))
    start = np.where(known[:, None], blurred, 0).astype(np.float32)
    threshold = (NOISE * np.nan_to_num(noise[:, None])) ** 4
    sharp = start.copy()
    for _ in range(ROUNDS):
        missing = start - kernel @ sharp
        fourth = missing**4
        gain = fourth / np.maximum(fourth + threshold, 1e-30)
        sharp = np.maximum(sharp + gain * missing, DARKER * start)
    return np.where(known[:, None], sharp, blurred).astype(np.float32)
