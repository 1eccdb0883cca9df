"""How normals turn over a surface: spheres, cylinders, planes, and texels that stand alone."""

import numpy as np
import pytest
from analytic import ball, rotation

from meshlab_svbrdf.geometry.surface_shape import steepest_turn, surface_shape


def grid(count=30, step=0.02):
    x, y = np.meshgrid(np.arange(count) * step, np.arange(count) * step)
    return x.ravel(), y.ravel()


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3])
def test_a_sphere_turns_alike_in_all_tangent_directions(radius):
    """S = (1 − n nᵀ) / R."""
    texels = ball(4000)
    n = texels.normal.astype(float)
    shape = surface_shape(radius * texels.position, texels.normal)
    expected = (np.eye(3) - n[:, :, None] * n[:, None, :]) / radius
    # A chord's normals differ by a little towards the ball's centre as well
    np.testing.assert_allclose(shape, expected, atol=0.05 / radius)
    np.testing.assert_allclose(steepest_turn(shape), 1 / radius, rtol=0.01)


def test_a_cylinder_turns_across_its_axis_only():
    x, y = grid()
    n = np.column_stack([np.sin(x / 0.5), 0 * x, np.cos(x / 0.5)])
    position = np.column_stack([0.5 * n[:, 0], y, 0.5 * n[:, 2]])
    shape = surface_shape(position, n)
    np.testing.assert_allclose(steepest_turn(shape), 2, rtol=0.01)
    assert np.linalg.norm(shape @ [0, 1, 0], axis=1).max() < 0.05


def test_normals_tell_and_not_positions():
    """A flat mesh with baked normals of a dent."""
    x, y = grid()
    flat = np.column_stack([x, y, 0 * x])
    up = np.tile([0.0, 0, 1], (len(x), 1))
    assert not surface_shape(flat, up).any()
    n = np.column_stack([-0.2 * x, 0 * x, np.ones_like(x)])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    np.testing.assert_allclose(steepest_turn(surface_shape(flat, n)), 0.2, rtol=0.05)


def test_turning_the_world_turns_the_shape():
    texels, matrix = ball(500), rotation(np.random.default_rng(0))
    a = surface_shape(texels.position, texels.normal)
    b = surface_shape(texels.position @ matrix.T, texels.normal @ matrix.T)
    np.testing.assert_allclose(b, matrix @ a @ matrix.T, atol=1e-4)


def test_texels_alone_or_in_a_row_do_not_tell():
    row = np.column_stack([np.arange(9) * 0.1, np.zeros(9), np.zeros(9)])
    up = np.tile([0.0, 0, 1], (9, 1))
    assert np.isnan(surface_shape(row, up)).all()
    assert np.isinf(steepest_turn(surface_shape(row, up))).all()
    assert np.isnan(surface_shape(row[:1], up[:1])).all()
    assert len(surface_shape(row[:0], up[:0])) == 0
