"""What a mesh file holds, and the checks and the triangulation that every format needs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DocumentError
from ..geometry.mesh import Mesh


@dataclass(frozen=True)
class MeshFile:
    """A mesh (or, with no faces, a point cloud) and what comes with it.

    mesh : faces without texture coordinates have uv 0 and texture_index −1, as in MeshLab
    textures : absolute paths, in the order of `mesh.texture_index`; they may not exist
    vertex_attributes : custom scalars (V,) or vectors (V, k) by name
    vertex_color : (V, 4) uint8 R, G, B, A, or None
    quality : (V,), or None
    face_color : (F, 4) uint8, or None; face_selected : (F,) bool, or None: read, never written
    """

    mesh: Mesh
    textures: tuple[Path, ...] = ()
    vertex_attributes: dict[str, np.ndarray] = field(default_factory=dict)
    vertex_color: np.ndarray | None = None
    quality: np.ndarray | None = None
    face_color: np.ndarray | None = None
    face_selected: np.ndarray | None = None


def fan(counts: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into fans of triangles around their first corner.

    Parameters
    ----------
    counts : (P,) corners of each polygon, all polygons' corners lying in one flat array
    path : named in errors

    Returns
    -------
    polygon : (F,) int64, the polygon of each triangle
    corner : (F, 3) int64, the triangles' corners in the flat array
    """
    if counts.size and counts.min() < 3:
        face = int(np.argmax(counts < 3))
        raise DocumentError(f"{path}: face {face} has {counts[face]} corners, expected 3 or more")
    counts = counts.astype(np.int64)
    triangles = counts - 2
    polygon = np.repeat(np.arange(len(counts)), triangles)
    turn = np.arange(len(polygon)) - (np.cumsum(triangles) - triangles)[polygon]
    first = (np.cumsum(counts) - counts)[polygon]
    return polygon, np.stack([first, first + turn + 1, first + turn + 2], axis=1)


def check_mesh(mesh: Mesh, textures: tuple[Path, ...], path: Path) -> None:
    """Refuse vertices, normals and coordinates that are not finite, indices that point nowhere."""
    if not len(mesh.vertices):
        raise DocumentError(f"{path}: has no vertices")
    for what, values in (
        ("vertex", mesh.vertices),
        ("normal", mesh.normals),
        ("texture coordinates of face", mesh.uv),
    ):
        if values is not None:
            finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
            _refuse(~finite, values, f"{path}: {what}", "finite numbers")
    count = len(mesh.vertices)
    outside = ((mesh.faces < 0) | (mesh.faces >= count)).any(axis=1)
    _refuse(outside, mesh.faces, f"{path}: vertices of face", f"indices below {count}")
    if mesh.texture_index is not None and textures:
        outside = (mesh.texture_index < -1) | (mesh.texture_index >= len(textures))
        _refuse(outside, mesh.texture_index, f"{path}: texture of face", f"below {len(textures)}")


def _refuse(bad: Any, values: np.ndarray, what: str, expected: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        raise DocumentError(
            f"{what} {row} is {values[row].tolist()}, expected {expected} ({bad.sum()} such rows); "
            "repair the mesh in MeshLab"
        )
