"""The document: what filters see, when they run, what is left when they fail, what is saved."""

import json
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, write_png
from meshlab_svbrdf.document.layers import Layer, attribute_name, file_name
from meshlab_svbrdf.document.mesh_files import MeshFile, write_ply
from meshlab_svbrdf.document.project import read_project, write_project
from meshlab_svbrdf.errors import DocumentError, MissingStageError, SvbrdfError
from meshlab_svbrdf.filter import Filter, Parameter
from meshlab_svbrdf.geometry.mesh import Mesh

TEXELS, SHADE, EDIT = "compute_demo_texels", "compute_demo_shade", "apply_demo_edit"

pytestmark = pytest.mark.usefixtures("demos")


@pytest.fixture
def document(small_project, tmp_path) -> Document:
    return Document.open(small_project, tmp_path / "out")


@pytest.fixture
def shaded(document) -> Document:
    document.apply(TEXELS)
    document.apply(SHADE)
    return document


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def ran(document: Document, *names: str, **parameters) -> list[bool]:
    return [not document.apply(name, **parameters).skipped for name in names]


# Where things are


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        (None, "in/small"),
        ("out", "out/small"),
        ("out/other.mlp", "out/other"),
        ("x.mlb", "x"),
    ],
)
def test_results_lie_beside_the_project_to_write(small_project, tmp_path, output, expected):
    document = Document.open(small_project, output and tmp_path / output)
    assert document.path.with_suffix("") == tmp_path / expected
    assert document.folder == (tmp_path / expected).with_suffix(".svbrdf")
    assert not document.folder.exists()


def test_the_mesh_is_in_world_coordinates(document, stone):
    layer = document.object_layer()
    expected = stone.vertices @ layer.matrix[:3, :3].T + layer.matrix[:3, 3]
    assert np.allclose(document.mesh().vertices, expected, rtol=0, atol=1e-15)


def test_the_object_is_the_visible_mesh_unless_another_is_chosen(
    small_project, tmp_path, caplog, stone
):
    project = read_project(small_project)
    write_ply(tmp_path / "other.ply", stone)
    write_ply(tmp_path / "points.ply", np.zeros((3, 3)) + np.arange(3)[:, None])
    for label, path in (("points", "points"), ("other", "other"), ("third", "other")):
        project.add_mesh(label, tmp_path / f"{path}.ply")
    project.meshes[0].visible = False
    write_project(project, small_project)
    document = Document.open(small_project)
    assert document.object_layer().label == "other"
    assert document.object_layer().label == "other"
    assert caplog.text.count("working on 'other'") == 1
    document.set(object="third")
    assert Document.open(small_project).object_layer().label == "third"
    document.set(object="nobody")
    with pytest.raises(DocumentError, match=r"no mesh layer 'nobody'.*'stone', 'points'"):
        document.object_layer()


def test_a_users_layer_may_be_called_as_ours(small_project):
    project = read_project(small_project)
    project.meshes[0].label = "texels"
    write_project(project, small_project)
    assert Document.open(small_project).object_layer().label == "texels"


def test_a_project_without_a_mesh_says_so(small_project):
    project = read_project(small_project)
    project.meshes.clear()
    write_project(project, small_project)
    with pytest.raises(DocumentError, match=r"no mesh layer with faces \(its layers: none\)"):
        Document.open(small_project).object_layer()


# When filters run


def test_a_filter_runs_once_for_the_same_inputs_also_in_another_process(document):
    assert ran(document, TEXELS, SHADE) == [True, True]
    assert ran(document, TEXELS, SHADE) == [False, False]
    document.save()
    assert ran(Document.open(document.path), TEXELS, SHADE) == [False, False]
    moved = document.save(document.path.parent / "deep" / "er" / "other.mlb")
    assert ran(Document.open(moved), TEXELS, SHADE) == [False, False]


def test_forced_it_runs_again(shaded):
    assert ran(shaded, TEXELS, SHADE, force=True) == [True, True]


def test_a_parameter_runs_it_and_what_depends_on_it_again(shaded):
    assert ran(shaded, TEXELS, size=16) == [False]
    assert ran(shaded, TEXELS, size=8) == [True]
    assert shaded.stale("shade") == "texels"
    assert ran(shaded, SHADE) == [True]
    assert len(shaded.attribute("height")) == len(shaded.texels())


