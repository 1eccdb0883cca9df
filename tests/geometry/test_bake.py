"""Baked normals against analytic surfaces, thin walls and themselves."""

import numpy as np
import pytest

from meshlab_svbrdf.geometry.bake import bake_normals
from meshlab_svbrdf.geometry.mesh import Mesh

UP = np.array([0, 0, 1.0])


def ball(n, m, radius=1.0):
    """A sphere of latitudes and longitudes, with its exact normals."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, m), indexing="ij")
    r = np.sin(theta)
    v = np.stack([r * np.cos(phi), r * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    i = np.arange(n * m).reshape(n, m)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    return Mesh(v * radius, faces, v)


def points_on(mesh, count, seed=0):
    rng = np.random.default_rng(seed)
    corner = mesh.vertices[mesh.faces]
    area = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    face = rng.choice(len(area), count, p=area / area.sum())
    barycentric = rng.dirichlet([1, 1, 1], count)
    position = np.einsum("ij,ijk->ik", barycentric, corner[face])
    normal = np.einsum("ij,ijk->ik", barycentric, mesh.vertex_normals()[mesh.faces[face]])
    return position, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def plane(z, normal=UP):
    v = np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]], float)
    return Mesh(
        v, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.tile(np.asarray(normal, float), (4, 1))
    )


def join(*meshes):
    return Mesh(
        np.vstack([m.vertices for m in meshes]),
        np.vstack([m.faces + 4 * i for i, m in enumerate(meshes)]),
        np.vstack([m.normals for m in meshes]),
    )


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_a_coarse_ball_gets_the_fine_ones_normals(shift):
    """Where the ray p + s n meets the unit sphere, the normal is that point itself."""
    position, normal = points_on(ball(9, 17), 3000)
    fine = ball(257, 513)
    fine = Mesh(fine.vertices + shift, fine.faces, fine.normals)
    baked, hit = bake_normals(position + shift, normal, fine, 0.2)
    assert hit.all()
    along = np.einsum("ij,ij->i", position, normal)
    s = -along + np.sqrt(along**2 + 1 - np.einsum("ij,ij->i", position, position))
    analytic = position + s[:, None] * normal
    np.testing.assert_allclose(np.linalg.norm(baked, axis=1), 1, rtol=1e-12)
    assert np.degrees(np.linalg.norm(baked - analytic, axis=1)).max() < 0.05


def test_a_surface_bakes_onto_itself():
    mesh = ball(17, 33)
    position, normal = points_on(mesh, 3000)
    baked, hit = bake_normals(position, normal, mesh, 1e-3)
    assert hit.all()
    np.testing.assert_allclose(baked, normal, atol=2e-5)


@pytest.mark.parametrize("z", [0.05, -0.05])
def test_both_sides_are_searched_and_normals_are_interpolated(z):
    tilted = np.array([[-1, 0, 4], [1, 0, 4], [1, 0, 4], [-1, 0, 4.0]])
    high = Mesh(plane(z).vertices, plane(z).faces, tilted)
    x = np.linspace(-0.9, 0.9, 7)
    position = np.column_stack([x, 0 * x, 0 * x])
    baked, hit = bake_normals(position, np.tile(UP, (7, 1)), high, 0.1)
    assert hit.all()
    expected = np.column_stack([x, 0 * x, 4 + 0 * x])
    np.testing.assert_allclose(
        baked, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-6
    )


def test_the_nearer_side_wins():
    right, left = np.array([0.6, 0, 0.8]), np.array([-0.6, 0, 0.8])
    high = join(plane(0.05, right), plane(-0.04, left))
    baked, hit = bake_normals(np.zeros((1, 3)), UP[None], high, 0.1)
    assert hit[0]
    np.testing.assert_allclose(baked[0], left, atol=1e-6)


@pytest.mark.parametrize("gap", [1e-3, 1e-4, 1e-5])
def test_a_sheet_close_by_does_not_take_the_place_of_the_own(gap):
    right, left = np.array([0.6, 0, 0.8]), np.array([-0.6, 0, 0.8])
    high = join(plane(0.0, left), plane(gap, right), plane(-gap, right))
    position = np.column_stack([np.linspace(-0.9, 0.9, 101), np.full(101, 0.3), np.zeros(101)])
    baked, hit = bake_normals(position, np.tile(UP, (101, 1)), high, 0.1)
    assert hit.all()
    np.testing.assert_allclose(baked, np.tile(left, (101, 1)), atol=1e-6)


def test_the_back_of_a_thin_wall_is_passed_through():
    high = join(plane(0.02, -UP), plane(0.05, [0.6, 0, 0.8]))
    baked, hit = bake_normals(np.zeros((1, 3)), UP[None], high, 0.1)
    assert hit[0]
    np.testing.assert_allclose(baked[0], [0.6, 0, 0.8], atol=1e-6)


def test_what_is_not_hit_keeps_its_normal_and_says_so():
    high = join(plane(0.05), plane(-0.01, -UP))
    position = np.array([[0, 0, 0], [5, 0, 0], [0, 0, 0.0]])
    normal = np.array([[0, 0.6, 0.8], UP, [0, 0, 0]])
    baked, hit = bake_normals(position, normal, high, 0.01)
    np.testing.assert_array_equal(hit, [False, False, False])
    np.testing.assert_array_equal(baked, normal)
    assert bake_normals(position, normal, high, 0.1)[1].tolist() == [True, False, False]


@pytest.mark.parametrize("distance", [0.0, -1.0, np.nan])
def test_a_distance_must_be_a_length(distance):
    with pytest.raises(ValueError, match="length > 0"):
        bake_normals(np.zeros((1, 3)), UP[None], plane(0.0), distance)
