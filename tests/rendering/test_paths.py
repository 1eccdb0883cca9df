"""Camera paths: through their keys, closed where they go around, the same wherever the world is."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from analytic import look_at, orbit, rotation
from scipy.spatial.transform import Rotation, Slerp

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.rendering.paths import AIR, fitting, smooth_way, turntable, upward

UP = np.array([0, 1.0, 0])


def moved(camera: Camera, Q: np.ndarray, shift: np.ndarray) -> Camera:
    """The camera after the world went X → Q X + shift."""
    return replace(camera, R=camera.R @ Q.T, t=camera.t - camera.R @ Q.T @ shift)


def same(a: Camera, b: Camera) -> None:
    np.testing.assert_allclose(a.R, b.R, atol=1e-12)
    np.testing.assert_allclose(a.center, b.center, atol=1e-9)
    assert (a.width, a.height) == (b.width, b.height)
    np.testing.assert_allclose([a.fx, a.fy, a.cx, a.cy], [b.fx, b.fy, b.cx, b.cy], atol=1e-9)


@pytest.mark.parametrize("elevation", [-40.0, 0.0, 25.0])
def test_a_turntable_is_even_and_closes(elevation):
    """The same turn takes every frame to the next, and the last one to the first."""
    center = np.array([5.0, -3, 2])
    first = look_at((1.0, 0.4, 4.0))
    ring = turntable(first, center, 1.0, UP, 24, elevation)
    turn = Rotation.from_rotvec(2 * np.pi / 24 * UP).as_matrix()
    for here, there in zip(ring, [*ring[1:], ring[0]], strict=True):
        same(moved(here, turn, center - turn @ center), there)
    distance = [np.linalg.norm(camera.center - center) for camera in ring]
    np.testing.assert_allclose(distance, distance[0])
    seen = [camera.project(np.array([center, center + 0.1 * UP])) for camera in ring]
    for middle, above in seen:
        np.testing.assert_allclose(middle[:2], [(first.width - 1) / 2, (first.height - 1) / 2])
        assert above[1] < middle[1]
        assert above[0] == pytest.approx(middle[0])
    height = np.degrees(np.arcsin((ring[0].center - center) @ UP / distance[0]))
    assert height == pytest.approx(elevation)


def test_a_turntable_shows_the_whole_object_or_stands_where_it_is_told():
    first, center, radius = look_at((0, 0, 4)), np.array([0.1, 0.2, 0.3]), 1.7
    rng = np.random.default_rng(3)
    points = rng.standard_normal((5000, 3))
    points = center + radius * points / np.linalg.norm(points, axis=1, keepdims=True)
    for camera in turntable(first, center, radius, UP, 5):
        x, y, z = camera.project(points).T
        assert (z > 0).all()
        assert min(x.min(), y.min(), first.width - 1 - x.max(), first.height - 1 - y.max()) > 0
        assert max(np.ptp(x) / first.width, np.ptp(y) / first.height) > 0.8
    told = turntable(first, center, radius, UP, 3, distance=9.0)
    assert [np.linalg.norm(c.center - center) for c in told] == pytest.approx([9.0] * 3)
    above = turntable(replace(first, t=-first.R @ (center + 5 * UP)), center, radius, UP, 3)
    assert np.isfinite([camera.R for camera in above]).all()


@pytest.mark.parametrize("elevation", [-35.0, 0.0, 20.0, 75.0])
@pytest.mark.parametrize("shape", [(3.0, 0.2, 0.2), (0.2, 3.0, 0.3), (1.0, 1.0, 1.0)])
def test_a_fitting_turntable_just_shows_all(shape, elevation):
    """A tenth nearer, what was nearest to the border is on it."""
    first, center = look_at((0, 0, 4)), np.array([0.1, 0.2, 0.3])
    rng = np.random.default_rng(3)
    points = center + rng.standard_normal((200, 3)) * shape
    distance = fitting(first, center, points, UP, elevation)
    for share, inside in ((1.0, True), (1 / AIR, True), (0.99 / AIR, False)):
        ring = turntable(first, center, 1.0, UP, 720, elevation, share * distance)
        x, y, z = np.concatenate([camera.project(points) for camera in ring]).T
        fits = (np.abs(x - (first.width - 1) / 2) <= first.width / 2) & (z > 0)
        fits &= np.abs(y - (first.height - 1) / 2) <= first.height / 2
        assert fits.all() == inside


def test_up_is_the_axis_of_a_walk_however_far_down_the_cameras_look():
    rng = np.random.default_rng(0)
    for turns, climb in ((1.0, 100.0), (0.2, 60.0)):
        Q, shift = rotation(rng), rng.standard_normal(3)
        walk = [moved(camera, Q, shift) for camera in orbit(40, turns=turns, climb=climb)]
        np.testing.assert_allclose(upward(walk), Q @ UP, atol=1e-6)
    still = [look_at((0, 0, 4))] * 3
    np.testing.assert_allclose(upward(still), UP, atol=1e-9)


def test_a_way_passes_its_keys_at_equal_times():
    keys = [
        replace(camera, fx=300.0 + 10 * k, fy=300.0 + 10 * k)
        for k, camera in enumerate(orbit(7, climb=50))
    ]
    way = smooth_way(keys, 6 * 8 + 1)
    assert len(way) == 49
    for key, frame in zip(keys, way[::8], strict=True):
        same(key, frame)
    turns = [
        np.degrees((Rotation.from_matrix(b.R) * Rotation.from_matrix(a.R).inv()).magnitude())
        for a, b in pairwise(way)
    ]
    assert max(turns) < 1.3 * min(turns)  # no jerk at the keys


def test_between_two_keys_it_is_slerp_on_a_line():
    a, b = look_at((0, 0, 4)), look_at((3, 1, 2))
    way = smooth_way([a, b], 11)
    at = np.linspace(0, 1, 11)
    turned = Slerp([0, 1], Rotation.from_matrix([a.R, b.R]))(at).as_matrix()
    np.testing.assert_allclose([camera.R for camera in way], turned, atol=1e-9)
    line = a.center + at[:, None] * (b.center - a.center)
    np.testing.assert_allclose([camera.center for camera in way], line, atol=1e-9)


def test_a_way_around_stays_on_its_circle():
    keys = orbit(25, distance=4.0, climb=0.0)
    radius = [np.linalg.norm(camera.center) for camera in smooth_way(keys, 200)]
    np.testing.assert_allclose(radius, 4, atol=2e-3)


def test_paths_do_not_depend_on_where_the_world_is():
    rng = np.random.default_rng(1)
    Q, shift = rotation(rng), 100 * rng.standard_normal(3)
    keys = orbit(6, climb=40)
    there = [moved(key, Q, shift) for key in keys]
    for a, b in zip(smooth_way(keys, 20), smooth_way(there, 20), strict=True):
        same(moved(a, Q, shift), b)
    here = turntable(keys[0], np.zeros(3), 1.0, UP, 8)
    for a, b in zip(here, turntable(there[0], shift, 1.0, Q @ UP, 8), strict=True):
        same(moved(a, Q, shift), b)


def test_what_is_no_way_is_said():
    a = look_at((0, 0, 4))
    with pytest.raises(ValueError, match="two cameras or more, found 1"):
        smooth_way([a], 5)
    with pytest.raises(ValueError, match="have one size"):
        smooth_way([a, replace(a, width=a.width + 1)], 5)
