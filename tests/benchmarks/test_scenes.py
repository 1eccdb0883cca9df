"""The benchmark's scenes: their geometry, their light against a second renderer, their scoring."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.scenes.cameras import misregistered, orbits
from benchmarks.scenes.catalogue import CONVEX, SCENES
from benchmarks.scenes.make import ensure_scene
from benchmarks.scenes.paint import paint
from benchmarks.scenes.score import score, seen_lobes
from benchmarks.scenes.score_environment import environment_picture
from benchmarks.scenes.shapes import make_shape
from benchmarks.scenes.variant import Lamp
from meshlab_svbrdf.document.images import read_exr, read_image, write_exr, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from sample_projects.procedural.capture import Scene, picture
from sample_projects.procedural.light import Floodlight, Material, Surface
from sample_projects.procedural.paint import Atlas

TINY = replace(
    CONVEX, name="tiny", detail=16, frames=6, width=80, height=60, samples=4, texture=96, views=1
)


def _mitsuba_renders() -> bool:
    """In a process of its own: with an LLVM too old Mitsuba ends the process it runs in."""
    code = (
        "import mitsuba as m; m.set_variant('llvm_ad_rgb'); "
        "m.render(m.load_dict(m.cornell_box()), spp=1).numpy()"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


@pytest.fixture(scope="module")
def mitsuba():
    pytest.importorskip(
        "mitsuba", "3.9", reason="the benchmark's renderer is not installed ([benchmark])"
    )
    if not _mitsuba_renders():
        pytest.skip("Mitsuba does not render here (it needs LLVM 16 or newer)")


@pytest.mark.parametrize("shape", ["bumpy", "vessel", "bowl", "knot"])
def test_shapes_face_outwards_and_keep_their_charts(shape):
    fine, coarse = make_shape(shape, 24, 4.0, 1)
    assert len(fine.faces) > 3 * len(coarse.faces)
    for mesh in (fine, coarse):
        a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
        assert np.einsum("ij,ij->", np.cross(a, b), c) > 0
    assert fine.radius == pytest.approx(1)
    np.testing.assert_allclose(fine.center, 0, atol=1e-6)
    # A texel shows the same place on both
    places = []
    for mesh in (fine, coarse):
        atlas = Atlas.of(mesh, 64)
        points = mesh.vertices[mesh.faces[atlas.face]]
        places.append(np.where(atlas.face[..., None] < 0, np.nan,
                               (atlas.barycentric[..., None] * points).sum(-2)))  # fmt: skip
    distance = np.linalg.norm(places[0] - places[1], axis=-1)
    assert np.nanmax(distance) < 0.12
    assert np.nanmedian(distance) < 0.015


@pytest.mark.parametrize("size", [0.5, 5.0, 30.0])
def test_radiance_of_a_disk_is_the_textbooks(size):
    lamp = Lamp("disk", 70, 30, 8.0, (size, size), intensity=2.0)
    assert lamp.radiance() * np.sin(np.radians(size)) ** 2 == pytest.approx(2.0, rel=2e-3)
    assert np.cross(*lamp.half_axes) @ lamp.direction < 0


def test_pose_errors_move_pixels_by_as_much():
    variant = replace(CONVEX, pose_error=0.5, frames=40)
    mesh, _ = make_shape("bumpy", 12, 1.0, 1)
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    right = orbits(variant, reach)
    moved = [
        (a.project(mesh.vertices) - b.project(mesh.vertices))[:, :2]
        for a, b in zip(right, misregistered(right, variant, reach), strict=True)
    ]
    assert 0.4 < np.sqrt(np.mean(np.square(moved))) < 0.8


def test_every_scene_has_its_own_name_and_cache():
    assert all(name == variant.name for name, variant in SCENES.items())
    assert len({repr(variant) for variant in SCENES.values()}) == len(SCENES)
    assert repr(SCENES["ggx"]).count("GgxMaterial") == 2  # what the cache knows a scene by


def test_an_older_mitsuba_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", SimpleNamespace(__version__="3.8.1"))
    monkeypatch.setitem(sys.modules, "drjit", SimpleNamespace())
    monkeypatch.delitem(sys.modules, "benchmarks.scenes.renderer", raising=False)
    with pytest.raises(SvbrdfError, match=r"Mitsuba 3\.8\.1 is installed: needs Mitsuba >= 3\.9"):
        importlib.import_module("benchmarks.scenes.renderer")


def test_mitsuba_and_embree_agree(mitsuba):
    """Small disks in one renderer, points in the other: images, and irradiance with shadows."""
    from benchmarks.scenes.renderer import Renderer

    lamps = tuple(
        replace(lamp, half_extent=(0.2, 0.2)) for lamp in SCENES["floods_concave"].lamps[:2]
    )
    variant = replace(TINY, shape="vessel", lamps=lamps, ambient=0.0)
    mesh, _ = make_shape("vessel", 24, 1.0, 1)
    maps = paint(mesh, variant)
    renderer = Renderer(mesh, maps, variant)

    # Give each face one material and colour: their second renderer knows no material maps
    place = (mesh.uv.mean(1) * variant.texture).astype(int)
    face_material = maps.material[variant.texture - 1 - place[:, 1], place[:, 0]]
    surface = Surface(mesh, face_material, maps.albedo)
    scene = Scene(
        surface,
        [Floodlight(l.name, l.direction, l.distance, l.intensity) for l in lamps],
        0.0,
        tuple(Material(m.name, m.rho_s, m.alpha) for m in variant.materials),
    )
    camera = orbits(variant, 1.0)[0]
    ours, cover = renderer.render(camera, 64, 1)
    theirs, theirs_cover = picture(scene, camera, 6, np.random.default_rng(1))
    np.testing.assert_allclose(cover, theirs_cover, atol=0.13)
    assert np.abs(cover - theirs_cover).mean() < 2e-3
    on = (cover > 0.999) & (theirs_cover > 0.999)
    error = np.abs(ours - theirs)[on]
    assert np.median(error) < 0.01 * ours[on].mean()
    assert np.quantile(error, 0.9) < 0.1 * ours[on].mean()

    atlas = Atlas.of(mesh, 64)
    inside = atlas.face >= 0
    position, normal, _, _ = surface.at(atlas.face[inside], atlas.barycentric[inside])
    a, b, c = surface.corners[atlas.face[inside]].transpose(1, 0, 2)
    facet = np.cross(b - a, c - a)
    received = renderer.irradiance(
        position, normal, facet / np.linalg.norm(facet, axis=1)[:, None], 8, 1
    )
    expected = surface.irradiance(atlas.face[inside], atlas.barycentric[inside], scene.lights, 0.0)
    error = np.abs(received - expected)
    assert np.median(error) < 2e-3
    assert (error > 0.05).mean() < 0.05


@pytest.fixture(scope="module")
def tiny(mitsuba, tmp_path_factory) -> Path:
    return ensure_scene(TINY, tmp_path_factory.mktemp("cache"))


def test_equal_variants_give_equal_files(tiny, tmp_path):
    again = ensure_scene(TINY, tmp_path)
    files = sorted(p.relative_to(tiny.parent) for p in tiny.parent.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(again.parent) for p in tmp_path.rglob("*") if p.is_file())
    for file in files:
        ours, theirs = tiny.parent / file, again.parent / file
        if file.suffix == ".exr":
            np.testing.assert_allclose(read_exr(ours), read_exr(theirs), rtol=1e-5, atol=1e-7)
        elif file.suffix in (".png", ".jpg"):
            difference = read_image(ours).astype(int) - read_image(theirs)
            assert (difference != 0).mean() < 1e-3
        else:
            assert ours.read_bytes() == theirs.read_bytes(), file


def test_a_rendered_scene_stays_until_its_declaration_changes(tiny):
    frame = next(iter(read_project(tiny).rasters)).path
    before = frame.stat().st_mtime_ns
    assert ensure_scene(TINY, tiny.parents[1]) == tiny
    assert frame.stat().st_mtime_ns == before


def test_the_truth_scores_perfectly(tiny, tmp_path):
    truth = tiny.parent / "ground_truth"
    _write_truth_as_result(truth, tmp_path)
    figures = score(tmp_path, truth, truth / "views", np.zeros(3))
    assert figures["lights_missed"] == figures["lights_false"] == 0
    assert figures["light_deg_max"] < 1e-3
    assert figures["ln_gain_max"] < 1e-9
    assert figures["coverage"] == 1
    assert figures["dE_mean"] < 1e-3
    assert abs(figures["ln_rho_s_worst"]) < 1e-6
    assert abs(figures["ln_alpha_worst"]) < 1e-6
    assert figures["adjusted_rand"] == pytest.approx(1)
    assert figures["labelled"] == 1
    assert figures["env_energy_inside"] > 0.9  # the lamps' rims are dimmer
    assert figures["env_outside_sr"] == 0
    assert figures["psnr"] > 100
    assert figures["ssim_highlights"] == pytest.approx(1)
    environment_picture(tmp_path, truth, tmp_path / "environment.png")
    picture = read_image(tmp_path / "environment.png")
    assert picture.shape == (520, 512, 3)
    bright = picture.min(-1) > 200
    assert 0 < bright[264:].sum() < 2000
    assert (bright[:256] == bright[264:]).mean() > 0.995


def _write_truth_as_result(truth: Path, folder: Path) -> None:
    (folder / "maps").mkdir()
    emitters = json.loads((truth / "lights.json").read_text())["emitters"]
    lights = [
        {k: e[k] for k in ("direction", "position")} | {"gain": e["phong_intensity"][0]}
        for e in emitters
    ]
    (folder / "lights.json").write_text(json.dumps({"lights": lights}))
    (folder / "arrays").mkdir()
    radiance = read_exr(truth / "env.exr").mean(-1)
    np.save(folder / "arrays" / "environment_radiance.npy", radiance)
    np.save(folder / "arrays" / "environment_weight.npy", np.ones_like(radiance))
    write_exr(folder / "environment.exr", np.clip(radiance, 0, 1))
    diffuse = read_exr(truth / "diffuse_full.exr")
    write_exr(folder / "maps" / "diffuse.exr", diffuse)
    valid = np.isfinite(diffuse).all(-1)
    write_png(folder / "maps" / "valid.png", np.where(valid, 255, 0).astype(np.uint8))
    ids = read_image(truth / "material_id.png")
    lobes = np.array(seen_lobes(truth)[0])[ids]
    for k, name in enumerate(("rho_s", "alpha")):
        write_exr(folder / "maps" / f"{name}.exr", lobes[..., k].astype(np.float32))
    shutil.copy(truth / "material_id.png", folder / "maps" / "material.png")
