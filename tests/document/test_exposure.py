"""Exposure from EXIF: t·ISO/N², or None."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from meshlab_svbrdf.document.deep_images import read_values
from meshlab_svbrdf.document.exposure import read_exposure, told_exposure
from meshlab_svbrdf.errors import DocumentError

TIME, F_NUMBER, ISO = 33434, 33437, 34855


def photograph(path: Path, tags: dict) -> Path:
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    Image.new("RGB", (8, 8)).save(path, exif=exif)
    return path


def rational(a: int, b: int) -> IFDRational:
    return IFDRational(a, b)


@pytest.mark.parametrize(
    ("time", "f_number", "iso", "expected"),
    [
        (rational(1, 50), rational(5, 2), 800, 0.02 * 800 / 2.5**2),
        (rational(10, 1), rational(22, 1), 50, 10 * 50 / 22**2),
        (rational(1, 8000), rational(14, 10), (400, 0), 400 / 8000 / 1.4**2),
    ],
)
def test_relative_exposure(tmp_path, time, f_number, iso, expected):
    path = photograph(tmp_path / "a.jpg", {TIME: time, F_NUMBER: f_number, ISO: iso})
    assert read_exposure(path) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "broken",
    [
        {TIME: None},
        {F_NUMBER: None},
        {ISO: None},
        {TIME: rational(0, 1)},
        {TIME: rational(1, 0)},
        {TIME: rational(0, 0)},
        {F_NUMBER: rational(0, 0)},
        {F_NUMBER: rational(0, 1)},
        {F_NUMBER: 1e-200},
        {TIME: 1e200, F_NUMBER: 1e-120},
        {ISO: 0},
    ],
)
def test_missing_zero_and_undefined_tags_give_none(tmp_path, broken):
    tags = {TIME: rational(1, 50), F_NUMBER: rational(5, 2), ISO: 800} | broken
    path = photograph(tmp_path / "a.jpg", {k: v for k, v in tags.items() if v is not None})
    assert read_exposure(path) is None


def test_an_image_without_or_with_broken_exif_gives_none(tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png")
    assert read_exposure(tmp_path / "a.png") is None
    path = photograph(tmp_path / "a.jpg", {TIME: rational(1, 50), F_NUMBER: rational(5, 2), ISO: 8})
    whole = path.read_bytes()
    at = whole.index(b"Exif\0\0")
    for cut in range(8, 120, 7):
        # Zero the directory from here on, as a careless editor does
        path.write_bytes(
            whole[: at + cut] + bytes(len(whole[at + cut : at + 130])) + whole[at + 130 :]
        )
        assert read_exposure(path) is None or read_exposure(path) > 0


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (b"", None),
        (b"EXPOSURE=0.25\n", 0.25),
        (b"EXPOSURE= 2.0\nEXPOSURE=4\n", 8.0),  # a program adds its own line to the others'
        (b"EXPOSURE=2.0\nEXPOSURE=bright\n", None),
        (b"EXPOSURE=0\n", None),
    ],
)
def test_radiance_tells_what_its_pixels_are_multiplied_by(tmp_path, lines, expected):
    path = tmp_path / "a.hdr"
    cv2.imwrite(str(path), np.full((8, 8, 3), 0.5, np.float32))
    head, _, pixels = path.read_bytes().partition(b"\n\n")
    path.write_bytes(head + b"\n" + lines + b"\n" + pixels)
    assert told_exposure(path) == expected
    assert read_values(path)[0, 0, 0] == pytest.approx(0.5, rel=0.01)  # as they are stored


@pytest.mark.parametrize("lacking", [None, "expTime", "isoSpeed", "aperture"])
def test_openexr_tells_its_exposure_where_that_is_asked_for(tmp_path, lacking):
    tags = {"expTime": 0.5, "isoSpeed": 200.0, "aperture": 4.0}
    header = {key: value for key, value in tags.items() if key != lacking}
    path = tmp_path / "a.exr"
    OpenEXR.File(header, {"RGB": np.ones((8, 8, 3), np.float32)}).write(str(path))
    assert told_exposure(path) is None
    assert told_exposure(path, asked=True) == (None if lacking else 0.5 * 200 / 16)


def test_what_is_no_image_is_an_error(tmp_path):
    (tmp_path / "a.jpg").write_text("no image")
    for name in ("a.jpg", "none.jpg"):
        with pytest.raises(DocumentError, match=name):
            read_exposure(tmp_path / name)


def test_the_gold_capes_exposures():
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of scenes")
    scene = Path(scenes) / "goldcape"
    views = json.loads((scene / "cameras.json").read_text())["views"]
    found = np.array([read_exposure(scene / view["file"]) for view in views], float)
    expected = np.array([view["rel_exposure"] for view in views])
    np.testing.assert_allclose(found / np.median(found), expected / np.median(expected), rtol=1e-6)
