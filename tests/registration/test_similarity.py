"""Cameras from elsewhere brought to the mesh: exact pairs, and points of the object."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.registration.similarity import (
    Similarity,
    similarity_of_points,
    similarity_to_mesh,
)


def some(seed: int) -> Similarity:
    rng = np.random.default_rng(seed)
    return Similarity(
        float(rng.uniform(0.1, 9)), Rotation.random(random_state=seed).as_matrix(),
        rng.uniform(-20, 20, 3),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [3, 12])
def test_exact_pairs_give_the_similarity_back(seed, count):
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    found = similarity_of_points(points, some(seed).points(points))
    np.testing.assert_allclose(found.scale, some(seed).scale, rtol=1e-9)
    np.testing.assert_allclose(found.rotation, some(seed).rotation, atol=1e-9)
    np.testing.assert_allclose(found.translation, some(seed).translation, atol=1e-7)


def test_a_moved_camera_sees_the_moved_points_at_the_same_pixels():
    rng = np.random.default_rng(7)
    R = Rotation.random(random_state=7).as_matrix()
    camera = Camera(640, 480, 500.0, 510.0, 300.0, 250.0, R, np.array([0.1, 0.2, 5.0]))
    points = rng.uniform(-1, 1, (30, 3))
    before = camera.project(points)
    after = some(7).camera(camera).project(some(7).points(points))
    np.testing.assert_allclose(after[:, :2], before[:, :2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(after[:, 2], some(7).scale * before[:, 2])


@pytest.mark.parametrize(
    ("points", "says"),
    [(np.eye(3)[:2], "at least 3"), (np.outer(np.arange(5.0), [1, 2, 3]), "on a line")],
)
def test_pairs_that_determine_no_turn_are_refused(points, says):
    with pytest.raises(ValueError, match=says):
        similarity_of_points(points, points)


def shape(count: int, seed: int) -> np.ndarray:
    """Points of a lopsided surface."""
    u = np.random.default_rng(seed).normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    bump = 1 + 0.4 * u[:, :1] + 0.25 * np.cos(3 * u[:, 1:2]) + 0.3 * u[:, :1] * u[:, 2:]
    return u * bump * [3, 1.8, 1]


@pytest.mark.parametrize("seed", range(3))
def test_points_of_the_object_find_the_mesh(seed):
    there = some(seed)
    target = shape(20000, 1)
    inverse = similarity_of_points(there.points(target[:50]), target[:50])
    rng = np.random.default_rng(seed)
    points = inverse.points(shape(800, 2))
    stray = rng.uniform(points.min(0), points.max(0), (60, 3))
    found, rms = similarity_to_mesh(np.vstack([points, stray]), target)
    assert rms < 0.1
    np.testing.assert_allclose(found.points(points), there.points(points), rtol=0, atol=0.15)


def test_few_points_are_refused():
    with pytest.raises(ValueError, match="too few"):
        similarity_to_mesh(np.zeros((9, 3)), np.zeros((9, 3)))