def touch(document: Document) -> None:
    path = document.rasters[2].path
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))


def turn(document: Document) -> None:
    raster = document.rasters[2]
    raster.camera = replace(raster.camera, cx=raster.camera.cx + 1e-3)


@pytest.mark.parametrize(
    "change",
    [
        touch,
        turn,
        lambda document: document.hold_out(),
        lambda document: setattr(document.rasters[0], "exposure", 2.0),
        lambda document: setattr(document.rasters[0], "sequence", "another"),
        lambda document: document.project.rasters.pop(),
    ],
)
def test_any_change_of_the_frames_runs_what_reads_them_again(shaded, change):
    change(shaded)
    assert ran(shaded, TEXELS, SHADE) == [False, True]


def test_a_change_of_the_mesh_makes_everything_stale(shaded):
    layer = shaded.object_layer()
    layer.matrix = layer.matrix @ np.diag([2, 2, 2, 1.0])
    assert shaded.stale("shade") == "mesh"
    with pytest.raises(MissingStageError, match=f"mesh changed since: run {TEXELS} again"):
        shaded.apply(SHADE)


def test_a_missing_stage_is_named(document):
    with pytest.raises(MissingStageError, match=f"{SHADE} needs the texels: run {TEXELS} first"):
        document.apply(SHADE)
    document.apply(TEXELS)
    with pytest.raises(MissingStageError, match="no attribute height"):
        document.attribute("height")
    with pytest.raises(MissingStageError, match="no map height"):
        document.map("height")


def test_a_lost_file_is_made_again(shaded):
    (shaded.folder / "maps" / "height.exr").unlink()
    assert ran(shaded, TEXELS, SHADE) == [False, True]


def test_files_given_as_parameters_count_by_content(shaded, tmp_path):
    image = tmp_path / "image.png"
    write_png(image, np.zeros((2, 2), np.uint8))
    assert ran(shaded, SHADE, image=image) == [True]
    image.touch()
    assert ran(shaded, SHADE, image=str(image)) == [False]
    write_png(image, np.ones((2, 2), np.uint8))
    assert ran(shaded, SHADE, image=image) == [True]


def test_lengths_arrive_in_world_units(document):
    got = []
    probe = Filter(
        "get_length",
        "Length",
        ("mesh",),
        parameters=(Parameter("near", "length", "10%"),),
        apply=lambda document, parameters, progress: got.append(parameters.near),
    )
    document.apply(probe)
    document.apply(probe, near=0.25)
    assert got == [pytest.approx(0.1 * np.sqrt(3), rel=1e-12), 0.25]


def test_an_edit_is_never_unchanged_and_kept_until_its_maker_is_forced(shaded):
    before = shaded.attribute("height")
    assert ran(shaded, EDIT, EDIT) == [True, True]
    assert np.array_equal(shaded.attribute("height"), before + 2)
    assert shaded.map("height")
    assert shaded.stale("shade") == ""
    again = shaded.apply(SHADE)
    assert (again.skipped, again.message) == (True, "unchanged but for edits (kept)")
    assert np.array_equal(shaded.attribute("height"), before + 2)
    assert ran(shaded, SHADE, force=True) == [True]
    assert np.array_equal(shaded.attribute("height"), before)
    assert shaded.apply(SHADE).message == "unchanged"


def test_an_edited_product_is_made_anew_from_changed_inputs(shaded):
    before = shaded.attribute("height")
    shaded.apply(EDIT)
    assert ran(shaded, TEXELS, force=True) == [True]
    assert ran(shaded, SHADE) == [False]
    shaded.layers[0].matrix[:3, 3] += 1
    assert ran(shaded, TEXELS, SHADE) == [True, True]
    assert not np.array_equal(shaded.attribute("height"), before + 1)


def test_held_out_frames_are_every_eighth_by_name_and_no_filter_sees_them(document):
    document.hold_out()
    assert [raster.label for raster in document.held_out] == ["f3.png"]
    document.apply(TEXELS)
    document.apply(SHADE)
    frames = document.json("frames")["frames"]
    assert len(frames) == 9
    assert frames[-1] == {"label": "f3.png", "left_out": "held out"}
    document.hold_out(False)
    assert len(document.rasters) == 9
    assert ran(document, SHADE) == [True]


