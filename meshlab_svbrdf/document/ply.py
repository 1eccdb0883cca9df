"""PLY: read what MeshLab and others write, write what MeshLab reads."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..blocks import blocks, resting, room, rowwise
from ..errors import DocumentError
from ..geometry.mesh import Mesh
from .atomic import replacing
from .mesh_file import MeshFile, check_mesh, fan
from .ply_format import Element, Lists, read_ply_columns

log = logging.getLogger("meshlab_svbrdf")

XYZ, NORMAL, RGBA = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue", "alpha")
UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
OWN_NAMES = {*XYZ, *NORMAL, *RGBA, "quality", "flags"}
ATTRIBUTE_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}")
PLY_TYPES = {"u1": "uchar", "i4": "int", "f4": "float", "f8": "double"}
SELECTED = 0x20
"""The bit of a face's flags, as MeshLab writes them, that says it is selected."""
ROWS = 1 << 14
"""Of a file, written at once."""
FAR = 64  # radii from the origin: from there on float32 positions lose what fine texels need


@np.errstate(invalid="ignore")  # signalling NaNs warn when they are widened; check_mesh names them
def read_ply(path: Path) -> MeshFile:
    """Read a PLY file; see `mesh_files.read_mesh`."""
    comments, elements = read_ply_columns(path)
    if "tristrips" in elements:
        raise DocumentError(f"{path}: holds triangle strips; save it again as triangles in MeshLab")
    vertex = elements["vertex"].columns if "vertex" in elements else {}
    if not set(XYZ) <= set(vertex):
        raise DocumentError(f"{path}: has no vertices with x, y, z")
    vertices = _stack(vertex, XYZ)
    element = elements.get("face", Element("face", 0))
    faces, uv, texture_index, polygon = _read_faces(element, path)

    # Take texture coordinates per wedge, else per vertex
    used = set(OWN_NAMES)
    uv_names = next((pair for pair in UV_NAMES if set(pair) <= set(vertex)), None)
    if uv is None and uv_names is not None and len(faces):
        uv = _stack(vertex, uv_names)[np.clip(faces, 0, len(vertices) - 1)]
        used |= set(uv_names)
    textures = tuple(
        Path(os.path.normpath(path.absolute().parent / name))
        for word, _, name in (comment.partition(" ") for comment in comments)
        if word.lower() == "texturefile" and name.strip()
    )
    normals = _stack(vertex, NORMAL) if set(NORMAL) <= set(vertex) else None
    mesh = Mesh(vertices, faces, normals, uv, texture_index)
    check_mesh(mesh, textures, path)
    color = None
    if set(RGBA[:3]) <= set(vertex):
        channels = _stack(vertex, RGBA if "alpha" in vertex else RGBA[:3])
        color = _rgba(_integers(channels, f"{path}: vertex colour", 0, 255).astype(np.uint8))
    quality = vertex.get("quality")
    return MeshFile(
        mesh=mesh,
        textures=textures,
        vertex_attributes=_attributes({n: c for n, c in vertex.items() if n not in used}, path),
        vertex_color=color,
        quality=None if quality is None else _attribute(quality, "quality", path),
        face_color=_face_color(element, polygon, path),
        face_selected=_face_selected(element, polygon, path),
    )


Column = tuple[str, Any, np.ndarray]
"""Name, kind and values of a property."""


