"""The workload: what it promises about its mesh, frames, cameras and truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf.bench.body import body
from meshlab_svbrdf.bench.scene import BenchScene
from meshlab_svbrdf.bench.walk import frame_camera, turn_of
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_exr, read_frame
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.raster import rasterise
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.uv_checks import check_uv
from meshlab_svbrdf.rendering.surface import _barycentric
from meshlab_svbrdf.samples.luminance import encode

TINY = Options(triangles=500, width=160, height=90, step=45.0, truth=64)


def test_body_is_closed_and_its_charts_do_not_overlap():
    mesh = body(500)
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).all()
    assert mesh.winding() == 1
    report = check_uv(mesh, ((512, 512),))
    assert report.overlap_share == 0
    assert report.flipped_faces == 0
    assert report.covered_share == pytest.approx(0.7, abs=0.02)
    assert np.einsum("ij,ij->i", mesh.vertex_normals(), mesh.vertices).min() > 0


@pytest.mark.parametrize("triangles", [12, 500, 200_000])
def test_triangles_and_texels(triangles):
    mesh = body(triangles)
    assert len(mesh.faces) == pytest.approx(
        triangles, rel=0.2 if triangles < 1000 else 0.01, abs=40
    )
    if triangles == 200_000:
        assert len(rasterise_texels(mesh, ((1024, 1024),))) >= 700_000


def test_object_lies_within_every_frame():
    scene = BenchScene(500)
    for index in range(0, 3382, 7):
        camera = frame_camera(index, 1920, 1080, scene.reach, 1.0)
        col, row, depth = camera.project(scene.mesh.vertices).T
        assert depth.min() > 0
        assert col.min() > 0
        assert col.max() < 1919
        assert row.min() > 0
        assert row.max() < 1079
        assert np.ptp(row) > 0.75 * 1080


def test_neighbouring_frames_are_about_a_degree_apart():
    eyes = np.array([frame_camera(k, 1920, 1080, 1.13, 1.0).center for k in range(3382)])
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    apart = np.degrees(np.arccos(np.clip((eyes[1:] * eyes[:-1]).sum(1), -1, 1)))
    same = np.array([turn_of(k, 1.0) == turn_of(k + 1, 1.0) for k in range(3381)])
    assert 0.5 < np.median(apart[same]) < 1.2
    assert apart[same].max() < 1.6


@pytest.mark.parametrize("format", ["jpeg", "png"])
def test_workload_is_made_once_and_equally(tmp_path, format):
    options = replace(TINY, format=format)
    first = make_workload(tmp_path / "a", 3, options)
    frames = [first.frame_path(k) for k in range(3)]
    made = [path.stat().st_mtime_ns for path in frames]
    longer = make_workload(tmp_path / "a", 9, options)
    assert longer.folder == first.folder
    assert [path.stat().st_mtime_ns for path in frames] == made
    other = make_workload(tmp_path / "b", 9, options)
    for k in range(9):
        assert longer.frame_path(k).read_bytes() == other.frame_path(k).read_bytes()
    project = read_project(longer.project)
    assert len(project.rasters) == 9
    assert len({raster.sequence for raster in project.rasters}) == 2
    assert len(read_project(longer.first(3)).rasters) == 3


def test_videos_show_the_frames_that_images_are_of(tmp_path):
    workload = make_workload(tmp_path, 9, replace(TINY, format="h264", noise=0.0))
    document = Document.open(workload.project)
    sequences = [raster.sequence for raster in document.rasters]
    assert len(set(sequences)) == 2
    with Frames(document.rasters) as frames:
        for index, raster in enumerate(document.rasters):
            error = frames.read(raster).astype(int) - workload.frame(index)
            assert np.abs(error).mean() < 3
    made = workload.video(0).stat().st_mtime_ns
    assert make_workload(tmp_path, 8, workload.options).video(0).stat().st_mtime_ns == made
    assert len(Document.open(workload.first(3)).rasters) == 3


def test_cameras_survive_the_project(tmp_path):
    workload = make_workload(tmp_path, 3, TINY)
    document = Document.open(workload.project)
    np.testing.assert_allclose(document.mesh().vertices, workload.scene.mesh.vertices, atol=1e-7)
    np.testing.assert_allclose(document.mesh().uv, workload.scene.mesh.uv, atol=1e-7)
    for k, raster in enumerate(document.rasters):
        ours = workload.camera(k)
        points = workload.scene.mesh.vertices
        np.testing.assert_allclose(raster.camera.project(points), ours.project(points), atol=1e-3)


def test_without_gloss_a_frame_shows_the_true_diffuse_colour():
    """The truth at the places behind the pixels is what the camera sees, to a code's rounding."""
    scene = BenchScene(500, noise=0.0)
    camera = frame_camera(0, 320, 180, scene.reach, 1.0)
    image = scene.frame(camera, 0, gloss=False)
    mesh = scene.mesh
    _, face_index = rasterise(mesh.vertices, mesh.faces, camera)
    row, col = np.nonzero(face_index >= 0)
    face = face_index[row, col]
    weights = np.empty((len(face), 3))
    points = mesh.vertices @ camera.R.T + camera.t
    _barycentric(
        points, mesh.faces, camera.fx, camera.fy, camera.cx, camera.cy, row, col, face, weights
    )
    some = rasterise_texels(mesh, ((16, 16),))
    D, kind = scene.truth(replace(some, face=face, barycentric=weights))
    assert set(kind) == {0, 1, 2}
    assert np.abs(image[row, col] - 255 * encode(D)).max() < 0.8


def test_gloss_only_adds_and_only_where_there_is_some():
    scene = BenchScene(500, noise=0.0)
    camera = frame_camera(3, 320, 180, scene.reach, 1.0)
    with_, without = (scene.frame(camera, 3, gloss=gloss).astype(int) for gloss in (True, False))
    assert (with_ >= without).all()
    assert (with_ > without + 20).any()


def test_truth_lies_beside_the_frames(tmp_path):
    workload = make_workload(tmp_path, 1, TINY)
    truth = read_exr(workload.folder / "ground_truth" / "diffuse_shaded.exr")
    texels = workload.texels(64)
    np.testing.assert_allclose(
        truth[texels.row, texels.col], workload.scene.truth(texels)[0], rtol=1e-6
    )
    views = read_project(workload.views())
    assert len(views.rasters) == 4
    frame = read_frame(views.rasters[0].path)
    assert frame.shape == (45, 80, 3)


def test_unknown_format_is_refused(tmp_path):
    with pytest.raises(SvbrdfError, match="expected one of jpeg, png, h264"):
        make_workload(tmp_path, 1, replace(TINY, format="tiff"))
