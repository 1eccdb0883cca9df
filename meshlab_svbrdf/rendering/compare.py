"""A rendering against the frame that it should be: in figures."""

from __future__ import annotations

import numpy as np
from skimage.metrics import structural_similarity

WINDOW = 7
"""Pixels along a side that SSIM looks at."""
CLIPPED = 0.98
"""Linear value from which a pixel tells nothing on the gain."""


def channel_gain(rendered: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The linear gain per channel, (3,), that brings `rendered` (n, 3) nearest to `truth`."""
    usable = truth.max(1) < CLIPPED
    product, power = (rendered * truth)[usable].sum(0), (rendered**2)[usable].sum(0)
    return np.divide(product, power, out=np.ones(3), where=power > 0)


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """Decibels between sRGB values in 0..1 of one shape; infinite where they are the same."""
    square = float(((image - truth) ** 2).mean())
    return float("inf") if square == 0 else float(-10 * np.log10(square))


def similarity(image: np.ndarray, truth: np.ndarray, on: np.ndarray) -> float:
    """SSIM of sRGB images (H, W, 3) in 0..1, the mean over the pixels `on` (H, W) bool.

    What lies beside them counts as the same in both. NaN where nothing is on, or the image is
    smaller than a window.
    """
    if not on.any() or min(on.shape) < WINDOW:
        return float("nan")
    rows, cols = np.flatnonzero(on.any(1)), np.flatnonzero(on.any(0))
    box = tuple(
        slice(max(min(own[0], size - WINDOW) - WINDOW, 0), max(own[-1] + 1, WINDOW) + WINDOW)
        for own, size in zip((rows, cols), on.shape, strict=True)
    )
    same = np.where(on[..., None], image, truth)[box]
    _, values = structural_similarity(
        same, truth[box], channel_axis=2, data_range=1.0, full=True, win_size=WINDOW
    )
    return float(values.mean(-1)[on[box]].mean())