def write_ply(
    path: str | Path,
    mesh: Mesh | np.ndarray,
    *,
    textures: Sequence[str | Path] = (),
    color: np.ndarray | None = None,
    quality: np.ndarray | None = None,
    vertex_attributes: Mapping[str, np.ndarray] | None = None,
    dtype: type[np.float32] | type[np.float64] = np.float32,
) -> None:
    """Write a binary little-endian PLY that MeshLab opens, whole or not at all.

    Parameters
    ----------
    mesh : a mesh, a mesh without faces (a point cloud with normals), or points (V, 3)
    textures : image files, written relative to the PLY's folder
    color : (V, 3) or (V, 4) uint8
    quality : (V,), shown by MeshLab with its histogram and colour map
    vertex_attributes : (V,) scalars by name (letters, digits, _), written as further properties;
        MeshLab ignores them, `read_mesh` gives them back
    dtype : of positions, normals, quality and attributes; texture coordinates are float32, MeshLab
        reads no other. An object far from the origin gets float64 positions all the same.

    Raises
    ------
    ValueError : a column does not fit, an attribute's name is not an identifier.
    DocumentError : the mesh would be refused when read; a texture's name has a space.
    """
    path = Path(path)
    if not isinstance(mesh, Mesh):
        mesh = Mesh(np.asarray(mesh, np.float64), np.empty((0, 3), np.int32))
    files = tuple(Path(os.path.abspath(texture)) for texture in textures)
    check_mesh(mesh, files, path)
    far = np.abs(mesh.vertices).max() > FAR * mesh.radius
    position_type = np.float64 if far else dtype

    # Collect the vertices' columns
    columns: list[Column] = [
        (name, position_type, mesh.vertices[:, i]) for i, name in enumerate(XYZ)
    ]
    if mesh.normals is not None:
        columns += [(name, dtype, mesh.normals[:, i]) for i, name in enumerate(NORMAL)]
    if color is not None:
        columns += [(name, np.uint8, _rgba(color)[:, i]) for i, name in enumerate(RGBA)]
    if quality is not None:
        columns.append(("quality", dtype, np.asarray(quality)))
    for name, values in (vertex_attributes or {}).items():
        if not ATTRIBUTE_NAME.fullmatch(name) or name in OWN_NAMES:
            raise ValueError(f"{name!r} cannot name a vertex attribute; use lower case svbrdf_…")
        columns.append((name, dtype, np.asarray(values)))

    # Give every face its corners, texture coordinates and texture
    faces: list[Column] = [
        ("vertex_indices", (np.int32, (3,)), mesh.faces),
    ]
    if mesh.uv is not None:
        faces.append(("texcoord", (np.float32, (6,)), mesh.uv.reshape(-1, 6)))
    if mesh.texture_index is not None and (len(files) > 1 or (mesh.texture_index < 0).any()):
        faces.append(("texnumber", np.int32, mesh.texture_index))

    folder = Path(os.path.abspath(path)).parent
    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"comment TextureFile {_texture_name(file, folder)}" for file in files]
    elements = (("vertex", columns, len(mesh.vertices)), ("face", faces, len(mesh.faces)))
    with replacing(path) as temporary, temporary.open("wb") as stream:
        for name, own, count in elements:
            header += [f"element {name} {count}", *_properties(_row(own, count))]
        stream.write("\n".join([*header, "end_header", ""]).encode("utf-8"))
        for _, own, count in elements:
            for rows in _rows(own, count):
                stream.write(rows.data)  # tofile does not notice that the disk is full


def _read_faces(
    element: Element, path: Path
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None, np.ndarray]:
    """Triangles (F, 3), wedge coordinates (F, 3, 2) and texture (F,) where the file has them, and
    of each triangle its polygon."""
    columns = element.columns
    corners = columns.get("vertex_indices", columns.get("vertex_index"))
    if corners is None:
        if element.count:
            raise DocumentError(f"{path}: its faces have no vertex_indices")
        return np.empty((0, 3), np.int32), None, None, np.empty(0, np.int64)
    if not isinstance(corners, Lists):
        raise DocumentError(f"{path}: its vertex_indices are not lists")
    polygon, triangle = fan(corners.counts, path)
    faces = resting(_integers(corners.values, f"{path}: vertex_indices")[triangle])
    texture = columns.get("texnumber")
    index = None if texture is None else _integers(texture, f"{path}: texnumber")[polygon]
    texcoord = columns.get("texcoord")
    if not isinstance(texcoord, Lists) or not len(texcoord.values):
        return faces, None, index, polygon

    # Faces without coordinates get zeros and no texture
    has = texcoord.counts > 0
    if (texcoord.counts[has] != 2 * corners.counts[has]).any():
        face = int(np.argmax(has & (texcoord.counts != 2 * corners.counts)))
        raise DocumentError(
            f"{path}: face {face} has {corners.counts[face]} corners and {texcoord.counts[face]} "
            "texture coordinates, expected two a corner"
        )
    flat = room((len(corners.values), 2), np.float64)
    flat[:] = 0
    flat[np.repeat(has, corners.counts)] = texcoord.values.reshape(-1, 2)
    if not has.all():
        index = np.where(has[polygon], 0 if index is None else index, -1).astype(np.int32)
    return faces, rowwise(lambda some: flat[some], triangle), index, polygon


def _face_color(element: Element, polygon: np.ndarray, path: Path) -> np.ndarray | None:
    columns = element.columns
    if not set(RGBA[:3]) <= set(columns):
        return None
    channels = _stack(columns, RGBA if "alpha" in columns else RGBA[:3])
    return _rgba(_integers(channels, f"{path}: face colour", 0, 255).astype(np.uint8))[polygon]


