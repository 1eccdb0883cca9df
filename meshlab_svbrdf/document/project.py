"""MeshLab's project files (.mlp, .mlb): layers and rasters, with all that we do not know kept."""

from __future__ import annotations

import copy
import math
import os
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera
from .cameras import decode_numbers, encode_numbers, read_camera, write_camera
from .project_xml import parse_xml, write_xml


@dataclass(eq=False)
class MeshEntry:
    """One mesh layer.

    path : absolute
    matrix : (4, 4) float64, the layer's own coordinates to the world's
    element : the MLMesh as read; attributes and children of others (RenderingOption) live here
    """

    label: str
    path: Path
    matrix: np.ndarray
    visible: bool = True
    element: ET.Element = field(default_factory=lambda: ET.Element("MLMesh"))


@dataclass(eq=False)
class RasterEntry:
    """One frame and its camera.

    path : absolute, the frame
    sequence : attribute `svbrdf_sequence`, else the frame's folder seen from the project's
    exposure : attribute `svbrdf_exposure`, relative, > 0, or None
    mask : attribute `svbrdf_mask` ("" for none), else `masks/STEM.png` beside or in the frame's folder
    """

    label: str
    path: Path
    camera: Camera
    visible: bool
    sequence: str
    exposure: float | None
    mask: Path | None
    element: ET.Element


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
                f"{self.path}: {len(found)} layers are labelled {label!r}, expected 1 (layers: {labels})"
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
        self.meshes.append(MeshEntry(label, _absolute(path), _matrix(matrix), visible))
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
        mesh.path, mesh.matrix, mesh.visible = _absolute(path), _matrix(matrix), visible
        return mesh

    def remove_mesh(self, label: str) -> None:
        """Take the layer of that label out; its file stays."""
        self.meshes.remove(self.mesh(label))

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
        path = _absolute(path)
        self.rasters.append(
            RasterEntry(
                label=label,
                path=path,
                camera=camera,
                visible=True,
                sequence=_folder_name(path, self.path) if sequence is None else sequence,
                exposure=exposure,
                mask=_beside(path) if mask is None else _absolute(mask),
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
    path = _absolute(path)
    root = parse_xml(path)
    meshes = [_read_mesh(element, path) for element in root.iterfind("MeshGroup/MLMesh")]
    rasters = [_read_raster(element, path) for element in root.iterfind("RasterGroup/MLRaster")]
    for label, count in Counter(raster.label for raster in rasters).items():
        if count > 1:
            raise DocumentError(f"{path}: {count} rasters are labelled {label!r}; rename all but one")
    _check_files(path, meshes, rasters)
    return Project(path, meshes, rasters, root)


def write_project(project: Project, path: str | Path) -> None:
    """Write a project whole or not at all; paths become relative to its new place.

    What did not change keeps its original characters. `.mlb` gets base64 doubles, `.mlp` text.
    `project` itself stays as it is.
    """
    path = _absolute(path)
    moved = project.path is None or path.parent != project.path.parent
    root = copy.deepcopy(project.root)
    meshes = [_mesh_element(mesh, project.path, path, moved) for mesh in project.meshes]
    rasters = [_raster_element(raster, project.path, path, moved) for raster in project.rasters]
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


def _read_mesh(element: ET.Element, project: Path) -> MeshEntry:
    label, filename = element.get("label", ""), element.get("filename", "")
    where = f"{project}: layer {label!r}"
    if not filename:
        raise DocumentError(f"{where} has no file; save the layer in MeshLab, then the project")
    matrix = element.find("MLMatrix44")
    text = "" if matrix is None or matrix.text is None else matrix.text.strip()
    return MeshEntry(
        label=label,
        path=_resolve(filename, project),
        matrix=_matrix(_decode_matrix(text, project, where), where),
        visible=_visible(element),
        element=element,
    )


def _decode_matrix(text: str, project: Path, where: str) -> np.ndarray:
    """An absent or empty matrix is the identity, as for MeshLab."""
    if not text:
        return np.eye(4)
    return decode_numbers(text, (16,), f"{where}: MLMatrix44", binary=_binary(project)).reshape(4, 4)


def _mesh_element(mesh: MeshEntry, old: Path | None, new: Path, moved: bool) -> ET.Element:
    element = copy.deepcopy(mesh.element)
    element.set("label", mesh.label)
    _set_path(element, "filename", mesh.path, old, new, moved)
    if "visible" not in element.attrib or _visible(element) != mesh.visible:
        element.set("visible", str(int(mesh.visible)))
    element.attrib.setdefault("idInFile", "-1")
    matrix = element.find("MLMatrix44")
    if matrix is None:
        matrix = ET.Element("MLMatrix44")
        element.insert(0, matrix)
    text = (matrix.text or "").strip()
    same_kind = old is not None and _binary(old) == _binary(new) and text
    if same_kind and np.array_equal(_decode_matrix(text, new, mesh.label), mesh.matrix):
        return element
    if _binary(new):
        matrix.text = encode_numbers(mesh.matrix.ravel(), True)
    else:  # one row a line: older MeshLabs read no other form
        matrix.text = "\n" + "".join(encode_numbers(row, False) + " \n" for row in mesh.matrix)
    return element


def _read_raster(element: ET.Element, project: Path) -> RasterEntry:
    label = element.get("label", "")
    where = f"{project}: raster {label!r}"
    camera, plane = element.find("VCGCamera"), element.find("Plane")
    if camera is None:
        raise DocumentError(f"{where} has no VCGCamera; register the frame or remove the raster")
    if plane is None or not plane.get("fileName"):
        raise DocumentError(f"{where} has no image (a Plane with a fileName); remove the raster")
    path = _resolve(plane.get("fileName", ""), project)
    exposure, mask = element.get("svbrdf_exposure"), element.get("svbrdf_mask")
    return RasterEntry(
        label=label,
        path=path,
        camera=read_camera(camera, where),
        visible=_visible(element),
        sequence=element.get("svbrdf_sequence", _folder_name(path, project)),
        exposure=None if exposure is None else _exposure(exposure, where),
        mask=_beside(path) if mask is None else _resolve(mask, project) if mask else None,
        element=element,
    )


def _raster_element(raster: RasterEntry, old: Path | None, new: Path, moved: bool) -> ET.Element:
    element = copy.deepcopy(raster.element)
    element.set("label", raster.label)
    if _visible(element) != raster.visible:
        element.set("visible", str(int(raster.visible)))
    if element.get("svbrdf_sequence", _folder_name(raster.path, old)) != raster.sequence:
        element.set("svbrdf_sequence", raster.sequence)
    _set_exposure(element, raster)
    if raster.mask is not None and ("svbrdf_mask" in element.attrib or raster.mask != _beside(raster.path)):
        _set_path(element, "svbrdf_mask", raster.mask, old, new, moved)
    elif raster.mask is None and ("svbrdf_mask" in element.attrib or _beside(raster.path)):
        element.set("svbrdf_mask", "")

    # Put the camera first: MeshLab reads the first child and no other
    camera = element.find("VCGCamera")
    if camera is None:
        camera = ET.Element("VCGCamera")
    else:
        element.remove(camera)
    write_camera(camera, raster.camera, binary=_binary(new))
    element.insert(0, camera)
    planes = element.findall("Plane") or [ET.SubElement(element, "Plane", semantic="1")]
    _set_path(planes[0], "fileName", raster.path, old, new, moved)
    for plane in planes[1:]:
        if old is not None and plane.get("fileName"):
            _set_path(plane, "fileName", _resolve(plane.get("fileName", ""), old), old, new, moved)
    return element


def _set_exposure(element: ET.Element, raster: RasterEntry) -> None:
    if raster.exposure is None:
        element.attrib.pop("svbrdf_exposure", None)
        return
    where = f"raster {raster.label!r}"
    text = element.get("svbrdf_exposure")
    if text is None or _exposure(text, where) != raster.exposure:
        element.set("svbrdf_exposure", repr(float(raster.exposure)))
        _exposure(element.get("svbrdf_exposure", ""), where)


def _exposure(text: str, where: str) -> float:
    value = float(decode_numbers(text, (1,), f"{where}: svbrdf_exposure")[0])
    if not (value > 0 and math.isfinite(value)):
        raise DocumentError(f"{where}: svbrdf_exposure is {text!r}, expected a number > 0")
    return value


def _visible(element: ET.Element) -> bool:
    return element.get("visible", "1").strip().lower() in ("1", "true")


def _matrix(matrix: np.ndarray | None, where: str = "layer") -> np.ndarray:
    matrix = np.eye(4) if matrix is None else np.array(matrix, np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise DocumentError(f"{where}: the matrix must be 4×4 finite numbers, found {matrix}")
    if not np.array_equal(matrix[3], [0, 0, 0, 1]) or np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        raise DocumentError(f"{where}: the matrix is not an invertible affine map:\n{matrix}")
    return matrix


def _binary(project: Path) -> bool:
    return project.suffix.lower() == ".mlb"


def _absolute(path: str | Path) -> Path:
    """Absolute, the folder's links followed: what is relative to a project is seen from there."""
    path = Path(path)
    return path.parent.resolve() / path.name


def _resolve(name: str, project: Path) -> Path:
    return Path(os.path.normpath(project.parent / name))


def _set_path(
    element: ET.Element, name: str, path: Path, old: Path | None, new: Path, moved: bool
) -> None:
    """Write a path as seen from the new project's folder, unless its characters say so already."""
    text = element.get(name)
    if not moved and old is not None and text and _resolve(text, old) == path:
        return
    element.set(name, _relative(path, new.parent))


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive on Windows has no relative path
        return path.as_posix()


def _folder_name(path: Path, project: Path | None) -> str:
    return path.parent.as_posix() if project is None else _relative(path.parent, project.parent)


def _beside(frame: Path) -> Path | None:
    """The mask that belongs to a frame by its name: frames/IMG.jpg ↔ masks/IMG.png."""
    for folder in (frame.parent.parent, frame.parent):
        mask = folder / "masks" / f"{frame.stem}.png"
        if mask.is_file():
            return mask
    return None


def _check_files(project: Path, meshes: list[MeshEntry], rasters: list[RasterEntry]) -> None:
    wanted = [(f"layer {mesh.label!r}", mesh.path) for mesh in meshes]
    wanted += [(f"raster {raster.label!r}", raster.path) for raster in rasters]
    wanted += [(f"mask of raster {r.label!r}", r.mask) for r in rasters if r.mask is not None]
    missing = [f"{what}: {file}" for what, file in wanted if not file.is_file()]
    if missing:
        raise DocumentError(
            f"{project}: {len(missing)} of its files do not exist; put them back or remove the "
            "entries:\n  " + "\n  ".join(missing[:5]) + ("\n  …" if len(missing) > 5 else "")
        )
