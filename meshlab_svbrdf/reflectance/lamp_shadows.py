"""Shadows of lamps that have a size: penumbrae, by rays to a disk."""

from __future__ import annotations

import numpy as np

from ..geometry.visibility import Rays, directional_visibility, spread_directions
from .lights import tangents

RAYS = 16
"""To a lamp that has a size, where its middle and rim are not seen alike."""
OUTER = 4
"""Of them, on the rim, that are looked at first."""


def lamp_share(
    rays: Rays, points: np.ndarray, normal: np.ndarray, direction: np.ndarray, curvature: float,
    size: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """The share of a lamp that each point sees, (N,) float64; 0 or 1 where it has no size.

    Parameters
    ----------
    rays : the mesh that casts shadows
    points : (N, 3) world; normal : (N, 3) unit
    direction : (3,) unit, from the mesh's centre; curvature : 1/distance in world units, 0: far
    size : the lamp's radius in radians as seen from the centre
    """

    def seen(place: np.ndarray, some: np.ndarray | slice) -> np.ndarray:
        where = None if curvature == 0 else place / curvature + rays.center
        lamp = [(place / np.linalg.norm(place), where)]
        return directional_visibility(rays, points[some], normal[some], lamp)[:, 0]

    if not size:
        return seen(direction, slice(None)).astype(float)
    # Look at the middle and the rim, then at all of the disk where they differ
    *inner, middle = disk(direction, size)[::-1]
    outer, inner = inner[:OUTER], inner[OUTER:]
    count = sum((seen(place, slice(None)) for place in (middle, *outer)), np.zeros(len(points)))
    partly = np.flatnonzero((count > 0) & (count <= OUTER))
    share = (count > OUTER).astype(float)
    share[partly] = (count[partly] + sum(seen(place, partly) for place in inner)) / RAYS
    return share


def disk(direction: np.ndarray, radius: float) -> np.ndarray:
    """Points spread evenly over a disk that faces the centre, (RAYS, 3), from its middle outwards,
    at the unit distance."""
    turn = np.arctan2(*spread_directions(RAYS)[:, 1::-1].T)
    away = np.sqrt((np.arange(RAYS) + 0.5) / RAYS) * np.tan(radius)
    return direction + (away * [np.cos(turn), np.sin(turn)]).T @ tangents(direction)
