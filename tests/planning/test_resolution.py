"""Texels against pixels: spheres and squares of which both sizes are known."""

from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.planning.resolution import FILLED, Resolution, resolution


def square(side=2.0, fill=1.0) -> Mesh:
    """A square about the origin, charted as the lower left part of its texture."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    vertices = np.column_stack([(corners - 0.5) * side, np.zeros(4)])
    return Mesh(vertices, faces, uv=corners[faces] * np.sqrt(fill))


def at(distance, focal=800.0) -> Camera:
    return Camera(640, 480, focal, focal, 320.0, 240.0, np.eye(3), np.array([0, 0, distance]))


def test_a_square_seen_head_on():
    """2 wide, a pixel of 4/800: 400 texels; on a quarter of the texture, twice as many."""
    found = resolution(square(), [at(4.0)])
    assert found.pixel == pytest.approx(4 / 800)
    assert found.exact == pytest.approx(400)
    assert found.side == 512
    assert found.pixels_per_texel(512) == pytest.approx(400 / 512)
    quarter = resolution(square(fill=0.25), [at(4.0)])
    assert quarter.exact == pytest.approx(800)
    assert quarter.charts == pytest.approx(0.25)


@pytest.mark.parametrize("scale", [1e-3, 7.0, 1e4])
def test_units_do_not_matter(scale):
    mesh = square()
    moved = replace(mesh, vertices=mesh.vertices * scale)
    assert resolution(moved, [at(4.0 * scale)]).exact == pytest.approx(400)


def test_nearer_frames_show_more_and_a_few_far_ones_change_nothing():
    far = [at(d) for d in np.linspace(4.0, 9.0, 50)]
    assert resolution(square(), far).exact < 400
    assert resolution(square(), far + [at(2.0)] * 10).exact == pytest.approx(800)
    assert resolution(square(), [at(4.0)] * 20 + [at(50.0)] * 60).exact == pytest.approx(400)


def test_a_mesh_without_charts_is_taken_to_fill_most_of_its_texture():
    found = resolution(replace(square(), uv=None), [at(4.0)])
    assert found.exact == pytest.approx(400 / np.sqrt(FILLED))


def test_torn_coordinates_do_not_count():
    mesh = square()
    uv = mesh.uv.copy()
    uv[1] = np.nan
    assert np.isfinite(resolution(replace(mesh, uv=uv), [at(4.0)]).exact)


@pytest.mark.parametrize(
    ("exact", "side"), [(0.0, 16), (1.0, 16), (256.0, 256), (257.0, 512), (1e9, 16384)]
)
def test_sides_are_powers_of_two_that_lose_nothing(exact, side):
    assert Resolution(1.0, exact, 1.0, 640).side == side


@pytest.mark.parametrize(
    ("pixels", "width", "times"),
    [
        (0.7, 1920, 1), (1.7, 1920, 1), (1.9, 1920, 2), (3.7, 1920, 2), (3.7, 3840, 4),
        (3.7, 1279, 1), (9.0, 1280, 2), (9.0, 640, 1),
    ],
)  # fmt: skip
def test_frames_are_reduced_where_neither_texels_nor_frames_get_too_coarse(pixels, width, times):
    assert Resolution(1.0, 100 * pixels, 1.0, width).reduction(100) == times


def test_a_reduced_camera_sees_the_same():
    """Exactly half the pixels' coordinates, their centres at whole numbers in both."""
    camera, point = at(3.0), np.array([[0.1, -0.2, 0.3]])
    x, y, z = camera.project(point)[0]
    for times in (2, 4):
        u, v, w = camera.reduced(times).project(point)[0]
        assert (times * (u + 0.5) - 0.5, times * (v + 0.5) - 0.5) == pytest.approx((x, y))
        assert w == z
