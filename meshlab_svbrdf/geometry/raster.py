"""The one rasteriser: which face a camera sees at each pixel, and how far away.

Corners are projected once. Small faces are prepared several at once, and test the pixels around
them; a large one is filled row by row between its edges. A face that reaches behind the camera is
filled in homogeneous image coordinates (Olano and Greer 1997), which need no clipping.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel
from .camera import Camera

_NEAR = 1e-9  # depth, in world units, at which a corner counts as behind the camera
BATCH = 64  # small faces that are prepared at once
SMALL = 16  # pixels wide and high, below which a face is small: float32 will do
_WIDE = 1e7  # pixels; farther out the edges' double precision gives out


@kernel
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


@kernel
def _put(inverse_depth, face_index, row, col, w, f):
    if w > inverse_depth[row, col]:
        inverse_depth[row, col] = w
        if len(face_index):
            face_index[row, col] = f


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _fill_homogeneous(a, b, c, f, inverse_depth, face_index):
    """Fill one face whose corners, homogeneous (u z, v z, z), may lie behind the camera."""
    height, width = inverse_depth.shape
    if max(a[2], b[2], c[2]) <= _NEAR:
        return
    e0, e1, e2 = _cross(b, c), _cross(c, a), _cross(a, b)
    det = a[0] * e0[0] + a[1] * e0[1] + a[2] * e0[2]
    if det == 0.0:
        return
    # A pixel far out may be under the face through infinity only: all are tested
    for row in range(height):
        for col in range(width):
            w0 = (e0[0] * col + e0[1] * row + e0[2]) / det
            w1 = (e1[0] * col + e1[1] * row + e1[2]) / det
            w2 = (e2[0] * col + e2[1] * row + e2[2]) / det
            if w0 >= 0.0 and w1 >= 0.0 and w2 >= 0.0:
                _put(inverse_depth, face_index, row, col, w0 + w1 + w2, f)


@kernel
def _prepare(corners, edges, depth):
    """Edge functions and depth of small faces: a loop that the compiler makes eight faces wide.

    corners : (10, N) float32: columns and rows of three corners from the face's first pixel on, 1/z
        of the first and how much more that of the others is, twice the area
    edges : (9, N), three times a, b, c of a · column + b · row + c, which is ≥ 0 inside. Faces
        overlap by a 100 000th of a pixel, so that rounding leaves no hole between them.
    depth : (5, N), how much more than at the first corner 1/z is: its slopes along columns and
        rows, its value at the first pixel, its bounds
    """
    u0, v0, u1, v1, u2, v2 = (
        corners[0], corners[1], corners[2], corners[3], corners[4], corners[5],
    )  # fmt: skip
    w01, w02, area = corners[7], corners[8], corners[9]
    a0, b0, c0, a1, b1, c1 = edges[0], edges[1], edges[2], edges[3], edges[4], edges[5]
    a2, b2, c2 = edges[6], edges[7], edges[8]
    du, dv, base, least, most = depth[0], depth[1], depth[2], depth[3], depth[4]
    zero, overlap = np.float32(0), np.float32(1e-5)
    for k in range(len(u0)):
        a0[k], b0[k] = v0[k] - v1[k], u1[k] - u0[k]
        a1[k], b1[k] = v1[k] - v2[k], u2[k] - u1[k]
        a2[k], b2[k] = v2[k] - v0[k], u0[k] - u2[k]
        c0[k] = overlap * (abs(a0[k]) + abs(b0[k])) - a0[k] * u0[k] - b0[k] * v0[k]
        c1[k] = overlap * (abs(a1[k]) + abs(b1[k])) - a1[k] * u1[k] - b1[k] * v1[k]
        c2[k] = overlap * (abs(a2[k]) + abs(b2[k])) - a2[k] * u2[k] - b2[k] * v2[k]
        # 1/z is linear in the pixel, and never beyond the corners'
        du[k] = (a2[k] * w01[k] + a0[k] * w02[k]) / area[k]
        dv[k] = (b2[k] * w01[k] + b0[k] * w02[k]) / area[k]
        base[k] = -du[k] * u0[k] - dv[k] * v0[k]
        least[k], most[k] = min(min(w01[k], w02[k]), zero), max(max(w01[k], w02[k]), zero)


@kernel
def _fill_small(corners, edges, depth, box, face, count, inverse_depth, face_index):
    """Test every pixel of the first `count` of some small faces' boxes (4, N)."""
    for k in range(count):
        a0, b0, c0 = edges[0, k], edges[1, k], edges[2, k]
        a1, b1, c1 = edges[3, k], edges[4, k], edges[5, k]
        a2, b2, c2 = edges[6, k], edges[7, k], edges[8, k]
        du, dv, base, least, most = depth[0, k], depth[1, k], depth[2, k], depth[3, k], depth[4, k]
        left, top = box[0, k], box[2, k]
        for row in range(box[3, k] - top + 1):
            y = np.float32(row)
            e0, e1, e2, more = c0 + b0 * y, c1 + b1 * y, c2 + b2 * y, base + dv * y
            for col in range(box[1, k] - left + 1):
                x = np.float32(col)
                if min(e0 + a0 * x, e1 + a1 * x, e2 + a2 * x) >= 0:
                    w = corners[6, k] + min(max(more + du * x, least), most)
                    _put(inverse_depth, face_index, top + row, left + col, w, face[k])


