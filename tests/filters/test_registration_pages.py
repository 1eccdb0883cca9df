"""Registration as filters: footage, starts, reports, rasters, about a core that knows the truth.

The core itself is tested in tests/registration; here it is one that answers from the film's truth,
so that what is told of frames, written and left out can be said exactly.
"""

import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from films import write_video
from scipy.spatial.transform import Rotation
from totems import WALK, edited, film, once

from meshlab_svbrdf.document.deep_images import read_values
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_frame, read_image, write_exr, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.document.registered import camera_from
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters import (
    _alignment,
    _lens_search,
    _starts,
    apply_svbrdf_raster_refinement,
    generate_svbrdf_rasters_from_cameras,
    generate_svbrdf_registered_rasters,
)
from meshlab_svbrdf.geometry.lens import Lens, with_coefficients
from meshlab_svbrdf.registration.refine import Refined
from meshlab_svbrdf.registration.results import FrameResult, Registration
from meshlab_svbrdf.registration.similarity import Similarity
from meshlab_svbrdf.samples.luminance import decode

TRACK = "generate_svbrdf_registered_rasters"
CAMERAS = "generate_svbrdf_rasters_from_cameras"
REFINE = "apply_svbrdf_raster_refinement"
USED = 12
BARREL = (-0.15, 0.02, 0.0, 0.0, 0.0)


class Core:
    """Answers with the truth; `results` has other answers, by frame."""

    def __init__(self, cameras):
        self.cameras = list(cameras)
        self.results = {}
        self.calls = []
        self.converged = True

    def register(self, vertices, faces, frames, start, options=None, progress=None):
        self.calls.append({"start": dict(start), "options": options, "count": len(frames)})
        for k in (0, len(frames) - 1):
            frames[k]
        offset = 0 if len(frames) <= len(self.cameras) else len(frames) - len(self.cameras)
        known = [c for _, c in sorted(start.items())][:offset] + self.cameras
        found = [
            self.results.get(
                k, FrameResult(known[k], "registered", "", 0.2 + k / 100, 90, 0.9, 0.3)
            )
            for k in range(len(frames))
        ]
        return Registration(found, [0])

    def refine(self, vertices, faces, image, camera, free_focal=False):
        self.calls.append({"refined": camera, "free_focal": free_focal})
        return Refined(self.cameras[0], 1.0, self.converged)

    def solve(self, points3d, points2d, size, focal=None):
        self.calls.append({"points": points2d, "focal": focal})
        return self.cameras[0]


@pytest.fixture
def rasters(tmp_path_factory):
    """The truth: frames and cameras of the first orbit's beginning."""
    project = read_project(film(tmp_path_factory, WALK))
    first = project.rasters[0].sequence
    return [r for r in project.rasters if r.sequence == first][:USED]


@pytest.fixture
def core(monkeypatch, rasters):
    made = Core([raster.camera for raster in rasters])
    for module in (generate_svbrdf_registered_rasters, apply_svbrdf_raster_refinement):
        monkeypatch.setattr(module, "register_frames", made.register)
    for module in (generate_svbrdf_rasters_from_cameras, apply_svbrdf_raster_refinement):
        monkeypatch.setattr(module, "refine_cameras", made.register)
    for name in ("refine_camera", "settle_camera"):
        monkeypatch.setattr(_starts, name, made.refine)
    monkeypatch.setattr(_starts, "solve_camera_from_points", made.solve)
    return made


@pytest.fixture
def folder(tmp_path, rasters):
    """The frames as images f0.png …, of which the project knows none."""
    folder = tmp_path / "walk"
    folder.mkdir()
    for k, raster in enumerate(rasters):
        write_png(folder / f"f{k}.png", read_frame(raster.path))
    return folder


@pytest.fixture
def movie(tmp_path_factory, rasters):
    def make(place):
        write_video(place / "walk.mp4", [read_frame(raster.path) for raster in rasters])

    return once(tmp_path_factory, "registration movie", make) / "walk.mp4"


@pytest.fixture
def project(tmp_path_factory, tmp_path):
    """The scan and its first raster, aligned."""
    source = film(tmp_path_factory, WALK)
    return edited(source, tmp_path / "in", lambda p: p.rasters.__setitem__(slice(1, None), []))


