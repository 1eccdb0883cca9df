"""What is selected or painted in MeshLab is read back; edits by hand are recorded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from totems import GLOSS, MATERIALS, WALK, contents, copied

import meshlab_svbrdf
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.mesh_files import read_mesh, write_ply
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.script import read_script, run_script

MARKS, SPLIT, MERGE = (f"apply_svbrdf_material_{word}" for word in ("marks", "split", "merge"))
EDITS, NAMES = "apply_svbrdf_material_edits", "set_svbrdf_material_names"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return Document.open(copied(tmp_path_factory, WALK, tmp_path / "result").save())


def labels(document: Document) -> np.ndarray:
    return document.attribute("material").astype(int)


def layer_file(document: Document) -> Path:
    return document.folder / "layers" / "materials.ply"


def upper_faces(document: Document, above: float = 0.2) -> np.ndarray:
    mesh = document.mesh()
    return np.flatnonzero(mesh.vertices[mesh.faces][..., 1].min(1) > above)


def flagged(path: Path, selected: np.ndarray) -> Path:
    """The PLY as MeshLab saves it with its faces' flags, in text."""
    mesh = read_mesh(path).mesh
    head = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    head += ["property int flags", "end_header"]
    rows = [" ".join(f"{x:.9g}" for x in vertex) for vertex in mesh.vertices]
    rows += [
        f"3 {a} {b} {c} {0x20 | 0x40 if chosen else 0x40}"
        for (a, b, c), chosen in zip(mesh.faces, selected, strict=True)
    ]
    path.unlink()  # other tests share the file
    path.write_text("\n".join([*head, *rows, ""]))
    return path


def expected(document: Document, faces: np.ndarray, before: np.ndarray) -> np.ndarray:
    taken = np.isin(document.texels().face, faces) & (before >= 0)
    return np.where(taken, before.max() + 1, before)


def test_selected_faces_of_the_saved_layer_become_a_cluster(result):
    before, faces = labels(result), upper_faces(result)
    chosen = np.isin(np.arange(len(result.mesh().faces)), faces)
    flagged(layer_file(result), chosen)
    said = Document.open(result.path).apply(MARKS).message
    assert said.startswith("1 splits by selected faces of the layer materials; ")
    after = Document.open(result.path)
    np.testing.assert_array_equal(labels(after), expected(result, faces, before))
    assert read_mesh(layer_file(after)).face_selected is None  # the marks are used up

    # What the hand did is a script that does it again
    steps = read_script(after.folder / "material_edits.mlx")
    assert [step.name for step in steps] == [MATERIALS, SPLIT]
    after.apply(MATERIALS, force=True)
    np.testing.assert_array_equal(labels(after), before)
    list(run_script(after, steps))
    np.testing.assert_array_equal(labels(after), expected(result, faces, before))


def test_paint_on_vertices_or_faces_by_meshlab_itself(result, tmp_path):
    """pymeshlab paints and saves; each colour is a cluster, or what it touches is one."""
    before, faces = labels(result), upper_faces(result)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(layer_file(result)))
    above = {name: "255" if name == "r" else "y>0.2 ? 0 : 255" for name in "rgb"}
    ms.compute_color_by_function_per_vertex(
        **{k: f"({v})" for k, v in zip("xyz", above.values(), strict=True)}
    )
    ms.save_current_mesh(str(tmp_path / "vertices.ply"), save_textures=False)
    said = result.apply(MARKS, file=tmp_path / "vertices.ply").message
    assert "by vertex colours of vertices.ply" in said
    found = np.flatnonzero(labels(result) != before)
    agrees = np.isin(result.texels().face[found], faces).mean()
    assert agrees > 0.9  # but for faces that the border crosses

    result.apply(MATERIALS, force=True)
    ms.compute_selection_by_condition_per_face(condselect="(y0>0.2)&&(y1>0.2)&&(y2>0.2)")
    ms.compute_color_by_function_per_face(r="255", g="255", b="255", onselected=False)
    ms.compute_color_by_function_per_face(r="0", g="200", b="0", onselected=True)
    ms.save_current_mesh(str(tmp_path / "faces.ply"), save_textures=False)
    said = result.apply(MARKS, file=tmp_path / "faces.ply", operation="merge").message
    assert said.startswith("1 merges by face colours of faces.ply; ")
    under = before[np.isin(result.texels().face, faces) & (before >= 0)]
    ids, count = np.unique(under, return_counts=True)
    meant = ids[count >= 0.01 * len(under)]
    merged = np.where(np.isin(before, meant), meant.min(), before)
    np.testing.assert_array_equal(labels(result), merged)


