"""How much a pixel blurs a lobe: it averages over the mirror directions that it covers.

A pixel that moves on the image by δp moves on the surface, which turns the normal by S δx, the
view by δv, and the mirror direction r = 2 (n·v) n − v by J δp. A pixel's spread of variance σ² per
axis thus spreads the mirror direction by J Jᵀ σ², and a lobe of shininess α seems to be one of

    1/α' = 1/α + b,   b = σ² tr(J Jᵀ)/2,   of the height α'/α (what a blur leaves of it).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .footprint import tangents

SPREAD = 1 / 12 + 1 / 6
"""Pixels², variance per axis of what a sample averages over: a pixel is a box (1/12), and between
two of them bilinear weights spread a sample by a (1 − a), which is 1/6 on average."""


@njit(cache=True, nogil=True)
def _squared_turn(shape, n, vx, vy, vz, facing, near, qx, qy, qz):
    """|J q|² of a step q across the view, as long as the distance's unit; near = 1 / distance."""
    # Stay on the surface
    away = (n[0] * qx + n[1] * qy + n[2] * qz) / facing
    x, y, z = qx - away * vx, qy - away * vy, qz - away * vz
    tx = shape[0, 0] * x + shape[0, 1] * y + shape[0, 2] * z
    ty = shape[1, 0] * x + shape[1, 1] * y + shape[1, 2] * z
    tz = shape[2, 0] * x + shape[2, 1] * y + shape[2, 2] * z
    # dr = 2 (δn·v + n·δv) n + 2 (n·v) δn − δv, and δv = −q / distance
    swing = tx * vx + ty * vy + tz * vz - (n[0] * qx + n[1] * qy + n[2] * qz) * near
    rx = 2.0 * (swing * n[0] + facing * tx) + qx * near
    ry = 2.0 * (swing * n[1] + facing * ty) + qy * near
    rz = 2.0 * (swing * n[2] + facing * tz) + qz * near
    return rx * rx + ry * ry + rz * rz


@njit(cache=True, nogil=True)
def pixel_blur(view, pixel, shape, t, f):
    """b of texel t, whose normals turn by `shape` (3, 3), seen from frame f; radians².

    pixel : (F,), radians that the frames' pixels subtend. 0 where the shape is not known.
    """
    n = view.normal[t]
    vx = view.eyes[f, 0] - view.position[t, 0]
    vy = view.eyes[f, 1] - view.position[t, 1]
    vz = view.eyes[f, 2] - view.position[t, 2]
    distance = np.sqrt(vx * vx + vy * vy + vz * vz)
    near = 1.0 / distance
    vx, vy, vz = vx * near, vy * near, vz * near
    facing = n[0] * vx + n[1] * vy + n[2] * vz
    if not facing > 0.0 or not np.isfinite(shape[0, 0]):
        return 0.0
    ax, ay, az, bx, by, bz = tangents(vx, vy, vz)
    total = _squared_turn(shape, n, vx, vy, vz, facing, near, ax, ay, az)
    total += _squared_turn(shape, n, vx, vy, vz, facing, near, bx, by, bz)
    side = distance * pixel[f]
    return 0.5 * SPREAD * side * side * total
