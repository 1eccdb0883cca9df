"""Rasters that are frames of videos: names that MeshLab keeps, wherever the project goes."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from films import noise, write_video
from typer.testing import CliRunner

from meshlab_svbrdf.cli import app
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_frame, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.document.video_file import frame_times
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.meshset import MeshSet

TEXELS, SHADE = "compute_demo_texels", "compute_demo_shade"
PICTURES = noise(40)
USED = range(4, 40, 5)
LABELS = [f"walk_{k:06d}.jpg" for k in USED]

pytestmark = pytest.mark.usefixtures("demos")


def camera(k: int) -> Camera:
    return Camera(64, 48, 70.0, 200 / 3, 31.5, 23.5, np.eye(3), np.array([0.1 * k, 1 / 3, 9.0]))


@pytest.fixture
def video(tmp_path) -> Path:
    (tmp_path / "films").mkdir()
    return write_video(tmp_path / "films/walk.mp4", PICTURES)


@pytest.fixture
def project(small_project, video) -> Path:
    """Nine images and eight frames of a video."""
    document = Document.open(small_project)
    document.add_video(video, {k: camera(k) for k in USED})
    return document.save()


def of_video(document: Document) -> list:
    return [raster for raster in document.project.rasters if raster.label in LABELS]


def assert_frames(document: Document) -> None:
    """The project's rasters are the images and frames that were added."""
    rasters = document.project.rasters
    assert [raster.label for raster in rasters] == [f"f{k}.png" for k in range(9)] + LABELS
    with Frames(rasters) as frames:
        assert all(frames.problem(raster) == "" for raster in rasters)
        for k, raster in enumerate(rasters[:9]):
            np.testing.assert_array_equal(frames.read(raster), read_frame(raster.path))
            np.testing.assert_array_equal(frames.read(raster), np.uint8(20 * k))
        for k, raster in zip(USED, rasters[9:], strict=True):
            np.testing.assert_array_equal(frames.read(raster), PICTURES[k])
    assert {raster.sequence for raster in rasters[9:]} == {"walk"}
    assert not any(raster.path.exists() for raster in rasters[9:])


# What is written


def test_names_stand_for_frames_of_the_video(project, video):
    assert_frames(Document.open(project))
    written = json.loads((project.parent / "small.svbrdf/frames/videos.json").read_text())
    times = frame_times(video)
    assert written == {
        "format": 1,
        "videos": [
            {
                "file": "../../../films/walk.mp4",
                "frames": {f"walk_{k:06d}.jpg": {"index": k, "time": times[k]} for k in USED},
            }
        ],
    }
    planes = [line for line in project.read_text().splitlines() if "walk_" in line]
    assert sum("small.svbrdf/frames/walk_0000" in line for line in planes) == len(USED)
    assert "svbrdf_sequence" not in project.read_text()


def test_more_frames_and_videos_are_added(project, tmp_path):
    (tmp_path / "other").mkdir()
    other = write_video(tmp_path / "other/walk.mp4", PICTURES[::-1])
    document = Document.open(project)
    document.add_video(tmp_path / "films/walk.mp4", {0: camera(0)})
    added = document.add_video(other, {9: camera(9), 0: camera(0)}, exposure=1.5)
    assert [raster.label for raster in added] == ["walk-2_000000.jpg", "walk-2_000009.jpg"]
    document = Document.open(document.save())
    rasters = {raster.label: raster for raster in document.project.rasters}
    with Frames(document.rasters) as frames:
        for label, picture in (
            ("walk_000000.jpg", PICTURES[0]),
            ("walk_000004.jpg", PICTURES[4]),
            ("walk-2_000009.jpg", PICTURES[-10]),
        ):
            np.testing.assert_array_equal(frames.read(rasters[label]), picture)
    assert list(dict.fromkeys(r.sequence for r in rasters.values())) == ["frames", "walk", "walk-2"]
    assert rasters["walk-2_000009.jpg"].exposure == 1.5
    assert frames.exposure(rasters["walk-2_000009.jpg"]) is None


@pytest.mark.parametrize(
    ("indices", "message"),
    [
        ([40, 3], r"walk\.mp4: has the frames 0 to 39, cameras were given for \[40\]"),
        ([-1], r"cameras were given for \[-1\]"),
        ([], "cameras were given for none"),
        ([5, 9], r"a raster 'walk_000009\.jpg' exists already"),
    ],
)
def test_frames_that_cannot_be_added_change_nothing(project, video, indices, message):
    document = Document.open(project)
    before = (document.folder / "frames/videos.json").read_bytes()
    with pytest.raises(DocumentError, match=message):
        document.add_video(video, {k: camera(k) for k in indices})
    assert len(document.project.rasters) == 9 + len(USED)
    assert (document.folder / "frames/videos.json").read_bytes() == before


