"""What a surface point can see: rays on the mesh, and harmonics per vertex (Palma et al., §3.1).

V(ω) is 1 where ω lies in the upper hemisphere of the point (n·ω > 0) and no surface is in the way,
from whichever side; else 0. Six bands of harmonics ring around such a step, so values that come out
of them go through `remap` before they are used.

A nearly convex object needs none of this: where `needs_visibility` says no, the coefficients are
left out (None) and V = [n·ω > 0] everywhere.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.sparse import csr_array

from ..blocks import blocks, places, room, rowwise, taken
from ..jit import kernel
from .harmonics import BANDS, COEFFICIENTS, basis
from .mesh import Mesh

# How far a ray starts off the surface, in radii. At a vertex only rounding is to be escaped. Inside
# a face the interpolated normal sees a little below the face's plane, which must not shadow itself.
VERTEX_OFFSET = 1e-4
POINT_OFFSET = 1e-3

NEARLY_CONVEX = 0.01

AGREEING = 0.03
"""RMS over the sphere by which neighbours' obstacles may differ from their mean: little more than
what 512 rays leave out."""
NEAR = 0.05
"""Radii, up to which a neighbour's obstacles are those of a vertex."""
FEW = 10_000
"""Rays that are shot before threads to share them have started."""
ROOM, ROOM_PER_FACE = 200 << 20, 400
"""Bytes that Embree may want; where it finds none it crashes."""
RESTING = 1 << 30
"""Of the latter bytes, from which on a tree is large: not held while no rays are shot."""
_HALF_LEGENDRE = np.array([1, 1 / 2, 0, -1 / 8, 0, 1 / 16])  # ∫₀¹ P_l


class Rays:
    """A mesh to shoot rays at, in float32 about its centre; safe to use from several threads."""

    def __init__(self, mesh: Mesh) -> None:
        self.center, self.radius = mesh.center, mesh.radius
        self._mesh, self._building = mesh, Lock()
        self._large = ROOM_PER_FACE * len(mesh.faces) >= RESTING
        self._scene = None if self._large else self._built()

    @property
    def scene(self) -> EmbreeScene:
        """Embree's tree of the triangles; a large one is built when it is first wanted."""
        with self._building:
            if self._scene is None:
                self._scene = self._built()
            return self._scene

    def rest(self) -> None:
        """Let go of a large tree until rays are shot again; none may be on their way."""
        if self._large:
            self._scene = None

    def _built(self) -> EmbreeScene:
        mesh = self._mesh
        np.empty(ROOM + ROOM_PER_FACE * len(mesh.faces), np.uint8)  # MemoryError in its place
        scene = EmbreeScene(robust=True)
        TriangleMesh(
            scene,
            rowwise(lambda some: (some - self.center).astype(np.float32), mesh.vertices),
            np.ascontiguousarray(mesh.faces, dtype=np.int32),
        )
        scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        return scene

    def blocked(self, origins: np.ndarray, directions: np.ndarray, reach=None) -> np.ndarray:
        """Whether anything is hit within `reach` lengths of the direction; (N,) bool.

        origins (N, 3) about the centre; directions (N, 3), or (1, 3) for all; reach float or (N,).
        """
        return self.scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            dists=reach,
            query="OCCLUDED",
        ) >= 0  # fmt: skip

    def nearest(self, origins: np.ndarray, directions: np.ndarray, reach=None):
        """The first hit: face (N,) int32, −1 for none; barycentric (N, 3); length (N,) float32."""
        hit = self.scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            dists=reach,
            query="INTERSECT",
            output=True,
        )
        u, v = hit["u"], hit["v"]
        return hit["primID"], np.column_stack([1 - u - v, u, v]), hit["tfar"]


def spread_directions(count: int) -> np.ndarray:
    """A spherical Fibonacci lattice (count, 3): even, deterministic, each worth 4π/count."""
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    phi = i * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(phi), r * np.sin(phi), z])


