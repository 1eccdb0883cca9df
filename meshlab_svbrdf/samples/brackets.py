"""Exposures of one view merged to one picture, in linear light (Debevec and Malik 1997)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FLOOR = 0.003
"""Light to which noise falls no further: where sRGB turns straight."""
FADE = 0.1
"""Of the light from which a pixel is clipped, over which its weight fades before."""


def merge(
    radiances: Sequence[np.ndarray], clipped: Sequence[float], exposures: Sequence[float]
) -> tuple[np.ndarray, float]:
    """The view as the first exposure would show it, and from where on its pixels may be brighter.

    Each exposure tells light / exposure with a variance of (light + FLOOR) / exposure²: noise of
    the photons, and nearly that of sRGB's codes. Weights are its inverse; light is taken from all
    exposures, for a weight that saw the pixel's own noise would pull. A pixel that is clipped in
    any channel does not count; one that is clipped in all exposures is told by the shortest.

    Parameters
    ----------
    radiances : (H, W, 3) float32 each, linear
    clipped : of each, the light from which on a pixel may have been brighter
    exposures : relative, of each
    """
    exposure = np.asarray(exposures, np.float64) / exposures[0]
    limits = np.asarray(clipped, np.float64)
    shown = [
        np.ones((*light.shape[:2], 1), np.float32) if np.isinf(limit)
        else np.clip((limit - light.max(-1, keepdims=True)) / (FADE * limit), 0, 1).astype("f4")
        for light, limit in zip(radiances, limits, strict=True)
    ]  # fmt: skip
    every = list(zip(radiances, shown, exposure.astype(np.float32), strict=True))
    level = sum(m * v for v, m, _ in every) / np.maximum(sum(m * e for _, m, e in every), 1e-12)
    top, total = np.zeros_like(radiances[0]), np.zeros_like(radiances[0])
    for v, m, e in every:
        weight = m * e * e / (level * e + np.float32(FLOOR))
        top += weight * (v / e)
        total += weight
    shortest = int(np.argmin(exposure))
    merged = np.where(
        total > 0, top / np.maximum(total, 1e-30), radiances[shortest] / exposure[shortest]
    )
    return merged.astype(np.float32), float((limits / exposure).max())
