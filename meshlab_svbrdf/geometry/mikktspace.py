"""Tangents that normal maps of other programs are told in: MikkTSpace's.

Corners of faces that have place, normal and texture coordinates in common, on charts of the same
orientation, share a tangent: the mean of their faces', each across the normal and weighed by its
angle there. The bitangent is sign × (normal × tangent). Between corners, normal and tangent are
interpolated and made unit vectors. (Morten Mikkelsen, "Simulation of Wrinkled Surfaces Revisited",
2008. His code also parts corners whose faces touch in a point alone; these are joined here.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .mesh import Mesh
from .normal_maps import face_tangents
from .texels import Texels


def same_rows(columns: Sequence[np.ndarray]) -> np.ndarray:
    """A number for each row (N,): the same where all columns (N,) agree."""
    order = np.lexsort(columns)
    new = np.zeros(len(order), bool)
    for column in columns:
        new[1:] |= column[order][1:] != column[order][:-1]
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new)
    return numbers


def corner_tangents(mesh: Mesh) -> np.ndarray:
    """Tangents (F, 3, 3) float64, unit, and in [..., 3] the sign ±1 of the bitangent: (F, 3, 4).

    Where the texture coordinates give no direction it is any one across the normal.
    """
    along_u, _ = face_tangents(mesh)
    assert mesh.uv is not None
    corners = mesh.faces.ravel()
    normal = mesh.vertex_normals()[corners]
    d1, d2 = mesh.uv[:, 1] - mesh.uv[:, 0], mesh.uv[:, 2] - mesh.uv[:, 0]
    upright = np.repeat(d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1] > 0, 3)

    # Weigh each face's tangent, across the corner's normal, by its angle there
    own = _across(np.repeat(along_u, 3, axis=0), normal)
    own *= (_angles(mesh) * np.repeat(along_u.any(axis=1), 3))[:, None]

    # Join corners at the same place of surface and texture
    place = same_rows([*(mesh.vertices + 0.0).T, *(mesh.vertex_normals() + 0.0).T])[corners]
    group = same_rows([place, *(mesh.uv.reshape(-1, 2) + 0.0).T, upright])
    total = np.stack([np.bincount(group, own[:, axis]) for axis in range(3)], axis=1)[group]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    lost = length[:, 0] < 1e-12
    total[lost] = _any_across(normal[lost])
    total = total / np.where(lost[:, None], 1, length)
    sign = np.where(upright, 1.0, -1.0)
    return np.concatenate([total, sign[:, None]], axis=1).reshape(-1, 3, 4)


def tangent_frames(texels: Texels, mesh: Mesh, tangents: np.ndarray) -> np.ndarray:
    """Tangent, bitangent and normal at the texels: the columns of (T, 3, 3), unit vectors.

    tangents : (F, 3, 4) of `corner_tangents`
    """
    own = tangents[texels.face]
    normal = texels.smooth_normals(mesh).astype(float)
    tangent = np.einsum("tc,tcd->td", texels.barycentric, own[..., :3])
    bitangent = own[:, 0, 3:] * np.cross(normal, tangent)
    columns = (tangent, bitangent, normal)
    return np.stack([_unit(column) for column in columns], axis=2)


def in_tangent_space(frames: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Unit vectors (T, 3) in their frames (T, 3, 3), unit; straight up where a frame is flat."""
    firm = np.abs(np.linalg.det(frames)) > 1e-3
    told = np.tile([0.0, 0.0, 1.0], (len(frames), 1))
    told[firm] = np.linalg.solve(frames[firm], normals[firm, :, None].astype(float))[..., 0]
    return _unit(told)


def _angles(mesh: Mesh) -> np.ndarray:
    """Of the faces at their corners, in the plane across the normal, (3F,) radians."""
    normal = mesh.vertex_normals()
    found = np.empty((len(mesh.faces), 3))
    for corner in range(3):
        here, after, before = (mesh.faces[:, (corner + k) % 3] for k in range(3))
        sides = [
            _across(mesh.vertices[to] - mesh.vertices[here], normal[here]) for to in (after, before)
        ]
        found[:, corner] = np.arccos(np.clip(np.einsum("ij,ij->i", *sides), -1, 1))
    return found.ravel()


def _across(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return _unit(vectors - normals * np.einsum("ij,ij->i", vectors, normals)[:, None])


def _any_across(normals: np.ndarray) -> np.ndarray:
    """A unit vector across each normal."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    return _across(axis, normals)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-12)
