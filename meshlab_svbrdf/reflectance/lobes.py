"""Phong lobes of all samples of a texel at once, sharp or blurred by pixels (`pixel_blur`).

Rows are taken by their numbers: unpacked, they would not be known to be contiguous.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner, kernel
from ..power import FAST, LANES, exp, ln

LEAST = np.float32(0.01)
"""Cosine of the farthest mirror direction that a lamp's lobe reaches."""
FAR = np.float32(1e6)
"""−ln cos beyond it."""
NOTHING = 14.0
"""−ln of what is left of a lobe's height where it ends."""


STRETCH = 64
"""Samples, one after the other, that a lamp's lobe reaches or not: their directions are alike."""


@inner(fastmath=FAST)
def _cosines(x, y, z, a, b, c, out):
    for j in range(len(x)):
        out[j] = a * x[j] + b * y[j] + c * z[j]


@inner(fastmath=LANES)
def _some_above(values, bound):
    """How many are above the bound."""
    count = np.float32(0)
    for j in range(len(values)):
        count += np.float32(1) if values[j] > bound else np.float32(0)
    return count


@inner(fastmath=FAST)
def _add_powers(cos, power, gain, out):
    for j in range(len(cos)):
        out[j] += gain * exp(power * ln(max(cos[j], np.float32(1e-9))))


@kernel
def add_sharp(x, y, z, rays, gains, alpha, rho, out):
    """Add ρ Σ_k g_k (l_k·r)₊^α of the mirror directions x, y, z (n,) to out (n,); float32.

    Lamps are left out for stretches of samples before all of which their lobes have ended.
    """
    power, reached = np.float32(alpha), np.float32(np.exp(-NOTHING / alpha))
    n, cos = len(x), np.empty(STRETCH, np.float32)
    for k in range(len(gains)):
        if gains[k] > 0:
            a, b, c, gain = rays[k, 0], rays[k, 1], rays[k, 2], np.float32(rho * gains[k])
            for first in range(0, n, STRETCH):
                stop = min(first + STRETCH, n)
                own = cos[: stop - first]
                _cosines(x[first:stop], y[first:stop], z[first:stop], a, b, c, own)
                if _some_above(own, reached) > 0:
                    _add_powers(own, power, gain, out[first:stop])


@kernel
def clear(n, out):
    """0 to out (n,); assigned to a slice it would take seconds to compile."""
    for j in range(n):
        out[j] = 0.0


@kernel
def take(mirror, blur, first, n, columns):
    """Mirror directions and blur, x y z and bx by bz s₁ s₂, to columns (8, n); the greatest s₁."""
    most = np.float32(0)
    for j in range(n):
        bx, by, bz = blur[first + j, 0], blur[first + j, 1], blur[first + j, 2]
        s1 = bx * bx + by * by + bz * bz
        most = max(most, s1)
        columns[0, j], columns[1, j] = mirror[first + j, 0], mirror[first + j, 1]
        columns[2, j], columns[3, j] = mirror[first + j, 2], bx
        columns[4, j], columns[5, j], columns[6, j], columns[7, j] = by, bz, s1, blur[first + j, 3]
    return most


@inner(fastmath=LANES)
def _least_sum(n, u1, u2):
    least = FAR
    for j in range(n):
        least = min(least, u1[j] + u2[j])
    return least


@kernel(fastmath=FAST)
def part(columns, n, ray, u1, u2):
    """How far a lamp stands from the mirror directions: −ln cos, shared out to the blur's axes.

    To u1, u2 (n,), along and across; returns the least of their sum.
    """
    a, b, c = ray[0], ray[1], ray[2]
    x, y, z, s1 = columns[0], columns[1], columns[2], columns[6]
    bx, by, bz = columns[3], columns[4], columns[5]
    for j in range(n):
        cos = a * x[j] + b * y[j] + c * z[j]
        u = -ln(min(max(cos, LEAST), np.float32(1)))
        along = a * bx[j] + b * by[j] + c * bz[j]
        spread = s1[j] * (np.float32(1) - cos * cos)
        share = min(along * along / max(spread, np.float32(1e-20)), np.float32(1))
        u = u if cos > LEAST else FAR
        u1[j] = u * share
        u2[j] = u - u1[j]
    return _least_sum(n, u1, u2)


@inner(fastmath=FAST)
def soften(columns, n, alpha, h1, h2, height):
    """What blur makes of the shininess α: α h₁ and α h₂ along its axes, and the lobe's height."""
    power = np.float32(alpha)
    s1, s2 = columns[6], columns[7]
    for j in range(n):
        a = np.float32(1) / (np.float32(1) + power * s1[j])
        b = np.float32(1) / (np.float32(1) + power * s2[j])
        h1[j], h2[j], height[j] = power * a, power * b, np.sqrt(a * b)


@kernel(fastmath=FAST)
def add(n, gain, h1, h2, height, u1, u2, out):
    """Add a lamp's lobe to out (n,)."""
    for j in range(n):
        out[j] += gain * height[j] * exp(-(h1[j] * u1[j] + h2[j] * u2[j]))


@kernel
def add_blurred(mirror, blur, first, n, rays, gains, alpha, scratch, out):
    """Add φ of the samples first..first + n to out (n,), scratch (13, n); all float32."""
    columns, u1, u2 = scratch[:8], scratch[8], scratch[9]
    h1, h2, height = scratch[10], scratch[11], scratch[12]
    blurriest = take(mirror, blur, first, n, columns)
    soften(columns, n, alpha, h1, h2, height)
    for k in range(len(gains)):
        if gains[k] > 0:
            least = part(columns, n, rays[k], u1, u2)
            if alpha * least <= NOTHING * (1.0 + alpha * blurriest):
                add(n, gains[k], h1, h2, height, u1, u2, out)