def _face_selected(element: Element, polygon: np.ndarray, path: Path) -> np.ndarray | None:
    flags = element.columns.get("flags")
    if flags is None or isinstance(flags, Lists):
        return None
    return (_integers(flags, f"{path}: face flags")[polygon] & SELECTED) > 0


def _integers(
    values: Any, where: str, low: float = -(2**31), high: float = 2**31 - 1
) -> np.ndarray:
    """Text files give doubles: (…) int32, if all are whole and within bounds."""
    values = np.asarray(values)
    good = (values >= low) & (values <= high) & (values == np.floor(values))
    if not good.all():
        raise DocumentError(
            f"{where} holds {values[~good][0]}, expected whole numbers from {low} to {high}; "
            "save the file again in MeshLab"
        )
    return values.astype(np.int32)


def _stack(columns: Mapping[str, Any], names: Sequence[str]) -> np.ndarray:
    rows = room((len(columns[names[0]]), len(names)), np.float64)
    for column, name in enumerate(names):
        rows[:, column] = columns[name]
    return rows


def _attributes(columns: Mapping[str, np.ndarray | Lists], path: Path) -> dict[str, np.ndarray]:
    """Further attributes of vertices; those that MeshLab's parser cannot take are left out, and
    told: one such name makes every function filter on the layer fail."""
    strange = [name for name in columns if not ATTRIBUTE_NAME.fullmatch(name)]
    if strange:
        shown = ", ".join(repr(name[:40]) for name in strange[:5])
        log.warning(
            "%s: attributes of its vertices are left out, for MeshLab takes names of letters, "
            "digits and _ alone: %s", path, shown,
        )  # fmt: skip
    return {n: _attribute(c, n, path) for n, c in columns.items() if n not in strange}


def _attribute(column: np.ndarray | Lists, name: str, path: Path) -> np.ndarray:
    if not isinstance(column, Lists):
        return column
    if len(set(column.counts.tolist())) > 1:
        raise DocumentError(f"{path}: vertex attribute {name!r} has lists of unequal length")
    return column.values.reshape(len(column.counts), -1)


def _rgba(color: np.ndarray) -> np.ndarray:
    color = np.asarray(color)
    if color.dtype != np.uint8 or color.ndim != 2 or color.shape[1] not in (3, 4):
        raise ValueError(f"expected colours (V, 3|4) uint8, found {color.shape} {color.dtype}")
    opaque = np.full((len(color), 4 - color.shape[1]), 255, np.uint8)
    return np.concatenate([color, opaque], axis=1)


def _row(columns: list[Column], count: int) -> np.dtype:
    """A row's type: the columns side by side, before a list its length."""
    fields: list[tuple] = []
    for name, kind, values in columns:
        shape = np.dtype(kind).shape
        if np.shape(values) != (count, *shape):
            raise ValueError(f"{name}: expected shape {(count, *shape)}, found {np.shape(values)}")
        length = [(f"{name}\nlength", "u1")] if shape else []
        fields += [*length, (name, np.dtype(kind).base.newbyteorder("<"), shape)]
    return np.dtype(fields)


def _rows(columns: list[Column], count: int) -> Iterator[np.ndarray]:
    """The rows, some at a time: what is written fits into the cache."""
    row = _row(columns, count)
    table = np.empty(min(ROWS, count), row)
    for own in blocks(count, ROWS):
        rows = table[: own.stop - own.start]
        for name, kind, values in columns:
            try:
                with np.errstate(over="raise"):
                    rows[name] = values[own]
            except FloatingPointError as error:
                raise ValueError(f"{name}: values exceed float32; pass dtype=np.float64") from error
            if np.dtype(kind).shape:
                rows[f"{name}\nlength"] = np.dtype(kind).shape[0]
        yield rows


def _properties(row: np.dtype) -> list[str]:
    lines = []
    for name in row.names or ():
        if name.endswith("\nlength"):
            continue
        word = PLY_TYPES[row[name].base.str[1:]]
        lines.append(f"property {f'list uchar {word}' if row[name].shape else word} {name}")
    return lines


def _texture_name(file: Path, folder: Path) -> str:
    try:
        name = Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # another drive on Windows has no relative path
        name = file.as_posix()
    if len(name.split()) != 1:
        raise DocumentError(
            f"{file}: MeshLab reads a PLY's texture name up to the first space; rename the file, "
            "or put the PLY where the path to the texture has none"
        )
    return name
