"""One layer or raster of a MeshLab project ↔ its XML element, with all that we do not know kept."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera
from .cameras import decode_numbers, encode_numbers, read_camera, write_camera
from .video_names import is_frames_folder, relative, video_of

LONGEST = 255  # bytes of a file's name


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
    sequence : attribute `svbrdf_sequence`, else the video, or the frame's folder seen from the
        project's
    exposure : attribute `svbrdf_exposure`, relative, > 0, or None
    mask : attribute `svbrdf_mask` ("" for none), else masks/STEM.png beside or in its folder
    told : the camera that `element` is known to tell; None: it has to be read
    """

    label: str
    path: Path
    camera: Camera
    visible: bool
    sequence: str
    exposure: float | None
    mask: Path | None
    element: ET.Element
    told: Camera | None = None


def read_mesh_entry(element: ET.Element, project: Path) -> MeshEntry:
    """The layer that an MLMesh of the file `project` describes."""
    label, filename = element.get("label", ""), element.get("filename", "")
    where = f"{project}: layer {label!r}"
    if not filename:
        raise DocumentError(f"{where} has no file; save the layer in MeshLab, then the project")
    matrix = element.find("MLMatrix44")
    text = "" if matrix is None or matrix.text is None else matrix.text.strip()
    return MeshEntry(
        label=label,
        path=_resolve(filename, project),
        matrix=checked_matrix(_decode_matrix(text, project, where), where),
        visible=_visible(element),
        element=element,
    )


def _decode_matrix(text: str, project: Path, where: str) -> np.ndarray:
    """An absent or empty matrix is the identity, as for MeshLab."""
    if not text:
        return np.eye(4)
    return decode_numbers(text, (16,), f"{where}: MLMatrix44", binary=_binary(project)).reshape(
        4, 4
    )


def mesh_element(mesh: MeshEntry, old: Path | None, new: Path, moved: bool) -> ET.Element:
    """The layer's MLMesh for the file `new`; `old` is where the entry was read, if anywhere."""
    element = copied(mesh.element)
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


def read_raster_entry(element: ET.Element, project: Path) -> RasterEntry:
    """The raster that an MLRaster of the file `project` describes."""
    label = element.get("label", "")
    where = f"{project}: raster {label!r}"
    camera, plane = element.find("VCGCamera"), element.find("Plane")
    if camera is None:
        raise DocumentError(f"{where} has no VCGCamera; register the frame or remove the raster")
    if plane is None or not plane.get("fileName"):
        raise DocumentError(f"{where} has no image (a Plane with a fileName); remove the raster")
    path = _resolve(plane.get("fileName", ""), project)
    mask, told = element.get("svbrdf_mask"), read_camera(camera, where)
    return RasterEntry(
        label=label,
        path=path,
        camera=told,
        visible=_visible(element),
        sequence=element.get("svbrdf_sequence", folder_name(path, project)),
        exposure=_read_exposure(element, where),
        mask=mask_beside(path) if mask is None else _resolve(mask, project) if mask else None,
        element=element,
        told=told,
    )