# Where the project goes


def test_a_project_saved_elsewhere_has_the_names_too(project, tmp_path):
    document = Document.open(project)
    there = document.save(tmp_path / "far/away/other.mlp")
    shutil.rmtree(project.with_suffix(".svbrdf"))
    assert_frames(Document.open(there))
    folder = tmp_path / "far/away/other.svbrdf/frames"
    assert {raster.path.parent for raster in of_video(Document.open(there))} == {folder}
    assert "../../../../films/walk.mp4" in (folder / "videos.json").read_text()


def test_results_elsewhere_have_the_names_too(project, tmp_path):
    before = project.read_bytes()
    document = Document.open(project, tmp_path / "out")
    document.apply(TEXELS)
    document.apply(SHADE)
    document.save()
    assert project.read_bytes() == before
    assert_frames(Document.open(project))
    shutil.rmtree(project.with_suffix(".svbrdf"))
    again = Document.open(tmp_path / "out/small.mlp")
    assert_frames(again)
    assert again.apply(SHADE).skipped


def test_project_and_video_move_together(project, tmp_path):
    (tmp_path / "moved").mkdir()
    for name in ("in", "films"):
        (tmp_path / name).rename(tmp_path / "moved" / name)
    assert_frames(Document.open(tmp_path / "moved/in/small.mlp"))


def test_a_folder_reached_by_a_link_is_the_same(project, video, tmp_path):
    os.symlink(tmp_path / "in", tmp_path / "link")
    document = Document.open(tmp_path / "link/small.mlp")
    assert_frames(document)
    (added,) = document.add_video(video, {0: camera(0)})
    assert added.label == "walk_000000.jpg"
    there = document.save(tmp_path / "link/there/other.mlp")
    shutil.rmtree(project.with_suffix(".svbrdf"))
    with Frames(Document.open(there).rasters) as frames:
        assert len(frames.videos) == len(USED) + 1
        np.testing.assert_array_equal(frames.read(added), PICTURES[0])


def test_a_video_that_went_elsewhere_is_named_anew(project, video, tmp_path):
    document = Document.open(project)
    document.apply(TEXELS)
    document.apply(SHADE)
    (tmp_path / "far").mkdir()
    video.rename(tmp_path / "far/walk.mp4")
    path = document.folder / "frames/videos.json"
    path.write_text(path.read_text().replace("../../../films/walk.mp4", f"{tmp_path}/far/walk.mp4"))
    again = Document.open(document.save())
    assert_frames(again)
    assert again.apply(SHADE).skipped


@pytest.mark.parametrize("name", ["small.mlp", "other.mlp"])
def test_meshlab_may_save_the_project(project, tmp_path, name):
    document = Document.open(project)
    document.apply(TEXELS)
    document.apply(SHADE)
    document.save()
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(project))
    meshes.save_project(str(project.with_name(name)))
    document = Document.open(project.with_name(name))
    assert_frames(document)
    assert document.apply(SHADE).skipped
    document.apply(SHADE, scale=2.0)
    assert_frames(Document.open(document.save()))


def test_the_meshset_takes_videos(small_project, video, tmp_path):
    meshes = MeshSet()
    meshes.load_project(small_project)
    meshes.add_video(video, {k: camera(k) for k in USED})
    assert_frames(meshes.document)
    meshes.compute_demo_texels()
    meshes.compute_demo_shade()
    meshes.save_project(tmp_path / "saved/object.mlp")
    assert_frames(meshes.document)
    del meshes
    saved = Document.open(tmp_path / "saved/object.mlp")
    assert_frames(saved)
    assert saved.apply(SHADE).skipped
    assert not small_project.with_suffix(".svbrdf").exists()


def test_projects_are_appended_with_their_videos(project, tmp_path, small_project_at):
    (tmp_path / "other").mkdir()
    other = write_video(tmp_path / "other/walk.mp4", PICTURES[::-1])
    document = Document.open(small_project_at(tmp_path / "second"))
    document.project.rasters.clear()
    for raster in document.add_video(other, {3: camera(3)}):
        raster.label = "mine"
    document.save()
    meshes = MeshSet()
    for path in (project, document.path):
        meshes.load_project(path)
    meshes.save_project(tmp_path / "both.mlp")
    rasters = {raster.label: raster for raster in Document.open(tmp_path / "both.mlp").rasters}
    with Frames(rasters.values()) as frames:
        np.testing.assert_array_equal(frames.read(rasters["mine"]), PICTURES[-4])
        np.testing.assert_array_equal(frames.read(rasters["walk_000004.jpg"]), PICTURES[4])
    assert rasters["mine"].sequence != rasters["walk_000004.jpg"].sequence


