"""Between the suite and MeshLab: what either wrote, the other reads, without loss that matters."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.layers import UNOBSERVED, texels_content
from meshlab_svbrdf.document.mesh_files import read_mesh, write_ply
from meshlab_svbrdf.document.project import read_project, write_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.meshlab import check
from meshlab_svbrdf.meshset import MeshSet
from meshlab_svbrdf.script import check_script, read_script, run_script
from sample_projects.make_totem import TINY, make_totem

DOCS = Path(__file__).parents[1] / "docs"
DIFFUSE = (
    "compute_svbrdf_visibility", "compute_svbrdf_samples", "compute_svbrdf_luminance_threshold",
    "generate_svbrdf_environment_map", "compute_svbrdf_diffuse_color",
    "compute_svbrdf_light_sources",
)  # fmt: skip


@pytest.fixture(scope="module")
def totem(tmp_path_factory) -> Path:
    return make_totem(tmp_path_factory.mktemp("totem") / "project", TINY).path


@pytest.fixture(scope="module")
def result(totem, tmp_path_factory) -> Path:
    """The sample up to the lights, saved."""
    document = Document.open(totem, tmp_path_factory.mktemp("result"))
    document.apply("compute_svbrdf_texels", texture_size=64)
    for name in DIFFUSE:
        document.apply(name)
    return document.save()


def lights(project: Path) -> np.ndarray:
    """Directions of the lights, (L, 3), strongest first."""
    told = json.loads((project.with_suffix(".svbrdf") / "lights.json").read_text())
    return np.array([light["direction"] for light in told["lights"]])


def by_label(meshes: pymeshlab.MeshSet, label: str) -> pymeshlab.Mesh:
    return next(mesh for mesh in meshes if mesh.label() == label)


def test_meshlab_opens_the_result(result):
    """Every layer with its texture or Quality; frames are left out, the wheels read no JPEG."""
    folder = result.parent / "plain"
    project = read_project(result)
    project.rasters.clear()
    folder.mkdir()
    write_project(project, folder / "meshes.mlp")
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(folder / "meshes.mlp"))
    assert [mesh.label() for mesh in meshes] == [layer.label for layer in project.meshes]
    diffuse = by_label(meshes, "totem").textures()
    assert [Path(name).name for name in diffuse] == ["diffuse.png"]
    assert by_label(meshes, "environment").texture_number() == 1
    assert by_label(meshes, "map: visibility").has_vertex_color()

    texels = by_label(meshes, "texels")
    document = Document.open(result)
    assert texels.vertex_number() == len(document.texels())
    threshold = document.attribute("threshold")
    shown = np.where(np.isfinite(threshold), threshold, UNOBSERVED)
    np.testing.assert_allclose(texels.vertex_scalar_array(), shown, rtol=1e-6)


def test_quality_has_no_nan_that_meshlab_dies_of(result):
    """The colour ramp counts into a histogram, where NaN is an index outside."""
    document = Document.open(result)
    texels = document.texels()
    values = np.full(len(texels), np.nan, np.float32)
    values[::2] = 7.0
    content = texels_content(texels, {"half": values}, None, "half")
    assert content.quality.tolist() == np.where(np.isnan(values), -1, values).tolist()
    np.testing.assert_array_equal(content.vertex_attributes["svbrdf_half"], values)

    path = document.folder.parent / "half.ply"
    write_ply(path, content.mesh, quality=content.quality)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    meshes.compute_color_from_scalar_per_vertex()
    assert len(np.unique(meshes.current_mesh().vertex_color_matrix(), axis=0)) == 2


def test_attributes_become_quality_in_meshlab(result):
    """The same through a function filter of MeshLab's, with unobserved texels in the attribute."""
    document = Document.open(result)
    threshold = document.attribute("threshold").copy()
    threshold[::3] = np.nan
    layer = next(layer for layer in document.layers if layer.label == "texels")
    layer.content = texels_content(document.texels(), {"threshold": threshold}, None, None)

    meshes = MeshSet()
    meshes._bridge.push(layer)
    mesh = meshes.current_mesh()
    assert mesh.vertex_custom_scalar_attribute_array("svbrdf_threshold").min() == UNOBSERVED
    meshes.compute_scalar_by_function_per_vertex(q="svbrdf_threshold * 2")
    meshes.compute_color_from_scalar_per_vertex()
    assert mesh.vertex_scalar_array().min() == 2 * UNOBSERVED


