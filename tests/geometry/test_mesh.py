"""Meshes: normals and boxes of shapes that are known, and how they move."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import rotation, sphere, unit

from meshlab_svbrdf.geometry.mesh import Mesh


def affine(linear, shift=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    return matrix


def test_computed_normals_of_a_tetrahedron_point_away_from_its_middle():
    vertices = np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    np.testing.assert_allclose(Mesh(vertices, faces).vertex_normals(), unit(vertices), atol=1e-15)


def test_vertex_normals_weigh_faces_by_their_area():
    vertices = np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    np.testing.assert_allclose(Mesh(vertices, faces).vertex_normals()[0], unit([1, 0, 3]))


def test_vertex_without_area_has_no_normal():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [2, 0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 1, 4]], np.int32)
    normals = Mesh(vertices, faces).vertex_normals()
    np.testing.assert_array_equal(normals[3:], 0)
    np.testing.assert_array_equal(normals[:3], [[0, 0, 1]] * 3)


def test_normals_of_the_file_are_made_unit_and_zero_ones_are_the_faces():
    normals = np.array([[0, 0, 7.0], [0, 0, 0], [1e-200, 0, 0]])
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32), normals)
    np.testing.assert_allclose(mesh.vertex_normals()[:2], [[0, 0, 1], unit([1, 1, 1])])


def test_a_file_whose_normals_are_all_zero_has_those_of_its_faces():
    mesh = sphere()
    bare = replace(mesh, normals=None)
    zero = replace(mesh, normals=np.zeros_like(mesh.vertices))
    np.testing.assert_array_equal(zero.vertex_normals(), bare.vertex_normals())
    assert (np.einsum("ij,ij->i", zero.vertex_normals(), unit(mesh.vertices)) >= 0).all()


@pytest.mark.parametrize("given", ["all", "zero", "none"])
def test_a_mirrored_mesh_is_not_inside_out(given):
    mesh = sphere()
    if given != "all":
        mesh = replace(mesh, normals=None if given == "none" else mesh.normals * 0.0)
    moved = mesh.transformed(affine(np.diag([-1.0, 2, 3]), [5, 0, 0]))
    outward = unit((moved.vertices - [5, 0, 0]) / np.array([1.0, 4, 9]))
    assert (
        np.einsum("ij,ij->i", moved.vertex_normals(), outward) >= 0
    ).all()  # 0: the poles that no face uses
    np.testing.assert_array_equal(moved.faces, mesh.faces)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_centre_and_radius_move_with_the_mesh(scale):
    mesh = sphere()
    moved = mesh.transformed(affine(scale * np.eye(3), [1e6, -2e6, 5]))
    np.testing.assert_allclose(moved.center, [1e6, -2e6, 5], atol=1e-9 * scale, rtol=1e-15)
    assert moved.radius == pytest.approx(scale * np.sqrt(3), rel=1e-6)


def test_normals_of_a_stretched_sphere_are_an_ellipsoids():
    stretch = np.diag([1.0, 2.0, 0.5])
    moved = sphere().transformed(affine(stretch))
    np.testing.assert_allclose(
        moved.normals, unit(moved.vertices / np.diag(stretch) ** 2), atol=1e-12
    )


def test_transform_and_its_inverse_cancel():
    rng = np.random.default_rng(1)
    matrix = affine(rotation(rng) @ np.diag([1, 2, 3.0]) @ rotation(rng), rng.normal(size=3))
    mesh = sphere()
    back = mesh.transformed(matrix).transformed(np.linalg.inv(matrix))
    np.testing.assert_allclose(back.vertices, mesh.vertices, atol=1e-12)
    np.testing.assert_allclose(back.normals, mesh.normals, atol=1e-12)
    assert back.faces is mesh.faces


def test_mesh_without_normals_stays_without():
    assert sphere(normals=False).transformed(affine(np.eye(3))).normals is None