def test_masks_beside_the_names_are_found_and_follow(small_project, video, tmp_path):
    document = Document.open(small_project)
    folder = document.folder / "frames/masks"
    folder.mkdir(parents=True)
    write_png(folder / "walk_000004.png", np.full((48, 64), 255, np.uint8))
    document.add_video(video, {k: camera(k) for k in USED})
    there = Document.open(document.save(tmp_path / "there/other.mlp"))
    shutil.rmtree(small_project.with_suffix(".svbrdf"))
    masks = [raster.mask for raster in of_video(there)]
    assert masks == [there.folder / "frames/masks/walk_000004.png"] + [None] * (len(USED) - 1)
    assert "svbrdf_mask" not in there.path.read_text()


# Whether results belong to it


def test_results_belong_to_the_video_that_they_were_made_from(project, video):
    document = Document.open(project)
    document.apply(TEXELS)
    document.apply(SHADE)
    assert document.stale("shade") == ""
    aside = video.rename(video.with_suffix(".aside"))
    assert document.stale("shade") == ""
    aside.rename(video)
    (of_video(document)[0].path).write_bytes(b"an image that was extracted, or not")
    assert document.stale("shade") == ""
    write_video(video, PICTURES[::-1])
    assert document.stale("shade") == "rasters"


def test_another_frame_under_the_same_name_is_noticed(project):
    document = Document.open(project)
    document.apply(TEXELS)
    document.apply(SHADE)
    path = document.folder / "frames/videos.json"
    written = json.loads(path.read_text())
    written["videos"][0]["frames"]["walk_000004.jpg"] = {"index": 5, "time": 0.2}
    path.write_text(json.dumps(written))
    assert document.stale("shade") == "rasters"


def test_every_8th_frame_is_held_out_as_of_images(project):
    document = Document.open(project)
    document.hold_out()
    assert [raster.label for raster in document.held_out] == ["f3.png", LABELS[2]]


# What is wrong

TIMELESS = (
    '{"format": 1, "videos": [{"file": "a", "frames": {"a_0.jpg": {"index": 0, "time": NaN}}}]}'
)


def test_a_video_that_went_away_is_named(project, video):
    video.unlink()
    document = Document.open(project)
    with Frames(document.rasters) as frames:
        for raster in of_video(document):
            assert frames.problem(raster).startswith(f"{video}: does not exist; put the video back")
        with pytest.raises(
            DocumentError, match=rf"raster '{LABELS[0]}': .*walk\.mp4: does not exi"
        ):
            frames.read(of_video(document)[0])


def test_a_camera_of_another_size_is_named(project):
    document = Document.open(project)
    raster = of_video(document)[0]
    raster.camera = Camera(60, 48, 70, 70, 30, 24, np.eye(3), np.zeros(3))
    with (
        Frames([raster]) as frames,
        pytest.raises(DocumentError, match=r"walk\.mp4: has 64×48 pix"),
    ):
        frames.read(raster)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", TIMELESS, '{"format": 2}', '{"format": 1, "videos": [{}]}']
)
def test_damaged_names_are_told(project, text):
    (project.with_suffix(".svbrdf") / "frames/videos.json").write_text(text)
    with pytest.raises(DocumentError, match=r"videos\.json: does not tell which .* add the videos"):
        Frames(read_project(project).rasters)


def test_names_that_were_lost_are_told(project):
    (project.with_suffix(".svbrdf") / "frames/videos.json").unlink()
    document = Document.open(project)
    with Frames(document.rasters) as frames:
        (lost,) = {frames.problem(raster).partition(" ")[2] for raster in of_video(document)}
    assert lost == (
        "does not exist, and videos.json beside it does not say which frame of a video it is"
    )


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux to see open files")
def test_videos_are_closed(project, video):
    def is_open() -> bool:
        return video in {path.resolve() for path in Path("/proc/self/fd").iterdir()}

    rasters = of_video(Document.open(project))
    with Frames(rasters) as frames:
        frames.read(rasters[0])
        assert is_open()
    assert not is_open()
    frames = Frames(rasters)
    for raster in rasters:
        frames.read(raster)
    assert not is_open()  # all were read


def test_info_tells_of_videos(project, video):
    shell = CliRunner()
    lines = shell.invoke(app, ["info", str(project)]).stdout.splitlines()
    assert f"video    {video}: {len(USED)} of the rasters" in lines
    video.unlink()
    (told,) = json.loads(shell.invoke(app, ["info", str(project), "--json"]).stdout)["videos"]
    assert told["frames"] == len(USED)
    assert "does not exist" in told["problem"]
