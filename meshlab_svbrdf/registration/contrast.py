"""Pictures made comparable: local mean and contrast divided out, so that exposure and broad
highlights change little."""

from __future__ import annotations

import cv2
import numpy as np

from ..jit import kernel

WINDOW = 31  # pixels
GAIN = 40.0  # codes per local standard deviation
NOISE = 6.0  # codes of contrast that are not made more of


def to_grey(image: np.ndarray) -> np.ndarray:
    """(h, w) or (h, w, 3) uint8 sRGB to (h, w) uint8."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def normalise(image: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """The image (h, w) with local mean 128, over the valid pixels, and local contrast GAIN; uint8.

    valid : (h, w) uint8, 1 or 0; elsewhere the result is 128
    """
    mask = valid.astype(np.float32)
    masked = image * mask
    share = 1 / np.maximum(_mean(mask), 1e-3)
    mean = _mean(masked) * share
    variance = _mean(masked * masked) * share - mean * mean
    flat = (masked - mean) * (GAIN / (cv2.sqrt(np.maximum(variance, 0)) + NOISE)) * mask
    return cv2.convertScaleAbs(np.maximum(flat + 128, 0))


def structure(image: np.ndarray, window: int):
    """Mean products of the image's slopes over a window: xx, xy, yy, each (h, w) float32."""
    dx, dy = (cv2.Scharr(image, cv2.CV_32F, *d, scale=1 / 32) for d in ((1, 0), (0, 1)))
    return tuple(cv2.blur(p, (window, window)) for p in (dx * dx, dx * dy, dy * dy))


@kernel
def structure_at(image, places, half, out):
    """Sums of products of the image's slopes, xx, xy, yy, around places (n, 2), to `out` (n, 3).

    image : (h, w) uint8; half : of the window, pixels
    """
    height, width = image.shape
    for i in range(len(places)):
        col, row = int(places[i, 0] + 0.5), int(places[i, 1] + 0.5)
        xx = xy = yy = 0.0
        for r in range(max(row - half, 1), min(row + half, height - 2) + 1):
            for c in range(max(col - half, 1), min(col + half, width - 2) + 1):
                dx = (float(image[r, c + 1]) - float(image[r, c - 1])) / 2
                dy = (float(image[r + 1, c]) - float(image[r - 1, c])) / 2
                xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
        out[i, 0], out[i, 1], out[i, 2] = xx, xy, yy


def _mean(image: np.ndarray) -> np.ndarray:
    return cv2.blur(image, (WINDOW, WINDOW), borderType=cv2.BORDER_REFLECT)


def blur_effect(image: np.ndarray) -> float:
    """0 (sharp) .. 1 (blurred): how little a picture loses by being blurred (Crete et al. 2007).

    image : (h, w) uint8
    """
    grey = image.astype(np.float32)
    worst = 0.0
    for axis in (0, 1):
        size = (1, 11) if axis == 0 else (11, 1)
        blurred = cv2.blur(grey, size)
        sharp, soft = np.abs(np.diff(grey, axis=axis)), np.abs(np.diff(blurred, axis=axis))
        total = float(sharp.sum())
        kept = total - float(np.maximum(sharp - soft, 0).sum())
        worst = max(worst, kept / total if total > 0 else 1.0)
    return worst
