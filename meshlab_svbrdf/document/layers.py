"""Layers: what the document adds to a project for people to look at.

Layer             any mesh layer, read from its file when first asked for
texels_content    one point per texel: all statistics as attributes, one of them as Quality
vertex_properties a texel attribute (T,) or (T, k) as PLY properties `svbrdf_…`
write_layer       a layer's content as PLY
mesh_digest       what tells whether a mesh is still the one that results were made from
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..blocks import blocks, rowwise
from ..geometry.mesh import Mesh
from .mesh_files import MeshFile, read_mesh, write_ply
from .project import MeshEntry

if TYPE_CHECKING:
    from ..geometry.texels import Texels

OURS = ("texels", "environment", "materials")
MAP = "map: "
UNOBSERVED = -1.0  # as Quality: MeshLab's colour ramps and histograms crash on NaN
MAX_NAME = 100  # MeshLab's function filters fail on longer attribute names


@dataclass(eq=False)
class Layer:
    """A mesh layer; a point cloud is a mesh without faces.

    label : as MeshLab shows it
    path : its file, absolute; None where it only is in memory
    matrix : (4, 4) float64, the layer's own coordinates to the world's
    content : mesh, textures, colour, quality, attributes; read from `path` when None
    entry : the project's own record of it, with all that we do not know
    """

    label: str
    path: Path | None = None
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    visible: bool = True
    content: MeshFile | None = None
    entry: MeshEntry | None = None

    def move(self, old: Path, new: Path) -> None:
        """Follow the folder `old` that is at `new` now."""
        if self.path is not None:
            self.path = moved(self.path, old, new)
        if self.content is not None:
            textures = tuple(moved(path, old, new) for path in self.content.textures)
            self.content = replace(self.content, textures=textures)

    def read(self) -> MeshFile:
        if self.content is None:
            assert self.path is not None
            self.content = read_mesh(self.path)
        return self.content

    @property
    def ours(self) -> bool:
        """Whether the suite made this layer: by its label, and by the folder that it lies in."""
        named = self.label in OURS or self.label.startswith(MAP)
        stored = self.path is None or self.path.parent.parent.suffix == ".svbrdf"
        return named and stored


def moved(path: Path, old: Path, new: Path) -> Path:
    """Where a file is, if it was in the folder `old` that is at `new` now."""
    return new / path.relative_to(old) if path.is_relative_to(old) else path


def file_name(label: str) -> str:
    """A layer's file: its label in letters that every system takes, `layers/map_shininess.ply`."""
    return f"layers/{re.sub(r'[^A-Za-z0-9]+', '_', label).strip('_') or 'layer'}.ply"


def attribute_name(name: str) -> str:
    """`name` without `svbrdf_`; ValueError where MeshLab's function filters would choke on it."""
    bare = name.removeprefix("svbrdf_")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", bare) or len(bare) > MAX_NAME - len("svbrdf__00"):
        raise ValueError(f"attribute {name!r}: use a short name of a-z, 0-9 and _")
    return bare


def vertex_properties(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """The scalar properties `svbrdf_NAME`, or `svbrdf_NAME_0` … for (T, k), float32."""
    values = values.astype(np.float32, copy=False)
    if values.ndim == 1:
        return {f"svbrdf_{name}": values}
    columns = values.reshape(len(values), -1)
    return {f"svbrdf_{name}_{k}": columns[:, k] for k in range(columns.shape[1])}


def texels_content(
    texels: Texels,
    attributes: dict[str, np.ndarray],
    images: list[np.ndarray] | None,
    quality: str | None,
) -> MeshFile:
    """One point per texel, about the texels' centre: its layer's matrix is the translation there.

    attributes : (T,) or (T, k) by name
    images : uint8 (h, w, 3) per texture, the points' colours
    quality : the attribute that MeshLab shows as Quality; UNOBSERVED where it is NaN
    """
    properties: dict[str, np.ndarray] = {}
    for name, values in attributes.items():
        properties |= vertex_properties(name, values)
    color = None
    if images is not None:
        color = np.full((len(texels), 4), 255, np.uint8)
        for index, image in enumerate(images):
            here = texels.texture == index
            color[here, :3] = image[texels.row[here], texels.col[here], :3]
    shown = properties.get(f"svbrdf_{quality}")
    if shown is not None:
        shown = np.where(np.isfinite(shown), shown, np.float32(UNOBSERVED))
    position = rowwise(lambda some: some.astype(np.float64), texels.position)
    return MeshFile(
        mesh=Mesh(position, np.zeros((0, 3), np.int32), texels.normal),
        vertex_attributes=properties,
        vertex_color=color,
        quality=shown,
    )


def write_layer(
    path: Path, content: MeshFile, *, textures: tuple[Path, ...] | None = None, double: bool = False
) -> None:
    """Write a layer's content as PLY; `textures` in place of its own, `double` loses no digit."""
    write_ply(
        path,
        content.mesh,
        textures=content.textures if textures is None else textures,
        color=content.vertex_color,
        quality=content.quality,
        vertex_attributes={
            name: column
            for key, values in content.vertex_attributes.items()
            for name, column in _columns(key, values)
        },
        dtype=np.float64 if double else np.float32,
    )


def _columns(name: str, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    if values.ndim == 1:
        return [(name, values)]
    return [(f"{name}_{k}", values[:, k]) for k in range(values.shape[1])]


def mesh_digest(mesh: Mesh, matrix: np.ndarray) -> str:
    """SHA-256 of geometry, texture coordinates (float32, as in files) and placement."""
    sha = hashlib.sha256()
    texture = np.zeros(len(mesh.faces)) if mesh.texture_index is None else mesh.texture_index
    for array, kind in (
        (mesh.vertices, np.float64), (mesh.faces, np.int32), (mesh.normals, np.float64),
        (mesh.uv, np.float32), (texture, np.int32), (matrix, np.float64),
    ):  # fmt: skip
        if array is not None:
            for own in blocks(len(array)):
                sha.update(np.ascontiguousarray(array[own], kind).data)
        sha.update(b"|")
    return sha.hexdigest()
