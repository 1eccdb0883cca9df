"""How bright each frame is, seen from the texels that frames share."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from ..jit import kernel
from ..ranks import quantile
from ..threads import thread_count
from .luminance import decode
from .observations import Observations, color
from .radiance_code import code_of
from .store import Block

LEAST_SHARED = 100  # samples of texels that other frames see too
DARK = 8
"""A code below which noise is too much of a sample's logarithm."""
DARK_LINEAR = 100 * float(decode(np.array(DARK / 255)))
"""The same, 0..100."""
PER_FRAME = 400  # samples, on average, so that frames that see little have enough as well
SCALE = 1.5
"""Robust standard deviations of a residual at which its weight has fallen to a quarter."""


@kernel
def _ratios(block, view, dark, logs, texel_of, frame_of):
    """ln colours, texels and frames of a block's samples but for clipped and dark ones; returns how
    many there are. dark : code below which a sample is dark"""
    n = 0
    for i in range(block.stop - block.first):
        for j in range(block.offsets[i], block.offsets[i + 1]):
            if (
                block.value[j, 3] >= 128
                or min(block.value[j, 0], block.value[j, 1], block.value[j, 2]) < dark
            ):
                continue
            r, g, b = color(block, view, j)
            logs[n, 0], logs[n, 1], logs[n, 2] = np.log(r), np.log(g), np.log(b)
            texel_of[n], frame_of[n] = i, block.frame[j]
            n += 1
    return n


@kernel
def _medians(values, order, starts, out):
    row = np.empty(len(values), np.float32)
    for k in range(len(out)):
        n = starts[k + 1] - starts[k]
        for i in range(n):
            row[i] = values[order[starts[k] + i]]
        out[k] = quantile(row[:n], 0.5) if n > 0 else np.nan


class Groups:
    """Samples (n,) grouped by their texel or frame, of `count`."""

    def __init__(self, of: np.ndarray, count: int) -> None:
        self.of, self.count = of, count
        self._order = np.argsort(of, kind="stable")
        self._starts = np.searchsorted(of[self._order], np.arange(count + 1))

    def median(self, values: np.ndarray) -> np.ndarray:
        """Of each group's finite values, (count,) float64; NaN for an empty one."""
        out = np.empty(self.count)
        _medians(values, self._order, self._starts, out)
        return out


def some_logs(
    observations: Observations, samples: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ln colours (N, 3) float32, texels and frames (N,) int64 of about so many samples, all of
    evenly spaced texels but for clipped and dark ones; samples : see `frame_gains`."""
    store = observations.store
    samples = samples or max(250_000, PER_FRAME * store.frames)
    chosen = np.arange(0, store.texels, max(1, len(store) // samples))
    view = observations.view
    dark = (
        DARK if store.bits == 8 else int(code_of(np.float32(DARK_LINEAR / np.median(view.scale))))
    )

    def work(block: Block, own: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        most = len(block.frame)
        logs = np.empty((most, 3), np.float32)
        texel, frame = np.empty(most, np.int64), np.empty(most, np.int64)
        n = _ratios(block, view, dark, logs, texel, frame)
        return logs[:n], texel[:n] + own.start, frame[:n]

    pieces = store.map_texels(work, chosen)
    logs, texel, frame = (np.concatenate(each) for each in zip(*pieces, strict=True))
    return logs, chosen[texel], frame


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
    samples : about how many of them to use; None: 250 000, or 400 for each of many frames
    rounds : of reweighting, at most

    Returns
    -------
    gains : (F, 3) float64, median 1; NaN for a frame with fewer than 100 shared samples
    residual : (F,) float64, median |ln| of what is left in green
    """
    store = observations.store
    logs, texel, frame = some_logs(observations, samples)
    # Keep the samples of texels that several frames see, and the frames that have enough of them
    shared = np.bincount(texel)[texel] > 1 if len(texel) else np.zeros(0, bool)
    enough = np.bincount(frame[shared], minlength=store.frames) >= LEAST_SHARED
    kept = np.flatnonzero(shared & enough[frame])
    gains, residual = np.full((store.frames, 3), np.nan), np.full(store.frames, np.nan)
    if len(kept) == 0:
        return gains, residual
    logs = logs[kept]
    known, texel = np.unique(texel[kept], return_inverse=True)
    texels, frames = Groups(texel, len(known)), Groups(frame[kept], store.frames)
    seen = np.bincount(frames.of, minlength=store.frames) > 0

    def fit(channel: int) -> tuple[np.ndarray, np.ndarray]:
        value, gain = logs[:, channel].astype(np.float64), np.zeros(store.frames)
        for _ in range(2):
            left = value - gain[frames.of]
            left -= texels.median(left)[texels.of]
            gain += np.nan_to_num(frames.median(left))
        return _reweighted(value, gain, texels, frames, rounds)

    with ThreadPoolExecutor(thread_count()) as pool:
        for channel, (gain, left) in enumerate(pool.map(fit, range(3))):
            gains[:, channel] = np.where(seen, np.exp(gain - np.median(gain[seen])), np.nan)
            if channel == 1:
                residual = frames.median(np.abs(left))
    return gains, residual


def _reweighted(
    value: np.ndarray, gain: np.ndarray, texels: Groups, frames: Groups, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """ln gains (F,) and residuals of value = texel + gain, by weights 1/(1 + (e/h)²)²."""
    texel, frame, count = texels.of, frames.of, frames.count
    left = value - gain[frame]
    left -= texels.median(left)[texel]
    for _ in range(rounds):
        scale = max(SCALE * 1.4826 * float(np.median(np.abs(left))), 1e-4)
        weight = 1 / (1 + (left / scale) ** 2) ** 2
        # Eliminate the texels: (diag Σw − Sᵀ S/W) gain = Σ w value − Sᵀ (Σ w value)/W
        shared = csr_array((weight, (texel, frame)), shape=(texels.count, count))
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
