"""How much a pixel blurs a lobe: it averages over the mirror directions that it covers.

A pixel that moves on the image by δp moves on the surface, which turns the normal by S δx, the
view by δv, and the mirror direction r = 2 (n·v) n − v by J δp. A pixel's spread of variance σ² per
axis thus spreads the mirror direction by the covariance σ² J Jᵀ, of the variances s₁, s₂ along its
axes. A lobe of shininess α seems to have, along each axis,

    1/α' = 1/α + s,   and the height √(α'₁ α'₂) / α, which is what a blur leaves of it.
"""

from __future__ import annotations

import numpy as np

from ..geometry.tangents import tangents
from ..jit import inner, kernel
from .footprint import SPREAD

SHARP = 2e-4
"""Of 1/α, the blur below which a lobe is as good as sharp."""


@inner
def _swing(shape, n, vx, vy, vz, facing, near, qx, qy, qz):
    """J q of a step q across the view, in the mesh's units; near = 1 / distance."""
    # Stay on the surface
    away = (n[0] * qx + n[1] * qy + n[2] * qz) / facing
    x, y, z = qx - away * vx, qy - away * vy, qz - away * vz
    tx = shape[0, 0] * x + shape[0, 1] * y + shape[0, 2] * z
    ty = shape[1, 0] * x + shape[1, 1] * y + shape[1, 2] * z
    tz = shape[2, 0] * x + shape[2, 1] * y + shape[2, 2] * z
    # dr = 2 (δn·v + n·δv) n + 2 (n·v) δn − δv, and δv = −q / distance
    swing = tx * vx + ty * vy + tz * vz - (n[0] * qx + n[1] * qy + n[2] * qz) * near
    return (
        2.0 * (swing * n[0] + facing * tx) + qx * near,
        2.0 * (swing * n[1] + facing * ty) + qy * near,
        2.0 * (swing * n[2] + facing * tz) + qz * near,
    )


@inner
def pixel_blur(view, pixel, shape, t, f):
    """The covariance of the mirror directions that a pixel covers, radians².

    Texel t, whose normals turn by `shape` (3, 3), is seen from frame f; pixel : (F,), radians that
    the frames' pixels subtend.

    Returns x, y, z, s₂: the vector √s₁ along the longer axis, and the variance across it. 0 where
    the shape is not known.
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
        return 0.0, 0.0, 0.0, 0.0
    ax, ay, az, bx, by, bz = tangents(vx, vy, vz)
    px, py, pz = _swing(shape, n, vx, vy, vz, facing, near, ax, ay, az)
    qx, qy, qz = _swing(shape, n, vx, vy, vz, facing, near, bx, by, bz)
    # Turn both so that they become the axes: J Jᵀ = p pᵀ + q qᵀ stays as it is
    pp = px * px + py * py + pz * pz
    pq = px * qx + py * qy + pz * qz
    qq = qx * qx + qy * qy + qz * qz
    half = 0.5 * (pp - qq)
    root = np.sqrt(half * half + pq * pq)
    c = np.sqrt(0.5 + 0.5 * half / root) if root > 0.0 else 1.0
    s = np.sqrt(max(1.0 - c * c, 0.0)) * np.sign(pq)
    side = np.sqrt(SPREAD) * distance * pixel[f]
    least = 0.5 * (pp + qq) - root
    return (
        side * (c * px + s * qx), side * (c * py + s * qy), side * (c * pz + s * qz),
        side * side * max(least, 0.0),
    )  # fmt: skip


@kernel
def along_and_across(cos, x, y, z, ray, s1):
    """How far a lamp stands from the mirror direction: −ln cos, shared out to a blur's two axes.

    x, y, z, s1 : from `pixel_blur`, s1 = x² + y² + z²
    """
    u = -np.log(min(cos, 1.0))
    sine = 1.0 - cos * cos
    if not (sine > 1e-12 and s1 > 0.0):
        return 0.0, u
    across = ray[0] * x + ray[1] * y + ray[2] * z
    part = u * min(across * across / (s1 * sine), 1.0)
    return part, u - part


@kernel
def blurred_lobe(alpha, u1, u2, s1, s2):
    """What is left of cos^α; u1, u2 from `along_and_across`; 0 below e⁻¹⁴ of its height."""
    if alpha * s1 < SHARP:
        e = alpha * (u1 + u2)
        return np.exp(-e) if e < 14.0 else 0.0
    h1, h2 = 1.0 / (1.0 + alpha * s1), 1.0 / (1.0 + alpha * s2)
    e = alpha * (h1 * u1 + h2 * u2)
    return np.sqrt(h1 * h2) * np.exp(-e) if e < 14.0 else 0.0