def vertex_visibility(
    mesh: Mesh,
    directions: int = 512,
    bands: int = BANDS,
    progress: Callable[[float], object] | None = None,
    rays: Rays | None = None,
) -> np.ndarray:
    """Harmonics of the visibility of each vertex's upper hemisphere (§3.1).

    The hemisphere's own are known; what obstacles take away from it is found by rays. These are
    shot from vertices of which no two share an edge, and from those between them whose neighbours
    do not agree on the obstacles; the others get their neighbours' mean.

    Parameters
    ----------
    mesh : Mesh
    directions : rays per vertex over the whole sphere (the lower half is not shot); 512 leave an
        RMS error of about .02 in V where there are obstacles, less than what six bands leave out
    bands : 1 to 6; coefficients of the bands above are zero. (0, no visibility at all, is
        coefficients=None to whoever uses them.)
    progress : called with the share done, 0 to 1
    rays : of the mesh, where there are any already

    Returns
    -------
    (V, 36) float32. A vertex without a normal sees nothing: its coefficients are all zero.
    """
    if not 1 <= bands <= BANDS:
        raise ValueError(f"bands={bands}: expected 1 to {BANDS}; for none use no coefficients")
    normals = mesh.vertex_normals()
    shot = _Obstacles(mesh, normals, directions, rays or Rays(mesh))
    lonely, between = _between(mesh, normals)
    tell = progress or (lambda share: None)
    taken = room((len(normals), COEFFICIENTS), np.float64)
    taken[:] = 0
    taken[lonely] = shot.taken(lonely, lambda share: tell(share * len(lonely) / len(normals)))

    # Where the neighbours agree, what they see is what is seen between them
    agree = np.zeros(len(taken), bool)
    powers = rowwise(lambda some: (some**2).sum(axis=1), taken)
    for own, near in zip(blocks(len(taken)), between, strict=True):
        count = near.sum(axis=1)
        mean = near @ taken / np.maximum(count, 1)[:, None]
        power = near @ powers / np.maximum(count, 1)
        differ = np.sqrt(np.maximum(power - (mean**2).sum(axis=1), 0) / (4 * np.pi))
        agree[own] = (count > 1) & (differ <= AGREEING)
        taken[own][agree[own]] = mean[agree[own]]
    done = len(lonely) + np.count_nonzero(agree)
    agree[lonely] = True
    rest = np.flatnonzero(~agree)
    left = 1 - done / max(1, len(normals))
    taken[rest] = shot.taken(rest, lambda share: tell(1 - left * (1 - share)))
    tell(1.0)
    kept = np.arange(COEFFICIENTS) < bands**2
    return rowwise(
        lambda n, some: np.where(kept, _hemispheres(n) - some, 0).astype(np.float32),
        normals, taken,
    )  # fmt: skip


def _hemispheres(normals: np.ndarray) -> np.ndarray:
    """Harmonics of [n·ω > 0], (V, 36): 2π ∫₀¹ P_l of Y_lm(n); zero for a zero normal."""
    shares = np.repeat(_HALF_LEGENDRE, 2 * np.arange(BANDS) + 1)
    return 2 * np.pi * shares * basis(normals) * normals.any(axis=1, keepdims=True)


def _between(mesh: Mesh, normals: np.ndarray) -> tuple[np.ndarray, list[csr_array]]:
    """Vertices of which no two share an edge, ascending, and which of them are near the others.

    Returns their indices, and a (V, V) matrix of ones where the column is such a vertex, shares an
    edge with the row, is no farther than `NEAR` and faces the same side: `blocks` of its rows.
    """
    indptr, indices = _edges(mesh)
    size = len(mesh.vertices)
    chosen = np.zeros(size, np.bool_)
    _choose(indptr, indices, normals.any(axis=1), chosen)
    near = []
    reach = NEAR * mesh.radius
    for own in blocks(size):
        span = indptr[own.start : own.stop + 1]
        row = np.repeat(np.arange(own.start, own.stop), np.diff(span))
        column = indices[span[0] : span[-1]]
        apart = np.linalg.norm(mesh.vertices[row] - mesh.vertices[column], axis=1)
        same = np.einsum("ij,ij->i", normals[row], normals[column]) > 0
        used = chosen[column] & ~chosen[row] & (apart <= reach) & same
        found = np.bincount(row[used] - own.start, minlength=len(span) - 1)
        starts, column = np.concatenate([[0], np.cumsum(found)]), column[used]
        shape = (len(found), size)
        near.append(csr_array((np.ones(len(column), np.int8), column, starts), shape=shape))
    return np.flatnonzero(chosen), near


