"""The benchmark's peers on a painted object: each must give the paint back where it was."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.peers.capture import read_capture
from benchmarks.peers.scores import peer_scores
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image, write_exr, write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

SIZE, CENTER = 64, np.array([3.0, -2.0, 5.0])


def tent() -> Mesh:
    """Four triangles from a square's rim to a tip; charts turned and of different sizes."""
    rim = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0.1, -0.2, 0.8]], float)
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32)
    uv = np.array(
        [
            [[0.05, 0.05], [0.60, 0.05], [0.30, 0.35]],
            [[0.95, 0.10], [0.95, 0.60], [0.65, 0.30]],
            [[0.90, 0.95], [0.40, 0.95], [0.60, 0.60]],
            [[0.05, 0.95], [0.05, 0.45], [0.35, 0.70]],
        ]
    )
    return Mesh(rim + CENTER, faces, uv=uv)


def paint() -> np.ndarray:
    """Another colour at each place of the texture, linear."""
    row, col = np.mgrid[:SIZE, :SIZE] / SIZE
    return np.stack([0.1 + 0.6 * row, 0.1 + 0.6 * col, 0.2 + 0.3 * row * col], -1)


def camera(azimuth: float, elevation: float) -> Camera:
    a, e = np.radians([azimuth, elevation])
    back = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    R = np.stack([right, -np.cross(back, right), -back])
    return Camera(120, 96, 150.0, 150.0, 59.5, 47.5, R, -R @ (CENTER + 4 * back))


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> tuple[Path, Path]:
    """Project and result; its truth is the paint."""
    folder = tmp_path_factory.mktemp("tent")
    mesh, truth = tent(), folder / "ground_truth"
    (truth / "views").mkdir(parents=True)
    inside = np.zeros((SIZE, SIZE), bool)
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    inside[texels.row, texels.col] = True
    none = np.full(inside.shape, np.nan)
    look = Appearance(paint(), none, none, np.ones((SIZE, SIZE, 3)))
    renderer = AcquisitionRenderer(mesh, [look], [])
    write_ply(folder / "mesh.ply", mesh, dtype=np.float64)
    cameras = [camera(30.0 * k, 35.0 + 20 * (k % 2)) for k in range(12)]
    for place, name, seen in (
        (folder, "tent.mlp", cameras),
        (truth / "views", "project.mlp", [camera(17.0, 50.0)]),
    ):
        project = new_project()
        project.add_mesh("tent", folder / "mesh.ply")
        for k, eye in enumerate(seen):
            image, coverage = renderer.render(eye, 4)
            write_png(place / f"{k}.png", to_srgb8(image + 0.4 * (1 - coverage[..., None])))
            project.add_raster(f"{k}.png", place / f"{k}.png", eye)
        write_project(project, place / name)
    write_exr(truth / "diffuse_shaded.exr", paint())
    write_png(truth / "texel_mask.png", np.where(inside, 255, 0).astype(np.uint8))
    write_png(truth / "material_id.png", np.zeros((SIZE, SIZE), np.uint8))

    document = Document.open(folder / "tent.mlp", folder / "result")
    document.apply("compute_svbrdf_texels", texture_size=SIZE)
    document.apply("compute_svbrdf_samples")
    document.save()
    return folder / "tent.mlp", document.folder


def scored(scene: tuple[Path, Path], folder: Path, name: str):
    """The figures of a peer, and its diffuse map's error where the neighbours are on the chart."""
    project, result = scene
    scores = peer_scores(project, result, project.parent / "ground_truth", SIZE, folder, [name])
    found = read_exr(folder / name / "maps" / "diffuse.exr")
    inside = read_capture(project, result, SIZE).inside
    core = inside.copy()
    for axis in (0, 1):
        core &= np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    assert np.isnan(found[~inside]).all()
    return scores[name], (found - paint())[core]


@pytest.mark.parametrize("name", ["mean", "median"])
def test_statistics_give_the_paint_back(scene, tmp_path, name):
    figures, error = scored(scene, tmp_path, name)
    assert np.quantile(np.abs(error), 0.99) < 0.02
    assert np.median(np.abs(error)) < 0.003
    assert figures["coverage"] > 0.98
    assert figures["dE_mean"] < 0.5
    assert figures["psnr"] > 38
    assert figures["seconds"] > 0


