"""The pinhole camera against OpenCV's, and far from the origin."""

import cv2
import numpy as np
import pytest
from analytic import look_at, rotation
from hypothesis import given, settings
from hypothesis import strategies as st

from meshlab_svbrdf.geometry.camera import Camera


def random_camera(rng, offset=0.0):
    R = rotation(rng)
    eye = rng.normal(size=3) + offset
    fx, fy = rng.uniform(200, 2000, 2)
    return Camera(640, 480, fx, fy, *rng.uniform(0, 640, 2), R, -R @ eye)


def points_before(camera, rng, count=50):
    inside = np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.uniform(0.5, 5, count)])
    return (inside - camera.t) @ camera.R


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_projects_like_opencv(seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    points = points_before(camera, rng)
    expected, _ = cv2.projectPoints(points, cv2.Rodrigues(camera.R)[0], camera.t, camera.K, None)
    np.testing.assert_allclose(camera.project(points)[:, :2], expected[:, 0], rtol=1e-9, atol=1e-7)


def test_depth_is_along_the_axis():
    rng = np.random.default_rng(0)
    camera = random_camera(rng)
    ahead = camera.center + np.array([[1.0], [2.5], [-1.0]]) * camera.R[2]
    projected = camera.project(ahead)
    np.testing.assert_allclose(projected[:, 2], [1, 2.5, -1], atol=1e-12)
    np.testing.assert_allclose(projected[:, 0], camera.cx, rtol=1e-9)
    np.testing.assert_allclose(projected[:, 1], camera.cy, rtol=1e-9)


def test_a_point_in_the_cameras_plane_gives_no_warning_and_no_number():
    camera = look_at([0, 0, 4])
    column, row, depth = camera.project(np.array([[0.0, 0, 4], [1, 0, 4]])).T
    assert not np.isfinite(column).any()
    assert not np.isfinite(row[0])
    np.testing.assert_array_equal(depth, 0)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_about_moves_the_world_not_the_image(offset):
    rng = np.random.default_rng(2)
    camera, origin = random_camera(rng, offset), np.full(3, offset) + rng.normal(size=3)
    points = points_before(camera, rng)
    near = camera.about(origin)
    np.testing.assert_allclose(
        near.project(points - origin), camera.project(points), rtol=1e-6, atol=2e-5
    )
    np.testing.assert_allclose(near.center, camera.center - origin, atol=1e-8)


def test_about_the_object_float32_is_enough_at_map_coordinates():
    rng = np.random.default_rng(3)
    origin = np.array([4.5e5, 5.4e6, 120.0])
    near = random_camera(rng)
    camera = Camera(640, 480, near.fx, near.fy, near.cx, near.cy, near.R, near.t - near.R @ origin)
    points = points_before(near, rng).astype(np.float32)
    again = camera.about(origin)
    pixels = (points @ again.R.astype(np.float32).T + again.t.astype(np.float32)) @ again.K.T
    np.testing.assert_allclose(
        pixels[:, :2] / pixels[:, 2:], near.project(points)[:, :2], atol=0.01
    )


def test_about_twice_is_about_the_sum():
    rng = np.random.default_rng(4)
    camera, a, b = random_camera(rng), rng.normal(size=3), rng.normal(size=3)
    np.testing.assert_allclose(camera.about(a).about(b).t, camera.about(a + b).t, atol=1e-12)