@pytest.fixture
def document(project, tmp_path):
    return Document.open(project, tmp_path / "out")


@pytest.fixture
def picked(tmp_path, rasters):
    """A file of points as the first camera sees them; lens : that it films through."""

    def write(frame="f0.png", count=6, lens=None):
        c = rasters[0].camera
        rng = np.random.default_rng(4)
        pixels = rng.uniform(0.1, 0.9, (count, 2)) * [c.width, c.height]
        rays = (pixels - [c.cx, c.cy]) / [c.fx, c.fy] if lens is None else lens.rays(pixels)
        depth = rng.uniform(0.8, 1.2, (count, 1))
        world = c.center + depth * np.c_[rays, np.ones(count)] @ c.R
        rows = np.hstack([world, pixels]).tolist()
        lines = [", ".join(map(repr, row)) for row in rows]
        path = tmp_path / "points.csv"
        path.write_text("\n".join([f"# frame: {frame}", *lines]))
        return path

    return write


def table(document, name="registration"):
    with (document.folder / f"{name}.csv").open() as stream:
        return list(csv.DictReader(stream))


def same(a, b):
    for name in vars(a):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, atol=1e-12)


# From one raster


def test_images_become_rasters_and_the_report_tells_all(document, core, folder, rasters):
    label = rasters[0].label
    outcome = document.apply(TRACK, images=folder, start=label)
    assert f"{USED} of {USED} frames registered, residual 0.2" in outcome.message
    assert f"start: raster '{label}'" in outcome.message
    assert list(core.calls[0]["start"]) == [0]
    same(core.calls[0]["start"][0], rasters[0].camera)
    added = document.rasters[1:]
    assert [raster.label for raster in added] == [f"f{k}.png" for k in range(USED)]
    for raster, true in zip(added, rasters, strict=True):
        same(raster.camera, true.camera)
        np.testing.assert_array_equal(read_frame(raster.path), read_frame(true.path))
    rows = table(document)
    assert [row["label"] for row in rows] == [raster.label for raster in added]
    assert rows[3]["residual"] == "0.23"
    assert rows[3]["inliers"] == "90"
    assert rows[3]["used"] == "1"
    told = document.json("registration")["clips"][0]["frames"]
    same(camera_from(told[5]["camera"]), rasters[5].camera)
    sheet = document.image("registration", "png")
    assert sheet.shape[1] > 4 * 320
    assert document.save() == document.path
    again = read_project(document.path)
    assert len(again.rasters) == USED + 1
    same(again.rasters[4].camera, rasters[3].camera)


def test_an_unchanged_registration_brings_its_rasters_again(
    project, tmp_path, core, folder, rasters
):
    given = {"images": folder, "start": rasters[0].label}
    for _ in range(2):  # the project that is read has not got them
        document = Document.open(project, tmp_path / "out")
        document.apply(TRACK, **given)
        document.save()
        assert len(document.rasters) == USED + 1
    assert len(core.calls) == 1
    document = Document.open(document.path)  # this one has
    assert document.apply(TRACK, **given).skipped
    assert len(document.rasters) == USED + 1
    assert not document.stale("registration")
    write_png(folder / "f3.png", read_frame(rasters[4].path))
    assert not Document.open(project, tmp_path / "out").apply(TRACK, **given).skipped


def test_steps_ranges_and_the_starts_frame(document, core, folder, rasters):
    document.apply(TRACK, images=folder, start=rasters[0].label, step=3, first=4, last=10)
    labels = [raster.label for raster in document.rasters[1:]]
    assert labels == ["f0.png", "f4.png", "f7.png", "f10.png"]
    assert list(core.calls[0]["start"]) == [0]


