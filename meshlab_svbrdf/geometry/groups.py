"""Groups of neighbouring points of a surface, texels or faces, that a frame can pass over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..blocks import BLOCK, blocks, room, rowwise
from ..jit import kernel

GROUP = 64
"""Consecutive points in a group."""
_MARGIN = 1e-3  # radians, for the rounding of float32 normals


class Groups(NamedTuple):
    """Balls around the points of each of G groups, and cones around their normals.

    center : (G, 3) float64; radius : (G,) float64
    axis : (G, 3) float64, unit
    cosine, sine : (G,) float64, of the angle between the axis and the direction to an eye at the
        ball's centre from which on no point can see it
    """

    center: np.ndarray
    radius: np.ndarray
    axis: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray


def group(position: np.ndarray, normal: np.ndarray, cut: float) -> Groups:
    """Bound every `GROUP` consecutive points; the last group may be smaller.

    position, normal : (N, 3) float; a normal of zero sees nothing
    cut : the least cosine between a normal and the direction to the eye that counts as seeing it
    """
    count = -(-len(position) // GROUP)
    groups = Groups(*(np.zeros((count, *axes)) for axes in ((3,), (), (3,), (), ())))
    for own in blocks(count, BLOCK // GROUP):
        points = slice(own.start * GROUP, own.stop * GROUP)
        for whole, part in zip(groups, _bound(position[points], normal[points], cut), strict=True):
            whole[own] = part
    return groups


def _bound(position: np.ndarray, normal: np.ndarray, cut: float) -> Groups:
    """`group` of a block."""
    first = np.arange(0, len(position), GROUP)
    of = np.arange(len(position)) // GROUP
    low, high = (f.reduceat(position, first).astype(float) for f in (np.minimum, np.maximum))
    center = (low + high) / 2
    away = np.linalg.norm(position - center[of], axis=1)
    axis = np.add.reduceat(normal, first).astype(float)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.divide(axis, length, out=np.zeros_like(axis), where=length > 0)
    turn = np.arccos(np.clip(np.einsum("td,td->t", normal, axis[of]), -1, 1))
    turn[~normal.any(axis=1)] = 0
    angle = np.maximum.reduceat(turn, first) + np.arccos(cut) + _MARGIN
    angle = np.minimum(angle, np.pi)
    return Groups(center, np.maximum.reduceat(away, first), axis, np.cos(angle), np.sin(angle))


@kernel
def faces_away(groups, g, eye):
    """Whether no point of group g can see the eye."""
    vx, vy, vz = (
        eye[0] - groups.center[g, 0],
        eye[1] - groups.center[g, 1],
        eye[2] - groups.center[g, 2],
    )
    distance = np.sqrt(vx * vx + vy * vy + vz * vz)
    sine = groups.radius[g] / distance  # of the angle under which the eye sees the ball
    cosine, away = groups.cosine[g], groups.sine[g]
    if not sine < 1.0 or (cosine < 0.0 and sine >= away):  # any direction may be turned to the eye
        return False
    along = (groups.axis[g, 0] * vx + groups.axis[g, 1] * vy + groups.axis[g, 2] * vz) / distance
    return along < cosine * np.sqrt(1.0 - sine * sine) - away * sine


def walk(position: np.ndarray) -> np.ndarray:
    """An order (N,) of points (N, 3) in which neighbours stay near: interleaved 10-bit codes."""
    low, extent = position.min(0), max(float(np.ptp(position, axis=0).max()), 1e-30)
    key = room(len(position), np.uint64)  # the code, and after it the place so far
    spreading = (16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)
    for own in blocks(len(position)):
        code = np.zeros(own.stop - own.start, np.uint32)
        for axis in range(3):
            x = ((position[own, axis] - low[axis]) / extent * 1023).astype(np.uint32)
            for shift, mask in spreading:
                x = (x | (x << np.uint32(shift))) & np.uint32(mask)
            code |= x << np.uint32(axis)
        place = np.arange(own.start, own.stop, dtype=np.uint64)
        key[own] = code.astype(np.uint64) << np.uint64(32) | place
    key.sort()
    return rowwise(lambda some: (some & np.uint64(0xFFFFFFFF)).astype(np.int64), key)
