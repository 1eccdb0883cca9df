"""A lidded two-handled vessel: turned parts stacked on one axis, carved, and two roped handles.

Its charts are rectangles by construction: one per turned part (with one seam each) and one per
handle. Materials belong to faces, so that their borders are the mesh's own edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from meshlab_svbrdf.geometry.mesh import Mesh

TERRACOTTA, GLAZE, BRONZE = 0, 1, 2


@dataclass(frozen=True)
class Part:
    """One chart of the object.

    name : str; material : int
    profile : (N, 2) control points: (radius, height) of a turned part, outwards of a handle
    rows : int, rows of quads at full detail
    rectangle : (x, y, width, height) of its chart in the unit square, y = v
    """

    name: str
    material: int
    profile: np.ndarray
    rows: int
    rectangle: tuple[float, float, float, float]


# fmt: off
TURNED = (
    Part("foot", BRONZE, np.array([
        (.37, 0), (.405, .015), (.415, .05), (.385, .085), (.335, .10), (.30, .13), (.22, .19),
        (.165, .26), (.16, .30), (.20, .322), (.205, .346), (.175, .37)]), 20, (0, .52, .70, .22)),
    Part("body", GLAZE, np.array([
        (.175, .37), (.25, .40), (.38, .50), (.49, .66), (.535, .84), (.52, 1.0), (.45, 1.14),
        (.36, 1.22)]), 28, (0, .0, 1, .345)),
    Part("neck", TERRACOTTA, np.array([
        (.36, 1.22), (.378, 1.236), (.36, 1.26), (.30, 1.30), (.27, 1.38), (.275, 1.46),
        (.31, 1.53), (.36, 1.57), (.375, 1.60), (.36, 1.625)]), 20, (0, .345, .80, .175)),
    Part("lid", BRONZE, np.array([
        (.36, 1.625), (.388, 1.642), (.38, 1.668), (.33, 1.678), (.315, 1.70), (.23, 1.73),
        (.15, 1.77), (.085, 1.80), (.07, 1.83), (.10, 1.86), (.135, 1.91), (.13, 1.97), (.09, 2.01),
        (.04, 2.045), (0, 2.055)]), 28, (0, .74, .65, .26)),
)
HANDLE = np.array([(.42, 1.10), (.545, 1.18), (.60, 1.34), (.55, 1.49), (.44, 1.575), (.32, 1.585)])
HANDLES = (
    Part("handle +x", TERRACOTTA, HANDLE, 26, (.70, .53, .13, .42)),
    Part("handle -x", TERRACOTTA, HANDLE, 26, (.85, .53, .13, .42)),
)
PARTS = TURNED + HANDLES
# fmt: on


def _along(profile: np.ndarray, rows: int) -> np.ndarray:
    """Points at equal steps of arc length on a smooth curve through the profile, (rows + 1, 2)."""
    chord = np.concatenate([[0], np.linalg.norm(np.diff(profile, axis=0), axis=1).cumsum()])
    curve = PchipInterpolator(chord, profile)
    fine = np.linspace(0, chord[-1], 40 * rows + 1)
    length = np.linalg.norm(np.diff(curve(fine), axis=0), axis=1).cumsum()
    length = np.concatenate([[0], length])
    return curve(np.interp(np.linspace(0, length[-1], rows + 1), length, fine))


def _bell(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """1 in the middle of (low, high), smoothly 0 at its ends and beyond."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.sin(np.pi * t) ** 2


