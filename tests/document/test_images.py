"""Images: exact inverses, the raw pixel grid, and errors that name raster and file."""

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image

from meshlab_svbrdf.document.images import (
    read_exr,
    read_frame,
    read_image,
    read_mask,
    write_exr,
    write_png,
)
from meshlab_svbrdf.errors import DocumentError

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 1), (5, 7, 3), (5, 7, 4), (1, 1, 3)])
def test_png_comes_back_exactly(tmp_path, dtype, shape):
    array = RNG.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    write_png(tmp_path / "a.png", array)
    back = read_image(tmp_path / "a.png")
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, array[..., 0] if shape[2:] == (1,) else array)
    if dtype == np.uint8 and shape[2:] != (1,):  # Pillow reads the same channels in the same order
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), array)


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 1), (5, 7, 3)])
def test_exr_comes_back_exactly(tmp_path, shape):
    array = RNG.normal(size=shape).astype(np.float32) * np.float32(1e6)
    array.flat[:4] = [np.nan, np.inf, -0.0, 1e-40]
    write_exr(tmp_path / "a.exr", array)
    back = read_exr(tmp_path / "a.exr")
    expected = array[..., 0] if shape[2:] == (1,) else array
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back.view(np.uint32), expected.view(np.uint32))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert set(file.channels()) == ({"R", "G", "B"} if len(expected.shape) == 3 else {"Y"})