def test_overwriting_what_a_later_stage_has_refined_makes_that_stage_stale(shaded):
    def write(value):
        return lambda document, parameters, progress: document.set_json("lights", {"value": value})

    find = Filter("find_lights", "Find", ("texels",), ("lights",), apply=write(1))
    refine = Filter("refine_lights", "Refine", ("lights",), ("fine",), apply=write(2))
    shaded.apply(find)
    shaded.apply(refine)
    assert shaded.apply(find).skipped
    assert shaded.apply(refine).skipped
    shaded.apply(find, force=True)
    assert shaded.json("lights") == {"value": 1}
    assert not shaded.apply(refine).skipped
    assert shaded.json("lights") == {"value": 2}


def test_results_do_not_grow_stale_when_their_frames_are_gone(shaded):
    path = shaded.save()
    for raster in shaded.rasters:
        raster.path.unlink()
    document = Document.open(path)
    assert document.stale("shade") == ""
    assert ran(document, EDIT) == [True]
    assert ran(document, SHADE) == [True]


# Whole or not at all


@pytest.mark.parametrize(
    ("how", "error"), [("error", SvbrdfError), ("interrupt", KeyboardInterrupt)]
)
def test_a_filter_that_fails_changes_nothing(shaded, how, error):
    before = files(shaded.folder)
    with pytest.raises(error):
        shaded.apply(SHADE, scale=2, fail=how)
    assert files(shaded.folder) == before
    assert ran(shaded, TEXELS, SHADE) == [False, False]


def test_a_wrong_parameter_is_refused_before_anything(document):
    with pytest.raises(SvbrdfError, match=f"{TEXELS}: parameter size is 'big', expected a whole"):
        document.apply(TEXELS, size="big")
    assert not document.folder.exists()


def test_a_filter_does_not_see_what_its_last_run_left(document):
    seen = []

    def look(document, parameters, progress):
        seen.append((document.has_array("own"), document.has_json("own")))
        document.set_array("own", np.arange(3))
        document.set_json("own", {})
        seen.append((document.has_array("own"), document.has_json("own")))

    probe = Filter("look_around", "Look", ("mesh",), ("own",), apply=look)
    document.apply(probe)
    document.apply(probe, force=True)
    assert seen == [(False, False), (True, True)] * 2
    assert np.array_equal(document.array("own", mmap=True), [0, 1, 2])


def test_what_a_filter_no_longer_sets_goes(document):
    for name in ("first", "second"):
        probe = Filter(
            "make_one", "One", ("mesh",), ("one",),
            apply=lambda document, parameters, progress, name=name: document.set_json(name, {}),
        )  # fmt: skip
        document.apply(probe, force=True)
    assert not document.has_json("first")
    assert document.has_json("second")


def test_results_are_set_by_filters_that_declare_them(shaded):
    with pytest.raises(RuntimeError, match="declares `writes`"):
        shaded.set_json("lights", {})
    silent = Filter(
        "write_nothing", "Nothing", apply=lambda document, *_: document.set_json("lights", {})
    )
    with pytest.raises(RuntimeError, match="declares `writes`"):
        shaded.apply(silent)
    with pytest.raises(ValueError, match=r"shape \(3,\)"), shaded.write("shade"):
        shaded.set_attribute("height", np.zeros(3))


def test_a_filter_cannot_change_what_the_user_chose(document):
    with document.write("p"), pytest.raises(RuntimeError, match="settings are the user's"):
        document.hold_out()
    assert document.held_out == []


def test_json_holds_numpy_and_says_null_for_what_is_no_number(document):
    value = {
        "a": np.float32(0.5),
        "b": np.array([1, np.nan]),
        "c": (np.inf, None),
        "d": np.bool_(1),
    }
    with document.write("p"):
        document.set_json("x", value)
    assert document.json("x") == {"a": 0.5, "b": [1, None], "c": [None, None], "d": True}