@kernel
def _fill_rows(u0, v0, w0, u1, v1, w1, u2, v2, w2, f, inverse_depth, face_index):
    """Fill a face row by row, each edge a bound of the columns from the left or the right."""
    height, width = inverse_depth.shape
    area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    du = ((w1 - w0) * (v2 - v0) - (w2 - w0) * (v1 - v0)) / area
    dv = ((w2 - w0) * (u1 - u0) - (w1 - w0) * (u2 - u0)) / area
    base, least, most = w0 - du * u0 - dv * v0, min(w0, w1, w2), max(w0, w1, w2)
    edges = ((u0, v0, u1, v1), (u1, v1, u2, v2), (u2, v2, u0, v0))
    top, bottom = max(np.ceil(min(v0, v1, v2)), 0.0), min(np.floor(max(v0, v1, v2)), height - 1.0)
    for row in range(int(top), int(bottom) + 1):
        left, right = 0.0, width - 1.0
        for ua, va, ub, vb in edges:
            if va > vb:
                left = max(left, np.ceil(ua + (ub - ua) * (row - va) / (vb - va)))
            elif va < vb:
                right = min(right, np.floor(ua + (ub - ua) * (row - va) / (vb - va)))
        start = base + dv * row
        for col in range(int(left), int(right) + 1):
            _put(inverse_depth, face_index, row, col, min(max(start + du * col, least), most), f)


@kernel
def _rasterise(points, homogeneous, faces, front, inverse_depth, face_index):
    """Keep, at each pixel centre, the largest 1/z of the faces over it and that face's index.

    front : 1 or −1, the sign of the image area of faces to fill; 0: both
    """
    height, width = inverse_depth.shape
    corners = np.ones((10, BATCH), np.float32)
    edges, depth = np.empty((9, BATCH), np.float32), np.empty((5, BATCH), np.float32)
    box, face, held = np.empty((4, BATCH), np.int64), np.empty(BATCH, np.int64), 0
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
        # Skip what faces away, and what lies between pixel centres or outside
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        if not abs(area) > 0.0 or area * front < 0.0:
            continue
        top, bottom = np.ceil(min(v0, v1, v2)), np.floor(max(v0, v1, v2))
        left, right = np.ceil(min(u0, u1, u2)), np.floor(max(u0, u1, u2))
        top, bottom = max(top, 0.0), min(bottom, height - 1.0)
        left, right = max(left, 0.0), min(right, width - 1.0)
        if top > bottom or left > right:
            continue
        if area < 0.0:
            u1, v1, w1, u2, v2, w2 = u2, v2, w2, u1, v1, w1
        if right - left >= SMALL or bottom - top >= SMALL:
            _fill_rows(u0, v0, w0, u1, v1, w1, u2, v2, w2, f, inverse_depth, face_index)
            continue
        corners[0, held], corners[1, held] = u0 - left, v0 - top
        corners[2, held], corners[3, held] = u1 - left, v1 - top
        corners[4, held], corners[5, held] = u2 - left, v2 - top
        corners[6, held], corners[7, held], corners[8, held] = w0, w1 - w0, w2 - w0
        box[0, held], box[1, held], box[2, held], box[3, held] = left, right, top, bottom
        corners[9, held], face[held] = abs(area), f
        held += 1
        if held == BATCH:
            _prepare(corners, edges, depth)
            _fill_small(corners, edges, depth, box, face, held, inverse_depth, face_index)
            held = 0
    _prepare(corners, edges, depth)
    _fill_small(corners, edges, depth, box, face, held, inverse_depth, face_index)


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
