"""MeshSet: everything pymeshlab can do, our filters, and nobody's data lost."""

import gc
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pymeshlab
import pytest

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.document.mesh_files import read_mesh, write_ply
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import MissingStageError, SvbrdfError
from meshlab_svbrdf.filter import Filter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.meshset import MeshSet

pytestmark = pytest.mark.usefixtures("demos")

A_CAMERA = Camera(8, 6, 10.0, 10.0, 3.5, 2.5, np.eye(3), np.array([0, 0, 9.0]))


@pytest.fixture
def meshes(small_project) -> MeshSet:
    meshes = MeshSet()
    meshes.load_project(small_project)
    return meshes


@pytest.fixture
def shaded(meshes) -> MeshSet:
    meshes.compute_demo_texels()
    meshes.compute_demo_shade()
    return meshes


def labels(meshes: MeshSet) -> list[str]:
    return [mesh.label() for mesh in meshes]


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def by_label(meshes: MeshSet, label: str) -> pymeshlab.Mesh:
    return next(mesh for mesh in meshes if mesh.label() == label)


def test_it_is_a_meshset_with_our_filters(meshes, small_project):
    assert isinstance(meshes, pymeshlab.MeshSet)
    assert {"compute_demo_texels", "meshing_surface_subdivision_loop"} <= set(dir(meshes))
    assert meshes.compute_demo_texels(size=8)["message"].endswith("texels")
    assert meshes.apply_filter("compute_demo_texels", size=8)["skipped"]
    with pytest.raises(AttributeError, match="compute_demo_nothing"):
        meshes.compute_demo_nothing()
    with pytest.raises(pymeshlab.PyMeshLabException):
        meshes.apply_filter("compute_demo_nothing")
    with pytest.raises(SvbrdfError, match="did you mean size"):
        meshes.compute_demo_texels(sise=8)
    meshes.clear()
    meshes.load_project(small_project)
    with pytest.raises(MissingStageError, match="compute_demo_texels first"):
        meshes.compute_demo_shade()


def test_a_project_is_loaded_with_its_rasters_unread(meshes, stone):
    assert labels(meshes) == ["stone"]
    assert meshes.raster_number() == len(meshes.rasters) == 9
    assert np.array_equal(meshes.current_mesh().vertex_matrix(), stone.vertices)
    assert meshes.current_mesh().transform_matrix()[0, 3] == 2
    assert pymeshlab.MeshSet.raster_number(meshes) == 0


def test_results_appear_as_layers_of_meshlabs(shaded):
    assert labels(shaded) == ["stone", "map: height", "texels"]
    texels, document = by_label(shaded, "texels"), shaded.document
    values = texels.vertex_custom_scalar_attribute_array("svbrdf_height")
    assert np.array_equal(values, document.attribute("height"))
    shaded.set_current_mesh(texels.id())
    shaded.compute_scalar_by_function_per_vertex(q="svbrdf_height*2")
    assert np.allclose(shaded.current_mesh().vertex_scalar_array(), 2 * values)
    for label in ("stone", "map: height"):
        assert by_label(shaded, label).texture_number() == 1
        assert by_label(shaded, label).texture(0).width() == 16


def test_the_layers_follow_the_results_and_ids_of_the_users_stay(shaded):
    before = {mesh.label(): mesh.id() for mesh in shaded}
    count = by_label(shaded, "texels").vertex_number()
    shaded.compute_demo_texels(size=32)
    assert labels(shaded) == ["stone", "texels"]
    assert by_label(shaded, "stone").id() == before["stone"]
    assert by_label(shaded, "texels").vertex_number() > 3 * count
    assert shaded.current_mesh().label() == "stone"


