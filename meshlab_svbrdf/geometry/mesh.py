"""A triangle mesh with texture coordinates per wedge: what the core needs of a MeshLab layer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..blocks import blocks, room, rowwise

CELL = 1e-6
"""Radii within which vertices count as one, where a surface is asked whether it is closed."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in the world's coordinates (metres, millimetres: whatever the scan uses).

    vertices : (V, 3) float64
    faces : (F, 3) int32
    normals : (V, 3) float64 unit vectors, or None where the file has none
    uv : (F, 3, 2) float64 per wedge, or None; image row 0 of a texture is v = 1
    texture_index : (F,) int32, which of the layer's textures a face uses
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None
    texture_index: np.ndarray | None = None

    @cached_property
    def center(self) -> np.ndarray:
        """The middle of the bounding box, (3,) float64: the origin of all directions to lights."""
        return (self.vertices.min(0) + self.vertices.max(0)) / 2

    @cached_property
    def radius(self) -> float:
        """Half the diagonal of the bounding box: the unit of all thresholds on distance."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)) / 2)

    def vertex_normals(self) -> np.ndarray:
        """The file's normals, or the area-weighted mean of the faces' around; (V, 3) float64, unit.

        Where the file's is zero the faces' mean stands in. A vertex without any area around it gets
        a zero vector: no view direction faces it.
        """
        if self.normals is None:
            return self._face_means()
        given = rowwise(_unit, self.normals)
        lost = ~given.any(axis=1)
        if lost.any():
            given[lost] = self._face_means()[lost]
        return given

    def winding(self) -> int:
        """1 where faces turn counter-clockwise seen from where the normals point; −1: mirrored."""
        normals, outwards = self.vertex_normals(), 0.0
        for own in blocks(len(self.faces)):
            means = normals[self.faces[own]].sum(axis=1)
            outwards += np.einsum("ij,ij->", self._areas(own), means)
        return -1 if outwards < 0 else 1

    def is_closed(self) -> bool:
        """Whether every edge has two faces that agree on their front, so that backs are hidden.

        Vertices at the same place, to a millionth of the radius, count as one: files double them
        along the seams of textures.
        """
        place = self._places()
        edges, backwards = (room(self.faces.size, np.int64) for _ in range(2))
        count = 0
        for own in blocks(len(self.faces)):
            corners = place[self.faces[own]]
            corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]  # with an area
            start, stop = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
            edges[count : count + len(start)] = start * len(place) + stop
            backwards[count : count + len(start)] = stop * len(place) + start
            count += len(start)
        edges, backwards = edges[:count], backwards[:count]
        edges.sort()
        backwards.sort()
        once = bool((edges[1:] != edges[:-1]).all())
        return len(edges) > 0 and once and bool((edges == backwards).all())

    def _places(self) -> np.ndarray:
        """Numbers below V, int64, that are the same where vertices are within a cell of a grid."""
        cell = max(CELL * self.radius, 1e-300)

        def key(vertices: np.ndarray) -> np.ndarray:
            grid = np.rint((vertices - self.center) / cell).astype(np.int64) + (1 << 20)
            return (grid[:, 0] << 42) + (grid[:, 1] << 21) + grid[:, 2]

        keys = rowwise(key, self.vertices)
        ordered = rowwise(np.copy, keys)
        ordered.sort()
        return rowwise(ordered.searchsorted, keys)

    def _areas(self, own: slice) -> np.ndarray:
        """Of some faces: normals twice as long as their area, (n, 3)."""
        a, b, c = np.moveaxis(self.vertices[self.faces[own]], 1, 0)
        return np.cross(b - a, c - a)

    def _face_means(self) -> np.ndarray:
        area = room((len(self.faces), 3), np.float64)
        for own in blocks(len(area)):
            area[own] = self._areas(own)
        total = room(self.vertices.shape, np.float64)
        total[:] = 0
        for corner in range(3):
            np.add.at(total, self.faces[:, corner], area)
        return rowwise(_unit, total)

    def transformed(self, matrix: np.ndarray) -> Mesh:
        """The mesh after an affine (4, 4) matrix, normals by the inverse transpose.

        One that mirrors turns the faces' winding inside out: normals are kept from before then.
        """
        linear = matrix[:3, :3]
        normals = self.vertex_normals() if np.linalg.det(linear) < 0 else self.normals
        if normals is not None:
            inverse = np.linalg.inv(linear)
            normals = rowwise(lambda some: _unit(some @ inverse), normals)
        vertices = rowwise(lambda some: some @ linear.T + matrix[:3, 3], self.vertices)
        return replace(self, vertices=vertices, normals=normals)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