def test_open3d_gives_the_paint_back(scene, tmp_path):
    pytest.importorskip("open3d", reason="Open3D does not import here", exc_type=ImportError)
    figures, error = scored(scene, tmp_path, "open3d")
    assert np.nanmedian(np.abs(error)) < 0.006
    assert figures["dE_mean"] < 1


def test_meshlab_gives_the_paint_back(scene, tmp_path):
    if sys.platform != "linux" or find_spec("PyQt5") is None or not shutil.which("xvfb-run"):
        pytest.skip("MeshLab's projection needs xvfb and Qt's plugins ([benchmark])")
    figures, error = scored(scene, tmp_path, "meshlab")
    assert np.nanmedian(np.abs(error)) < 0.006
    assert figures["dE_mean"] < 1


@pytest.mark.parametrize(
    ("size", "name", "message"),
    [(2 * SIZE, "mean", "--texture-size 128"), (SIZE, "guess", "no peer guess; there are mean")],
)
def test_what_cannot_be_compared_is_refused(scene, tmp_path, size, name, message):
    with pytest.raises(SvbrdfError, match=message):
        peer_scores(scene[0], scene[1], tmp_path, size, tmp_path, [name])


def _mitsuba_renders() -> bool:
    """In a process of its own: with an LLVM too old Mitsuba ends the process it runs in."""
    code = "from benchmarks.scenes import renderer as r; r.mi.render(r.mi.load_dict("
    code += "r.mi.cornell_box()), spp=1).numpy()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


@pytest.fixture(scope="module")
def inverse():
    pytest.importorskip("mitsuba", "3.9", reason="Mitsuba is not installed ([benchmark])")
    if not _mitsuba_renders():
        pytest.skip("Mitsuba does not render here (it needs LLVM 16 or newer)")
    from benchmarks.peers import mitsuba_inverse

    return mitsuba_inverse


def test_mitsuba_sees_through_the_same_camera(inverse):
    import mitsuba as mi

    eye = replace(camera(20.0, 40.0), cx=40.0, cy=61.0)
    points = CENTER + np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    seen = mi.Interaction3f()
    seen.p = mi.Point3f(points.T)
    sample, _ = inverse.unknown.sensor(eye).sample_direction(seen, mi.Point2f(0.5))
    np.testing.assert_allclose(np.array(sample.uv).T, eye.project(points)[:, :2] + 0.5, atol=1e-3)


def test_mitsuba_shows_its_own_diffuse_map(inverse, scene, tmp_path, monkeypatch):
    """Without gloss the view of its renderer and that of its map by ours are the same picture."""
    import mitsuba as mi

    from benchmarks.peers.scores import render_matte

    project, result = scene
    truth = project.parent / "ground_truth"
    capture = read_capture(project, result, SIZE)
    unknowns = inverse.Unknowns(capture, np.zeros((SIZE, SIZE), np.uint8))
    sky = np.random.default_rng(2).normal(0, 0.5, (*inverse.SKY, 3))
    unknowns.adam["albedo"] = mi.TensorXf(paint().astype(np.float32))
    unknowns.adam["rho_s"] = mi.Float([-20.0])
    unknowns.adam["sky"] = mi.TensorXf((sky - 1).astype(np.float32))
    unknowns.show()
    monkeypatch.setattr(inverse, "JUDGED", 144)
    unknowns.write(truth, tmp_path)
    render_matte(capture, tmp_path, truth, tmp_path / "matte")
    ours, theirs = (decode(read_image(tmp_path / k / "0.png") / 255) for k in ("matte", "views"))
    on = cv2.erode((theirs > 0).all(-1).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert theirs[on].max() < 1
    np.testing.assert_allclose(ours[on].mean(0), theirs[on].mean(0), rtol=0.01)
    for channel in range(3):
        assert np.corrcoef(ours[on][:, channel], theirs[on][:, channel])[0, 1] > 0.95