def raster_element(raster: RasterEntry, old: Path | None, new: Path, moved: bool) -> ET.Element:
    """The raster's MLRaster for the file `new`; `old` is where the entry was read, if anywhere."""
    element = copied(raster.element)
    element.set("label", raster.label)
    if _visible(element) != raster.visible:
        element.set("visible", str(int(raster.visible)))

    # Keep the sequence's name even where the frames' folder is now seen differently
    unnamed = old is None and raster.sequence == folder_name(raster.path, None)
    read_back = element.get("svbrdf_sequence", folder_name(raster.path, new))
    if not unnamed and read_back != raster.sequence:
        element.set("svbrdf_sequence", raster.sequence)

    where = f"raster {raster.label!r}"
    if raster.exposure is None:
        element.attrib.pop("svbrdf_exposure", None)
    elif _read_exposure(element, where) != raster.exposure:
        element.set("svbrdf_exposure", repr(float(raster.exposure)))
        _read_exposure(element, where)
    if raster.mask is not None and (
        "svbrdf_mask" in element.attrib or raster.mask != mask_beside(raster.path)
    ):
        _set_path(element, "svbrdf_mask", raster.mask, old, new, moved)
    elif raster.mask is None and ("svbrdf_mask" in element.attrib or mask_beside(raster.path)):
        element.set("svbrdf_mask", "")

    # Put the camera first: MeshLab reads the first child and no other
    camera = element.find("VCGCamera")
    if camera is None:
        camera = ET.Element("VCGCamera")
    else:
        element.remove(camera)
    write_camera(camera, raster.camera, binary=_binary(new), told=raster.told)
    element.insert(0, camera)
    planes = element.findall("Plane") or [ET.SubElement(element, "Plane", semantic="1")]
    _set_path(planes[0], "fileName", raster.path, old, new, moved)
    for plane in planes[1:]:
        if old is not None and plane.get("fileName"):
            _set_path(plane, "fileName", _resolve(plane.get("fileName", ""), old), old, new, moved)
    return element


def _read_exposure(element: ET.Element, where: str) -> float | None:
    text = element.get("svbrdf_exposure")
    if text is None:
        return None
    value = float(decode_numbers(text, (1,), f"{where}: svbrdf_exposure")[0])
    if not value > 0:
        raise DocumentError(f"{where}: svbrdf_exposure is {text!r}, expected a number > 0")
    return value


def _visible(element: ET.Element) -> bool:
    return element.get("visible", "1").strip().lower() in ("1", "true")


def checked_matrix(matrix: np.ndarray | None, where: str = "layer") -> np.ndarray:
    """The (4, 4) float64 matrix (None: the identity) if it is an invertible affine map."""
    matrix = np.eye(4) if matrix is None else np.array(matrix, np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise DocumentError(f"{where}: the matrix must be 4×4 finite numbers, found {matrix}")
    if not np.array_equal(matrix[3], [0, 0, 0, 1]) or np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        raise DocumentError(f"{where}: the matrix is not an invertible affine map:\n{matrix}")
    return matrix


def _binary(project: Path) -> bool:
    return project.suffix.lower() == ".mlb"


def copied(element: ET.Element) -> ET.Element:
    """An element with all that is in it, for its own: much faster than `copy.deepcopy`."""
    new = element.makeelement(element.tag, element.attrib)
    new.text, new.tail = element.text, element.tail
    new.extend([copied(child) for child in element])
    return new


def absolute(path: str | Path) -> Path:
    """Absolute, the folder's links followed: what is relative to a project is seen from there."""
    path = Path(path)
    return path.parent.resolve() / path.name


def _resolve(name: str, project: Path) -> Path:
    if any(len(os.fsencode(part)) > LONGEST for part in name.split("/")):
        raise DocumentError(f"{project}: no system has a file of that long name: {name[:60]!r}…")
    return Path(os.path.normpath(project.parent / name))


def _set_path(
    element: ET.Element, name: str, path: Path, old: Path | None, new: Path, moved: bool
) -> None:
    """Write a path as seen from the new project's folder, unless its characters say so already."""
    text = element.get(name)
    if not moved and old is not None and text and _resolve(text, old) == path:
        return
    element.set(name, relative(path, new.parent))


def folder_name(path: Path, project: Path | None) -> str:
    """What names a sequence by default: the folder of `path` as seen from the project's.

    Of a frame of a video it is the video.
    """
    if is_frames_folder(path.parent):
        return video_of(path.name)
    return path.parent.as_posix() if project is None else relative(path.parent, project.parent)


def mask_beside(frame: Path) -> Path | None:
    """The mask that belongs to a frame by its name: frames/IMG.jpg ↔ masks/IMG.png."""
    for folder in (frame.parent.parent, frame.parent):
        mask = f"{folder}/masks/{frame.stem}.png"
        if os.path.isfile(mask):
            return Path(mask)
    return None
