"""How bright each frame is, seen from the texels that frames share."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from .observations import Observations, color

LEAST_SHARED = 100  # samples of texels that other frames see too
SCALE = 1.5
"""Robust standard deviations of a residual at which its weight has fallen to a quarter."""


@njit(cache=True, nogil=True)
def _ratios(block, view, stride, logs, texel_of, frame_of, filled):
    """ln colours, texels and frames of every `stride`-th texel; clipped and dark ones left out."""
    n = filled
    for i in range(block.stop - block.first):
        t = block.first + i
        if t % stride != 0:
            continue
        for j in range(block.offsets[i], block.offsets[i + 1]):
            if (
                block.value[j, 3] >= 128
                or min(block.value[j, 0], block.value[j, 1], block.value[j, 2]) < 8
            ):
                continue
            r, g, b = color(block, view, j)
            logs[n, 0], logs[n, 1], logs[n, 2] = np.log(r), np.log(g), np.log(b)
            texel_of[n], frame_of[n] = t, block.frame[j]
            n += 1
    return n


def some_logs(
    observations: Observations, samples: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ln colours (N, 3) float32, texels and frames (N,) of about so many samples, evenly spaced
    texels'; None: 250 000, more for many frames. Clipped and dark ones are left out."""
    store = observations.store
    samples = samples or max(250_000, 10 * LEAST_SHARED * store.frames)
    stride = max(1, len(store) // samples)
    most = int(store.counts()[::stride].sum())
    logs = np.empty((most, 3), np.float32)
    texel, frame = np.empty(most, np.int64), np.empty(most, np.int64)
    filled = 0
    for block in store.blocks():
        filled = _ratios(block, observations.view, stride, logs, texel, frame, filled)
    return logs[:filled], texel[:filled], frame[:filled]


def frame_gains(
    observations: Observations, samples: int | None = None, rounds: int = 15
) -> tuple[np.ndarray, np.ndarray]:
    """Relative brightness of each frame and channel from the texels that frames share.

    ln sample = ln texel + ln gain, by reweighted least squares with the texels eliminated. Medians,
    of texels and of frames in turns, are where it starts, and weights that vanish for large
    residuals where it ends: highlights do not matter.

    Parameters
    ----------
    observations : the samples
    samples : about how many of them to use; None: 250 000, more for many frames
    rounds : of reweighting, at most

    Returns
    -------
    gains : (F, 3) float64, median 1; NaN for a frame with fewer than 100 shared samples
    residual : (F,) float64, median |ln| of what is left in green
    """
    store = observations.store
    logs, texel, frame = some_logs(observations, samples)
    # Keep the samples of texels that several frames see, and the frames that have enough of them
    shared = np.bincount(texel)[texel] > 1
    enough = np.bincount(frame[shared], minlength=store.frames) >= LEAST_SHARED
    kept = np.flatnonzero(shared & enough[frame])
    texel, frame, logs = texel[kept], frame[kept], logs[kept]
    gains, residual = np.full((store.frames, 3), np.nan), np.full(store.frames, np.nan)
    if len(kept) == 0:
        return gains, residual
    for channel in range(3):
        value, gain = logs[:, channel].astype(np.float64), np.zeros(store.frames)
        for _ in range(2):
            left = value - gain[frame]
            left -= group_median(left, texel)[texel]
            gain += np.nan_to_num(group_median(left, frame, store.frames))
        gain, left = _reweighted(value, gain, texel, frame, rounds)
        seen = np.bincount(frame, minlength=store.frames) > 0
        gain -= np.median(gain[seen])
        gains[:, channel] = np.where(seen, np.exp(gain), np.nan)
        if channel == 1:
            residual = group_median(np.abs(left), frame, store.frames)
    return gains, residual


def _reweighted(
    value: np.ndarray, gain: np.ndarray, texel: np.ndarray, frame: np.ndarray, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """ln gains (F,) and residuals of value = texel + gain, by weights 1/(1 + (e/h)²)²."""
    texel, count = np.unique(texel, return_inverse=True)[1], len(gain)
    left = value - gain[frame]
    left -= group_median(left, texel)[texel]
    for _ in range(rounds):
        scale = max(SCALE * 1.4826 * float(np.median(np.abs(left))), 1e-4)
        weight = 1 / (1 + (left / scale) ** 2) ** 2
        # Eliminate the texels: (diag Σw − Sᵀ S/W) gain = Σ w value − Sᵀ (Σ w value)/W
        shared = csr_array((weight, (texel, frame)), shape=(texel.max() + 1, count))
        per_texel, per_frame = np.bincount(texel, weight), np.bincount(frame, weight, count)
        level = np.bincount(texel, weight * value) / per_texel
        product = np.bincount(frame, weight * value, count) - shared.T @ level

        inertia = np.maximum(per_frame, 1e-12)  # frames without samples stay where they are

        def normal(g, shared=shared, per_texel=per_texel, per_frame=per_frame):
            return per_frame * g - shared.T @ (shared @ g / per_texel)

        found, _ = cg(
            LinearOperator((count, count), normal), product, gain, rtol=1e-6, maxiter=200,
            M=LinearOperator((count, count), lambda g, d=inertia: g / d),
        )  # fmt: skip
        step = float(np.abs(found - gain - np.median(found - gain)).max())
        gain = found
        left = value - gain[frame]
        left -= (np.bincount(texel, weight * left) / per_texel)[texel]
        if step < 1e-4:
            break
    return gain, left


def gain_spread(gains: np.ndarray) -> float:
    """How far gains (F, 3) vary: 1.48 · MAD of ln gain, in the channel where that is largest.

    A few frames that stand out do not count, a drifting white balance does. NaN without any gain.
    """
    logs = np.log(gains[np.isfinite(gains).all(axis=1)])
    if len(logs) == 0:
        return float("nan")
    return float(1.4826 * np.median(np.abs(logs - np.median(logs, axis=0)), axis=0).max())


def group_median(values: np.ndarray, group: np.ndarray, count: int | None = None) -> np.ndarray:
    """Median of the values of each group 0..count-1; NaN for an empty one."""
    count = int(group.max(initial=-1)) + 1 if count is None else count
    order = np.lexsort((values, group))
    sizes = np.bincount(group, minlength=count)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    out = np.full(count, np.nan)
    known = sizes > 0
    sorted_values = values[order]
    low, high = (first + (sizes - 1) // 2)[known], (first + sizes // 2)[known]
    out[known] = (sorted_values[low] + sorted_values[high]) / 2
    return out