def test_frames_that_cannot_be_relied_on_are_named_and_left_out(document, core, folder, rasters):
    camera = rasters[0].camera
    core.results = {
        2: FrameResult(None, "unregistered", "too blurred"),
        4: FrameResult(camera, "registered", "", 3.0, 5, 0.1, 0.9),
        6: FrameResult(camera, "bridged", "blurred", confidence=0.6),
    }
    start = rasters[0].label
    said = document.apply(TRACK, images=folder, start=start).message
    assert f"{USED - 3} of {USED} frames" in said
    assert "f2.png (too blurred)" in said
    assert "f4.png (confidence 0.10 is below 0.3)" in said
    assert "f6.png (blurred)" in said
    labels = [raster.label for raster in document.rasters]
    assert not {"f2.png", "f4.png", "f6.png"} & set(labels)
    assert [row["used"] for row in table(document)] == [
        "0" if k in (2, 4, 6) else "1" for k in range(USED)
    ]
    document.apply(TRACK, images=folder, start=start, bridged=True, threshold=0.05)
    labels = [raster.label for raster in document.rasters]
    assert "f6.png" in labels
    assert "f4.png" in labels
    assert len(labels) == USED


def test_where_no_frame_is_registered_nothing_changes(document, core, folder, rasters):
    core.results = {k: FrameResult(None, "unregistered", "no texture") for k in range(USED)}
    with pytest.raises(SvbrdfError, match=r"none of 12 frames.*f0\.png: no texture"):
        document.apply(TRACK, images=folder, start=rasters[0].label)
    assert len(document.rasters) == 1
    assert not document.has("registration")


def test_a_filter_that_breaks_places_no_raster(document, core, folder, rasters, monkeypatch):
    def breaks(*_):
        raise RuntimeError("the power went out")

    monkeypatch.setattr(document, "set_text", breaks)
    with pytest.raises(RuntimeError, match="power"):
        document.apply(TRACK, images=folder, start=rasters[0].label)
    assert len(document.rasters) == 1
    monkeypatch.undo()


# Videos


def test_frames_of_a_video_are_rasters_without_extraction(document, core, movie, rasters):
    """The start is found by its picture: its file is an image, elsewhere."""
    said = document.apply(TRACK, video=movie, start=rasters[0].label).message
    assert f"{USED} of {USED}" in said
    assert list(core.calls[0]["start"]) == [0]
    assert document.rasters[4].label == "walk_000003.jpg"
    with Frames(document.rasters) as frames:
        np.testing.assert_array_equal(frames.read(document.rasters[4]), read_frame(rasters[3].path))
    document.apply(TRACK, video=[movie], start=rasters[0].label, step=4)
    assert [r.label for r in document.rasters[1:]] == [f"walk_{k:06d}.jpg" for k in (0, 4, 8)]


def test_a_video_without_a_start_begins_where_it_is_like_another(
    document, core, movie, folder, rasters, tmp_path
):
    second = write_video(tmp_path / "more.mp4", [read_frame(r.path) for r in rasters])
    said = document.apply(TRACK, video=f"{movie}; {second}", start=rasters[0].label).message
    assert f"{2 * USED} of {2 * USED}" in said
    assert "more.mp4 from the frames before it" in said
    assert not core.calls[1]["options"].ordered
    assert sorted(core.calls[2]["start"]) == list(range(USED))
    assert {raster.sequence for raster in document.rasters[1:]} == {"walk", "more"}


# Picked points and rough cameras


def test_picked_points_are_solved_and_refined(document, core, folder, picked, rasters):
    said = document.apply(
        TRACK, images=folder, points=picked("f1.png"), focal=rasters[0].camera.fx
    ).message
    assert "6 points" in said
    assert "refined" in said
    assert core.calls[0]["focal"] == rasters[0].camera.fx
    assert core.calls[1]["free_focal"] is False
    assert list(core.calls[2]["start"]) == [1]


def test_points_whose_refinement_fails_are_used_as_they_are_and_that_is_said(
    document, core, folder, picked
):
    core.converged = False
    said = document.apply(TRACK, images=folder, points=picked()).message
    assert "not refined: the frame does not show the mesh's lines there" in said
    assert "focal length" in said


def test_a_slipped_point_is_named(document, core, folder, picked):
    path = picked()
    lines = path.read_text().splitlines()
    x, y, z, column, row = map(float, lines[3].split(","))
    lines[3] = f"{x}, {y}, {z}, {max(column - 20, 0)}, {row}"
    path.write_text("\n".join(lines))
    with pytest.raises(SvbrdfError, match=r"point 3 is \d+ pixels from where"):
        document.apply(TRACK, images=folder, points=path)


