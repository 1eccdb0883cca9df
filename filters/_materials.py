"""The clusters of texels: read, written, and shown as the layer `materials`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from meshlab_svbrdf.blocks import counted, rowwise
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.edit import pick
from meshlab_svbrdf.reflectance.labels import palette
from meshlab_svbrdf.reflectance.material_edits import (
    Canvas,
    Carve,
    Edit,
    Merge,
    Split,
    faces_text,
    perform,
    points_text,
    read_faces,
)
from meshlab_svbrdf.script import Step, read_script, write_script

from ._maps import set_texture

MERGE, SPLIT = "apply_svbrdf_material_merge", "apply_svbrdf_material_split"
START = "material_start"
"""The labels before any edit."""
SCRIPT = "material_edits"
"""NAME.svbrdf/material_edits.mlx: what makes the materials, edits and all."""


def read_labels(document: Document) -> np.ndarray:
    """(T,) int32, -1 for none."""
    return document.attribute("material").astype(np.int32, copy=False)


def cluster_at(points: np.ndarray, which: int, texels: Texels, labels: np.ndarray) -> int:
    """The cluster at one of points (S, 3) of the world; SvbrdfError where there is none, or where
    any of the points is off the object."""
    cluster = int(labels[pick(texels.position, points - texels.center)[which]])
    if cluster < 0:
        raise SvbrdfError(
            f"the object is unobserved at {points[which].tolist()}, and belongs to no cluster "
            "there: pick another point"
        )
    return cluster


def set_labels(document: Document, texels: Texels, labels: np.ndarray) -> str:
    """Stage attribute, maps/material.png and the layer; what there is, in words."""
    document.set_attribute("material", labels.astype(np.int32))
    count = int(labels.max(initial=-1)) + 1
    kind, none = (np.uint8, 255) if count <= 255 else (np.uint16, 65535)
    ids = rowwise(lambda some: np.where(some >= 0, some, none).astype(kind), labels)
    document.set_map("material", texels.images(ids, none), kind="png")

    # Show the clusters in distinct colours
    used = np.flatnonzero(counted(labels))
    colors = np.full((count + 1, 3), 60, np.uint8)  # the last: of no cluster
    colors[used] = palette(len(used))
    shown = rowwise(lambda some: colors[some], labels)
    set_texture(document, "materials_shown", texels, shown)
    layer = document.object_layer()
    mesh = document.mesh()
    local = replace(layer.read().mesh, uv=mesh.uv, texture_index=mesh.texture_index)
    textures = tuple(document.map_places("materials_shown", len(texels.sizes), "png"))
    document.set_layer(
        Layer("materials", None, layer.matrix, False, MeshFile(mesh=local, textures=textures))
    )
    return f"{len(used)} clusters, {100 * np.mean(labels >= 0):.1f} % of the texels"


# What was done to them


def start_step(document: Document) -> list[Step]:
    """The filter that made the materials before any edit, with its parameters."""
    if steps := _script(document):
        return [step for step in steps[:1] if step.name not in (MERGE, SPLIT)]
    if not document.has("materials") or document.edited("materials"):
        return []
    name = document.results.record["products"]["materials"]["filter"]
    given = document.results.record["runs"].get(name, {}).get("parameters", {})
    words = {key: _word(value) for key, value in given.items() if value is not None}
    return [Step(name, words)]


def read_edits(document: Document) -> list[Edit]:
    """The edits since the materials were made, in their order."""
    edits: list[Edit] = []
    for step in _script(document):
        if step.name not in (MERGE, SPLIT):
            continue
        given = step.parameters
        if step.name == MERGE:
            edits.append(Merge(tuple(map(int, given["ids"].split()))))
        elif given.get("faces"):
            edits.append(Carve(int(given["id"]), read_faces(given["faces"])))
        else:
            points = [[float(x) for x in row.split()] for row in given["stroke"].split(";")]
            edits.append(Split(int(given["id"]), np.array(points)))
    return edits


def edit_steps(edits: Iterable[Edit]) -> list[Step]:
    """Edits as steps of a script."""
    steps = []
    for edit in edits:
        if isinstance(edit, Merge):
            steps.append(Step(MERGE, {"ids": " ".join(map(str, edit.ids))}))
        elif isinstance(edit, Split):
            given = {"stroke": points_text(edit.stroke), "id": str(edit.cluster)}
            steps.append(Step(SPLIT, given))
        else:
            steps.append(Step(SPLIT, {"faces": faces_text(edit.faces), "id": str(edit.cluster)}))
    return steps


def apply_edits(
    document: Document, edits: list[Edit], progress: Progress, *, anew: bool = False
) -> str:
    """Edit the materials, stage them and the script that makes them again; what there is, in words.

    anew : from what the materials were before any edit
    """
    texels, labels, done = document.texels(), read_labels(document), read_edits(document)
    start = labels
    if document.has_array(START):
        start = document.array(START)
    if anew:
        labels, done = start, []
    canvas = Canvas(SurfaceGraph(texels.position, texels.normal), texels.center, texels.face)
    for edit in progress.over(edits, "editing"):
        labels = perform(labels, edit, canvas)
    document.set_array(START, start)
    steps = [*start_step(document), *edit_steps([*done, *edits])]
    write_script(document.stage_script(SCRIPT), steps)
    return set_labels(document, texels, labels)


def check_faces(document: Document, faces: np.ndarray) -> None:
    """Refuse faces that the mesh does not have."""
    count = len(document.mesh().faces)
    if len(faces) and faces[-1] >= count:
        raise SvbrdfError(
            f"the mesh has the faces 0 to {count - 1}, and face {int(faces[-1])} was named"
        )


def read_names(document: Document) -> dict[int, str]:
    """Names of materials by id, where they were given for these materials."""
    if not document.has("material_names") or document.stale("material_names"):
        return {}
    return {int(key): name for key, name in document.json("material_names").items()}


def names_text(names: dict[int, str]) -> str:
    """As set_svbrdf_material_names takes them: "0 gold; 3 oak"."""
    return "; ".join(f"{key} {name}" for key, name in sorted(names.items()))


def _script(document: Document) -> list[Step]:
    """The filters that make the materials; nothing where they were never edited."""
    path = document.find_script(SCRIPT)
    return read_script(path) if path else []


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
