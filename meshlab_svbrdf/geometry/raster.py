"""The one rasteriser: which face a camera sees at each pixel, and how far away.

Corners are projected once. Small faces are prepared several at once, and test the pixels around
them; a large one is filled row by row between its edges. A face that reaches behind the camera is
filled in homogeneous image coordinates (Olano and Greer 1997), which need no clipping.
"""

from __future__ import annotations

import numpy as np

from ..blocks import blocks, places, room, rowwise, taken, transposed
from ..jit import inner, kernel
from .camera import Camera
from .groups import GROUP, Groups, faces_away, group, walk

_NEAR = 1e-9  # depth, in world units, at which a corner counts as behind the camera
SMALL = 16  # pixels wide and high, below which a face is small: float32 will do
_NONE, _SMALL, _LARGE, _BEHIND = np.int32(0), np.int32(1), np.int32(2), np.int32(3)
"""Kinds of faces."""
# Rows of a group's tables: of small faces, corners from the face's first pixel on, 1/z of the first
# and how much more the others' is, twice the area; three times a, b, c of a · column + b · row + c,
# which is ≥ 0 inside; how much more than at the first corner 1/z is: slopes along columns and rows,
# value at the first pixel, bounds
X0, Y0, X1, Y1, X2, Y2, W0, W1, W2, AREA = range(0, 10 * GROUP, GROUP)
A0, B0, C0, A1, B1, C1, A2, B2, C2 = range(10 * GROUP, 19 * GROUP, GROUP)
DX, DY, BASE, LEAST, MOST = range(19 * GROUP, 24 * GROUP, GROUP)
LEFT, RIGHT, TOP, BOTTOM, KIND = range(0, 5 * GROUP, GROUP)  # of pixel centres that may be inside
_WIDE = 1e7  # pixels; farther out the edges' double precision gives out


@kernel
def _project_vertices(vertices, R, t, fx, fy, cx, cy, out):
    """Columns, rows and 1/z of vertices (3, V) to `out` (3, V) float64; 1/z = 0 is behind."""
    x, y, z = vertices[0], vertices[1], vertices[2]
    column, row, inverse_depth = out[0], out[1], out[2]
    r00, r01, r02, tx = R[0, 0], R[0, 1], R[0, 2], t[0]
    r10, r11, r12, ty = R[1, 0], R[1, 1], R[1, 2], t[1]
    r20, r21, r22, tz = R[2, 0], R[2, 1], R[2, 2], t[2]
    for i in range(len(x)):
        depth = r20 * x[i] + r21 * y[i] + r22 * z[i] + tz
        w = 1.0 / depth
        u = fx * (r00 * x[i] + r01 * y[i] + r02 * z[i] + tx) * w + cx
        v = fy * (r10 * x[i] + r11 * y[i] + r12 * z[i] + ty) * w + cy
        before = (depth > _NEAR) & (abs(u) < _WIDE) & (abs(v) < _WIDE)
        column[i] = u if before else 0.0
        row[i] = v if before else 0.0
        inverse_depth[i] = w if before else 0.0


@inner
def _put(surface, index, at, w, f):
    """The nearer of what is at a pixel and of face f at 1/z = w; 0 is none."""
    if index is None:
        surface[at] = max(surface[at], w)
    elif w > surface[at]:
        surface[at], index[at] = w, f


@inner
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def _fill_homogeneous(a, b, c, f, height, width, surface, index):
    """Fill one face whose corners, homogeneous (u z, v z, z), may lie behind the camera."""
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
                _put(surface, index, row * width + col, w0 + w1 + w2, f)


@kernel
def _place(points, front, width, height, small, whole):
    """Where a group's faces lie in the image.

    points : the corners' column, row and 1/z, float64, one row of a value after the other
    front : 1 or −1, the sign of the image area of faces to fill; 0: both
    small, whole : tables of the rows named above
    """
    # The compiler makes this loop, and the next, several faces wide: it sees that rows of one flat
    # array do not overlap
    for k in range(GROUP):
        u0, v0, w0 = points[k], points[GROUP + k], points[2 * GROUP + k]
        u1, v1, w1 = points[3 * GROUP + k], points[4 * GROUP + k], points[5 * GROUP + k]
        u2, v2, w2 = points[6 * GROUP + k], points[7 * GROUP + k], points[8 * GROUP + k]
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        left = max(np.ceil(min(min(u0, u1), u2)), 0.0)
        right = min(np.floor(max(max(u0, u1), u2)), width - 1.0)
        top = max(np.ceil(min(min(v0, v1), v2)), 0.0)
        bottom = min(np.floor(max(max(v0, v1), v2)), height - 1.0)
        whole[LEFT + k], whole[RIGHT + k] = np.int32(left), np.int32(right)
        whole[TOP + k], whole[BOTTOM + k] = np.int32(top), np.int32(bottom)
        # Skip what faces away, and what lies between pixel centres or outside
        seen = (abs(area) > 0.0) & (area * front >= 0.0) & (left <= right) & (top <= bottom)
        narrow = (right - left < SMALL) & (bottom - top < SMALL)
        behind = (w0 == 0.0) | (w1 == 0.0) | (w2 == 0.0)
        kind = (_SMALL if narrow else _LARGE) if seen else _NONE
        whole[KIND + k] = _BEHIND if behind else kind
        # Turn all the same way round
        turn = area < 0.0
        small[X0 + k], small[Y0 + k], small[W0 + k] = u0 - left, v0 - top, w0
        small[X1 + k], small[Y1 + k] = (u2 if turn else u1) - left, (v2 if turn else v1) - top
        small[X2 + k], small[Y2 + k] = (u1 if turn else u2) - left, (v1 if turn else v2) - top
        small[W1 + k], small[W2 + k] = (w2 if turn else w1) - w0, (w1 if turn else w2) - w0
        small[AREA + k] = abs(area)


