"""Merging and splitting clusters by what was selected or painted in MeshLab."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile, read_mesh
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.marks import (
    edits_of_marks,
    marks_of_faces,
    paint_marks,
    selection_marks,
)

from ._materials import apply_edits, read_labels

LAYER = "materials"
SAME_PLACE = 1e-4
"""How far a corner may be from where it was, in radii."""

FILTER = Filter(
    name="apply_svbrdf_material_marks",
    title="SVBRDF: edit materials by selection or paint",
    needs=("mesh", "texels", "materials"),
    writes=("materials",),
    parameters=(
        Parameter(
            "operation", "enum", "split", choices=("split", "merge"),
            help='"split" makes what is marked a cluster of its own, "merge" makes one of the '
            "clusters that a mark lies on; each colour is a mark.",
        ),
        Parameter(
            "marks", "enum", "auto", choices=("auto", "selection", "faces", "vertices"),
            help="Selected faces, face colours or vertex colours; auto takes the first of these "
            "that there are.",
        ),
        Parameter(
            "file", "path", "",
            help="The marked mesh as PLY: the object, its geometry unchanged. Empty: the layer "
            "`materials` as it was saved.",
        ),
        Parameter(
            "id", "int", -1, minimum=-1,
            help="Split only this cluster; -1 any, so that what is marked becomes one.",
        ),
        Parameter(
            "unpainted", "string", "255 255 255",
            help="The colour of what is not painted, red, green and blue.",
        ),
    ),
    help="Reads back what was selected or painted on the layer `materials` in MeshLab, as merges "
    "and splits by faces. The layer shows the new clusters afterwards, without the marks.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    layer, content, name = _marked(document, parameters.file)
    _check_same(document, content, name)
    marks, kind = _marks(content, parameters, name)
    texels, labels = document.texels(), read_labels(document)
    merges = parameters.operation == "merge"
    edits = edits_of_marks(marks, labels, texels.face, merges=merges, cluster=parameters.id)
    said = apply_edits(document, edits, progress)
    if layer is not None:  # its marks are used up
        layer.content, layer.path = None, document.folder / "layers" / f"{LAYER}.ply"
    return f"{len(edits)} {parameters.operation}s by {kind} of {name}; {said}"


def _marked(document: Document, file: Path | None) -> tuple[Layer | None, MeshFile, str]:
    """The marked mesh: its layer, where it is one, its content, and what to call it."""
    if file is not None:
        return None, read_mesh(file), file.name
    layer = next((x for x in document.layers if x.label == LAYER and x.ours), None)
    if layer is None:
        raise SvbrdfError(
            "the project has no layer `materials`: save it once, or give the marked mesh as file"
        )
    if layer.path is not None:
        layer.content = None  # MeshLab may have saved it since it was read
    return layer, layer.read(), f"the layer {LAYER}"


def _check_same(document: Document, content: MeshFile, name: str) -> None:
    """Refuse a mesh whose faces are not the object's, one by one."""
    layer = document.object_layer()
    own, other = layer.read().mesh, content.mesh
    if len(own.faces) != len(other.faces):
        raise SvbrdfError(
            f"{name} has {len(other.faces)} faces and the object {len(own.faces)}: mark the layer "
            "`materials` without changing its geometry"
        )
    corners = other.vertices[other.faces]
    for mesh in (own, own.transformed(layer.matrix)):
        if np.abs(mesh.vertices[mesh.faces] - corners).max() <= SAME_PLACE * mesh.radius:
            return
    raise SvbrdfError(
        f"the faces of {name} are not where the object's are: mark the layer `materials` without "
        "changing its geometry"
    )


def _marks(content: MeshFile, parameters: Namespace, name: str) -> tuple[np.ndarray, str]:
    """The mark of each face, and by what."""
    try:
        unpainted = np.array([int(x) for x in parameters.unpainted.replace(",", " ").split()])
    except ValueError:
        unpainted = np.zeros(0, int)
    if unpainted.shape != (3,):
        raise SvbrdfError(
            f"unpainted is {parameters.unpainted!r}, expected red, green and blue, 0 to 255"
        )
    chosen = content.face_selected
    has = {
        "selection": chosen is not None and bool(chosen.any()),
        "faces": content.face_color is not None,
        "vertices": content.vertex_color is not None,
    }
    if parameters.marks == "auto":
        kind = next((k for k, there in has.items() if there), "")
        if not kind:
            raise SvbrdfError(
                f"{name} holds no marks: select faces and save it as PLY with the faces' flags, or "
                "paint it and save it with its colours"
            )
    else:
        kind = parameters.marks
        if not has[kind]:
            raise SvbrdfError(f"{name} holds no {_WORDS[kind]}")
    if kind == "selection":
        assert chosen is not None
        return selection_marks(chosen), _WORDS[kind]
    if kind == "faces":
        assert content.face_color is not None
        return paint_marks(content.face_color, unpainted), _WORDS[kind]
    assert content.vertex_color is not None
    painted = paint_marks(content.vertex_color, unpainted)
    return marks_of_faces(painted, content.mesh.faces), _WORDS[kind]


_WORDS = {
    "selection": "selected faces",
    "faces": "face colours",
    "vertices": "vertex colours",
}
