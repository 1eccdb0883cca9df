"""Maps of directions: latitude-longitude for files, octahedral for fast lookup.

Latitude-longitude has its pole at the world's +Y: dir = (sin φ sin θ, cos θ, −cos φ sin θ),
φ = 2π (col + .5) / W, θ = π (row + .5) / H.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner, kernel


def directions(height: int) -> np.ndarray:
    """Unit directions of the pixels' centres, (H, 2H, 3) float64."""
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = np.pi * (np.arange(2 * height) + 0.5) / height
    st, ct = np.sin(theta)[:, None], np.cos(theta)[:, None]
    return np.stack(
        [np.sin(phi) * st, np.broadcast_to(ct, (height, 2 * height)), -np.cos(phi) * st], axis=-1
    )


def solid_angles(height: int) -> np.ndarray:
    """Steradians of the pixels, (H, 2H) float64; they sum to 4π."""
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return np.repeat((edges[:-1] - edges[1:])[:, None] * np.pi / height, 2 * height, axis=1)


@kernel
def pixel(x, y, z, height):
    """Row and column of a unit direction."""
    width = 2 * height
    row = int(np.arccos(min(max(y, -1.0), 1.0)) / np.pi * height)
    phi = np.arctan2(x, -z) / (2.0 * np.pi)
    col = int((phi + 1.0 if phi < 0.0 else phi) * width)
    return min(row, height - 1), min(col, width - 1)


@kernel
def look_up(environment, rays):
    """The map's value along each of the unit directions (N, 3), nearest pixel; NaN along none."""
    out = np.empty(len(rays), np.float64)
    for i in range(len(rays)):
        x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
        if np.isfinite(x + y + z):
            row, col = pixel(x, y, z, environment.shape[0])
            out[i] = environment[row, col]
        else:
            out[i] = np.nan
    return out


def octahedral_directions(size: int) -> np.ndarray:
    """Unit directions of the cells of an octahedral map, (size, size, 3) float64."""
    u = (np.arange(size) + 0.5) * 2 / size - 1
    x, y = np.meshgrid(u, u, indexing="xy")
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0)
    d = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


@kernel
def octahedral_cell(x, y, z, size):
    """Row and column of a direction, of any length, in an octahedral map: no trigonometry."""
    one, half = np.float32(1), np.float32(0.5 * size)
    scale = one / (abs(x) + abs(y) + abs(z))
    u, v = x * scale, y * scale
    if z < 0:
        a, b = one - abs(v), one - abs(u)
        u, v = a if u >= 0 else -a, b if v >= 0 else -b
    row, col = np.int64((v + one) * half), np.int64((u + one) * half)
    return min(row, size - 1), min(col, size - 1)


@inner
def octahedral_cells(x, y, z, size, cell):
    """`octahedral_cell` of directions (n,) float32, to cell (n,) uint32: row · size + column."""
    zero, one, half = np.float32(0), np.float32(1), np.float32(0.5 * size)
    last = np.int32(size - 1)
    for j in range(len(x)):
        scale = one / (abs(x[j]) + abs(y[j]) + abs(z[j]))
        u, v = x[j] * scale, y[j] * scale
        a, b = one - abs(v), one - abs(u)
        a, b = a if u >= zero else -a, b if v >= zero else -b
        u, v = a if z[j] < zero else u, b if z[j] < zero else v
        row, col = np.int32((v + one) * half), np.int32((u + one) * half)
        cell[j] = np.uint32(min(row, last) * np.int32(size) + min(col, last))