def rewritten(path: Path) -> Path:
    """A project of ours as MeshLab writes it: six digits, nothing that it does not know."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda number: f"{float(number[0]):.6g}", text)
    text = re.sub(r' svbrdf_\w+="[^"]*"| idInFile="-1"', "", text)
    view = '<RenderingOption pointSize="3">100001000000</RenderingOption></MLMesh>'
    text = text.replace("</MLMesh>", view)
    saved = path.with_name(f"{path.stem}_saved.mlp")
    saved.write_text(text, encoding="utf-8")
    return saved


@pytest.mark.parametrize("writer", ["pymeshlab", "MeshLab"])
def test_a_project_that_meshlab_saved(totem, result, writer, tmp_path):
    """Cameras of six digits: the lights are found within .1° of where they were."""
    if writer == "MeshLab":
        saved = rewritten(totem)
    else:
        meshes = pymeshlab.MeshSet()
        meshes.load_project(str(totem))
        saved = totem.with_name("pymeshlab.mlp")
        meshes.save_project(str(saved))
    ours, theirs = read_project(totem), read_project(saved)
    assert [r.label for r in theirs.rasters] == [r.label for r in ours.rasters]
    assert [r.path for r in theirs.rasters] == [r.path for r in ours.rasters]
    assert [r.sequence for r in theirs.rasters] == [r.sequence for r in ours.rasters]
    point = np.array([[0.3, 0.2, 0.1]])
    for a, b in zip(ours.rasters, theirs.rasters, strict=True):
        np.testing.assert_allclose(a.camera.project(point), b.camera.project(point), atol=2e-3)

    document = Document.open(saved, tmp_path)
    document.apply("compute_svbrdf_texels", texture_size=64)
    for name in DIFFUSE:
        document.apply(name)
    before, after = lights(result), lights(document.save())
    angle = np.degrees(np.arccos(np.clip((before * after).sum(axis=1), -1, 1)))
    assert len(before) == len(after)
    assert angle.max() < 0.1


def test_view_state_of_meshlabs_survives_another_run(result, tmp_path):
    saved = rewritten(result)
    text = saved.read_text(encoding="utf-8").replace('visible="1"', 'visible="0"')
    saved.write_text(text.replace('environment.ply" visible="0"', 'environment.ply" visible="1"'))
    document = Document.open(saved, tmp_path)
    document.apply("compute_svbrdf_texels", texture_size=32)
    text = document.save().read_text(encoding="utf-8")
    assert text.count("RenderingOption pointSize") == len(document.layers)
    assert not document.object_layer().visible


@pytest.mark.parametrize("uv", [True, False])
def test_simplify_parametrise_bake(totem, uv, tmp_path):
    """The documented chain: baked normals are the scan's, the simple mesh's own are not."""
    scan = read_mesh(totem.parent / "totem.ply").mesh
    if not uv:
        project = read_project(totem)
        project.meshes[0].path = tmp_path / "scan.ply"
        write_ply(tmp_path / "scan.ply", replace(scan, uv=None, texture_index=None))
        totem = tmp_path / "scan.mlp"
        write_project(project, totem)
    text = (DOCS / "simplify_parametrise_bake.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"^```xml\n(.*?)^```", text, re.DOTALL | re.M)
    script = script.replace('value="2000"', 'value="300"').replace('value="512"', 'value="128"')
    path = tmp_path / "bake.mlx"
    path.write_text(script if uv else script.replace(" (with texture)", ""), encoding="utf-8")
    steps = read_script(path)
    check_script(steps)
    bake = next(k for k, step in enumerate(steps) if step.name == "transfer_svbrdf_normals")

    document = Document.open(totem, tmp_path / "out")
    outcomes = list(run_script(document, steps[:bake]))
    assert ("parametrised" in outcomes[-1].message) == (not uv)
    assert len(document.mesh().faces) <= 300
    own = document.texels().normal
    list(run_script(document, steps[bake : bake + 1]))
    baked = document.texels()
    document.apply("transfer_svbrdf_normals", source="totem_copy", force=True)
    np.testing.assert_array_equal(document.texels().normal, baked.normal)

    near = np.argmin(
        np.linalg.norm(scan.vertices[:, None] - (baked.position + baked.center)[::7], axis=2),
        axis=0,
    )
    truth = scan.vertex_normals()[near]
    error = [
        np.degrees(np.arccos(np.clip((n[::7] * truth).sum(1), -1, 1))) for n in (own, baked.normal)
    ]
    assert np.median(error[1]) < 0.7 * np.median(error[0])

    document.save()
    told = {layer.label: layer.visible for layer in Document.open(document.path).layers}
    assert told["totem"]
    assert not told["totem_copy"]


def test_names_of_meshlabs_filters_count_to_the_letter():
    check("Duplicate Current layer", {})
    check("Laplacian Smooth", {})
    with pytest.raises(SvbrdfError, match="it writes 'Duplicate Current layer'"):
        check("Duplicate Current Layer", {})
