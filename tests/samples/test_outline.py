"""Outlines against edges: shifts that are known, other shapes, and what cannot be told."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import look_at, sphere

from meshlab_svbrdf.geometry.raster import rasterise_depth
from meshlab_svbrdf.samples.outline import REACH, outline_offset

MESH = sphere(24)
CAMERA = look_at([0, 0, 5], width=320, height=240, fx=330.0)


def depth(camera=CAMERA, stretch=(1, 1, 1)):
    return rasterise_depth(MESH.vertices * stretch, MESH.faces, camera)


@pytest.fixture
def picture():
    """The ball, textured and noisy, before a cluttered background: brighter here, darker there."""
    rng = np.random.default_rng(0)
    clutter = np.kron(rng.integers(40, 130, (24, 32)), np.ones((10, 10)))
    ball = 110 + 60 * np.sign(np.sin(np.arange(320) / 11))[None] + np.zeros((240, 1))
    image = np.where(depth() > 0, ball, clutter) + rng.normal(0, 3, (240, 320))
    return np.repeat(image.clip(0, 255).astype(np.uint8)[..., None], 3, 2)


@pytest.mark.parametrize(("x", "y"), [(0, 0), (20, 0), (-7, 5), (0, -28), (13, 21)])
def test_the_shift_of_the_cameras_is_found(picture, x, y):
    shifted = replace(CAMERA, cx=CAMERA.cx + x, cy=CAMERA.cy + y)
    found = outline_offset(depth(shifted), picture)
    np.testing.assert_allclose(found.shift, [-x, -y], atol=1)
    assert found.pixels == pytest.approx(np.hypot(x, y), abs=1)
    assert found.best > 0.35
    assert found.here <= found.best
    assert (found.here < 0.3) == (np.hypot(x, y) > 5)


def test_a_mask_serves_as_well(picture):
    shifted = replace(CAMERA, cx=CAMERA.cx + 15)
    found = outline_offset(depth(shifted), depth() > 0)
    np.testing.assert_array_equal(found.shift, [-15, 0])
    assert found.best > 0.85


def test_brightness_contrast_and_sign_do_not_matter(picture):
    a = outline_offset(depth(), picture)
    b = outline_offset(depth(), 255 - picture)
    np.testing.assert_array_equal(a.shift, b.shift)
    assert a.best == pytest.approx(b.best, abs=1e-6)


def test_another_shape_agrees_nowhere(picture):
    found = outline_offset(depth(stretch=(0.5, 1.4, 1)), picture)
    assert found.best < 0.3


def test_shifts_beyond_the_reach_do_not_agree(picture):
    far = replace(CAMERA, cx=CAMERA.cx + REACH * 320 + 25)
    assert outline_offset(depth(far), picture).best < 0.3


def test_without_an_outline_in_the_picture_nothing_is_said(picture):
    near, away = replace(CAMERA, fx=9000.0, fy=9000.0), look_at([0, 0, 5], [0, 0, 9], width=320,
                                                                height=240, fx=330.0)  # fmt: skip
    assert outline_offset(depth(near), picture) is None
    assert outline_offset(depth(away), picture) is None


def test_a_picture_without_edges_agrees_nowhere():
    found = outline_offset(depth(), np.full((240, 320, 3), 90, np.uint8))
    assert found.best == 0
