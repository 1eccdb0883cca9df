"""Lenses: OpenCV's model to the last digit, its inverse, and frames undistorted."""

import cv2
import numpy as np
import pytest

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.lens import Lens, with_coefficients

LENSES = [
    (-0.28, 0.09, 0.001, -0.0008, -0.01),
    (0.15, -0.05, -0.001, 0.002, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0),
]


def lens(k, width=320, height=240) -> Lens:
    return Lens(width, height, 300.0, 306.0, 155.0, 124.0, k)


@pytest.mark.parametrize("k", LENSES)
def test_the_model_is_opencvs(k):
    rays = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2))
    points = np.c_[rays, np.ones(50)] * 3
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens(k).K, np.array(k))
    np.testing.assert_allclose(lens(k).distort(rays), expected[:, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("k", LENSES)
def test_rays_are_the_inverse(k):
    pixels = np.random.default_rng(2).uniform(0, 1, (60, 2)) * [319, 239]
    np.testing.assert_allclose(lens(k).distort(lens(k).rays(pixels)), pixels, rtol=0, atol=1e-9)
    assert lens(k).rays(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("k", LENSES)
def test_every_pixel_of_the_undistorted_frame_was_filmed(k):
    camera = lens(k).pinhole()
    cols, rows = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = np.c_[cols.ravel() - camera.cx, rows.ravel() - camera.cy] / [camera.fx, camera.fy]
    at = lens(k).distort(rays)
    assert (at > -1e-6).all()
    assert (at < [319 + 1e-6, 239 + 1e-6]).all()
    assert camera.fx >= 300


def test_a_point_is_seen_where_its_undistorted_pixel_lies():
    made = lens(LENSES[0])
    R, _ = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))
    camera = made.pinhole(R, np.array([0.1, 0.2, 4.0]))
    points = np.random.default_rng(3).uniform(-0.8, 0.8, (40, 3))
    in_camera = points @ camera.R.T + camera.t
    filmed = made.distort(in_camera[:, :2] / in_camera[:, 2:])
    np.testing.assert_allclose(
        made.undistort_points(filmed), camera.project(points)[:, :2], rtol=0, atol=1e-7
    )


def test_a_grid_filmed_through_the_lens_is_straight_again():
    """Each pixel of the filmed frame is the smooth pattern in the direction it looks to."""
    made = lens(LENSES[0])

    def pattern(rays):
        return (127 + 60 * np.sin(12 * rays[:, 0]) + 60 * np.cos(9 * rays[:, 1])).astype(np.float32)

    cols, rows = np.meshgrid(np.arange(320.0), np.arange(240.0))
    pixels = np.c_[cols.ravel(), rows.ravel()]
    filmed = np.rint(pattern(made.rays(pixels))).reshape(240, 320).astype(np.uint8)
    camera = made.pinhole()
    rays = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    straight = made.undistort(filmed).astype(float)
    assert np.abs(straight - pattern(rays).reshape(240, 320)).max() < 2.5


def test_without_distortion_nothing_changes():
    image = np.random.default_rng(4).integers(0, 256, (240, 320, 3), np.uint8)
    made = lens((0.0,) * 5)
    assert not made.distorts
    np.testing.assert_array_equal(made.undistort(image), image)


def test_coefficients_that_fold_the_frame_are_refused():
    with pytest.raises(ValueError, match="fold the frame"):
        lens((-3.0, 0.0, 0.0, 0.0, 0.0)).pinhole()


def test_few_coefficients_are_completed():
    camera = Camera(320, 240, 300.0, 306.0, 155.0, 124.0, np.eye(3), np.zeros(3))
    assert with_coefficients(camera, [-0.28, 0.09]) == lens((-0.28, 0.09, 0.0, 0.0, 0.0))
