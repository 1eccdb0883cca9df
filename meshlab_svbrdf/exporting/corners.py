"""A mesh as graphics cards read it: one index per vertex, with texture coordinates and tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.mesh import Mesh
from ..geometry.mikktspace import same_rows


@dataclass(frozen=True)
class Vertices:
    """position, normal : (N, 3) float32, about the mesh's centre; uv : (N, 2) float32, v upwards
    tangent : (N, 4) float32, or None; index : (F, 3) uint32, counter-clockwise seen from outside
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    tangent: np.ndarray | None
    index: np.ndarray


def outward(mesh: Mesh) -> np.ndarray:
    """The order in which to take a face's corners: normals point to where they turn left."""
    return np.array([0, 1, 2] if mesh.winding() > 0 else [0, 2, 1])


def joined_vertices(mesh: Mesh, faces: np.ndarray, tangents: np.ndarray | None = None) -> Vertices:
    """Vertices of some faces (bool or indices), those that agree in all once.

    tangents : (F, 3, 4) of all the mesh's faces
    """
    assert mesh.uv is not None
    turn = outward(mesh)
    corner = mesh.faces[faces][:, turn].ravel()
    uv = mesh.uv[faces][:, turn].reshape(-1, 2).astype(np.float32)
    columns = [corner, *uv.T]
    told = None
    if tangents is not None:
        told = tangents[faces][:, turn].reshape(-1, 4).astype(np.float32)
        columns += [*told.T]
    group = same_rows(columns)
    first = np.zeros(group.max(initial=-1) + 1, np.int64)
    first[group[::-1]] = np.arange(len(group))[::-1]
    normal = mesh.vertex_normals()
    normal[~normal.any(axis=1)] = [0, 0, 1]  # no area around it: never seen
    return Vertices(
        (mesh.vertices - mesh.center)[corner[first]].astype(np.float32),
        normal[corner[first]].astype(np.float32),
        uv[first],
        None if told is None else told[first],
        group.reshape(-1, 3).astype(np.uint32),
    )


def textured_faces(mesh: Mesh, count: int) -> list[np.ndarray]:
    """The faces of each of `count` textures, and at last those without any: index arrays."""
    if mesh.texture_index is None:
        return [np.arange(len(mesh.faces))] + [np.zeros(0, np.int64)] * count
    return [np.flatnonzero(mesh.texture_index == k) for k in [*range(count), -1]]
