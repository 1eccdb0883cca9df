"""Numbers as colours: scales whose brightness rises evenly."""

from __future__ import annotations

import cv2
import numpy as np


def viridis(share: np.ndarray) -> np.ndarray:
    """Shares (…) of a scale, cut to 0..1, as (…, 3) uint8 sRGB, from violet to yellow."""
    return _table(cv2.COLORMAP_VIRIDIS)[_codes(share)]


def inferno(share: np.ndarray) -> np.ndarray:
    """The same from black over red to bright yellow, for errors."""
    return _table(cv2.COLORMAP_INFERNO)[_codes(share)]


def _codes(share: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)


def _table(scale: int) -> np.ndarray:
    bgr = cv2.applyColorMap(np.arange(256, dtype=np.uint8), scale)
    return bgr.reshape(256, 3)[:, ::-1]