def test_a_rough_camera_must_converge(document, core, folder, rasters, tmp_path):
    c = rasters[2].camera
    entry = {
        "image": "f2", "width": c.width, "height": c.height, "K": c.K.tolist(),
        "R": c.R.tolist(), "t": c.t.tolist(),
    }  # fmt: skip
    path = tmp_path / "rough.json"
    path.write_text(json.dumps({"cameras": [entry]}))
    said = document.apply(TRACK, images=folder, camera=path).message
    assert "rough.json: f2, refined" in said
    same(core.calls[0]["refined"], c)
    core.converged = False
    with pytest.raises(SvbrdfError, match="does not converge"):
        document.apply(TRACK, images=folder, camera=path, force=True)


# Lenses


def test_distorted_images_are_written_undistorted(document, core, folder, rasters):
    (folder.parent / "masks").mkdir()
    mask = np.zeros(read_frame(rasters[0].path).shape[:2], np.uint8)
    mask[:, 40:] = 255
    write_png(folder.parent / "masks" / "f1.png", mask)
    filmed = rasters[0].camera
    lens = with_coefficients(filmed, BARREL)
    core.cameras = [lens.pinhole(c.R, c.t) for c in core.cameras]
    document.apply(
        TRACK, images=folder, start=rasters[0].label, distortion="-0.15, 0.02"
    )  # fmt: skip
    raster = document.rasters[2]
    assert raster.path == document.folder / "undistorted" / "walk" / "f1.jpg"
    expected = lens.undistort(read_frame(rasters[1].path)).astype(int)
    assert np.abs(read_frame(raster.path).astype(int) - expected).mean() < 2
    assert raster.mask == document.folder / "undistorted" / "walk" / "masks" / "f1.png"
    assert set(np.unique(read_image(raster.mask))) == {0, 255}
    same(core.calls[0]["start"][0], lens.pinhole(filmed.R, filmed.t))
    document.save()
    assert read_project(document.path).rasters[2].path.is_file()


@pytest.mark.parametrize(("suffix", "write", "to"), [
    (".png", write_png, lambda codes: codes.astype(np.uint16) * 257),
    (".exr", write_exr, lambda codes: decode(codes / 255).astype(np.float32)),
])  # fmt: skip
def test_distorted_images_keep_all_their_bits(document, core, folder, rasters, suffix, write, to):
    for k, raster in enumerate(rasters):
        (folder / f"f{k}.png").unlink()
        write(folder / f"f{k}{suffix}", to(read_frame(raster.path)))
    lens = with_coefficients(rasters[0].camera, BARREL)
    core.cameras = [lens.pinhole(c.R, c.t) for c in core.cameras]
    document.apply(TRACK, images=folder, start=rasters[0].label, distortion="-0.15, 0.02")
    raster = document.rasters[2]
    assert raster.path == document.folder / "undistorted" / "walk" / f"f1{suffix}"
    expected = np.maximum(lens.undistort(to(read_frame(rasters[1].path))), 0)
    found = read_values(raster.path)
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)


def test_a_distorted_video_is_undistorted_when_it_is_read(document, core, movie, rasters):
    lens = with_coefficients(rasters[0].camera, BARREL)
    core.cameras = [lens.pinhole(c.R, c.t) for c in core.cameras]
    document.apply(TRACK, video=movie, start=rasters[0].label, distortion="-0.15 0.02")
    document.save()
    document = Document.open(document.path)
    raster = document.rasters[3]
    with Frames(document.rasters) as frames:
        np.testing.assert_array_equal(
            frames.read(raster), lens.undistort(read_frame(rasters[2].path))
        )
        stamp = frames.stamp(raster)
    document.apply(TRACK, video=movie, start=rasters[0].label, distortion="-0.1")
    with Frames(document.rasters) as frames:
        assert frames.stamp(document.rasters[3]) != stamp


