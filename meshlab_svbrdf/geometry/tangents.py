"""Two directions across a normal, for kernels."""

from __future__ import annotations

import numpy as np

from ..jit import kernel


@kernel
def tangents(x, y, z):
    """Two unit vectors that span the plane across the unit normal (x, y, z)."""
    if abs(x) < 0.9:
        ax, ay, az = 0.0, z, -y
    else:
        ax, ay, az = -z, 0.0, x
    scale = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * scale, ay * scale, az * scale
    return ax, ay, az, y * az - z * ay, z * ax - x * az, x * ay - y * ax
