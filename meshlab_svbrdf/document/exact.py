"""exact.mlp: the project with every digit and attribute, for MeshLab's saving drops some.

MeshLab and PyMeshLab write cameras and matrices with six digits (or in single precision) and drop
svbrdf_sequence, svbrdf_exposure and svbrdf_mask. Where a project is what they would have made of
the one remembered, the remembered is restored; any other change is the user's and stays.

remember   write exact.mlp into the result folder
restore    give the project's rasters, and its layers' matrices, what they lost; tell what
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .cameras import COUNTS, decode_numbers, same_camera
from .frames import file_stamp
from .layers import Layer
from .project import MeshEntry, Project, RasterEntry, write_project
from .project_entries import read_mesh_entry, read_raster_entry
from .project_xml import parse_xml

EXACT = "exact.mlp"
SIX_DIGITS = 6e-6  # half a unit of the sixth digit, and single precision's error
ATTRIBUTES = ("svbrdf_sequence", "svbrdf_exposure", "svbrdf_mask")


def remember(
    project: Project, layers: Iterable[Layer], folder: Path, known: list[Any] | None = None
) -> list[Any]:
    """Write the rasters, and the layers of the user's that have a file, to FOLDER/exact.mlp.

    Returns what was written and the file's stamp; known : what an earlier call returned, to write
    nothing where all that `restore` reads is as it was.
    """
    meshes = [
        MeshEntry(layer.label, layer.path, layer.matrix)
        for layer in layers
        if not layer.ours and layer.path is not None
    ]
    path = folder / EXACT
    said: list[Any] = [(mesh.label, mesh.matrix.tobytes()) for mesh in meshes]
    said += map(_said, project.rasters)
    if known != [said, file_stamp(path)]:
        root = ET.Element("MeshLabProject")
        write_project(Project(project.path, meshes, project.rasters, root), path)
    return [said, file_stamp(path)]


def _said(raster: RasterEntry) -> tuple[Any, ...]:
    """All of a raster that can change, to be compared."""
    entry, camera = dict(vars(raster)), vars(raster.camera)
    for name in ("element", "told", "camera"):
        del entry[name]
    turn, shift = raster.camera.R.tobytes(), raster.camera.t.tobytes()
    return (*entry.values(), *(camera[n] for n in camera if n not in "Rt"), turn, shift)


def restore(project: Project, folder: Path) -> str:
    """Give the entries of `project` back what MeshLab's saving took; what that was, or ""."""
    path = folder / EXACT
    if not path.is_file():
        return ""
    root = parse_xml(path)
    known = {
        raster.label: raster
        for raster in (read_raster_entry(e, path) for e in root.iterfind("RasterGroup/MLRaster"))
    }
    matrices = {
        mesh.label: mesh.matrix
        for mesh in (read_mesh_entry(e, path) for e in root.iterfind("MeshGroup/MLMesh"))
    }
    pairs = [
        (raster, known[raster.label])
        for raster in project.rasters
        if raster.label in known
        and raster.path == known[raster.label].path
        and _says(raster, known[raster.label])
    ]
    cameras = sum(_restore_camera(raster, exact) for raster, exact in pairs)

    # MeshLab drops the attributes of all rasters: where one has any, the others' are as meant
    attributes = 0
    if not any(name in raster.element.attrib for raster in project.rasters for name in ATTRIBUTES):
        attributes = sum(_restore_attributes(raster, exact) for raster, exact in pairs)
    placed = sum(_restore_matrix(mesh, matrices.get(mesh.label)) for mesh in project.meshes)
    counts = {"cameras": cameras, "sequences, exposures or masks": attributes, "matrices": placed}
    return ", ".join(f"{what} ({count})" for what, count in counts.items() if count)


def _says(raster: RasterEntry, exact: RasterEntry) -> bool:
    """Whether the raster's camera is the exact one, or what MeshLab would write for it."""
    ours, theirs = _element(exact), _element(raster)
    return same_camera(raster.camera, exact.camera) or all(
        _rounded(_numbers(theirs, name), _numbers(ours, name)) for name in COUNTS
    )


def _element(raster: RasterEntry) -> ET.Element:
    camera = raster.element.find("VCGCamera")
    assert camera is not None
    return camera


def _numbers(camera: ET.Element, name: str) -> np.ndarray:
    """The numbers of an attribute, without TranslationVector's fourth and LensDistortion's rest."""
    binary = camera.get("BinaryData", "0").strip() == "1"
    text = camera.get(name)
    if text is None:  # LensDistortion, all others were read already
        return np.zeros(COUNTS[name][0])
    integer = name == "ViewportPx"
    numbers = decode_numbers(text, COUNTS[name], name, binary=binary, integer=integer)
    return numbers[: COUNTS[name][0]]


def _rounded(values: np.ndarray, exact: np.ndarray) -> bool:
    """Whether each value is the exact one, or that with six digits or in single precision."""
    near = np.abs(values - exact) <= SIX_DIGITS * np.abs(exact)
    with np.errstate(over="ignore"):
        single = values.astype(np.float32) == exact.astype(np.float32)
    six = np.array([float(f"{value:.6g}") == value for value in values])
    return bool(np.all(near & (single | six)))


def _restore_camera(raster: RasterEntry, exact: RasterEntry) -> bool:
    if same_camera(raster.camera, exact.camera):
        return False
    raster.camera = raster.told = exact.camera
    _element(raster).attrib = dict(_element(exact).attrib)
    return True


def _restore_attributes(raster: RasterEntry, exact: RasterEntry) -> bool:
    """Where the remembered raster had an attribute, its value counts again."""
    before = raster.sequence, raster.exposure, raster.mask
    if "svbrdf_sequence" in exact.element.attrib:
        raster.sequence = exact.sequence
    if "svbrdf_exposure" in exact.element.attrib:
        raster.exposure = exact.exposure
    if "svbrdf_mask" in exact.element.attrib:
        raster.mask = exact.mask
    return before != (raster.sequence, raster.exposure, raster.mask)


def _restore_matrix(mesh: MeshEntry, exact: np.ndarray | None) -> bool:
    if exact is None or np.array_equal(mesh.matrix, exact):
        return False
    same = _rounded(mesh.matrix.ravel(), exact.ravel())
    if same:
        mesh.matrix = exact
    return same