def test_points_are_undistorted_with_the_frame(document, core, folder, picked, rasters):
    filmed = rasters[0].camera
    width, height, f = filmed.width, filmed.height, filmed.fx
    lens = Lens(width, height, f, f, (width - 1) / 2, (height - 1) / 2, BARREL)
    core.cameras = [lens.pinhole(c.R, c.t) for c in core.cameras]
    path = picked(lens=lens)
    document.apply(TRACK, images=folder, points=path, distortion="-0.15 0.02", focal=f)
    assert core.calls[0]["focal"] == pytest.approx(lens.pinhole().fx)


@pytest.mark.parametrize("true", [-0.2, 0.0, 0.11])
def test_distortion_is_estimated_by_the_least_residual(
    document, core, folder, rasters, monkeypatch, true
):
    def register(vertices, faces, frames, start, options=None, progress=None):
        k1 = frames.lenses[0].coefficients[0] if frames.lenses[0] else 0.0
        residual = 0.2 + 2 * abs(k1 - true)
        result = FrameResult(core.cameras[0], "registered", "", residual, 90, 0.9, 0.3)
        return Registration([result] * len(frames), [0])

    monkeypatch.setattr(_lens_search, "register_frames", register)
    said = document.apply(
        TRACK, images=folder, start=rasters[0].label, distortion="auto"
    ).message  # fmt: skip
    lens = document.json("registration")["clips"][0]["frames"][0]["lens"]
    assert lens["coefficients"][0] == pytest.approx(true, abs=0.03)
    assert f"distortion k1 {lens['coefficients'][0]:+.4f}" in said


def test_distortion_without_a_focal_length_is_not_estimated(document, core, folder, picked):
    with pytest.raises(SvbrdfError, match="auto needs the focal length"):
        document.apply(TRACK, images=folder, points=picked(), distortion="auto")


# What is refused


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "give the frames"),
        ({"images": "{folder}", "video": "{folder}/f0.png"}, "give the frames"),
        ({"images": "{folder}"}, "give a start"),
        ({"images": "{folder}", "start": "nobody"}, "no raster is labelled 'nobody'"),
        ({"images": "{folder}", "points": "{points}#"}, "cannot be read"),
        ({"images": "{folder}/none", "points": "{points}"}, "is no folder"),
        ({"video": "{folder}/f0.png", "points": "{points}"}, "is not a video"),
        ({"images": "{folder}", "points": "{points}", "first": 99}, "has the frames 0 to 11"),
        ({"images": "{folder}", "points": "{points}", "distortion": "1 x"}, "parameter distortion"),
        ({"images": "{folder}", "points": "{points}", "distortion": "-.1"}, "give focal"),
        (
            {"images": "{folder}", "points": "{points}", "distortion": "-9", "focal": 100},
            "fold the frame",
        ),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_happens(
    document, core, folder, picked, given, says
):
    names = {"folder": folder, "points": picked()}
    given = {k: v.format(**names) if isinstance(v, str) else v for k, v in given.items()}
    with pytest.raises(SvbrdfError, match=says):
        document.apply(TRACK, **given)
    assert len(document.rasters) == 1
    assert not document.has("registration")


@pytest.mark.parametrize(
    ("frame", "says"),
    [("f99.png", "no frame of the footage is called 'f99.png'"), ("77", "no frame")],
)
def test_points_of_no_frame_are_refused(document, core, folder, picked, frame, says):
    with pytest.raises(SvbrdfError, match=says):
        document.apply(TRACK, images=folder, points=picked(frame))


@pytest.mark.parametrize("frame", ["f1.png", "f1", "walk#1", "1", "C:\\films\\f1.png", "x/f1.jpg"])
def test_a_frame_is_known_by_many_names(document, core, folder, picked, frame):
    document.apply(TRACK, images=folder, points=picked(frame))
    assert list(core.calls[-1]["start"]) == [1]


def test_few_points_are_refused(document, core, folder, picked):
    with pytest.raises(SvbrdfError, match="holds 3 points, at least 4"):
        document.apply(TRACK, images=folder, points=picked(count=3))


