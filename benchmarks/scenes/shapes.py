"""The scanned objects: triangles with charts, in the object's frame (centre 0, radius 1, +Y up)."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from meshlab_svbrdf.geometry.mesh import Mesh
from sample_projects.procedural.shape import totem

GUTTER = 3 / 512  # free margin of each chart, in units of the texture's width


def make_shape(name: str, detail: int, coarse: float, seed: int) -> tuple[Mesh, Mesh]:
    """The surface that is rendered, and the scan of it with `coarse` times less triangles.

    Both are the same parametric surface, their charts the same: texture maps of one fit the other.
    """
    make = {"bumpy": _bumpy, "vessel": _vessel, "bowl": _bowl, "knot": _knot}[name]
    fine = make(detail, seed)
    return _centred(fine, fine), _centred(make(max(4, round(detail / coarse**0.5)), seed), fine)


def _centred(mesh: Mesh, like: Mesh) -> Mesh:
    points = (mesh.vertices - like.center) / like.radius
    points = points.astype(np.float32).astype(np.float64)
    normals = Mesh(points, mesh.faces).vertex_normals()
    assert mesh.uv is not None
    uv = mesh.uv.astype(np.float32).astype(np.float64)
    return Mesh(points, mesh.faces, normals.astype(np.float32).astype(np.float64), uv)


def _patch(points: np.ndarray, cell: tuple[float, float, float, float]) -> tuple[np.ndarray, ...]:
    """A grid of points (N, M, 3) as triangle corners (F, 3, 3), and in its cell of UV (F, 3, 2)."""
    n, m = points.shape[:2]
    x, y, width, height = cell
    u = x + GUTTER + (width - 2 * GUTTER) * np.linspace(0, 1, m)
    v = y + GUTTER + (height - 2 * GUTTER) * np.linspace(0, 1, n)
    place = np.stack(np.meshgrid(u, v), -1)
    i, j = (k.ravel() for k in np.mgrid[: n - 1, : m - 1])
    corner = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]

    def triangles(grid: np.ndarray) -> np.ndarray:
        a, b, c, d = (grid[k] for k in corner)
        return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])

    return triangles(points), triangles(place)


def _weld(patches: list[tuple[np.ndarray, ...]]) -> Mesh:
    """Merge corners at the same place; triangles that collapse go."""
    corners = np.concatenate([p[0] for p in patches])
    uv = np.concatenate([p[1] for p in patches])
    key = np.round(corners.reshape(-1, 3), 7) + 0.0
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1, 3).astype(np.int32)
    a, b, c = faces.T
    keep = (a != b) & (b != c) & (c != a)
    return Mesh(corners.reshape(-1, 3)[first], faces[keep], uv=uv[keep])


def _bumpy(detail: int, seed: int) -> Mesh:
    """A sphere with a dozen soft bumps and dents, charted as the six sides of a cube."""
    rng = np.random.default_rng([seed, 1])
    middle = rng.standard_normal((14, 3))
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    height = rng.uniform(0.06, 0.16, 14) * rng.choice([-1, 1], 14)
    t = np.tan(np.linspace(-1, 1, detail + 1) * np.pi / 4)
    t[[0, -1]] = -1, 1
    a, b = np.meshgrid(t, t)
    one = np.ones_like(a)
    sides = [(one, b, -a), (-one, b, a), (a, one, -b), (a, -one, b), (a, b, one), (-a, b, -one)]
    patches = []
    for k, side in enumerate(sides):
        way = np.stack(side, -1)
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        bumps = height * np.exp((way @ middle.T - 1) / 0.09)
        points = way * (1 + bumps.sum(-1, keepdims=True))
        patches.append(_patch(points, (k % 3 / 3, k // 3 / 2, 1 / 3, 1 / 2)))
    return _weld(patches)


def _bowl(detail: int, seed: int) -> Mesh:
    """A deep bowl with a thick wall, turned: its outside one chart, its inside the other."""
    wall = np.array([(0, 0), (0.34, 0), (0.62, 0.12), (0.85, 0.40), (0.97, 0.74), (1, 0.98)])
    hollow = np.array([(1, 0.98), (0.95, 1.02), (0.89, 0.95), (0.84, 0.72), (0.72, 0.42),
                       (0.5, 0.22), (0.25, 0.14), (0, 0.13)])  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 3 * detail + 1)
    angle[-1] = 0
    patches = []
    for k, profile in enumerate((wall, hollow)):
        chord = np.concatenate([[0], np.linalg.norm(np.diff(profile, axis=0), axis=1).cumsum()])
        along = PchipInterpolator(chord, profile)(np.linspace(0, chord[-1], detail + 1))
        radius, height = along[:, :1], along[:, 1:]
        points = [radius * np.cos(angle), height + 0 * angle, -radius * np.sin(angle)]
        patches.append(_patch(np.stack(points, -1), (0, k / 2, 1, 1 / 2)))
    return _weld(patches)


def _knot(detail: int, seed: int) -> Mesh:
    """A tube along the (2, 3) torus knot: a surface that shadows itself from all sides."""
    t = np.linspace(0, 2 * np.pi, 6 * (detail // 2) * 2 + 1)[:, None]
    core = 2 * np.concatenate([np.cos(2 * t), 0 * t, np.sin(2 * t)], 1)
    line = core * (1 + np.cos(3 * t) / 2) + np.sin(3 * t) * [0, 1, 0]
    along = np.gradient(line, axis=0)
    along[[0, -1]] = line[1] - line[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    n = line - core
    n -= (n * along).sum(1, keepdims=True) * along
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    b = np.cross(along, n)
    around = np.linspace(0, 2 * np.pi, detail + 1)[:, None]
    around[-1] = 0
    points = line[:, None] + 0.55 * (np.cos(around) * n[:, None] + np.sin(around) * b[:, None])
    points[-1] = points[0]
    rows = (len(points) - 1) // 12
    return _weld(
        [
            _patch(points[k * rows : (k + 1) * rows + 1], (k % 3 / 3, k // 3 / 4, 1 / 3, 1 / 4))
            for k in range(12)
        ]
    )


def _vessel(detail: int, seed: int) -> Mesh:
    """The sample project's lidded vessel with two handles; its base and its lid's tip are fixed."""
    mesh = totem(2 * round(1.2 * detail), GUTTER)[0]
    points = mesh.vertices - [0, mesh.vertices[:, 1].min(), 0]
    return Mesh(points / points[:, 1].max(), mesh.faces, uv=mesh.uv)
