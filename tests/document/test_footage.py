"""Footage: natural order, steps and ranges, the sharpest, and pixels in any order."""

import cv2
import numpy as np
import pytest
from films import noise, write_video
from PIL import Image

from meshlab_svbrdf.document import footage
from meshlab_svbrdf.document.focal_length import read_focal_length
from meshlab_svbrdf.document.footage import ClipFrames, open_images, open_video
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.lens import Lens

PICTURES = noise(60)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    times = np.cumsum(np.random.default_rng(3).integers(20, 90, len(PICTURES))).tolist()
    return write_video(tmp_path_factory.mktemp("films") / "walk.mp4", PICTURES, times)


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    for k in (10, 2, 1, 33):
        write_png(folder / f"f{k}.png", PICTURES[k])
    (folder / "notes.txt").write_text("no image")
    return folder


def test_images_come_in_natural_order(folder):
    clip = open_images(folder)
    assert clip.names == ["f1.png", "f2.png", "f10.png", "f33.png"]
    assert clip.size == (64, 48)
    assert not clip.is_video
    with ClipFrames(clip) as frames:
        np.testing.assert_array_equal(frames[2], PICTURES[10])
        with pytest.raises(IndexError):
            frames[4]


def test_a_video_is_named_by_its_frames(film):
    clip = open_video(film)
    assert clip.is_video
    assert len(clip) == 60
    assert clip.names[7] == "walk_000007.jpg"
    assert clip.size == (64, 48)


@pytest.mark.parametrize("order", [range(60), range(59, -1, -1), [5, 50, 4, 3, 51, 2, 59, 0]])
def test_frames_of_a_video_in_any_order(film, order):
    with ClipFrames(open_video(film)) as frames:
        for k in order:
            np.testing.assert_array_equal(frames[k], PICTURES[k])


def test_reading_backwards_decodes_blocks(film):
    """Of a video that is read backwards, frames are not decoded again for each one before."""
    with ClipFrames(open_video(film)) as frames:
        for k in range(59, -1, -1):
            frames[k]
        assert frames._reader is not None
        assert frames._reader.decoded < 3 * 60


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, list(range(60))),
        ({"step": 20}, [0, 20, 40]),
        ({"step": 10, "first": 15, "last": 40}, [15, 25, 35]),
        ({"step": 20, "always": [33, 0]}, [0, 20, 33, 40]),
    ],
)
def test_steps_and_ranges(film, given, expected):
    assert open_video(film).chosen(**given).indices == expected


def test_an_empty_range_is_refused(film):
    with pytest.raises(DocumentError, match="has the frames 0 to 59"):
        open_video(film).chosen(first=60)


def test_the_sharpest_of_each_window(tmp_path):
    sharp = {1, 5, 6, 11}
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(12):
        image = PICTURES[0] if k in sharp else cv2.GaussianBlur(PICTURES[0], (0, 0), 1 + k / 9)
        write_png(folder / f"{k}.png", image)
    assert open_images(folder).chosen(4, sharpest=True).indices == [1, 5, 11]
    assert open_images(folder).chosen(1, sharpest=True).indices == list(range(12))


def test_frames_are_undistorted(folder):
    lens = Lens(64, 48, 60.0, 60.0, 31.5, 23.5, (-0.2, 0.0, 0.0, 0.0, 0.0))
    with ClipFrames(open_images(folder), [lens, None, None, None]) as frames:
        np.testing.assert_array_equal(frames[0], lens.undistort(PICTURES[1]))
        np.testing.assert_array_equal(frames[1], PICTURES[2])
        np.testing.assert_array_equal(frames.raw(0), PICTURES[1])


def test_folders_that_are_none(tmp_path, folder):
    with pytest.raises(DocumentError, match="is no folder"):
        open_images(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DocumentError, match="holds no images"):
        open_images(tmp_path / "empty")
    write_png(folder / "f5.png", PICTURES[0][:40])
    with pytest.raises(DocumentError, match=r"f5\.png: has 64×40 pixels, f1\.png has 64×48"):
        open_images(folder)
    (folder / "f5.png").write_bytes(b"no image")
    with pytest.raises(DocumentError, match=r"f5\.png: cannot be read"):
        open_images(folder)


def test_natural_order():
    names = ["f2", "F10", "f1b", "a9", "10", "9"]
    assert sorted(names, key=footage.natural) == ["9", "10", "a9", "f1b", "f2", "F10"]


# EXIF


def photograph(path, **tags):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags.get("ifd", {}))
    Image.new("RGB", (400, 300)).save(path, exif=exif)
    return path


@pytest.mark.parametrize(
    ("ifd", "pixels"),
    [
        ({0xA405: 50}, 50 / np.hypot(36, 24) * 500),
        ({0x920A: 5.0, 0xA20E: 1000.0, 0xA210: 3, 0xA002: 4000, 0xA003: 3000}, 50.0),
        ({0x920A: 5.0}, None),
        ({0xA405: 0}, None),
        ({}, None),
    ],
)
def test_the_focal_length_that_exif_tells(tmp_path, ifd, pixels):
    found = read_focal_length(photograph(tmp_path / "p.jpg", ifd=ifd))
    assert found == (None if pixels is None else pytest.approx(pixels, rel=1e-6))


def test_a_focal_length_of_no_image(tmp_path):
    with pytest.raises(DocumentError, match="cannot be read"):
        read_focal_length(tmp_path / "none.jpg")