def test_a_raster_that_is_not_aligned_or_not_of_the_footage_is_no_start(
    document, core, folder, rasters, tmp_path
):
    raster = document.project.rasters[0]
    true = raster.camera
    raster.camera = replace(true, t=np.zeros(3))
    with pytest.raises(SvbrdfError, match="not aligned"):
        document.apply(TRACK, images=folder, start=raster.label)
    raster.camera, raster.path = true, tmp_path / "other.png"
    noise = np.random.default_rng(1).integers(0, 256, (true.height, true.width, 3), np.uint8)
    write_png(raster.path, noise)
    with pytest.raises(SvbrdfError, match="is no frame of the footage"):
        document.apply(TRACK, images=folder, start=raster.label)


# Cameras of other programs

WORLD = Similarity(3.0, Rotation.from_rotvec([0.4, 1.0, -0.3]).as_matrix(), np.array([5.0, -2, 1]))


@pytest.fixture
def foreign(tmp_path, rasters):
    """The true cameras in another program's world, as a cameras.json."""

    def write(names=None, size=None):
        names = names or [f"images/f{k}.png" for k in range(USED)]
        entries = []
        for name, raster in zip(names, rasters, strict=False):
            c = WORLD.camera(raster.camera)
            entries.append({
                "image": name, "width": size or c.width, "height": c.height, "K": c.K.tolist(),
                "R": c.R.tolist(), "t": c.t.tolist(),
            })  # fmt: skip
        path = tmp_path / "cameras.json"
        path.write_text(json.dumps({"cameras": entries}))
        return path

    return write


@pytest.fixture
def pairs(tmp_path, document):
    corners = document.mesh().vertices[:: len(document.mesh().vertices) // 6]
    path = tmp_path / "pairs.txt"
    rows = np.hstack([WORLD.points(corners), corners]).tolist()
    path.write_text("# theirs, ours\n" + "\n".join(" ".join(map(repr, row)) for row in rows))
    return path


def test_cameras_are_brought_to_the_mesh_and_refined(document, core, foreign, folder, pairs):
    said = document.apply(CAMERAS, cameras=foreign(), images=folder, pairs=pairs).message
    assert "aligned by 7 pairs of points, 0.00 % of the radius off" in said
    start = core.calls[0]["start"]
    assert sorted(start) == list(range(USED))
    for k, camera in start.items():
        for name in vars(camera):
            np.testing.assert_allclose(
                getattr(camera, name), getattr(core.cameras[k], name), rtol=1e-7, atol=1e-7
            )
    assert len(document.rasters) == USED + 1


def test_cameras_can_be_taken_as_they_are(document, core, foreign, folder, pairs, rasters):
    names = [f"f{k}" for k in range(USED - 2)]
    said = document.apply(
        CAMERAS, cameras=foreign(names), images=folder, pairs=pairs, refine=False
    ).message
    assert f"{USED - 2} of {USED} frames" in said
    assert "f10.png (no camera in cameras.json)" in said
    assert not core.calls
    np.testing.assert_allclose(document.rasters[3].camera.R, rasters[2].camera.R, atol=1e-9)


def test_aligned_rasters_bring_them_too(tmp_path_factory, tmp_path, core, foreign, rasters):
    """Three rasters of the project show the same images, by their names."""
    source = film(tmp_path_factory, WALK)
    keep = {raster.label for raster in rasters[:3]}
    project = edited(
        source, tmp_path / "three",
        lambda p: p.rasters.__setitem__(slice(None), [r for r in p.rasters if r.label in keep]),
    )  # fmt: skip
    document = Document.open(project, tmp_path / "out3")
    names = [raster.path.name for raster in rasters]
    said = document.apply(
        CAMERAS, cameras=foreign(names), images=rasters[0].path.parent, refine=False
    ).message
    assert "aligned by 3 aligned rasters" in said
    found = {raster.label: raster.camera for raster in document.rasters}
    for raster in rasters:
        np.testing.assert_allclose(found[raster.path.name].t, raster.camera.t, atol=1e-7)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"images": "{folder}"}, "give the cameras"),
        ({"images": "{folder}", "cameras": "{cameras}"}, "nothing tells how its world lies"),
        ({"images": "{folder}", "cameras": "{cameras}", "align": "pairs"}, "needs pairs=FILE"),
        ({"images": "{folder}", "cameras": "{cameras}", "align": "points"}, "too few"),
        ({"images": "{folder}", "cameras": "{cameras}", "pairs": "{bad}"}, "line 1: expected x, y"),
    ],
)
def test_cameras_that_cannot_be_placed_are_refused(
    document, core, folder, foreign, tmp_path, given, says
):
    bad = tmp_path / "bad.txt"
    bad.write_text("1 2 3 4 5\n")
    names = {"folder": folder, "cameras": foreign(), "bad": bad}
    with pytest.raises(SvbrdfError, match=says):
        document.apply(CAMERAS, **{k: v.format(**names) for k, v in given.items()})
    assert len(document.rasters) == 1