def test_a_selection_in_a_mesh_set_needs_no_file(result):
    before, faces = labels(result), upper_faces(result)
    ms = meshlab_svbrdf.MeshSet()
    ms.load_project(result.path)
    for mesh in ms:
        if mesh.label() == "materials":
            ms.set_current_mesh(mesh.id())
    condition = "(y0>0.2)&&(y1>0.2)&&(y2>0.2)"
    ms.compute_selection_by_condition_per_face(condselect=condition)
    ms.apply_svbrdf_material_marks()
    now = ms.document.attribute("material")
    np.testing.assert_array_equal(now, expected(result, faces, before))
    with pytest.raises(SvbrdfError, match="holds no marks"):
        ms.apply_svbrdf_material_marks()


def test_marks_that_mean_nothing_change_nothing(result, tmp_path):
    before = contents(result.folder)
    mesh = read_mesh(layer_file(result)).mesh
    white = np.full((len(mesh.vertices), 3), 255, np.uint8)
    write_ply(tmp_path / "white.ply", mesh, color=white, dtype=np.float64)
    write_ply(
        tmp_path / "less.ply", replace(mesh, faces=mesh.faces[1:], uv=None, texture_index=None)
    )
    write_ply(tmp_path / "moved.ply", replace(mesh, vertices=mesh.vertices + 1))
    for given, says in (
        ({}, "the layer materials holds no marks"),
        ({"marks": "faces"}, "holds no face colours"),
        ({"file": tmp_path / "white.ply"}, "nothing is painted"),
        ({"file": tmp_path / "white.ply", "unpainted": "white"}, "expected red, green and blue"),
        ({"file": tmp_path / "less.ply"}, "without changing its geometry"),
        ({"file": tmp_path / "moved.ply"}, "are not where the object's are"),
    ):
        with pytest.raises(SvbrdfError, match=says):
            result.apply(MARKS, **given)
    with pytest.raises(DocumentError, match="does not exist"):
        result.apply(MARKS, file=tmp_path / "nothing.ply")
    assert contents(result.folder) == before


def test_edits_at_once_are_done_whole_or_not_at_all(result):
    before, faces = labels(result), upper_faces(result)
    result.apply(EDITS, edits="merge 0 1 | split -1 faces " + " ".join(map(str, faces)))
    first = labels(result)
    start = np.where(before == 1, 0, before)
    np.testing.assert_array_equal(first, expected(result, faces, start))
    held = contents(result.folder)
    with pytest.raises(SvbrdfError, match="no material 1"):
        result.apply(EDITS, edits="merge 0 2 | merge 0 1")
    assert contents(result.folder) == held
    result.apply(EDITS, edits="merge 1 2", anew=True)
    np.testing.assert_array_equal(labels(result), np.where(before == 2, 1, before))
    result.apply(EDITS, anew=True)
    np.testing.assert_array_equal(labels(result), before)


def test_names_belong_to_the_clusters_that_they_were_given(result):
    assert result.apply(NAMES, names="0 gold; 1  weathered   oak").message == "2 materials named"
    assert result.json("material_names") == {"0": "gold", "1": "weathered oak"}
    assert not result.stale("material_specular")  # the fit need not run again for a name
    for names, says in (
        ("0", "an id and a name"),
        ("x y", "an id and a name"),
        ("77 z", "no material 77"),
    ):
        with pytest.raises(SvbrdfError, match=says):
            result.apply(NAMES, names=names)
    result.apply(MERGE, ids="0 1")
    assert result.stale("material_names") == "materials"
    result.apply(GLOSS)


def test_faces_that_the_mesh_does_not_have(result):
    with pytest.raises(SvbrdfError, match=r"faces 0 to \d+, and face 99999999 was named"):
        result.apply(SPLIT, faces="99999999")
    with pytest.raises(SvbrdfError, match="not both"):
        result.apply(SPLIT, faces="1", stroke="0 0 0; 1 1 1")
