"""How bright each frame is, seen from the texels that frames share."""

from __future__ import annotations

import numpy as np
from numba import njit

from .observations import Observations, color

LEAST_SHARED = 100  # samples of texels that other frames see too


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
                block.quality[j] >= 128
                or min(block.rgb[j, 0], block.rgb[j, 1], block.rgb[j, 2]) < 8
            ):
                continue
            r, g, b = color(block, view, j)
            logs[n, 0], logs[n, 1], logs[n, 2] = np.log(r), np.log(g), np.log(b)
            texel_of[n], frame_of[n] = t, block.frame[j]
            n += 1
    return n


def frame_gains(
    observations: Observations, samples: int | None = None, rounds: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    """Relative brightness of each frame and channel from the texels that frames share.

    In turns, a texel's colour is the median of its samples with the frames' gains taken off, and a
    frame's gain the median of its samples over their texels' colours: highlights do not matter.

    Parameters
    ----------
    observations : the samples
    samples : about how many of them to use; None: 250 000, more for many frames

    Returns
    -------
    gains : (F, 3) float64, median 1; NaN for a frame with fewer than 100 shared samples
    residual : (F,) float64, median |ln| of what is left in green
    """
    store = observations.store
    samples = samples or max(250_000, 10 * LEAST_SHARED * store.frames)
    stride = max(1, len(store) // samples)
    most = int(store.counts()[::stride].sum())
    logs = np.empty((most, 3), np.float32)
    texel, frame = np.empty(most, np.int64), np.empty(most, np.int64)
    filled = 0
    for block in store.blocks():
        filled = _ratios(block, observations.view, stride, logs, texel, frame, filled)
    # Keep the samples of texels that several frames see, and the frames that have enough of them
    shared = np.bincount(texel[:filled])[texel[:filled]] > 1
    enough = np.bincount(frame[:filled][shared], minlength=store.frames) >= LEAST_SHARED
    kept = np.flatnonzero(shared & enough[frame[:filled]])
    texel, frame, logs = texel[kept], frame[kept], logs[kept]
    gains, residual = np.full((store.frames, 3), np.nan), np.full(store.frames, np.nan)
    if len(kept) == 0:
        return gains, residual
    for channel in range(3):
        value, gain = logs[:, channel].astype(np.float64), np.zeros(store.frames)
        for _ in range(rounds):
            left = value - gain[frame]
            left -= _group_median(left, texel)[texel]
            step = _group_median(left, frame, store.frames)
            gain += np.nan_to_num(step)
            gain -= np.median(gain[np.isfinite(step)])
        gains[:, channel] = np.where(np.isfinite(step), np.exp(gain), np.nan)
        if channel == 1:
            residual = _group_median(np.abs(left), frame, store.frames)
    return gains, residual


def gain_spread(gains: np.ndarray) -> float:
    """How far gains (F, 3) vary: 1.48 · MAD of ln gain, in the channel where that is largest.

    A few frames that stand out do not count, a drifting white balance does. NaN without any gain.
    """
    logs = np.log(gains[np.isfinite(gains).all(axis=1)])
    if len(logs) == 0:
        return float("nan")
    return float(1.4826 * np.median(np.abs(logs - np.median(logs, axis=0)), axis=0).max())


def _group_median(values: np.ndarray, group: np.ndarray, count: int | None = None) -> np.ndarray:
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
