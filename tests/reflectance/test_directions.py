"""Maps of directions: pixel and direction are inverses, and angles add up to the sphere."""

import numpy as np
import pytest
from analytic import unit
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance.directions import (
    directions,
    look_up,
    octahedral_cell,
    octahedral_directions,
    pixel,
    solid_angles,
)

UNIT = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3).map(unit)


@pytest.mark.parametrize("height", [1, 2, 7, 64, 128])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_pixel_inverts_directions(height, dtype):
    d = directions(height).astype(dtype)
    found = [[pixel(*ray, height) for ray in row] for row in d]
    row, col = np.meshgrid(np.arange(height), np.arange(2 * height), indexing="ij")
    np.testing.assert_array_equal(found, np.stack([row, col], -1))


@pytest.mark.parametrize("size", [1, 2, 5, 32, 64])
def test_cell_inverts_octahedral_directions(size):
    d = octahedral_directions(size)
    found = [[octahedral_cell(*ray, size) for ray in row] for row in d]
    row, col = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    np.testing.assert_array_equal(found, np.stack([row, col], -1))
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1)


def test_convention_is_the_files():
    """The pole is +Y; φ runs from −z over +x."""
    d = directions(64)
    assert d[0, :, 1].min() > 0.999
    assert d[-1, :, 1].max() < -0.999
    for axis, (row, col) in {
        (0, 0, -1): (32, 0), (1, 0, 0): (32, 32), (0, 0, 1): (32, 64), (-1, 0, 0): (32, 96),
    }.items():  # fmt: skip
        assert pixel(*map(float, axis), 64) == (row, col)
        assert d[row, col] @ axis > 0.998


@given(UNIT)
def test_any_direction_is_near_its_pixel(d):
    row, col = pixel(*d, 64)
    assert 0 <= row < 64
    assert 0 <= col < 128
    assert directions(64)[row, col] @ d > np.cos(np.pi / 64 / np.sqrt(2) * 1.001)


@given(UNIT)
def test_any_direction_is_near_its_octahedral_cell(d):
    row, col = octahedral_cell(*d, 64)
    assert octahedral_directions(64)[row, col] @ d > np.cos(3 * np.sqrt(2) / 64)


@pytest.mark.parametrize(
    "d", [(0, 1, 0), (0, -1, 0), (-0.0, 0, -1), (0.0, 0, -1), (-1e-30, 0, -1), (0, 1 + 1e-7, 0),
          (0, 0, 1), (1, 0, -0.0), (-1, -0.0, 0), (1, 1e-300, -1e-300)],
)  # fmt: skip
def test_poles_seam_and_rounding_stay_inside(d):
    row, col = pixel(*map(float, d), 128)
    assert 0 <= row < 128
    assert 0 <= col < 256
    row, col = octahedral_cell(*map(float, d), 128)
    assert 0 <= row < 128
    assert 0 <= col < 128


@pytest.mark.parametrize("height", [1, 3, 128])
def test_solid_angles_fill_the_sphere(height):
    assert solid_angles(height).sum() == pytest.approx(4 * np.pi)
    assert solid_angles(height).shape == (height, 2 * height)
    assert (solid_angles(height) > 0).all()


def test_directions_weighted_by_solid_angle_balance_and_have_unit_moments():
    d, w = directions(128), solid_angles(128)
    np.testing.assert_allclose(np.einsum("ij,ijc->c", w, d), 0, atol=1e-12)
    np.testing.assert_allclose(
        np.einsum("ij,ijc,ijd->cd", w, d, d), 4 * np.pi / 3 * np.eye(3), atol=2e-3
    )


def test_look_up_returns_the_pixel():
    values = np.random.default_rng(0).random((32, 64))
    np.testing.assert_array_equal(look_up(values, directions(32).reshape(-1, 3)), values.ravel())


def test_look_up_of_no_direction_is_no_value():
    values = np.ones((32, 64))
    rays = np.array([[np.nan, 0, 0], [0, np.nan, 0], [0, 0, np.nan], [np.inf] * 3, [0, 1, 0]])
    np.testing.assert_array_equal(np.isnan(look_up(values, rays)), [1, 1, 1, 1, 0])
    assert look_up(values, np.zeros((0, 3))).shape == (0,)
