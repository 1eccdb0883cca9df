"""Pictures made comparable: local mean and contrast divided out, so that exposure and broad
highlights change little."""

from __future__ import annotations

import cv2
import numpy as np

WINDOW = 31  # pixels
GAIN = 40.0  # codes per local standard deviation
NOISE = 6.0  # codes of contrast that are not made more of


def to_grey(image: np.ndarray) -> np.ndarray:
    """(h, w) or (h, w, 3) uint8 sRGB to (h, w) uint8."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def normalise(image: np.ndarray, valid: np.ndarray, *others: np.ndarray) -> list[np.ndarray]:
    """Images (h, w) whose local mean, over the valid pixels, is 128 and whose contrast is GAIN.

    valid : (h, w) uint8, 1 or 0; elsewhere the result is 128
    """
    mask = valid.astype(np.float32)
    share = np.maximum(_mean(mask), 1e-3)
    result = []
    for each in (image, *others):
        masked = each * mask
        mean = _mean(masked) / share
        variance = np.maximum(_mean(masked * masked) / share - mean * mean, 0)
        flat = (masked - mean) * (GAIN / (np.sqrt(variance) + NOISE))
        result.append(np.where(valid > 0, np.clip(128.5 + flat, 0, 255), 128).astype(np.uint8))
    return result


def structure(image: np.ndarray, window: int):
    """Mean products of the image's slopes over a window: xx, xy, yy, each (h, w) float32."""
    dx, dy = (cv2.Scharr(image, cv2.CV_32F, *d, scale=1 / 32) for d in ((1, 0), (0, 1)))
    return tuple(cv2.blur(p, (window, window)) for p in (dx * dx, dx * dy, dy * dy))


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