def test_meshlabs_changes_are_seen_by_our_filters(shaded, stone):
    shaded.set_current_mesh(0)
    shaded.meshing_surface_subdivision_midpoint(iterations=1, threshold=pymeshlab.PureValue(0))
    assert len(shaded.document.mesh().faces) == 4 * len(stone.faces)
    with pytest.raises(MissingStageError, match="mesh changed"):
        shaded.compute_demo_shade()
    assert not shaded.compute_demo_texels()["skipped"]
    shaded.set_matrix(transformmatrix=np.diag([2, 2, 2, 1.0]))
    assert not shaded.compute_demo_texels()["skipped"]
    assert shaded.document.texels().radius == pytest.approx(np.sqrt(3))


def test_nothing_is_written_before_save_project(small_project, tmp_path):
    before = files(small_project.parent)
    meshes = MeshSet()
    meshes.load_project(small_project)
    meshes.compute_demo_texels()
    meshes.compute_demo_shade()
    assert labels(meshes)
    now = files(small_project.parent)
    assert {name for name in now if not name.startswith(".svbrdf-")} == set(before)
    meshes.save_project(tmp_path / "out" / "r.mlp")
    del meshes
    gc.collect()
    assert files(small_project.parent) == before
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"r.mlp", "r.svbrdf"}