def test_exr_of_half_floats_and_with_alpha_is_read(tmp_path):
    rgba = RNG.random((4, 3, 4)).astype(np.float16)
    OpenEXR.File({}, {"RGBA": rgba}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr"), rgba[..., :3].astype(np.float32))


@pytest.mark.parametrize(
    ("write", "array"),
    [
        (write_png, np.zeros((4, 4))),
        (write_png, np.zeros((4, 4, 2), np.uint8)),
        (write_png, np.zeros((0, 4), np.uint8)),
        (write_exr, np.zeros((4, 4, 2))),
        (write_exr, np.zeros(4)),
    ],
)
def test_arrays_that_are_no_images_are_refused(tmp_path, write, array):
    with pytest.raises(ValueError, match="expects"):
        write(tmp_path / "a.png", array)
    assert not list(tmp_path.iterdir())


def test_frames_are_rgb_whatever_they_are_stored_as(tmp_path):
    rgb = RNG.integers(0, 256, (6, 9, 3), np.uint8)
    write_png(tmp_path / "rgb.png", rgb)
    write_png(tmp_path / "rgba.png", np.dstack([rgb, rgb[..., :1]]))
    write_png(tmp_path / "grey.png", rgb[..., 0])
    for name in ("rgb.png", "rgba.png"):
        np.testing.assert_array_equal(read_frame(tmp_path / name, size=(9, 6)), rgb)
    grey = read_frame(tmp_path / "grey.png")
    np.testing.assert_array_equal(grey, np.repeat(rgb[..., :1], 3, axis=2))


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_exif_orientation_is_ignored(tmp_path, orientation):
    rgb = np.zeros((16, 32, 3), np.uint8)
    rgb[:8, :16] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    for name in ("a.jpg", "a.png"):
        Image.fromarray(rgb).save(tmp_path / name, exif=exif)
        frame = read_frame(tmp_path / name, size=(32, 16))
        np.testing.assert_allclose(frame.astype(int), rgb, atol=8)
        np.testing.assert_array_equal(read_mask(tmp_path / name, size=(32, 16)), rgb[..., 0] > 127)


def test_frames_that_cannot_be_used_name_raster_and_file(tmp_path):
    rgb = RNG.integers(0, 256, (64, 64, 3), np.uint8)
    write_png(tmp_path / "deep.png", rgb.astype(np.uint16) * 257)
    write_png(tmp_path / "whole.png", rgb)
    cv2.imwrite(str(tmp_path / "whole.jpg"), rgb)
    for suffix in ("png", "jpg"):
        data = (tmp_path / f"whole.{suffix}").read_bytes()
        (tmp_path / f"cut.{suffix}").write_bytes(data[: len(data) // 2])
        (tmp_path / f"long.{suffix}").write_bytes(data + b"trailer")
        assert read_frame(tmp_path / f"long.{suffix}").shape == rgb.shape
    (tmp_path / "text.jpg").write_text("no image")
    (tmp_path / "empty.jpg").write_bytes(b"")
    for name, says in (
        ("none.jpg", "cannot be read"),
        ("text.jpg", "not an image"),
        ("empty.jpg", "not an image"),
        ("cut.jpg", "cut off"),
        ("cut.png", "cut off"),
        ("deep.png", "8-bit sRGB expected"),
        ("whole.png", "64×64 pixels, its camera's ViewportPx says 32×64"),
    ):
        with pytest.raises(DocumentError, match=says) as caught:
            read_frame(tmp_path / name, label="f007", size=(32, 64))
        assert "f007" in str(caught.value)
        assert name in str(caught.value)


def test_a_thumbnail_does_not_hide_that_a_jpeg_is_cut_off(tmp_path):
    rgb = RNG.integers(0, 256, (64, 64, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "thumb.jpg"), rgb[:8, :8])
    thumbnail = (tmp_path / "thumb.jpg").read_bytes()
    cv2.imwrite(str(tmp_path / "a.jpg"), rgb)
    data = (tmp_path / "a.jpg").read_bytes()
    segment = b"\xff\xe5" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    whole = data[:2] + segment + data[2:]
    (tmp_path / "b.jpg").write_bytes(whole)
    assert read_frame(tmp_path / "b.jpg").shape == rgb.shape
    (tmp_path / "b.jpg").write_bytes(whole[:-200])
    with pytest.raises(DocumentError, match="cut off"):
        read_frame(tmp_path / "b.jpg")


def test_masks_are_more_than_half_white(tmp_path):
    grey = np.array([[0, 127, 128, 255]], np.uint8)
    write_png(tmp_path / "m.png", grey)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), [[False, False, True, True]])
    write_png(tmp_path / "empty.png", grey * 0)
    assert not read_mask(tmp_path / "empty.png").any()
    write_png(tmp_path / "ones.png", grey // 255)
    with pytest.raises(DocumentError, match="largest value is 1, 255 expected"):
        read_mask(tmp_path / "ones.png")


def test_exr_files_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "a.exr").write_text("no image")
    OpenEXR.File({}, {"U": np.zeros((2, 2), np.float32), "V": np.zeros((2, 2), np.float32)}).write(
        str(tmp_path / "uv.exr")
    )
    for name, says in (("none", "not exist"), ("a", "cannot be read"), ("uv", "expected channels")):
        with pytest.raises(DocumentError, match=says) as caught:
            read_exr(tmp_path / f"{name}.exr")
        assert f"{name}.exr" in str(caught.value)


def test_a_write_that_fails_leaves_the_old_image(tmp_path, monkeypatch):
    write_png(tmp_path / "a.png", np.full((2, 2), 7, np.uint8))

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_png(tmp_path / "a.png", np.zeros((2, 2), np.uint8))
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert (read_image(tmp_path / "a.png") == 7).all()


def test_the_scenes_frames_masks_and_score_reader(tmp_path, monkeypatch):
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of scenes")
    scene = Path(scenes) / "goldcape"
    frame = read_frame(scene / "frames/IMG_5881.jpg", size=(1216, 1216))
    np.testing.assert_allclose(
        frame.astype(int), np.asarray(Image.open(scene / "frames/IMG_5881.jpg")), atol=3
    )
    mask = read_mask(scene / "masks/IMG_5881.png", size=(1216, 1216))
    assert 0.4 < mask.mean() < 0.6
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(scenes)
    import score

    for array in (RNG.random((3, 4)), RNG.random((3, 4, 3))):
        write_exr(tmp_path / "a.exr", array)
        np.testing.assert_array_equal(score.exr(tmp_path / "a.exr"), array.astype(np.float32))


@pytest.mark.parametrize("times", [2, 4])
@pytest.mark.parametrize("size", [(64, 48), (61, 47)])
def test_a_jpeg_is_read_at_the_size_that_others_are_reduced_to(tmp_path, times, size):
    col, row = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    image = (
        np.stack([60 + 2 * col, 200 - 2 * row, 90 + row + col], -1).clip(0, 255).astype(np.uint8)
    )
    cv2.imwrite(str(tmp_path / "a.jpg"), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])
    write_png(tmp_path / "a.png", image)
    jpeg = read_frame(tmp_path / "a.jpg", size=size, reduce=times)
    png = read_frame(tmp_path / "a.png", size=size, reduce=times)
    assert jpeg.shape == png.shape == (-(-size[1] // times), -(-size[0] // times), 3)
    inner = np.s_[: size[1] // times - 1, : size[0] // times - 1]
    assert np.abs(jpeg[inner].astype(int) - png[inner]).max() <= 4
    with pytest.raises(DocumentError, match="ViewportPx"):
        read_frame(tmp_path / "a.jpg", size=(size[0] + 9, size[1]), reduce=times)