def test_texels_come_back_to_the_last_bit(shaded):
    again = Document.open(shaded.project.path, shaded.path)
    a, b = vars(shaded.texels()), vars(again.texels())
    assert a.keys() == b.keys()
    assert all(np.array_equal(a[name], b[name]) and type(a[name]) is type(b[name]) for name in a)


@pytest.mark.parametrize("name", ["Bad", "a b", "x" * 101, "", "1a", "é"])
def test_attribute_names_that_meshlab_chokes_on_are_refused(name):
    with pytest.raises(ValueError, match="attribute"):
        attribute_name(name)


def test_the_prefix_of_attributes_is_optional(shaded):
    assert np.array_equal(shaded.attribute("svbrdf_height"), shaded.attribute("height"))
    assert shaded.attributes() == ["height"]


# Saving


def test_a_saved_project_shows_every_result(shaded, stone):
    shaded.set(quality="height")
    path = shaded.save()
    labels = [mesh.label for mesh in read_project(path).meshes]
    assert labels == ["stone", "map: height", "texels"]
    document = Document.open(path)
    object_layer, shown, texels = document.layers
    assert [object_layer.visible, shown.visible, texels.visible] == [True, False, False]
    assert np.array_equal(object_layer.matrix, shaded.object_layer().matrix)
    for layer in (object_layer, shown):
        assert layer.read().textures == (document.folder / "maps" / "diffuse.png",)
        assert np.array_equal(layer.read().mesh.vertices, stone.vertices)
    content = texels.read()
    assert np.array_equal(content.vertex_attributes["svbrdf_height"], shaded.attribute("height"))
    assert np.array_equal(content.quality, shaded.attribute("height"))
    t = shaded.texels()
    assert np.array_equal(
        content.vertex_color[:, :3], shaded.map("diffuse", "png")[0][t.row, t.col]
    )
    world = content.mesh.transformed(texels.matrix).vertices
    assert np.allclose(world, t.position + t.center, rtol=0, atol=1e-7)
    frames = [raster.path for raster in document.rasters]
    assert frames == [raster.path for raster in shaded.rasters]


def test_saving_again_writes_only_what_changed(shaded):
    shaded.save()
    layers = shaded.folder / "layers"
    before = {path.name: path.stat().st_mtime_ns for path in layers.iterdir()}
    shaded.save()
    Document.open(shaded.path).save()
    assert {path.name: path.stat().st_mtime_ns for path in layers.iterdir()} == before
    shaded.apply(EDIT)
    shaded.save()
    after = {path.name: path.stat().st_mtime_ns for path in layers.iterdir()}
    assert {name for name in after if after[name] != before[name]} == {"texels.ply"}


def test_what_the_user_hides_or_shows_and_unknown_xml_stay(shaded):
    path = shaded.save()
    tree = ET.fromstring(path.read_bytes())
    for mesh in tree.iter("MLMesh"):
        mesh.set("visible", "0" if mesh.get("label") == "stone" else "1")
        ET.SubElement(mesh, "RenderingOption").text = "1"
    path.write_bytes(ET.tostring(tree))
    document = Document.open(path)
    document.apply(EDIT)
    document.save()
    meshes = ET.fromstring(path.read_bytes()).findall(".//MLMesh")
    assert [mesh.get("visible") for mesh in meshes] == ["0", "1", "1"]
    assert all(mesh.find("RenderingOption") is not None for mesh in meshes)


def test_stale_results_are_not_shown_and_the_object_is_never_lost(shaded, stone):
    path = shaded.save()
    document = Document.open(path)
    document.apply(TEXELS, size=8)
    document.save()
    again = Document.open(path)
    assert [layer.label for layer in again.layers] == ["stone", "texels"]
    assert again.layers[1].read().vertex_attributes == {}
    assert np.array_equal(again.object_layer().read().mesh.vertices, stone.vertices)


def test_the_input_is_left_alone(document, small_project):
    before = files(small_project.parent)
    document.apply(TEXELS)
    document.apply(SHADE)
    document.save()
    assert files(small_project.parent) == before


