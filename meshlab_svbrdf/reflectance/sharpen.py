"""D as sharp as the surface, not as the pixels: their footprint taken out again.

A sample is a mean over its pixel, and over four of them where it is interpolated: both are facts of
any camera, whatever blur its lens adds. The mean of a texel's samples is therefore B = K D, K a
Gaussian of the frames' mean footprint. D ← D + g (B − K D), a few times, undoes it; the gain g
goes to 0 where B − K D is no more than the noise of B.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.sparse import csr_array

from ..blocks import blocks, room, rowwise
from ..geometry.tangents import tangents
from ..geometry.texels import Texels
from ..jit import kernel
from ..power import exp
from ..threads import thread_count
from .footprint import SPREAD

REACH = 4
"""Rings of texels around one that may blur into it; finer textures are sharpened less."""
CUT = 9.0
"""Square of the Mahalanobis distance beyond which nothing blurs in."""
PIECE = 1 << 14
"""Texels whose rows of K are made at once."""
HELD = 32 << 20
"""Entries of K, 8 bytes each, that are held from round to round; further rows are made anew."""
ROUNDS = 8
NOISE = 5.0
"""Standard errors of B at which the gain is a half."""
DARKER = 0.2
"""Of B, the least that D may be: beside a bright edge rounds could overshoot to black."""


@kernel
def _rows(first, stop, position, normal, row, col, covariance, index, counts, columns, weights):
    """The texels that blur into first..stop, and how much; returns how many they are."""
    height, width = index.shape
    n = 0
    for t in range(first, stop):
        nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
        ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
        aa, ab, bb = SPREAD * covariance[t, 0], SPREAD * covariance[t, 1], SPREAD * covariance[t, 2]
        determinant = aa * bb - ab * ab
        if not determinant > 0.0:
            continue
        xx, xy, yy = bb / determinant, -2.0 * ab / determinant, aa / determinant
        zz = 1.0 / (aa + bb)
        start, total = n, 0.0
        for ring in range(REACH + 1):
            beyond = True
            for r in range(max(row[t] - ring, 0), min(row[t] + ring + 1, height)):
                step = 1 if abs(r - row[t]) == ring else 2 * ring
                for c in range(col[t] - ring, col[t] + ring + 1, step):
                    u = index[r, c] if 0 <= c < width else -1
                    if u < 0:
                        beyond = False
                        continue
                    x = position[u, 0] - position[t, 0]
                    y = position[u, 1] - position[t, 1]
                    z = position[u, 2] - position[t, 2]
                    a, b = x * ax + y * ay + z * az, x * bx + y * by + z * bz
                    off = x * nx + y * ny + z * nz
                    d2 = xx * a * a + xy * a * b + yy * b * b + zz * off * off
                    beyond &= d2 >= CUT
                    facing = normal[u, 0] * nx + normal[u, 1] * ny + normal[u, 2] * nz
                    if d2 < CUT and facing > 0.0:
                        columns[n], weights[n] = u, exp(-0.5 * d2)
                        total += weights[n]
                        n += 1
            if beyond:
                break
        for k in range(start, n):
            weights[k] /= total
        counts[t - first] = n - start
    return n


class Blur:
    """K, (T, T), some of its rows at a time: at fine textures a row has eighty entries.

    covariance : (T, 3) float32, from `footprints`. Rows sum to 1, and are empty where there are no
        samples. Charts that lie side by side do not blur into each other: distances are those on
        the surface. A chart's border blurs with its own side only.
    """

    def __init__(self, texels: Texels, covariance: np.ndarray) -> None:
        self._texels, self._covariance = texels, covariance
        # Lay the textures below one another, out of each other's reach
        widest = max(size[1] for size in texels.sizes)
        tops = np.cumsum([0, *(size[0] + REACH for size in texels.sizes)])
        down = np.array(tops[:-1], np.int32)
        self._row = rowwise(lambda row, number: row + down[number], texels.row, texels.texture)
        self._index = room((tops[-1], widest), np.int32)
        self._index[:] = -1
        for block in blocks(len(texels)):
            own = block.start + np.flatnonzero(covariance[block, 0] > 0)
            self._index[self._row[own], texels.col[own]] = own

    def rows(self, own: slice) -> csr_array:
        """The rows of some texels, (n, T)."""
        first, stop, texels = own.start, own.stop, self._texels
        most = (stop - first) * (2 * REACH + 1) ** 2
        columns, weights = np.empty(most, np.int32), np.empty(most, np.float32)
        counts = np.zeros(stop - first, np.int64)
        n = _rows(
            first, stop, texels.position, texels.normal, self._row, texels.col, self._covariance,
            self._index, counts, columns, weights,
        )  # fmt: skip
        offsets = np.concatenate([[0], np.cumsum(counts)])
        shape = (stop - first, len(texels))
        return csr_array((weights[:n].copy(), columns[:n].copy(), offsets), shape=shape)


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

    def only(own: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.where(own[:, None], values, 0).astype(np.float32)

    blur, start = Blur(texels, rowwise(only, known, covariance)), rowwise(only, known, blurred)
    pieces = list(blocks(len(start), PIECE))
    held: dict[int, csr_array] = {}
    sharp, after = (room(start.shape, np.float32) for _ in range(2))
    sharp[:] = start

    def step(number: int) -> None:
        own = pieces[number]
        rows = held.get(number)
        if rows is None:
            rows = blur.rows(own)
            if sum(each.nnz for each in list(held.values())) + rows.nnz <= HELD:
                held[number] = rows
        limit = np.float32(NOISE) * np.nan_to_num(noise[own, None]).astype(np.float32)
        missing = start[own] - rows @ sharp
        fourth = (missing * missing) ** 2
        fourth /= np.maximum(fourth + limit**4, np.float32(1e-30))
        after[own] = np.maximum(sharp[own] + fourth * missing, np.float32(DARKER) * start[own])

    with ThreadPoolExecutor(thread_count()) as pool:
        for _ in range(ROUNDS):
            list(pool.map(step, range(len(pieces))))
            sharp, after = after, sharp

    def joined(own: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
        return np.where(own[:, None], new, old).astype(np.float32)

    return rowwise(joined, known, sharp, blurred)
