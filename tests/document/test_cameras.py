"""Cameras: MeshLab's attributes and OpenCV's convention say the same, to the last digit."""

import base64
import json
import os
from pathlib import Path
from xml.etree.ElementTree import Element

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.document.cameras import (
    decode_numbers,
    encode_numbers,
    read_camera,
    same_camera,
    write_camera,
)
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.camera import Camera

GOOD = {
    "CameraType": "0",
    "BinaryData": "0",
    "FocalMm": "11.340095237695319",
    "LensDistortion": "0 0",
    "PixelSizeMm": "0.01 0.0125",
    "ViewportPx": "640 480",
    "CenterPx": "333.25 201.75",
    "RotationMatrix": "0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1 ",
    "TranslationVector": "0.25 -0.5 -4 1",
}


def some_camera(seed: int, at: float = 1.0) -> Camera:
    rng = np.random.default_rng(seed)
    R = Rotation.random(rng=rng).as_matrix()
    fx, fy = rng.uniform(300, 5000, 2)
    center = at * rng.normal(size=3)
    return Camera(
        1920, 1080, fx, fy, rng.uniform(0, 1920), rng.uniform(0, 1080), R, -R @ center
    )  # fmt: skip


def meshlab_pixel(attributes: dict[str, str], X: np.ndarray) -> np.ndarray:
    """vcglib's Shot::Project by its formula, then from its pixels to ours; (N, 2)."""
    numbers = {n: np.array(v.split(), float) for n, v in attributes.items()}
    p = (X + numbers["TranslationVector"][:3]) @ numbers["RotationMatrix"].reshape(4, 4)[:3, :3].T
    z = -p[:, 2]
    x = numbers["FocalMm"] * p[:, 0] / (z * numbers["PixelSizeMm"][0]) + numbers["CenterPx"][0]
    y_up = numbers["FocalMm"] * p[:, 1] / (z * numbers["PixelSizeMm"][1]) + numbers["CenterPx"][1]
    return np.column_stack([x - 0.5, numbers["ViewportPx"][1] - y_up - 0.5])


def in_front(camera: Camera, count: int = 50) -> np.ndarray:
    rng = np.random.default_rng(5)
    seen = rng.uniform([-1, -1, 2], [1, 1, 6], (count, 3))
    return (seen - camera.t) @ camera.R


@pytest.mark.parametrize("seed", range(5))
def test_projection_agrees_with_meshlabs_formula_and_with_opencv(seed):
    camera, element = some_camera(seed), Element("VCGCamera")
    write_camera(element, camera)
    back = read_camera(element, "test")
    X = in_front(camera)
    expected, _ = cv2.projectPoints(X, camera.R, camera.t, camera.K, None)
    for pixels in (camera.project(X)[:, :2], back.project(X)[:, :2]):
        np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-8)
    np.testing.assert_allclose(meshlab_pixel(element.attrib, X), expected[:, 0], atol=1e-8)


def test_reads_off_centre_principal_points_and_oblong_pixels():
    camera = read_camera(Element("VCGCamera", GOOD), "test")
    assert (camera.cx, camera.cy) == (332.75, 480 - 201.75 - 0.5)
    assert (camera.fx, camera.fy) == (11.340095237695319 / 0.01, 11.340095237695319 / 0.0125)
    np.testing.assert_array_equal(camera.center, [-0.25, 0.5, 4])
    X = in_front(camera)
    np.testing.assert_allclose(camera.project(X)[:, :2], meshlab_pixel(GOOD, X), atol=1e-9)


@pytest.mark.parametrize("binary", [False, True])
@settings(deadline=None)
@given(seed=st.integers(0, 10**6), at=st.sampled_from([0.0, 1.0, 1e6]))
def test_writing_is_the_inverse_of_reading(binary, seed, at):
    camera, element = some_camera(seed, at), Element("VCGCamera")
    write_camera(element, camera, binary=binary)
    back = read_camera(element, "test")
    assert back.fx == camera.fx
    assert np.array_equal(back.R, camera.R)
    for name in ("fy", "cx", "cy"):
        assert abs(getattr(back, name) - getattr(camera, name)) <= 1e-12 * 5000
    np.testing.assert_allclose(back.t, camera.t, rtol=0, atol=1e-14 * max(at, 1))