def test_an_object_far_from_the_origin_keeps_its_digits(tmp_path, stone, small_project_at):
    matrix = np.eye(4)
    matrix[:3, 3] = 4e6, 5e6, 100
    project = small_project_at(tmp_path / "far", matrix=matrix)
    document = Document.open(project, tmp_path / "out")
    document.apply(TEXELS, size=64)
    layer = Document.open(document.save()).layers[-1]
    corners = stone.vertices + matrix[:3, 3]
    world = layer.read().mesh.transformed(layer.matrix).vertices
    assert np.abs(layer.read().mesh.vertices).max() < 2
    assert ((world >= corners.min(0) - 1e-6) & (world <= corners.max(0) + 1e-6)).all()
    barycentric = document.texels().barycentric.astype(np.float64)
    faces = stone.faces[document.texels().face]
    exact = np.einsum("tc,tcd->td", barycentric, stone.vertices[faces])
    assert np.abs(world - matrix[:3, 3] - exact).max() < 2e-7 + np.spacing(5e6)


def test_texture_coordinates_of_ours_do_not_count_as_a_change(tmp_path, stone, small_project_at):
    project = small_project_at(tmp_path / "plain", uv=False)
    document = Document.open(project, tmp_path / "out")
    assert ran(document, TEXELS, SHADE) == [True, True]
    assert np.array_equal(document.mesh().uv.astype(np.float32), stone.uv.astype(np.float32))
    again = Document.open(document.save())
    assert again.layers[0].read().mesh.uv is not None
    assert ran(again, TEXELS, SHADE) == [False, False]
    assert ran(again, TEXELS, size=8) == [True]


def test_a_layer_of_a_filter_is_saved_with_its_texture(shaded, stone):
    corner = stone.uv
    sphere = Mesh(stone.vertices, stone.faces, uv=corner)

    def show(document, parameters, progress):
        document.set_image("environment", np.full((2, 4, 3), 7, np.uint8), kind="png")
        content = MeshFile(mesh=sphere, textures=(document.folder / "environment.png",))
        document.set_layer(
            Layer("environment", None, 3 * np.eye(4) - np.diag([0, 0, 0, 2]), True, content)
        )

    shaded.apply(Filter("show_sphere", "Sphere", ("texels",), ("environment",), apply=show))
    layer = next(x for x in Document.open(shaded.save()).layers if x.label == "environment")
    assert layer.visible
    assert layer.matrix[0, 0] == 3
    assert np.array_equal(read_image(layer.read().textures[0]), np.full((2, 4, 3), 7, np.uint8))


def test_layers_that_only_are_in_memory_get_files_of_their_own(shaded, tmp_path, stone):
    for scale in (1, 2):
        mesh = replace(stone, vertices=stone.vertices * scale)
        shaded.layers.append(Layer("same name", None, np.eye(4), True, MeshFile(mesh=mesh)))
    path = shaded.save(tmp_path / "elsewhere" / "x.mlp")
    layers = [layer for layer in Document.open(path).layers if layer.label == "same name"]
    assert len({layer.path for layer in layers}) == 2
    sizes = [np.ptp(layer.read().mesh.vertices[:, 0]) for layer in layers]
    assert sizes == [1, 2]


def test_saving_elsewhere_makes_a_complete_copy(shaded, tmp_path):
    shaded.save()
    first, before = shaded.path, files(shaded.folder)
    second = shaded.save(tmp_path / "copy" / "other.mlp")
    assert files(first.with_suffix(".svbrdf")) == before
    document = Document.open(second)
    assert all(
        layer.path.is_relative_to(second.with_suffix(".svbrdf")) for layer in document.layers
    )
    assert ran(document, TEXELS, SHADE) == [False, False]


def test_the_record_tells_what_made_what(shaded):
    record = json.loads((shaded.folder / "svbrdf.json").read_text())
    run = record["runs"][SHADE]
    assert run["parameters"]["scale"] == 1.0
    assert run["message"] == "shaded"
    assert record["products"]["shade"]["filter"] == SHADE
    assert record["products"]["shade"]["inputs"].keys() == {"texels", "rasters"}
    assert record["products"]["shade"]["inputs"]["texels"] == record["products"]["texels"]["key"]


@pytest.mark.parametrize(
    ("label", "expected"),
    [("map: rho s/α", "layers/map_rho_s.ply"), ("...", "layers/layer.ply"), ("a", "layers/a.ply")],
)
def test_file_names_of_layers_are_plain(label, expected):
    assert file_name(label) == expected
