"""sRGB and linear light, and the luminance that every stage compares by (Rec. 709, 0..100)."""

from __future__ import annotations

import numpy as np

REC709 = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear sRGB primaries."""


def decode(srgb: np.ndarray) -> np.ndarray:
    """sRGB in 0..1 to linear light in 0..1 (IEC 61966-2-1); exact inverse of `encode`."""
    srgb = np.asarray(srgb, np.float64)
    return np.where(
        srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4
    )


def encode(linear: np.ndarray) -> np.ndarray:
    """Linear light in 0..1 to sRGB in 0..1 (IEC 61966-2-1)."""
    linear = np.asarray(linear, np.float64)
    return np.where(
        linear <= 0.0031308,
        12.92 * linear,
        1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055,
    )


def to_srgb8(linear: np.ndarray) -> np.ndarray:
    """Linear light in 0..1 to 8-bit sRGB, clipped; NaN becomes 0."""
    return np.rint(255 * encode(np.clip(np.nan_to_num(linear), 0, 1))).astype(np.uint8)


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Linear Y of linear RGB (..., 3), in the same scale."""
    return np.asarray(rgb) @ REC709.astype(np.asarray(rgb).dtype)