def test_cameras_of_other_frames_are_refused(document, core, folder, foreign, pairs):
    with pytest.raises(SvbrdfError, match="none of 1 cameras is of a frame"):
        document.apply(CAMERAS, cameras=foreign(["x.png"]), images=folder, pairs=pairs)
    with pytest.raises(SvbrdfError, match="is of 999×"):
        document.apply(CAMERAS, cameras=foreign(size=999), images=folder, pairs=pairs)


def test_pairs_that_contradict_each_other_are_refused(pairs, tmp_path):
    source, target = _alignment.read_pairs(pairs)
    path = tmp_path / "mixed.txt"
    rows = np.hstack([source, target[::-1]]).tolist()
    path.write_text("\n".join(" ".join(map(repr, row)) for row in rows))
    assert [len(points) for points in _alignment.read_pairs(path)] == [7, 7]


# The project's own rasters


def test_rasters_are_refined_and_bad_ones_taken_out(tmp_path_factory, tmp_path, core, rasters):
    source = film(tmp_path_factory, WALK)
    keep = {raster.label for raster in rasters}

    def shake(project):
        project.rasters[:] = [r for r in project.rasters if r.label in keep]
        for raster in project.rasters:
            raster.camera = replace(raster.camera, t=raster.camera.t + 0.01)

    project = edited(source, tmp_path / "own", shake)
    core.results = {5: FrameResult(None, "unregistered", "moved by hand")}
    for _ in range(2):
        document = Document.open(project, tmp_path / "out")
        document.apply(REFINE)
        document.save()
        assert len(document.rasters) == USED - 1
        for raster, true in zip(document.rasters, rasters[:5], strict=False):
            same(raster.camera, true.camera)
    assert len(core.calls) == 1
    assert (
        f"{rasters[5].label} (moved by hand)" in document.results.record["runs"][REFINE]["message"]
    )
    assert not document.stale("refinement")


def test_rasters_that_are_not_aligned_are_registered_from_those_that_are(
    tmp_path_factory, tmp_path, core, rasters
):
    source = film(tmp_path_factory, WALK)
    keep = {raster.label for raster in rasters}

    def forget(project):
        project.rasters[:] = [r for r in project.rasters if r.label in keep]
        for raster in project.rasters[1:]:
            raster.camera = replace(raster.camera, R=np.diag([1.0, -1, -1]), t=np.zeros(3))

    document = Document.open(edited(source, tmp_path / "own", forget), tmp_path / "out")
    document.apply(REFINE)
    assert list(core.calls[0]["start"]) == [0]
    same(document.rasters[7].camera, rasters[7].camera)
    for raster in document.project.rasters:
        raster.camera = replace(raster.camera, t=np.zeros(3))
    with pytest.raises(SvbrdfError, match="align one in MeshLab"):
        document.apply(REFINE)


def test_the_contact_sheet_has_a_red_border_where_a_frame_is_left_out(
    document, core, folder, rasters
):
    core.results = {1: FrameResult(None, "unregistered", "blurred")}
    document.apply(TRACK, images=folder, start=rasters[0].label)
    sheet = document.image("registration", "png")
    assert (sheet[:, :, :3] == (230, 60, 50)).all(axis=2).any()
    assert (sheet[:, :, :3] == (70, 200, 90)).all(axis=2).any()
    assert cv2.cvtColor(sheet[..., :3], cv2.COLOR_RGB2GRAY).std() > 10