def _edges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Which vertices share an edge, both ways: indptr (V + 1,) int64, indices (E,) int32."""
    size, count = len(mesh.vertices), len(mesh.faces)
    key = room(6 * count, np.int64)
    for own in blocks(count):
        corners = mesh.faces[own].astype(np.int64)
        for k, (a, b) in enumerate(((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2))):
            key[k * count + own.start : k * count + own.stop] = corners[:, a] * size + corners[:, b]
    key.sort()
    fresh = np.ones(len(key), bool)
    np.not_equal(key[1:], key[:-1], out=fresh[1:])
    key = taken(key, places(fresh))
    indptr = np.searchsorted(key, np.arange(size + 1) * size)
    return indptr, rowwise(lambda some: (some % size).astype(np.int32), key)


@kernel
def _choose(indptr, indices, usable, chosen):
    """Choose usable vertices in their order, unless a neighbour has been chosen."""
    for i in range(len(chosen)):
        free = usable[i]
        for k in range(indptr[i], indptr[i + 1]):
            free = free and not chosen[indices[k]]
        chosen[i] = free


class _Obstacles:
    """Shoots rays from vertices into their upper hemispheres, and keeps those that are blocked."""

    def __init__(self, mesh: Mesh, normals: np.ndarray, directions: int, rays: Rays) -> None:
        self.rays, self.normals = rays, normals
        self.origins = _off_surface(mesh, mesh.vertices, normals, VERTEX_OFFSET)
        self.omega = spread_directions(directions)
        self.weights = basis(self.omega) * (4 * np.pi / directions)

    def taken(self, vertices: np.ndarray, progress: Callable[[float], object]) -> np.ndarray:
        """Harmonics of what obstacles take from some vertices' (n,) hemispheres, (n, 36)."""
        whole = room((len(vertices), COEFFICIENTS), np.float64)
        for own in blocks(len(vertices)):

            def tell(share: float, own: slice = own) -> None:
                progress((own.start + share * (own.stop - own.start)) / len(vertices))

            whole[own] = self._of(vertices[own], tell)
        return whole

    def _of(self, vertices: np.ndarray, progress: Callable[[float], object]) -> np.ndarray:
        """`taken` of a block."""
        normals, origins = self.normals[vertices], self.origins[vertices]

        def blocked(direction: np.ndarray) -> np.ndarray:
            hit = normals @ direction > 0
            front = np.flatnonzero(hit)
            hit[front] = self.rays.blocked(origins[front], direction[None])
            return hit

        # Project one block of directions after the other onto the harmonics
        coefficients = np.zeros((len(vertices), COEFFICIENTS))
        block = max(1, min(64, 2**24 // max(1, len(vertices))))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for start in range(0, len(self.omega), block):
                some = slice(start, start + block)
                hits = np.stack(list(pool.map(blocked, self.omega[some])), axis=1)
                coefficients += hits.astype(np.float64) @ self.weights[some]
                progress(min(1.0, (start + block) / len(self.omega)))
        return coefficients


def needs_visibility(
    mesh: Mesh,
    threshold: float = NEARLY_CONVEX,
    vertices: int = 2000,
    directions: int = 64,
    rays: Rays | None = None,
) -> tuple[bool, float]:
    """Whether self-occlusion matters, and the share of front-facing rays that are blocked.

    A seeded sample of vertices is tried; an object with less than `threshold` blocked is nearly
    convex, and [n·ω > 0] is as good as its visibility. rays : of the mesh, if there are any already
    """
    rays, normals = rays or Rays(mesh), mesh.vertex_normals()
    usable = np.flatnonzero(normals.any(axis=1))
    if len(usable) > vertices:
        usable = np.sort(np.random.default_rng(0).choice(usable, vertices, replace=False))
    normals = normals[usable]
    origins = _off_surface(mesh, mesh.vertices[usable], normals, VERTEX_OFFSET)
    shot = hit = 0
    for direction in spread_directions(directions):
        front = normals @ direction > 0
        shot += int(front.sum())
        hit += int(rays.blocked(origins[front], direction[None]).sum())
    share = hit / shot if shot else 0.0
    return share >= threshold, share


def directional_visibility(
    surface: Mesh | Rays,
    points: np.ndarray,
    normals: np.ndarray,
    lights: Sequence[tuple[np.ndarray, np.ndarray | None]],
    offset: float = POINT_OFFSET,
) -> np.ndarray:
    """Exact shadows: which points see which lights.

    Parameters
    ----------
    surface : the mesh, or the rays of it, to be used again
    points : (N, 3) world, on the surface
    normals : (N, 3) unit; a zero normal sees nothing
    lights : (direction, position): a unit vector away from the surface, and the world position of a
        near light, which then replaces the direction, or None for a far one
    offset : how far rays start off the surface, in radii of the mesh

    Returns
    -------
    (N, L) bool
    """
    rays = surface if isinstance(surface, Rays) else Rays(surface)
    origins = _off_surface(rays, points, normals, offset)
    seen = np.zeros((len(points), len(lights)), dtype=bool)

    def shadow(light: int, some: slice) -> None:
        direction, position = lights[light]
        if position is None:
            to_light = np.asarray(direction, dtype=np.float64)[None]
            front = some.start + np.flatnonzero(normals[some] @ to_light[0] > 0)
            blocked = rays.blocked(origins[front], to_light)
        else:
            to_light = np.asarray(position) - points[some]
            above = np.flatnonzero(np.einsum("ij,ij->i", normals[some], to_light) > 0)
            front = some.start + above
            to_light = np.asarray(position) - rays.center - origins[front]
            blocked = rays.blocked(origins[front], to_light, reach=1.0)
        seen[front, light] = ~blocked

    pieces = [slice(s, min(s + 2**18, len(points))) for s in range(0, len(points), 2**18)]
    tasks = [(k, s) for k in range(len(lights)) for s in pieces]
    if len(points) * len(lights) < FEW:
        for task in tasks:
            shadow(*task)
    else:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda task: shadow(*task), tasks))
    return seen


def remap(visibility: np.ndarray) -> np.ndarray:
    """clip((V − 0.25)/0.5, 0, 1): takes the harmonics' ringing back to 0..1."""
    return np.clip((visibility - 0.25) * 2, 0, 1)


def _off_surface(
    mesh: Mesh | Rays, points: np.ndarray, normals: np.ndarray, offset: float
) -> np.ndarray:
    lift = offset * mesh.radius
    return rowwise(
        lambda some, up: (some - mesh.center + lift * up).astype(np.float32), points, normals
    )