def test_an_unchanged_camera_keeps_its_characters():
    element = Element("VCGCamera", GOOD)
    write_camera(element, read_camera(element, "test"))
    assert element.attrib == GOOD


def test_text_and_base64_say_the_same_camera_exactly():
    element = Element("VCGCamera", GOOD)
    camera = read_camera(element, "test")
    write_camera(element, camera, binary=True)
    assert element.get("BinaryData") == "1"
    assert element.get("FocalMm") != GOOD["FocalMm"]
    assert same_camera(read_camera(element, "test"), camera)
    write_camera(element, camera, binary=False)
    assert same_camera(read_camera(element, "test"), camera)


@settings(deadline=None)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=16))
def test_numbers_come_back_bit_by_bit(values):
    for binary in (False, True):
        text = encode_numbers(values, binary)
        back = decode_numbers(text, (len(values),), "test", binary=binary)
        assert np.array_equal(np.signbit(back), np.signbit(values))
        assert np.array_equal(back, values)


def test_base64_of_single_precision_is_told_by_its_length():
    values = np.array([1.5, -2.25, 3e-7], "<f4")
    text = base64.b64encode(values.tobytes()).decode()
    np.testing.assert_array_equal(decode_numbers(text, (3, 4), "test", binary=True), values)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("CameraType", "1", "perspective"),
        ("LensDistortion", "0.1 0", "undistort"),
        ("FocalMm", "0", "not calibrated"),
        ("FocalMm", "-3", "not calibrated"),
        ("FocalMm", "nan", "finite"),
        ("FocalMm", "abc", "expected 1 numbers"),
        ("FocalMm", None, "no FocalMm"),
        ("PixelSizeMm", "0.01", "expected 2 numbers"),
        ("PixelSizeMm", "0.01 0", "not calibrated"),
        ("ViewportPx", "640 0", "not calibrated"),
        ("ViewportPx", "640.5 480", "ViewportPx"),
        ("ViewportPx", "99999999999999999999 480", "expected 2 numbers"),
        ("ViewportPx", "4000000000 480", "more pixels"),
        ("ViewportPx", "-640 -480", "not calibrated"),
        ("CenterPx", "1 inf", "finite"),
        ("RotationMatrix", "1 0 0 0 0 1 0 0 0 0 1 0", "expected 16 numbers"),
        ("RotationMatrix", "1 0.1 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "not a rotation"),
        ("RotationMatrix", "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", "not a rotation"),
        ("RotationMatrix", "-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "not a rotation"),
        ("RotationMatrix", "1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1", "not a rotation"),
        ("TranslationVector", "1 2", "expected 3 or 4 numbers"),
        ("BinaryData", "1", "expected"),
    ],
)
def test_unusable_cameras_are_refused_and_named(name, value, says):
    attributes = {n: v for n, v in (GOOD | {name: value}).items() if v is not None}
    with pytest.raises(DocumentError, match=says) as caught:
        read_camera(Element("VCGCamera", attributes), "raster 'f007'")
    assert "raster 'f007'" in str(caught.value)


def test_an_unusable_camera_is_not_written():
    camera = some_camera(0)
    with pytest.raises(DocumentError, match="not a rotation"):
        write_camera(
            Element("VCGCamera"),
            Camera(9, 9, 1.0, 1.0, 4.0, 4.0, 2 * camera.R, camera.t),
        )


def test_cameras_of_the_scenes_agree_with_their_json():
    folder = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not folder:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of scenes")
    for scene, key in (("bust_floods", "frames"), ("goldcape", "views")):
        project = read_project(Path(folder) / scene / f"{scene}.mlp")
        views = json.loads((Path(folder) / scene / "cameras.json").read_text())[key]
        assert len(views) == len(project.rasters)
        for raster, view in zip(project.rasters, views, strict=True):
            np.testing.assert_allclose(raster.camera.K, view["K"], rtol=1e-14)
            np.testing.assert_allclose(raster.camera.R, view["R"], atol=1e-15)
            np.testing.assert_allclose(raster.camera.t, view["t"], atol=1e-13)
