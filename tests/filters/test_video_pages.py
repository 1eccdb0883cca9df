"""Films as video files: the chain sees the same frames, and MeshLab gets the images it wants."""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from films import write_video
from totems import SAMPLES, TEXELS, THRESHOLD, WALK, contents, film, once, run, sized

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame, write_png
from meshlab_svbrdf.document.project import Project, RasterEntry, read_project, write_project
from meshlab_svbrdf.errors import DocumentError, SvbrdfError

IMAGES = "generate_svbrdf_raster_images"
STORE = {"texture_size": 64}


def orbits(project: Project) -> dict[str, list[RasterEntry]]:
    """The frames of each orbit of the totem's film."""
    found: dict[str, list[RasterEntry]] = {}
    for raster in project.rasters:
        found.setdefault(raster.sequence, []).append(raster)
    return found


def write_projects(folder: Path, source: Path) -> None:
    """The same film twice: images.mlp with a PNG per frame, video.mlp with a video per orbit."""
    project = read_project(source)
    document = Document.open(source, folder / "video.mlp")
    document.project.rasters.clear()
    for name, rasters in orbits(project).items():
        pictures = [read_frame(raster.path) for raster in rasters]
        (folder / name).mkdir()
        for raster, picture in zip(rasters, pictures, strict=True):
            raster.path = folder / name / f"{raster.path.stem}.png"
            write_png(raster.path, picture)
        filler = np.zeros_like(pictures[0])  # the film is longer than what was registered
        write_video(folder / f"{name}.mp4", [filler, *pictures, filler])
        document.add_video(
            folder / f"{name}.mp4", {k + 1: raster.camera for k, raster in enumerate(rasters)}
        )
    write_project(project, folder / "images.mlp")
    document.save()


@pytest.fixture
def films(tmp_path_factory) -> Path:
    source = film(tmp_path_factory, WALK)
    return once(tmp_path_factory, "video", lambda folder: write_projects(folder, source))


@pytest.fixture
def video(films, tmp_path) -> Document:
    """With results of its own."""
    return Document.open(films / "video.mlp", tmp_path / "out")


def cut(films: Path, folder: Path, rasters: Sequence[int]) -> Document:
    """The film with a raster more: a frame that its video, which is cut off, does not have."""
    document = Document.open(films / "video.mlp", folder / "cut.mlp")
    document.apply(TEXELS, **STORE)
    path = document.folder / "frames/videos.json"
    written = json.loads(path.read_text())
    frames = written["videos"][0]["frames"]
    for k in rasters:
        frames[list(frames)[k]]["time"] += 1000.0
    path.write_text(json.dumps(written))
    return document


def test_a_video_gives_what_its_frames_as_images_give(films, video, tmp_path):
    images = Document.open(films / "images.mlp", tmp_path / "images")
    for document in (images, video):
        run(document, THRESHOLD, **sized(WALK))
    assert len(video.rasters) == len(images.rasters) == WALK.frames
    named = [
        name for name in contents(images.folder) if name.split("/")[0] in ("samples", "texels")
    ]
    assert len(named) > 8
    of_images, of_video = contents(images.folder), contents(video.folder)
    assert {name: of_video[name] for name in named} == {name: of_images[name] for name in named}
    assert np.isfinite(video.attribute("threshold")).mean() > 0.8

    frames = [document.json("frames") for document in (images, video)]
    for record in frames:
        for frame in record["frames"]:
            del frame["label"], frame["sequence"]
    steps = [record.pop("median_step_degrees") for record in frames]
    assert steps[0] == pytest.approx(steps[1], rel=1e-12)  # cameras are written in text
    assert frames[0] == frames[1]
    assert {raster.sequence for raster in video.rasters} == set(orbits(images.project))


def test_steps_and_held_out_frames_are_those_of_images(films, video, tmp_path):
    images = Document.open(films / "images.mlp", tmp_path / "images")
    for document in (images, video):
        document.hold_out()
        run(document, SAMPLES, **{TEXELS: STORE, SAMPLES: {"step": 3}})
    store = [document.result_folder("samples") / "store.json" for document in (images, video)]
    assert store[0].read_text() == store[1].read_text()


