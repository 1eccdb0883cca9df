"""Texels at the edges of shadows: a lamp that is seen in part, or only perhaps.

A ray to a lamp's middle says lit or not. Near a shadow's edge it is wrong by up to a whole lobe,
and all on one side of the lamp: such texels pull it away. They are left out of the fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..samples.observations import Observations
from .lights import Light, tangents
from .phong import cast_shadows

MARGIN = np.radians(3)
"""Beyond a lamp's bar and breadth: how large a compact lamp may be, and what the scan may err."""
STILL = 0.1 * MARGIN
"""By which a light moves before its edges are looked for anew."""
LEAST = 0.1
"""Of a material's texels that stay; where shadows have edges everywhere, none is left out."""


def shadow_edges(
    observations: Observations, texels: np.ndarray, lights: list[Light], lit: np.ndarray
) -> np.ndarray:
    """Which of some texels (n,) see a light in part: (n,) bool.

    lit : (T, K), what their rays to the lights' middles say, from `cast_shadows`
    """
    edge = np.zeros(len(texels), bool)
    for corner in range(4):
        seen = cast_shadows(observations, texels, [_rim(light, corner) for light in lights])
        assert seen is not None
        edge |= (seen[texels] != lit[texels]).any(axis=1)
    return edge


def alike(lights: list[Light], others: list[Light]) -> bool:
    """Whether the edges of both lights' shadows are the same, but for a tenth of the margin."""
    return len(lights) == len(others) and all(
        np.linalg.norm([*(a.direction - b.direction), a.curvature - b.curvature]) < STILL
        and np.linalg.norm([*(a.bar - b.bar), a.breadth - b.breadth]) < STILL
        for a, b in zip(lights, others, strict=True)
    )


def kept(edge: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Which texels (n,) are fitted: not those at edges, unless a material would have hardly any."""
    keep = ~edge
    for m in np.unique(material):
        own = material == m
        if keep[own].mean() < LEAST:
            keep[own] = True
    return keep


def _rim(light: Light, corner: int) -> Light:
    """A point beside the lamp, beyond the middle of one of its four sides, as a light."""
    if light.bar.any():
        length = float(np.linalg.norm(light.bar))
        reach = np.array([length, light.breadth]) + np.tan(MARGIN)
        axes = reach[:, None] * np.array([light.bar / length, light.side])
    else:
        axes = tangents(light.direction) * np.tan(MARGIN)
    away = light.direction + (1 - 2 * (corner % 2)) * axes[corner // 2]
    return replace(light, direction=away / np.linalg.norm(away), bar=np.zeros(3), breadth=0.0)
