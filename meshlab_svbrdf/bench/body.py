"""The workload's object: a bumpy ball in six charts, closed, of as many triangles as asked."""

from __future__ import annotations

import numpy as np

from ..geometry.mesh import Mesh

CHART = (0.325, 0.362)  # of the atlas: six of these fill 70 %, as unwrapped charts do
CELLS = (1 / 3, 1 / 2)
TILED = (0.94, 0.94)  # of a UDIM tile: one of these in each of six
BUMPS = np.array(  # amplitude, then wave vector: what is added to the radius along a direction
    [
        [0.050, 3.0, 1.0, -2.0],
        [0.040, -2.0, 5.0, 3.0],
        [0.022, 7.0, -4.0, 6.0],
        [0.014, -9.0, 8.0, 11.0],
        [0.008, 17.0, 12.0, -15.0],
    ]
)


def body(triangles: int, tiles: bool = False) -> Mesh:
    """About that many triangles (6 charts of n × n quads), numbers exact in float32.

    The charts are the sides of a cube, blown up: vertices on its edges are shared, their texture
    coordinates are not. tiles : each chart has a UDIM tile of its own, 1001-1003 and 1011-1013.
    """
    n = max(2, round((triangles / 12) ** 0.5))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
    quad = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.stack([quad, quad + 1, quad + n + 2, quad, quad + n + 2, quad + n + 1], -1)
    faces = faces.reshape(-1, 3)
    lattice, triples, uv = [], [], []
    for side in range(6):
        axis, far = side % 3, side < 3
        corner = np.empty((len(i), 3), np.int64)
        corner[:, axis] = n if far else 0
        # Turn the near sides over, so that all faces look outwards and no chart is mirrored
        corner[:, (axis + 1) % 3] = i if far else n - i
        corner[:, (axis + 2) % 3] = j
        lattice.append(corner)
        triples.append(faces + side * len(i))
        uv.append(_chart(side, i / n, j / n, tiles)[faces])
    points, shared = np.unique(np.concatenate(lattice), axis=0, return_inverse=True)
    vertices = _surface(points, n).astype(np.float32).astype(np.float64)
    index = shared.reshape(-1)[np.concatenate(triples)].astype(np.int32)
    normals = Mesh(vertices, index).vertex_normals().astype(np.float32).astype(np.float64)
    wedges = np.concatenate(uv).astype(np.float32).astype(np.float64)
    return Mesh(vertices, index, normals, wedges, np.zeros(len(index), np.int32))


def _surface(lattice: np.ndarray, n: int) -> np.ndarray:
    """Points of the cube's lattice, blown up to the ball by equal angles, and displaced."""
    direction = np.tan((2 * lattice / n - 1) * np.pi / 4)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = 1 + np.sin(direction @ BUMPS[:, 1:].T) @ BUMPS[:, 0]
    return radius[:, None] * direction


def _chart(side: int, u: np.ndarray, v: np.ndarray, tiles: bool) -> np.ndarray:
    """Texture coordinates of a side, in the middle of its cell, or of its tile."""
    cells, chart = ((1.0, 1.0), TILED) if tiles else (CELLS, CHART)
    cell = np.array([side % 3, side // 3])
    low = (cell + 0.5) * cells - np.array(chart) / 2
    return low + np.stack([u, v], -1) * chart
