"""Groups of neighbouring texels, which a frame can pass over as a whole."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..jit import kernel
from .texels import Texels

GROUP = 64
"""Consecutive texels in a group: they are neighbours on the surface."""
_MARGIN = 1e-3  # radians, for the rounding of float32 normals


class TexelGroups(NamedTuple):
    """Balls around the texels of each of G groups, and cones around their normals.

    center : (G, 3) float64, about the texels' centre; radius : (G,) float64
    axis : (G, 3) float64, unit; spread : (G,) float64, radians from the axis to the farthest normal
    """

    center: np.ndarray
    radius: np.ndarray
    axis: np.ndarray
    spread: np.ndarray


def group_texels(texels: Texels) -> TexelGroups:
    """Bound every `GROUP` consecutive texels; the last group may be smaller."""
    first = np.arange(0, len(texels), GROUP)
    if not len(first):
        return TexelGroups(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0))
    group = np.arange(len(texels)) // GROUP
    low, high = (f.reduceat(texels.position, first).astype(float) for f in (np.minimum, np.maximum))
    center = (low + high) / 2
    away = np.linalg.norm(texels.position - center[group], axis=1)
    axis = np.add.reduceat(texels.normal, first).astype(float)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.divide(axis, length, out=np.zeros_like(axis), where=length > 0)
    turn = np.arccos(np.clip(np.einsum("td,td->t", texels.normal, axis[group]), -1, 1))
    return TexelGroups(
        center, np.maximum.reduceat(away, first), axis, np.maximum.reduceat(turn, first)
    )


@kernel
def faces_away(groups, g, eye, cut):
    """Whether no texel of group g can see the eye at a cosine of `cut` or more."""
    vx, vy, vz = (
        eye[0] - groups.center[g, 0],
        eye[1] - groups.center[g, 1],
        eye[2] - groups.center[g, 2],
    )
    distance = np.sqrt(vx * vx + vy * vy + vz * vz)
    if distance <= groups.radius[g]:
        return False
    cos = (groups.axis[g, 0] * vx + groups.axis[g, 1] * vy + groups.axis[g, 2] * vz) / distance
    reach = groups.spread[g] + np.arcsin(groups.radius[g] / distance) + np.arccos(cut) + _MARGIN
    return reach < np.pi and cos < np.cos(reach)
