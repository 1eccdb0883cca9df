"""Numbers as colours: scales whose brightness rises evenly."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ..blocks import places, taken


class Scale(NamedTuple):
    """From where to where colours tell values, and whether they go by their logarithms."""

    low: float
    high: float
    log: bool

    def share(self, values: np.ndarray) -> np.ndarray:
        """How far along the scale values lie, 0..1; NaN stays."""
        place = np.log if self.log else np.asarray
        low, high = place(self.low), place(self.high)
        return (place(np.clip(values, self.low, self.high)) - low) / (high - low)


def scale_of(values: np.ndarray, logarithmic: bool = False) -> Scale:
    """From the first to the last percent of values (T,), NaN where unknown; half of it to both
    sides where all are the same. A logarithmic scale needs values above 0."""
    flat = np.ravel(values)
    known = taken(flat, places(np.isfinite(flat)))
    low, high = (0.0, 1.0)
    if len(known):
        low, high = map(float, np.quantile(known, [0.01, 0.99], overwrite_input=True))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low, high = low - 0.5 * max(abs(low), 1e-3), high + 0.5 * max(abs(high), 1e-3)
    return Scale(low, high, logarithmic and low > 0)


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
