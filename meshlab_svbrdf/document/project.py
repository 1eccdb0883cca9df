"""MeshLab's project files (.mlp, .mlb): layers and rasters, with all that we do not know kept."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera
from .project_entries import (
    MeshEntry,
    RasterEntry,
    absolute,
    checked_matrix,
    copied,
    folder_name,
    mask_beside,
    mesh_element,
    raster_element,
    read_mesh_entry,
    read_raster_entry,
)
from .project_xml import parse_xml, write_xml


@dataclass(eq=False)
class Project:
    """Layers and rasters in the file's order; `path` is where it was read, None for a new one."""

    path: Path | None
    meshes: list[MeshEntry]
    rasters: list[RasterEntry]
    root: ET.Element

    def mesh(self, label: str) -> MeshEntry:
        """The only layer of that label; `DocumentError` if there is none or more."""
        found = [mesh for mesh in self.meshes if mesh.label == label]
        if len(found) != 1:
            labels = ", ".join(repr(mesh.label) for mesh in self.meshes)
            raise DocumentError(
                f"{self.path}: {len(found)} layers are labelled {label!r}, expected 1 of: {labels}"
            )
        return found[0]

    def add_mesh(
        self,
        label: str,
        path: str | Path,
        matrix: np.ndarray | None = None,
        *,
        visible: bool = True,
    ) -> MeshEntry:
        """Append a layer; `DocumentError` if its label is taken."""
        if any(mesh.label == label for mesh in self.meshes):
            raise DocumentError(f"{self.path}: a layer {label!r} exists already; use set_mesh")
        self.meshes.append(MeshEntry(label, absolute(path), checked_matrix(matrix), visible))
        return self.meshes[-1]

    def set_mesh(
        self,
        label: str,
        path: str | Path,
        matrix: np.ndarray | None = None,
        *,
        visible: bool = True,
    ) -> MeshEntry:
        """Add a layer, or replace the one of that label in its place (RenderingOption is kept)."""
        if all(mesh.label != label for mesh in self.meshes):
            return self.add_mesh(label, path, matrix, visible=visible)
        mesh = self.mesh(label)
        mesh.path, mesh.matrix, mesh.visible = absolute(path), checked_matrix(matrix), visible
        return mesh

    def add_raster(
        self,
        label: str,
        path: str | Path,
        camera: Camera,
        *,
        sequence: str | None = None,
        exposure: float | None = None,
        mask: str | Path | None = None,
    ) -> RasterEntry:
        """Append a frame with its camera; `DocumentError` if its label is taken."""
        if any(raster.label == label for raster in self.rasters):
            raise DocumentError(f"{self.path}: a raster {label!r} exists already")
        path = absolute(path)
        self.rasters.append(
            RasterEntry(
                label=label,
                path=path,
                camera=camera,
                visible=True,
                sequence=folder_name(path, self.path) if sequence is None else sequence,
                exposure=exposure,
                mask=mask_beside(path) if mask is None else absolute(mask),
                element=ET.Element("MLRaster"),
            )
        )
        return self.rasters[-1]


def new_project() -> Project:
    """A project without layers and rasters, to be written anywhere."""
    return Project(None, [], [], ET.Element("MeshLabProject"))


def read_project(path: str | Path) -> Project:
    """Parse a MeshLab project.

    Raises
    ------
    DocumentError
        Names the file and the place: malformed XML, wrong counts of numbers, unusable cameras,
        duplicate raster labels, layers never saved, files that do not exist.
    """
    path = absolute(path)
    root = parse_xml(path)
    meshes = [read_mesh_entry(element, path) for element in root.iterfind("MeshGroup/MLMesh")]
    rasters = [
        read_raster_entry(element, path) for element in root.iterfind("RasterGroup/MLRaster")
    ]
    for label, count in Counter(raster.label for raster in rasters).items():
        if count > 1:
            raise DocumentError(
                f"{path}: {count} rasters are labelled {label!r}; rename all but one"
            )
    _check_masks(path, rasters)
    _check_meshes(path, meshes)
    return Project(path, meshes, rasters, root)


def write_project(project: Project, path: str | Path) -> None:
    """Write a project whole or not at all; paths become relative to its new place.

    What did not change keeps its original characters. `.mlb` gets base64 doubles, `.mlp` text.
    `project` itself stays as it is.
    """
    path = absolute(path)
    moved = project.path is None or path.parent != project.path.parent
    root = copied(project.root)
    meshes = [mesh_element(mesh, project.path, path, moved) for mesh in project.meshes]
    rasters = [raster_element(raster, project.path, path, moved) for raster in project.rasters]
    for tag, item, elements in (
        ("MeshGroup", "MLMesh", meshes),
        ("RasterGroup", "MLRaster", rasters),
    ):
        group, *others = root.findall(tag) or [ET.SubElement(root, tag)]
        for other in others:
            group.extend(other)
            root.remove(other)
        group[:] = elements + [child for child in group if child.tag != item]
    ET.indent(root, " ")
    write_xml(root, path)


def _check_masks(project: Path, rasters: list[RasterEntry]) -> None:
    """Refuse a mask that two different frames find by their name: it can belong to one only."""
    frame_of: dict[Path, RasterEntry] = {}
    for raster in rasters:
        if raster.mask is None or raster.mask != mask_beside(raster.path):
            continue
        first = frame_of.setdefault(raster.mask, raster)
        if first.path != raster.path:
            raise DocumentError(
                f"{project}: rasters {first.label!r} and {raster.label!r} both take {raster.mask} "
                "for their mask; name each one's own in its attribute svbrdf_mask"
            )


def _check_meshes(project: Path, meshes: list[MeshEntry]) -> None:
    """Meshes must be there. Frames need not: what reads them says which are missing."""
    missing = [f"layer {mesh.label!r}: {mesh.path}" for mesh in meshes if not mesh.path.is_file()]
    if missing:
        raise DocumentError(
            f"{project}: {len(missing)} of its meshes do not exist; put them back or remove the "
            "layers:\n  " + "\n  ".join(missing[:5]) + ("\n  …" if len(missing) > 5 else "")
        )
