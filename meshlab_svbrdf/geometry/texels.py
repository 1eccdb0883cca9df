"""Texels: one for each pixel centre of the texture images that lies in a triangle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..blocks import blocks, places, room, rowwise, taken
from ..jit import kernel
from .groups import walk
from .mesh import Mesh


@dataclass(frozen=True)
class Texels:
    """T texels, ordered so that neighbours in memory are neighbours on the surface.

    position : (T, 3) float32, about `center`; normal : (T, 3) float32, unit
    face : (T,) int32; barycentric : (T, 3) float32
    texture : (T,) uint8; row, col : (T,) int32 in that texture's image (row 0 is v = 1)
    center : (3,) float64, world; radius : half the diagonal of the mesh's bounding box
    sizes : (height, width) of each texture image
    """

    position: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    texture: np.ndarray
    row: np.ndarray
    col: np.ndarray
    center: np.ndarray
    radius: float
    sizes: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.face)

    def every(self, step: int) -> Texels:
        """Every `step`-th texel."""
        each = ("position", "normal", "face", "barycentric", "texture", "row", "col")
        return replace(self, **{name: getattr(self, name)[::step] for name in each})

    def smooth_normals(self, mesh: Mesh) -> np.ndarray:
        """The mesh's own normals at the texels (T, 3), unit, whatever was baked or corrected; the
        texel's where the mesh has none."""
        corners = mesh.vertex_normals()[mesh.faces[self.face]]
        normal = np.einsum("tc,tcd->td", self.barycentric, corners)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.where(length > 1e-6, normal / np.maximum(length, 1e-6), self.normal)

    def to_images(self, values: np.ndarray, fill=np.nan) -> list[np.ndarray]:
        """Per-texel values (T,) or (T, C) as one image per texture, `fill` outside the charts."""
        return list(self.images(values, fill))

    def images(self, values: np.ndarray, fill=np.nan) -> Iterator[np.ndarray]:
        """The same, one image after the other."""
        for index, size in enumerate(self.sizes):
            image = np.full((*size, *values.shape[1:]), fill, values.dtype)
            here = places(self.texture == index) if len(self.sizes) > 1 else np.arange(len(self))
            for block in blocks(len(here)):
                own = here[block]
                image[self.row[own], self.col[own]] = values[own]
            yield image


@kernel
def _cover(corners, faces, owner, barycentric):
    """Give each pixel centre to the first face over it; `corners` in pixels, (n, 3, 2) float64, of
    the faces (n,)."""
    height, width = owner.shape
    for k in range(len(faces)):
        f = faces[k]
        ax, ay, bx, by, cx, cy = (
            corners[k, 0, 0], corners[k, 0, 1], corners[k, 1, 0],
            corners[k, 1, 1], corners[k, 2, 0], corners[k, 2, 1],
        )  # fmt: skip
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if not abs(area) > 0.0:
            continue
        top, bottom = (
            int(min(max(np.ceil(min(ay, by, cy)), 0.0), height)),
            int(max(min(np.floor(max(ay, by, cy)), height - 1.0), -1.0)),
        )
        left, right = (
            int(min(max(np.ceil(min(ax, bx, cx)), 0.0), width)),
            int(max(min(np.floor(max(ax, bx, cx)), width - 1.0), -1.0)),
        )
        for row in range(top, bottom + 1):
            for col in range(left, right + 1):
                u = ((cx - bx) * (row - by) - (col - bx) * (cy - by)) / area
                v = ((ax - cx) * (row - cy) - (col - cx) * (ay - cy)) / area
                w = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and w >= 0.0 and owner[row, col] < 0:
                    owner[row, col] = f
                    barycentric[row, col, 0], barycentric[row, col, 1], barycentric[row, col, 2] = (
                        u,
                        v,
                        w,
                    )


def rasterise_texels(mesh: Mesh, sizes: tuple[tuple[int, int], ...]) -> Texels:
    """Rasterise the UV charts of `mesh` into texture images of the given (height, width) sizes.

    Where charts overlap the first face wins (geometry/uv_checks tells how much of that there is).
    Texel normals are the vertex normals interpolated; on a vertex without one, the face's.
    """
    if mesh.uv is None:
        raise ValueError("the mesh has no texture coordinates: parametrise it first")
    texture_index = (
        np.zeros(len(mesh.faces), np.int32) if mesh.texture_index is None else mesh.texture_index
    )
    parts = []
    for index, (height, width) in enumerate(sizes):
        owner, barycentric = room((height, width), np.int32), room((height, width, 3), np.float32)
        owner[:] = -1
        here = np.flatnonzero(texture_index == index)
        for block in blocks(len(here)):
            own = here[block]
            uv = mesh.uv[own]
            corners = np.stack([uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5], -1)
            finite = np.isfinite(corners).all((1, 2))
            _cover(corners[finite], own[finite], owner, barycentric)
        row, col = np.nonzero(owner >= 0)
        row, col = row.astype(np.int32), col.astype(np.int32)
        parts.append([
            taken(owner, row, col), taken(barycentric, row, col),
            np.full(len(row), index, np.uint8), row, col,
        ])  # fmt: skip
        del owner, barycentric, row, col
    face, barycentric, texture, row, col = (_joined(parts) for _ in range(5))

    center = mesh.center
    vertices = rowwise(lambda some: (some - center).astype(np.float32), mesh.vertices)
    directions = rowwise(lambda some: some.astype(np.float32), mesh.vertex_normals())
    position, normal = (room((len(face), 3), np.float32) for _ in range(2))
    for block in blocks(len(face)):
        corners = mesh.faces[face[block]]
        position[block] = np.einsum("tc,tcd->td", barycentric[block], vertices[corners])
        normal[block] = np.einsum("tc,tcd->td", barycentric[block], directions[corners])
    _unit_or_face(normal, mesh, face)
    order = walk(position) if len(face) else np.arange(0)
    return Texels(
        taken(position, order), taken(normal, order), taken(face, order),
        taken(barycentric, order), taken(texture, order), taken(row, order),
        taken(col, order), center, mesh.radius, tuple(sizes),
    )  # fmt: skip


def _joined(parts: list[list[np.ndarray]]) -> np.ndarray:
    """The first column of all parts, which lose it."""
    column = [part.pop(0) for part in parts]
    if len(column) == 1:
        return column[0]
    rows = sum(map(len, column))
    return np.concatenate(column, out=room((rows, *column[0].shape[1:]), column[0].dtype))


def _unit_or_face(normal: np.ndarray, mesh: Mesh, face: np.ndarray) -> None:
    """Make normals (T, 3) unit in place; those of zero are the faces'."""
    length = room(len(normal), np.float32)
    for own in blocks(len(normal)):
        length[own] = np.linalg.norm(normal[own], axis=1)
    lost = np.flatnonzero(length < 1e-6)
    a, b, c = (mesh.vertices[mesh.faces[face[lost], i]] for i in range(3))
    normal[lost] = mesh.winding() * np.cross(b - a, c - a)
    length[lost] = np.linalg.norm(normal[lost], axis=1)
    for own in blocks(len(normal)):
        normal[own] /= np.maximum(length[own], 1e-30)[:, None]