@inner
def _prepare(small):
    """Edge functions and depth of small faces, in the table of `_place`.

    Faces overlap by a 30 000th of a pixel, so that rounding leaves no hole between them.
    """
    zero, overlap = np.float32(0), np.float32(3e-5)
    for k in range(GROUP):
        x0, y0, x1, y1 = small[X0 + k], small[Y0 + k], small[X1 + k], small[Y1 + k]
        x2, y2, area = small[X2 + k], small[Y2 + k], small[AREA + k]
        w1, w2 = small[W1 + k], small[W2 + k]
        a0, b0 = y0 - y1, x1 - x0
        a1, b1 = y1 - y2, x2 - x1
        a2, b2 = y2 - y0, x0 - x2
        small[A0 + k], small[B0 + k] = a0, b0
        small[A1 + k], small[B1 + k] = a1, b1
        small[A2 + k], small[B2 + k] = a2, b2
        small[C0 + k] = overlap * (abs(a0) + abs(b0)) - a0 * x0 - b0 * y0
        small[C1 + k] = overlap * (abs(a1) + abs(b1)) - a1 * x1 - b1 * y1
        small[C2 + k] = overlap * (abs(a2) + abs(b2)) - a2 * x2 - b2 * y2
        # 1/z is linear in the pixel, and never beyond the corners'
        dx = (a2 * w1 + a0 * w2) / area
        dy = (b2 * w1 + b0 * w2) / area
        small[DX + k], small[DY + k], small[BASE + k] = dx, dy, -dx * x0 - dy * y0
        small[LEAST + k], small[MOST + k] = min(min(w1, w2), zero), max(max(w1, w2), zero)


@inner
def _fill_small(small, whole, count, first, width, surface, index):
    """Test every pixel of the small faces' boxes, of the `count` faces from `first` on."""
    zero = np.float32(0)
    for k in range(count):
        if whole[KIND + k] != _SMALL:
            continue
        a0, b0, row0 = small[A0 + k], small[B0 + k], small[C0 + k]
        a1, b1, row1 = small[A1 + k], small[B1 + k], small[C1 + k]
        a2, b2, row2 = small[A2 + k], small[B2 + k], small[C2 + k]
        w, dx, dy, row_depth = small[W0 + k], small[DX + k], small[DY + k], small[BASE + k]
        least, most = small[LEAST + k], small[MOST + k]
        columns, rows = (
            whole[RIGHT + k] - whole[LEFT + k] + 1,
            whole[BOTTOM + k] - whole[TOP + k] + 1,
        )
        row_at = np.uint64(whole[TOP + k] * np.int64(width) + whole[LEFT + k])
        for _ in range(rows):
            e0, e1, e2, depth, at = row0, row1, row2, row_depth, row_at
            for _ in range(columns):
                # Without branches: whether a pixel is inside cannot be foretold
                near = w + min(max(depth, least), most)
                near = near if (e0 >= 0) & (e1 >= 0) & (e2 >= 0) else zero
                _put(surface, index, at, near, first + k)
                e0, e1, e2, depth, at = e0 + a0, e1 + a1, e2 + a2, depth + dx, at + np.uint64(1)
            row0, row1, row2, row_depth = row0 + b0, row1 + b1, row2 + b2, row_depth + dy
            row_at += np.uint64(width)


@inner
def _fill_rows(points, f, height, width, surface, index):
    """Fill a face row by row, each edge a bound of the columns from the left or the right.

    points : (9,) float64: column, row and 1/z of three corners
    """
    u0, v0, w0, u1, v1, w1, u2, v2, w2 = points
    area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    if area < 0.0:
        u1, v1, w1, u2, v2, w2 = u2, v2, w2, u1, v1, w1
        area = -area
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
            near = min(max(start + du * col, least), most)
            _put(surface, index, row * width + col, near, f)