def test_what_a_process_that_died_left_goes_with_the_next_load(small_project, meshes):
    here = small_project.parent
    (mine,) = here.glob(".svbrdf-*")
    code = (
        "import os, sys\n"
        "from meshlab_svbrdf import MeshSet\n"
        "meshes = MeshSet()\n"
        "meshes.load_project(sys.argv[1])\n"
        "os._exit(1)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, str(small_project)]).returncode == 1
    assert len(list(here.glob(".svbrdf-*"))) == 2
    (here / ".svbrdf-notes").mkdir()
    other = MeshSet()
    other.load_project(small_project)
    left = set(here.glob(".svbrdf-*")) - {mine, here / ".svbrdf-notes"}
    assert len(left) == 1
    assert mine.is_dir()
    assert (here / ".svbrdf-notes").is_dir()
    assert other._bridge.document.folder.parent in left


def test_what_a_filter_hides_stays_hidden(meshes, demos, tmp_path):
    def hide(document, parameters, progress):
        document.layers[0].visible = False
        return "hidden"

    demos["hide"] = Filter("hide", "Hide", ("mesh",), ("hidden",), apply=hide)
    meshes.create_sphere(subdiv=1)
    meshes.apply_filter("hide")
    assert [mesh.is_visible() for mesh in meshes] == [False, True]
    meshes.set_mesh_visibility(0, True)
    script = tmp_path / "hide.mlx"
    script.write_text('<FilterScript><filter name="hide"/></FilterScript>')
    meshes.set_current_mesh(0)
    meshes.set_matrix(transformmatrix=np.diag([2, 2, 2, 1.0]))
    meshes.apply_filter_script(script)
    assert [mesh.is_visible() for mesh in meshes] == [False, True]
    assert not meshes.document.layers[0].visible


def test_a_saved_project_comes_back_with_its_results(shaded, tmp_path):
    shaded.save_project(tmp_path / "out" / "r.mlp")
    again = MeshSet()
    again.load_project(tmp_path / "out" / "r.mlp")
    assert labels(again) == ["stone", "map: height", "texels"]
    assert again.compute_demo_texels()["skipped"]
    assert again.compute_demo_shade()["skipped"]
    values = by_label(again, "texels").vertex_custom_scalar_attribute_array("svbrdf_height")
    assert np.array_equal(values, shaded.document.attribute("height"))
    assert [r.path for r in again.rasters] == [r.path for r in shaded.rasters]
    plain = Document.open(tmp_path / "out" / "r.mlp")
    assert plain.apply("compute_demo_shade").skipped


def test_work_goes_on_after_saving_and_touches_what_was_saved_only_when_saved(shaded, tmp_path):
    shaded.save_project(tmp_path / "out" / "r.mlp")
    before = files(tmp_path / "out" / "r.svbrdf")
    shaded.compute_demo_shade(scale=2)
    assert labels(shaded) == ["stone", "map: height", "texels"]
    assert files(tmp_path / "out" / "r.svbrdf") == before
    shaded.save_project(tmp_path / "out" / "r.mlp")
    assert files(tmp_path / "out" / "r.svbrdf") != before
    assert Document.open(tmp_path / "out" / "r.mlp").apply("compute_demo_shade", scale=2).skipped


def test_a_saved_project_opens_in_pymeshlab_itself(shaded, tmp_path):
    shaded.save_project(tmp_path / "r.mlp")
    meshes = pymeshlab.MeshSet()
    for entry in read_project(tmp_path / "r.mlp").meshes:
        meshes.load_new_mesh(str(entry.path))
        assert meshes.current_mesh().texture_number() == int(entry.label != "texels")
    assert meshes.current_mesh().has_vertex_color()


def test_layers_that_meshlab_added_changed_or_removed_are_saved_so(shaded, tmp_path):
    shaded.create_sphere(subdiv=2)
    sphere = shaded.current_mesh().vertex_matrix()
    shaded.set_current_mesh(0)
    shaded.compute_color_by_function_per_vertex(x="255", y="0", z="7")
    shaded.save_project(tmp_path / "r.mlp")
    layers = {layer.label: layer for layer in Document.open(tmp_path / "r.mlp").layers}
    assert list(layers) == ["stone", "map: height", "texels", "Sphere"]
    assert np.array_equal(layers["Sphere"].read().mesh.vertices, sphere)
    assert (layers["stone"].read().vertex_color == [255, 0, 7, 255]).all()
    assert shaded.compute_demo_texels()["skipped"]
    shaded.set_current_mesh(by_label(shaded, "Sphere").id())
    shaded.delete_current_mesh()
    shaded.save_project(tmp_path / "r.mlp")
    assert "Sphere" not in [mesh.label for mesh in read_project(tmp_path / "r.mlp").meshes]


def test_what_meshlab_did_to_a_layer_of_ours_is_saved_until_the_result_changes(shaded, tmp_path):
    shaded.set_current_mesh(by_label(shaded, "texels").id())
    shaded.compute_color_by_function_per_vertex(x="1", y="2", z="3")
    for _ in range(2):
        shaded.save_project(tmp_path / "r.mlp")
        saved = Document.open(tmp_path / "r.mlp").layers[-1].read()
        assert (saved.vertex_color == [1, 2, 3, 255]).all()
        assert np.array_equal(
            saved.vertex_attributes["svbrdf_height"], shaded.document.attribute("height")
        )
    shaded.apply_demo_edit()
    shaded.save_project(tmp_path / "r.mlp")
    saved = Document.open(tmp_path / "r.mlp").layers[-1].read()
    assert not (saved.vertex_color == [1, 2, 3, 255]).all()


def test_visibility_and_labels_set_in_meshlab_are_saved(shaded, tmp_path):
    shaded.set_mesh_visibility(0, False)
    by_label(shaded, "stone").set_label("rock")
    shaded.save_project(tmp_path / "r.mlp")
    first = read_project(tmp_path / "r.mlp").meshes[0]
    assert (first.label, first.visible) == ("rock", False)
    assert Document.open(tmp_path / "r.mlp").apply("compute_demo_shade").skipped


def test_jpeg_textures_are_shown_and_kept(tmp_path, stone):
    picture = tmp_path / "skin.jpg"
    cv2.imwrite(str(picture), np.full((8, 8, 3), 90, np.uint8))
    write_ply(tmp_path / "skin.ply", stone, textures=[picture], dtype=np.float64)
    meshes = MeshSet()
    meshes.load_new_mesh(tmp_path / "skin.ply")
    assert meshes.current_mesh().texture(0).width() == 8
    meshes.meshing_surface_subdivision_midpoint(iterations=1)
    meshes.save_project(tmp_path / "out" / "r.mlp")
    layer = Document.open(tmp_path / "out" / "r.mlp").layers[0]
    assert layer.read().textures == (picture,)


def test_textures_that_meshlab_makes_are_saved_with_the_project(meshes, tmp_path):
    meshes.compute_color_by_function_per_vertex(x="200", y="100", z="50")
    meshes.compute_texmap_from_color(textname=str(tmp_path / "made.png"), textw=32, texth=32)
    assert meshes.current_mesh().texture_number() == 1
    meshes.save_project(tmp_path / "out" / "r.mlp")
    meshes.clear()
    content = Document.open(tmp_path / "out" / "r.mlp").layers[0].read()
    assert content.textures[0].is_relative_to(tmp_path / "out" / "r.svbrdf")
    assert (read_image(content.textures[0])[..., :3] == [200, 100, 50]).all(-1).any()


def test_without_a_project_meshes_and_rasters_are_added_by_hand(small_project, tmp_path):
    meshes = MeshSet()
    meshes.load_new_mesh(str(small_project.parent / "mesh.ply"))
    for frame in sorted((small_project.parent / "frames").iterdir()):
        meshes.add_raster(frame, A_CAMERA, sequence="video")
    meshes.compute_demo_texels()
    meshes.compute_demo_shade()
    meshes.save_project(tmp_path / "hand.mlp")
    document = Document.open(tmp_path / "hand.mlp")
    assert [raster.sequence for raster in document.rasters] == ["video"] * 9
    assert document.object_layer().label == "mesh"
    assert document.apply("compute_demo_shade").skipped
    with pytest.raises(SvbrdfError, match="does not exist"):
        meshes.add_raster("nowhere.png", A_CAMERA)
    with pytest.raises(SvbrdfError, match="add_raster"):
        meshes.load_new_raster("frame.png")


def test_a_second_project_is_appended(meshes, small_project_at, tmp_path):
    with pytest.raises(SvbrdfError, match=r"raster 'f0\.png' is loaded already"):
        meshes.load_project(small_project_at(tmp_path / "other"))
    assert labels(meshes) == ["stone"]
    assert meshes.raster_number() == 9
    meshes.clear()
    assert (meshes.mesh_number(), meshes.raster_number()) == (0, 0)
    meshes.load_project(tmp_path / "other" / "small.mlp")
    assert labels(meshes) == ["stone"]


def test_scripts_mix_both_kinds_of_filters(meshes, stone, tmp_path):
    path = tmp_path / "mixed.mlx"
    path.write_text(
        '<FilterScript><filter name="compute_demo_texels"/>'
        '<filter name="Subdivision Surfaces: Midpoint"><Param name="Threshold" value="0" '
        'type="RichAbsPerc" min="0" max="1"/>'
        '<Param name="Iterations" type="RichInt" value="1"/></filter>'
        '<filter name="compute_demo_texels"/><filter name="compute_demo_shade"/></FilterScript>'
    )
    meshes.apply_filter_script(path)
    assert sorted(labels(meshes)) == ["map: height", "stone", "texels"]
    assert meshes.mesh(0).face_number() == 4 * len(stone.faces)
    path.write_text(
        '<FilterScript><filter name="compute_demo_texels"/><filter name="No"/></FilterScript>'
    )
    with pytest.raises(SvbrdfError, match="filter 2"):
        meshes.apply_filter_script(path)


def test_meshes_of_other_formats_are_meshlabs_to_read(tmp_path):
    other = pymeshlab.MeshSet()
    other.create_cube()
    other.save_current_mesh(str(tmp_path / "cube.stl"))
    meshes = MeshSet()
    meshes.load_new_mesh(str(tmp_path / "cube.stl"))
    meshes.save_project(tmp_path / "r.mlp")
    assert len(read_mesh(read_project(tmp_path / "r.mlp").meshes[0].path).mesh.faces) == 12
