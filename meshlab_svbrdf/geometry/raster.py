"""The one rasteriser: which face a camera sees at each pixel, and how far away.

Corners are projected once. A small face tests the pixels around it, eight at a time without a
branch; a large one is filled row by row between its edges. A face that reaches behind the camera is
filled in homogeneous image coordinates (Olano and Greer 1997), which need no clipping.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .camera import Camera

_NEAR = 1e-9  # depth, in world units, at which a corner counts as behind the camera
LANES = 8  # pixels that are tested without a branch
_WIDE = 1e7  # pixels; farther out the edges' double precision gives out


@njit(cache=True, nogil=True, error_model="numpy")
def project_vertices(vertices, R, t, fx, fy, cx, cy, out):
    """Columns, rows and 1/z of vertices (V, 3) to `out` (V, 3) float64; 1/z = 0 is behind."""
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        depth = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2]
        if not depth > _NEAR:
            out[i, 0], out[i, 1], out[i, 2] = 0.0, 0.0, 0.0
            continue
        w = 1.0 / depth
        u = fx * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0]) * w + cx
        v = fy * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1]) * w + cy
        out[i, 0], out[i, 1], out[i, 2] = u, v, w if abs(u) < _WIDE and abs(v) < _WIDE else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _put(inverse_depth, face_index, row, col, w, f):
    if w > inverse_depth[row, col]:
        inverse_depth[row, col] = w
        if len(face_index):
            face_index[row, col] = f


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_homogeneous(a, b, c, f, inverse_depth, face_index):
    """Fill one face whose corners, homogeneous (u z, v z, z), may lie behind the camera."""
    height, width = inverse_depth.shape
    if max(a[2], b[2], c[2]) <= _NEAR:
        return
    e0, e1, e2 = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    det = a[0] * e0[0] + a[1] * e0[1] + a[2] * e0[2]
    if det == 0.0:
        return
    e0, e1, e2 = e0 / det, e1 / det, e2 / det
    # A pixel far out may be under the face through infinity only: all are tested
    for row in range(height):
        for col in range(width):
            w0 = e0[0] * col + e0[1] * row + e0[2]
            w1 = e1[0] * col + e1[1] * row + e1[2]
            w2 = e2[0] * col + e2[1] * row + e2[2]
            if w0 >= 0.0 and w1 >= 0.0 and w2 >= 0.0:
                _put(inverse_depth, face_index, row, col, w0 + w1 + w2, f)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_small(edges, plane, left, top, bottom, f, inverse_depth, face_index):
    """Test the pixels of a face that is at most `LANES` wide."""
    (u0, v0, u1, v1), (_, _, u2, v2), _ = edges
    du, dv, base, least, most = plane
    # Edge functions about the first pixel: in float32, for they are small here
    a0, b0, c0 = _edge_function(u0, v0, u1, v1, left, top)
    a1, b1, c1 = _edge_function(u1, v1, u2, v2, left, top)
    a2, b2, c2 = _edge_function(u2, v2, u0, v0, left, top)
    first, slope = np.float32(base + du * left + dv * top), np.float32(du)
    down, least, most = np.float32(dv), np.float32(least), np.float32(most)
    for row in range(bottom - top + 1):
        r = np.float32(row)
        e0, e1, e2, w0 = c0 + b0 * r, c1 + b1 * r, c2 + b2 * r, first + down * r
        depth = inverse_depth[top + row, left : left + LANES]
        for lane in range(LANES):
            x = np.float32(lane)
            inside = (e0 + a0 * x >= 0) & (e1 + a1 * x >= 0) & (e2 + a2 * x >= 0)
            w = min(max(w0 + slope * x, least), most)
            if len(face_index) and inside and w > depth[lane]:
                face_index[top + row, left + lane] = f
            depth[lane] = max(depth[lane], w if inside else np.float32(0))


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_function(u0, v0, u1, v1, left, top):
    """a, b, c of a · column + b · row + c, which is ≥ 0 inside; pixels count from (left, top).

    Faces overlap by a 100 000th of a pixel, so that rounding leaves no hole between them.
    """
    a, b = v0 - v1, u1 - u0
    c = a * (left - u0) + b * (top - v0) + 1e-5 * (abs(a) + abs(b))
    return np.float32(a), np.float32(b), np.float32(c)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_rows(edges, plane, top, bottom, f, inverse_depth, face_index):
    """Fill a face row by row, each edge a bound of the columns from the left or the right."""
    du, dv, base, least, most = plane
    for row in range(top, bottom + 1):
        left, right = 0.0, inverse_depth.shape[1] - 1.0
        for u0, v0, u1, v1 in edges:
            if v0 > v1:
                left = max(left, np.ceil(u0 + (u1 - u0) * (row - v0) / (v1 - v0)))
            elif v0 < v1:
                right = min(right, np.floor(u0 + (u1 - u0) * (row - v0) / (v1 - v0)))
        start = base + dv * row
        for col in range(int(left), int(right) + 1):
            _put(inverse_depth, face_index, row, col, min(max(start + du * col, least), most), f)


@njit(cache=True, nogil=True, error_model="numpy")
def _rasterise(points, homogeneous, faces, front, inverse_depth, face_index):
    """Keep, at each pixel centre, the largest 1/z of the faces over it and that face's index.

    front : 1 or −1, the sign of the image area of faces to fill; 0: both
    """
    height, width = inverse_depth.shape
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        w0, w1, w2 = points[i, 2], points[j, 2], points[k, 2]
        if w0 == 0.0 or w1 == 0.0 or w2 == 0.0:
            _fill_homogeneous(
                homogeneous[i], homogeneous[j], homogeneous[k], f, inverse_depth, face_index
            )
            continue
        u0, v0, u1, v1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        u2, v2 = points[k, 0], points[k, 1]
        # Skip what lies between pixel centres or outside, and what faces away
        top = int(max(np.ceil(min(v0, v1, v2)), 0.0))
        bottom = int(min(np.floor(max(v0, v1, v2)), height - 1.0))
        if top > bottom or max(u0, u1, u2) < 0.0 or min(u0, u1, u2) > width - 1.0:
            continue
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        if not abs(area) > 0.0 or area * front < 0.0:
            continue
        if area < 0.0:
            u1, v1, w1, u2, v2, w2 = u2, v2, w2, u1, v1, w1
            area = -area
        # 1/z is linear in the pixel, and never beyond the corners'
        du = ((w1 - w0) * (v2 - v0) - (w2 - w0) * (v1 - v0)) / area
        dv = ((w2 - w0) * (u1 - u0) - (w1 - w0) * (u2 - u0)) / area
        plane = (du, dv, w0 - du * u0 - dv * v0, min(w0, w1, w2), max(w0, w1, w2))
        edges = ((u0, v0, u1, v1), (u1, v1, u2, v2), (u2, v2, u0, v0))
        left, right = np.ceil(min(u0, u1, u2)), np.floor(max(u0, u1, u2))
        if left >= 0.0 and right < left + LANES and left + LANES <= width:
            _fill_small(edges, plane, int(left), top, bottom, f, inverse_depth, face_index)
        else:
            _fill_rows(edges, plane, top, bottom, f, inverse_depth, face_index)


def _fill(vertices, faces, camera: Camera, front: int, inverse_depth, face_index) -> None:
    points = np.empty((len(vertices), 3))
    project_vertices(
        vertices, camera.R, camera.t, camera.fx, camera.fy, camera.cx, camera.cy, points
    )
    # Only faces behind the camera need their corners in the other form
    behind = points[:, 2] == 0.0
    homogeneous = (vertices @ camera.R.T + camera.t) @ camera.K.T if behind.any() else points
    _rasterise(points, homogeneous, faces, front, inverse_depth, face_index)


def rasterise(
    vertices: np.ndarray, faces: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest surface at each pixel centre.

    Parameters
    ----------
    vertices : (V, 3) float64, in the camera's world
    faces : (F, 3) int32

    Returns
    -------
    inverse_depth : (H, W) float32, 1/z in world units; 0 where nothing is seen
    face_index : (H, W) int32, -1 where nothing is seen
    """
    inverse_depth = np.zeros((camera.height, camera.width), np.float32)
    face_index = np.full((camera.height, camera.width), -1, np.int32)
    _fill(vertices, faces, camera, 0, inverse_depth, face_index)
    return inverse_depth, face_index


def rasterise_depth(
    vertices: np.ndarray, faces: np.ndarray, camera: Camera, front: int = 0
) -> np.ndarray:
    """As `rasterise`, 1/z alone.

    front : the sign of the image area (y down) of the faces to fill, where only those of one side
        can be seen because the surface is closed; 0: all faces
    """
    inverse_depth = np.zeros((camera.height, camera.width), np.float32)
    _fill(vertices, faces, camera, front, inverse_depth, np.zeros((0, 0), np.int32))
    return inverse_depth
