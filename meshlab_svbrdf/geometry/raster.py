"""The one rasteriser: which face a camera sees at each pixel, and how far away.

It works in homogeneous image coordinates (Olano and Greer 1997), so that a triangle that reaches
behind the camera needs no clipping.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .camera import Camera


@njit(cache=True, nogil=True)
def _rasterise(points, faces, fx, fy, cx, cy, inverse_depth, face_index):
    """Keep, at each pixel centre, the largest 1/z of the faces over it and that face's index."""
    height, width = inverse_depth.shape
    p = np.empty((3, 3))
    e = np.empty((3, 3))
    for f in range(faces.shape[0]):
        # Bring the corners to homogeneous image coordinates (u z, v z, z)
        behind = 0
        u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
        for i in range(3):
            x, y, z = points[faces[f, i], 0], points[faces[f, i], 1], points[faces[f, i], 2]
            p[i, 0], p[i, 1], p[i, 2] = fx * x + cx * z, fy * y + cy * z, z
            if z > 1e-9:
                u, v = p[i, 0] / z, p[i, 1] / z
                u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
            else:
                behind += 1
        if behind == 3:
            continue
        if behind > 0:
            u0, u1, v0, v1 = 0.0, width - 1.0, 0.0, height - 1.0
        left, right = (
            int(min(max(np.ceil(u0), 0.0), width)),
            int(max(min(np.floor(u1), width - 1.0), -1.0)),
        )
        top, bottom = (
            int(min(max(np.ceil(v0), 0.0), height)),
            int(max(min(np.floor(v1), height - 1.0), -1.0)),
        )
        if left > right or top > bottom:
            continue
        # Set up edge functions and 1/z, all linear in the pixel
        for i in range(3):
            a, b = p[(i + 1) % 3], p[(i + 2) % 3]
            e[i, 0] = a[1] * b[2] - a[2] * b[1]
            e[i, 1] = a[2] * b[0] - a[0] * b[2]
            e[i, 2] = a[0] * b[1] - a[1] * b[0]
        det = p[0, 0] * e[0, 0] + p[0, 1] * e[0, 1] + p[0, 2] * e[0, 2]
        if det == 0.0:
            continue
        for i in range(3):
            for j in range(3):
                e[i, j] /= det
        wx, wy, w1 = (
            e[0, 0] + e[1, 0] + e[2, 0],
            e[0, 1] + e[1, 1] + e[2, 1],
            e[0, 2] + e[1, 2] + e[2, 2],
        )
        for row in range(top, bottom + 1):
            for col in range(left, right + 1):
                if (
                    e[0, 0] * col + e[0, 1] * row + e[0, 2] >= 0.0
                    and e[1, 0] * col + e[1, 1] * row + e[1, 2] >= 0.0
                    and e[2, 0] * col + e[2, 1] * row + e[2, 2] >= 0.0
                ):
                    w = wx * col + wy * row + w1
                    if w > inverse_depth[row, col]:
                        inverse_depth[row, col] = w
                        face_index[row, col] = f


def rasterise(
    vertices: np.ndarray, faces: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest surface at each pixel centre.

    Parameters
    ----------
    vertices : (V, 3) float, in the camera's world
    faces : (F, 3) int32

    Returns
    -------
    inverse_depth : (H, W) float32, 1/z in world units; 0 where nothing is seen
    face_index : (H, W) int32, -1 where nothing is seen
    """
    points = np.ascontiguousarray(vertices @ camera.R.T + camera.t, dtype=np.float64)
    inverse_depth = np.zeros((camera.height, camera.width), np.float32)
    face_index = np.full((camera.height, camera.width), -1, np.int32)
    _rasterise(points, faces, camera.fx, camera.fy, camera.cx, camera.cy, inverse_depth, face_index)
    return inverse_depth, face_index