def carving(height: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """How far the chisel moves the turned surface outwards, in the profile's units."""
    gadroons = 0.030 * (np.abs(np.cos(6 * angle)) - 0.7) * _bell(height, 0.40, 1.02)
    flutes = 0.012 * np.cos(16 * angle) * _bell(height, 1.27, 1.55)
    leaves = 0.012 * np.cos(12 * angle) * _bell(height, 0.10, 0.31)
    petals = 0.014 * np.cos(8 * angle) * _bell(height, 1.665, 1.80)
    knob = 0.013 * np.cos(8 * angle) * _bell(height, 1.84, 2.04)
    return gadroons + flutes + leaves + petals + knob


def _grid(rows: int, columns: int, first: int, rectangle: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Faces and wedge coordinates of a grid of quads whose last column closes on the first."""
    row, column = np.mgrid[0:rows, 0:columns]
    corner = [(0, 0), (0, 1), (1, 1), (1, 0)]
    index = [first + (row + i) * columns + (column + j) % columns for i, j in corner]
    x, y, width, height = rectangle
    place = [
        np.stack([x + width * (column + j) / columns, y + height * (row + i) / rows], -1)
        for i, j in corner
    ]
    halves = [(0, 1, 2), (0, 2, 3)]
    faces = np.stack([np.stack([index[c] for c in half], -1) for half in halves], -2)
    uv = np.stack([np.stack([place[c] for c in half], -2) for half in halves], -3)
    return faces.reshape(-1, 3), uv.reshape(-1, 3, 2)


def _turned(rows: list[int], columns: int) -> np.ndarray:
    """All turned parts as one stack of rings, neighbours sharing theirs; (rings * columns, 3)."""
    rings = [_along(part.profile, n)[:-1] for part, n in zip(TURNED, rows, strict=True)]
    profile = np.concatenate([*rings, TURNED[-1].profile[-1:]])
    angle = 2 * np.pi * np.arange(columns) / columns
    radius, height = profile[:, :1], profile[:, 1:]
    r = radius + carving(height, angle)
    r[-1] = 0
    return np.stack([r * np.cos(angle), height + 0 * r, -r * np.sin(angle)], -1).reshape(-1, 3)


def _handle(rows: int, columns: int, side: float) -> np.ndarray:
    """A roped tube along the handle's curve; its ends lie inside the body and the neck."""
    line = _along(HANDLE, rows)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    t = np.linspace(0, 1, rows + 1)[:, None]
    angle = 2 * np.pi * np.arange(columns) / columns
    thickness = 0.052 * (1 - 0.25 * np.sin(np.pi * t)) * (1 + 0.12 * np.cos(3 * angle + 26 * t))
    outward, sideways = thickness * np.cos(angle), thickness * np.sin(angle)
    x = line[:, :1] + outward * along[:, 1:]
    y = line[:, 1:] - outward * along[:, :1]
    # The other side's handle is this one turned by half a revolution
    return np.stack([side * x, y, -side * sideways], -1).reshape(-1, 3)


def _weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge equal vertices and drop triangles that collapse; also the mask of kept faces."""
    positive_zero = vertices + 0.0
    vertices, inverse = np.unique(positive_zero, axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    a, b, c = faces.T
    keep = (a != b) & (b != c) & (c != a)
    return vertices, faces[keep].astype(np.int32), keep


def totem(columns: int, gutter: float) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """The object about the middle of its bounding box, its radius 1, standing along +Y.

    Parameters
    ----------
    columns : facets around the axis: the mesh's detail (96: 19k triangles)
    gutter : free margin of each chart, in units of the texture's width

    Returns
    -------
    mesh : Mesh, its numbers exact in float32, normals and texture coordinates included
    part : (F,) index into PARTS; material : (F,)
    """
    inset = [
        (x + gutter, y + gutter, w - 2 * gutter, h - 2 * gutter)
        for x, y, w, h in (p.rectangle for p in PARTS)
    ]
    rows = [max(4, round(p.rows * columns / 96)) for p in PARTS]
    around = max(8, columns // 6)
    vertices = [_turned(rows[: len(TURNED)], columns)]
    vertices += [
        _handle(n, around, side) for n, side in zip(rows[len(TURNED) :], (1, -1), strict=True)
    ]
    faces, uv, part = [], [], []
    first = 0
    for k, n in enumerate(rows):
        width = columns if k < len(TURNED) else around
        grid, place = _grid(n, width, first, inset[k])
        faces.append(grid)
        uv.append(place)
        part.append(np.full(len(grid), k))
        # A turned part's last ring is the next part's first
        first += (n if k < len(TURNED) - 1 else n + 1) * width

    points, triangles, keep = _weld(np.concatenate(vertices), np.concatenate(faces))
    middle, half = (points.max(0) + points.min(0)) / 2, np.linalg.norm(np.ptp(points, axis=0)) / 2
    points = ((points - middle) / half).astype(np.float32).astype(np.float64)
    coordinates = np.concatenate(uv)[keep].astype(np.float32).astype(np.float64)
    index = np.zeros(len(triangles), np.int32)
    normals = Mesh(points, triangles).vertex_normals().astype(np.float32).astype(np.float64)
    of_part = np.concatenate(part)[keep]
    materials = np.array([p.material for p in PARTS])[of_part]
    return Mesh(points, triangles, normals, coordinates, index), of_part, materials