@kernel
def _rasterise(points, homogeneous, faces, groups, eye, front, height, width, surface, index):
    """Keep, at each pixel centre, the largest 1/z of the faces over it and that face's index.

    groups : of the faces, where only their fronts are to be filled; or empty
    front : 1 or −1, the sign of the image area of faces to fill; 0: both
    surface, index : (height · width,); no index: None
    """
    own = np.zeros(9 * GROUP)
    small, whole = np.zeros(24 * GROUP, np.float32), np.zeros(5 * GROUP, np.int32)
    for first in range(0, len(faces), GROUP):
        if len(groups.radius) and faces_away(groups, first // GROUP, eye):
            continue
        count = min(GROUP, len(faces) - first)
        for k in range(count):
            for corner in range(3):
                i = faces[first + k, corner]
                for value in range(3):
                    own[(3 * corner + value) * GROUP + k] = points[value, i]
        _place(own, front, width, height, small, whole)
        _prepare(small)
        _fill_small(small, whole, count, first, width, surface, index)
        for k in range(count):
            if whole[KIND + k] == _LARGE:
                _fill_rows(own[k::GROUP], first + k, height, width, surface, index)
            elif whole[KIND + k] == _BEHIND:
                i, j, l = faces[first + k]
                _fill_homogeneous(
                    homogeneous[i], homogeneous[j], homogeneous[l], first + k,
                    height, width, surface, index,
                )  # fmt: skip


_UNGROUPED = group(np.zeros((0, 3)), np.zeros((0, 3)), 0.0)


def _fill(
    vertices: np.ndarray, faces: np.ndarray, groups: Groups, camera: Camera, front: int,
    inverse_depth: np.ndarray, face_index: np.ndarray | None,
) -> None:  # fmt: skip
    """vertices : (3, V)"""
    points = room(vertices.shape, np.float64)
    _project_vertices(
        vertices, camera.R, camera.t, camera.fx, camera.fy, camera.cx, camera.cy, points
    )
    # Only faces behind the camera need their corners in the other form
    behind = bool((points[2] == 0.0).any())
    homogeneous = (vertices.T @ camera.R.T + camera.t) @ camera.K.T if behind else np.zeros((0, 3))
    _rasterise(
        points, homogeneous, faces, groups, camera.center, front, camera.height, camera.width,
        inverse_depth.reshape(-1), None if face_index is None else face_index.reshape(-1),
    )  # fmt: skip


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
    _fill(transposed(vertices, np.float64), faces, _UNGROUPED, camera, 0, inverse_depth, face_index)
    return inverse_depth, face_index


def rasterise_depth(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> np.ndarray:
    """As `rasterise`, 1/z alone."""
    inverse_depth = np.zeros((camera.height, camera.width), np.float32)
    _fill(transposed(vertices, np.float64), faces, _UNGROUPED, camera, 0, inverse_depth, None)
    return inverse_depth


class DepthMaps:
    """Many depth maps of one surface: its faces in groups, of which those that face away are
    passed over where the surface is closed, so that backs are hidden.

    Parameters
    ----------
    vertices : (V, 3) float64, in the cameras' world
    faces : (F, 3) int32
    front : the sign of the image area (y down) of the faces to fill, where only those of one side
        can be seen because the surface is closed; 0: all faces
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, front: int) -> None:
        finite = np.isfinite(vertices).all(1)
        faces = taken(faces, places(rowwise(lambda some: finite[some].all(1), faces)))
        if len(faces):
            faces = taken(faces, walk(rowwise(lambda some: vertices[some].mean(1), faces)))
        # Number the vertices as the faces come to them
        corners = faces.reshape(-1)
        first = room(len(vertices), np.int64)
        first[:] = len(corners)
        for own in reversed(list(blocks(len(corners)))):
            first[corners[own][::-1]] = np.arange(own.start, own.stop)[::-1]
        order = np.argsort(first, kind="stable")
        number = np.empty(len(order), np.int32)
        number[order] = np.arange(len(order), dtype=np.int32)
        self._faces = taken(number, faces)
        used = np.count_nonzero(first < len(corners))
        self._vertices = transposed(taken(vertices, order[:used]), np.float64)
        self._front, self._groups = front, _UNGROUPED
        if front:

            def facing(corners: np.ndarray) -> np.ndarray:
                a, b, c = np.moveaxis(corners, 1, 0)
                normal = -front * np.cross(b - a, c - a)
                length = np.linalg.norm(normal, axis=1, keepdims=True)
                return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)

            middle = rowwise(lambda some: vertices[some].sum(1) / 3, faces)
            self._groups = group(middle, rowwise(lambda some: facing(vertices[some]), faces), 0.0)

    def of(self, camera: Camera) -> np.ndarray:
        """1/z at each pixel centre, (H, W) float32; 0 where nothing is seen."""
        inverse_depth = np.zeros((camera.height, camera.width), np.float32)
        _fill(self._vertices, self._faces, self._groups, camera, self._front, inverse_depth, None)
        return inverse_depth
