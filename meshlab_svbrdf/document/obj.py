"""OBJ and its MTL: geometry, wedge texture coordinates, and which image a face takes (map_Kd)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.mesh import Mesh
from .mesh_file import MeshFile, check_mesh, fan

MAP_OPTIONS = {
    **dict.fromkeys(("-blendu", "-blendv", "-bm", "-boost", "-cc", "-clamp", "-imfchan"), 1),
    **{"-texres": 1, "-type": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3},
}


def read_obj(path: Path) -> MeshFile:
    """Read an OBJ file and the MTL files it names; see `mesh_files.read_mesh`."""
    lines = path.read_bytes().decode("utf-8", "surrogateescape").replace("\\\n", " ").splitlines()
    rows: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    polygons: list[str] = []
    totals: list[tuple[int, int, int]] = []
    material_of: list[int] = []
    materials: dict[str, int] = {}
    libraries: list[str] = []
    material = -1

    # Sort the lines by kind; remember for each face what had been declared above it
    v, vt, vn = rows["v"], rows["vt"], rows["vn"]
    for line in lines:
        kind, _, rest = line.strip().partition(" ")
        if kind in rows:
            rows[kind].append(rest)
        elif kind == "f":
            polygons.append(rest.partition("#")[0])
            totals.append((len(v), len(vt), len(vn)))
            material_of.append(material)
        elif kind == "usemtl":
            material = materials.setdefault(rest.strip(), len(materials))
        elif kind == "mtllib":
            libraries.append(rest.strip())

    position = _numbers(v, (3, 4, 6, 7), path, "v")
    counts = np.array([len(polygon.split()) for polygon in polygons], np.int64)
    corner = _corners(" ".join(polygons).split(), path)
    corner = _absolute(corner, np.repeat(np.array(totals).reshape(-1, 3), counts, axis=0), path)
    polygon, triangle = fan(counts, path)
    faces = corner[triangle, 0]

    # Look up wedge coordinates; faces without get zeros and no texture
    uv, index = None, None
    textures: tuple[Path, ...] = ()
    if vt and (corner[:, 1] >= 0).any():
        table = _numbers(vt, (1, 2, 3), path, "vt")
        table = np.pad(table, ((0, 0), (0, 1)))  # v is 0 where it is left out
        wedge = corner[triangle, 1]
        has = (wedge >= 0).all(axis=1)
        uv = np.where(has[:, None, None], table[wedge, :2], 0.0)
        image, textures = _textures(path, libraries, list(materials))
        index = np.append(image, 0 if not materials else -1)[np.array(material_of)[polygon]]
        index = np.where(has, index, -1).astype(np.int32)
        if len(textures) < 2 and (index == index[0]).all():
            index = None
    normals = _vertex_normals(corner, _numbers(vn, (3,), path, "vn"), len(position)) if vn else None
    mesh = Mesh(position[:, :3], faces.astype(np.int32), normals, uv, index)
    check_mesh(mesh, textures, path)
    color = None
    if position.shape[1] >= 6:
        rgb = np.clip(np.round(position[:, -3:] * 255), 0, 255).astype(np.uint8)
        color = np.column_stack([rgb, np.full(len(rgb), 255, np.uint8)])
    return MeshFile(mesh=mesh, textures=textures, vertex_color=color)


def _numbers(rows: list[str], widths: tuple[int, ...], path: Path, what: str) -> np.ndarray:
    """All rows' numbers, (N, W) float64; each row must have as many as the first."""
    if not rows:
        raise DocumentError(f"{path}: has no {what} lines")
    rows = [row.partition("#")[0] for row in rows]
    width = len(rows[0].split())
    uneven = next((row for row in rows if len(row.split()) != width), None)
    if width not in widths or uneven is not None:
        raise DocumentError(
            f"{path}: expected {' or '.join(map(str, widths))} numbers in each {what} line, as "
            f"many in all; found {rows[0].strip()!r}"
            + (f" and {uneven.strip()!r}" if uneven else "")
        )
    return _parse(" ".join(rows), np.float64, path, what).reshape(-1, width)


def _corners(words: list[str], path: Path) -> np.ndarray:
    """Corners "v", "v/vt", "v//vn", "v/vt/vn" to (N, 3) int64, 0 where absent."""
    if not words:
        return np.empty((0, 3), np.int64)
    three = " ".join(word + "/0" * (2 - word.count("/")) for word in words)
    corners = _parse(three.replace("//", "/0/").replace("/", " "), np.int64, path, "f")
    if three.count("/") != 2 * len(words) or corners.size != 3 * len(words):
        raise DocumentError(f"{path}: a face's corner is not v, v/vt, v//vn or v/vt/vn")
    return corners.reshape(-1, 3)


def _parse(text: str, dtype: type, path: Path, what: str) -> np.ndarray:
    try:
        return np.fromstring(text, dtype, sep=" ")
    except ValueError as error:
        raise DocumentError(f"{path}: the numbers of its {what} lines cannot be read") from error


def _absolute(corner: np.ndarray, totals: np.ndarray, path: Path) -> np.ndarray:
    """From 1, or backwards from the face's line if negative, to indices from 0; −1 if absent."""
    index = np.where(corner > 0, corner - 1, np.where(corner < 0, totals + corner, -1))
    last = totals.max(axis=0, initial=0)
    bad = (index >= last) | ((corner < 0) & (index < 0)) | (np.arange(3) == 0) & (index < 0)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise DocumentError(
            f"{path}: a face's {('vertex', 'texture coordinate', 'normal')[column]} index is "
            f"{corner[row, column]}, but only 1 to {last[column]} exist"
        )
    return index


def _vertex_normals(corner: np.ndarray, table: np.ndarray, count: int) -> np.ndarray | None:
    """The mean direction of the normals that a vertex's wedges have, (V, 3)."""
    has = corner[:, 2] >= 0
    if not has.any():
        return None
    wedge = table[corner[has, 2]]
    total = np.stack(
        [np.bincount(corner[has, 0], wedge[:, i], minlength=count) for i in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _textures(
    path: Path, libraries: list[str], materials: list[str]
) -> tuple[np.ndarray, tuple[Path, ...]]:
    """Each material's image (M,), −1 without, and the images, each once, in materials' order."""
    maps: dict[str, Path] = {}
    for name in libraries:
        maps |= _read_mtl(path.parent / name, path)
    images = list(dict.fromkeys(maps[name] for name in materials if name in maps))
    index = [images.index(maps[name]) if name in maps else -1 for name in materials]
    return np.array(index, np.int64), tuple(images)


def _read_mtl(path: Path, obj: Path) -> dict[str, Path]:
    try:
        text = path.read_bytes().decode("utf-8", "surrogateescape")
    except (OSError, ValueError) as error:  # ValueError: no name of a file
        raise DocumentError(
            f"{obj}: its material library {path} cannot be read; put it there, or remove the "
            "mtllib line if the mesh has a single texture"
        ) from error
    maps: dict[str, Path] = {}
    material = ""
    for line in text.splitlines():
        kind, _, rest = line.strip().partition(" ")
        if kind == "newmtl":
            material = rest.strip()
        elif kind == "map_Kd":
            words = rest.split()
            while words and words[0] in MAP_OPTIONS:
                words = words[1 + MAP_OPTIONS[words[0]] :]
            name = " ".join(words).replace("\\", "/")
            maps[material] = Path(os.path.normpath(path.absolute().parent / name))
    return maps
