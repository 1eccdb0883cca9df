"""Mesh files ↔ arrays: read PLY and OBJ, write PLY."""

from __future__ import annotations

from pathlib import Path

from ..errors import DocumentError
from .mesh_file import MeshFile
from .obj import read_obj
from .ply import read_ply, write_ply

__all__ = ["MeshFile", "read_mesh", "write_ply"]


def read_mesh(path: str | Path) -> MeshFile:
    """Read a mesh or point cloud, polygons as fans of triangles, texture coordinates per wedge.

    Raises
    ------
    DocumentError
        The file is missing, cut off, neither PLY nor OBJ, has vertices that are not finite, or
        indices that point nowhere; names the file and what is wrong.
    """
    path = Path(path)
    if not path.is_file():
        raise DocumentError(f"{path}: does not exist")
    readers = {".ply": read_ply, ".obj": read_obj}
    if path.suffix.lower() not in readers:
        raise DocumentError(f"{path}: expected a PLY or OBJ file; save the layer as PLY in MeshLab")
    return readers[path.suffix.lower()](path)