def test_videos_have_no_exif(video):
    video.apply(TEXELS, **STORE)
    with pytest.raises(DocumentError, match=r"frames without EXIF exposure: low_000001\.jpg"):
        video.apply(SAMPLES, exposure="exif")


def test_frames_that_the_video_has_not_are_named_or_skipped(films, tmp_path):
    document = cut(films, tmp_path, [2, 5])
    with pytest.raises(DocumentError, match=r"raster 'low_000003\.jpg': .*low\.mp4: has no frame"):
        document.apply(SAMPLES)
    outcome = document.apply(SAMPLES, unreadable="skip")
    assert "left out, unreadable: low_000003.jpg, low_000006.jpg" in outcome.message
    assert f"samples of {WALK.frames - 2} frames" in outcome.message


def test_a_video_that_is_not_there_is_told_once(films, tmp_path):
    document = cut(films, tmp_path, [])
    path = document.folder / "frames/videos.json"
    path.write_text(path.read_text().replace("high.mp4", "elsewhere.mp4"))
    frames = len(orbits(document.project)["high"])
    with pytest.raises(DocumentError) as caught:
        document.apply(SAMPLES)
    assert str(caught.value).startswith(f"{frames} of {WALK.frames} frames cannot be read (")
    assert str(caught.value).count("elsewhere.mp4: does not exist; put the video back") == 1


# Images for MeshLab


def extracted(document: Document) -> list[str]:
    return sorted(path.name for path in (document.folder / "frames").glob("*.jpg"))


def test_all_frames_become_the_images_that_the_rasters_name(video, films):
    assert "60 images, from 2 videos" in video.apply(IMAGES).message
    assert extracted(video) == sorted(raster.path.name for raster in video.project.rasters)
    for raster, source in zip(
        video.project.rasters, read_project(films / "images.mlp").rasters, strict=True
    ):
        picture = cv2.imread(str(raster.path))[..., ::-1].astype(int)
        assert np.abs(picture - read_frame(source.path)).mean() < 2
    assert video.apply(IMAGES).skipped
    again = Document.open(video.save())
    assert all(raster.path.is_file() for raster in again.rasters)


def test_some_are_chosen_by_labels_or_by_step(video):
    video.apply(IMAGES, labels="high_000004.jpg; low_000002.jpg")
    assert extracted(video) == ["high_000004.jpg", "low_000002.jpg"]
    video.apply(IMAGES, step=10)
    places = {
        raster.label: k for rs in orbits(video.project).values() for k, raster in enumerate(rs)
    }
    assert extracted(video) == sorted(label for label, k in places.items() if k % 10 == 0)
    with pytest.raises(SvbrdfError, match=r"labelled 'high_0004', did you mean high_0000\d4\.jpg"):
        video.apply(IMAGES, labels="high_0004")


def test_images_are_extracted_whole_or_not_at_all(films, tmp_path):
    document = cut(films, tmp_path, [7])
    document.apply(IMAGES, labels="high_000001.jpg")
    with pytest.raises(DocumentError, match=r"raster 'low_000008\.jpg': .*has no frame"):
        document.apply(IMAGES)
    assert extracted(document) == ["high_000001.jpg"]


def test_extracted_images_are_not_what_is_computed_from(video):
    run(video, SAMPLES, **{TEXELS: STORE, SAMPLES: {"step": 5}})
    before = contents(video.folder / "samples")
    video.apply(IMAGES)
    for raster in video.rasters:
        raster.path.write_bytes(b"no image")
    assert video.apply(SAMPLES, step=5).skipped
    video.apply(SAMPLES, step=5, force=True)
    assert contents(video.folder / "samples") == before


def test_a_project_without_videos_has_its_images(films, tmp_path):
    images = Document.open(films / "images.mlp", tmp_path / "images")
    with pytest.raises(SvbrdfError, match="no raster is a frame of a video"):
        images.apply(IMAGES)
