"""The rasteriser against rays: every pixel centre's nearest triangle, found by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import look_at, plane, sphere
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.raster import DepthMaps, rasterise, rasterise_depth


def rays(camera):
    """Directions of the pixel centres in camera coordinates with z = 1, (H·W, 3)."""
    col, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    x = (col.ravel() - camera.cx) / camera.fx
    y = (row.ravel() - camera.cy) / camera.fy
    return np.column_stack([x, y, np.ones(x.size)])


def brute_force(vertices, faces, camera):
    """Largest 1/z of all triangles at every pixel by Möller and Trumbore's test, and its face."""
    p = vertices @ camera.R.T + camera.t
    d = rays(camera)
    inverse, face = np.zeros(len(d)), np.full(len(d), -1)
    for f, (a, b, c) in enumerate(p[faces]):
        e1, e2 = b - a, c - a
        h = np.cross(d, e2)
        det = h @ e1
        ok = det != 0
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (h @ -a) / det
            q = np.cross(-a, e1)
            v = (d @ q) / det
            z = (q @ e2) / det
            hit = ok & (u >= 0) & (v >= 0) & (u + v <= 1) & (z > 0) & (1 / z > inverse)
            inverse = np.where(hit, 1 / z, inverse)
        face[hit] = f
    shape = camera.height, camera.width
    return inverse.reshape(shape), face.reshape(shape)


ODD = Camera(70, 50, 60.0, 45.0, 12.3, 40.7, np.eye(3), np.zeros(3))


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_rays_on_triangles_all_around_the_camera(seed):
    """Off-centre principal point, pixels not square, triangles that reach behind the camera."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(90, 3)) * [2, 2, 3]
    faces = rng.integers(0, 90, (60, 3)).astype(np.int32)
    inverse, face = rasterise(vertices, faces, ODD)
    expected, expected_face = brute_force(vertices, faces, ODD)
    assert (vertices[faces][..., 2].min(1) < 0).any()
    np.testing.assert_allclose(inverse, expected, rtol=1e-6)
    np.testing.assert_array_equal(face, expected_face)


def test_ground_plane_through_the_camera_ends_at_the_horizon():
    """Depth of a ground that reaches behind the camera is analytic: 1/z = y / height."""
    ground = np.array([[-1e4, 1.5, -1e4], [1e4, 1.5, -1e4], [1e4, 1.5, 1e4], [-1e4, 1.5, 1e4]])
    inverse, _ = rasterise(ground, np.array([[0, 1, 2], [0, 2, 3]], np.int32), ODD)
    down = (np.arange(ODD.height) - ODD.cy) / ODD.fy / 1.5
    expected = np.where(down > 1e-4, down, 0)
    np.testing.assert_allclose(inverse, np.repeat(expected[:, None], ODD.width, 1), rtol=1e-6)


def test_sphere_has_no_cracks_and_its_depth():
    """Every ray that meets the ball inscribed in the mesh sees it, none outside the sphere does."""
    mesh, camera = sphere(24), look_at([0.3, 1, 3], cx=70.0, cy=64.5, fy=130.0)
    inverse, _ = rasterise(mesh.vertices, mesh.faces, camera)
    d = rays(camera)
    length = np.linalg.norm(d, axis=1)
    along = d @ camera.t / length
    closest2 = camera.t @ camera.t - along**2
    seen = inverse.ravel() > 0
    inscribed = np.cos(np.pi / 48) ** 2
    assert seen[closest2 < inscribed**2].all()
    assert not seen[closest2 > 1].any()
    depth = (along - np.sqrt(np.maximum(1 - closest2, 0))) / length
    central = closest2 < 0.5
    np.testing.assert_allclose(1 / inverse.ravel()[central], depth[central], atol=0.01)


def test_degenerate_duplicate_and_reversed_triangles_change_no_depth():
    mesh, camera = sphere(12), look_at([0, 0.5, 3])
    inverse, face = rasterise(mesh.vertices, mesh.faces, camera)
    points = np.repeat(np.arange(0, 100, 7)[:, None], 3, 1)
    lines = np.column_stack([np.arange(50), np.arange(50), np.arange(50) + 1])
    more = np.vstack([mesh.faces, points, lines, mesh.faces[:, ::-1]]).astype(np.int32)
    again, face_again = rasterise(mesh.vertices, more, camera)
    np.testing.assert_allclose(again, inverse, rtol=2e-7)
    twin = np.where(
        face_again >= len(mesh.faces), face_again - (len(more) - len(mesh.faces)), face_again
    )
    same_depth = inverse > 0
    assert np.mean(twin[same_depth] == face[same_depth]) > 0.99
    np.testing.assert_array_equal(face_again >= 0, face >= 0)


def test_order_of_faces_does_not_matter():
    mesh, camera = sphere(12), look_at([0, 0.5, 3])
    inverse, _ = rasterise(mesh.vertices, mesh.faces, camera)
    order = np.random.default_rng(0).permutation(len(mesh.faces))
    again, _ = rasterise(mesh.vertices, mesh.faces[order], camera)
    np.testing.assert_array_equal(again, inverse)


def test_map_coordinates_cost_nothing():
    mesh, camera = sphere(12), look_at([0, 0.5, 3])
    inverse, _ = rasterise(mesh.vertices, mesh.faces, camera)
    origin = np.array([1e6, -3e6, 2e5])
    far = camera.about(-origin)
    again, _ = rasterise(mesh.vertices + origin, mesh.faces, far)
    np.testing.assert_allclose(again, inverse, rtol=1e-6, atol=1e-6)


def test_nothing_before_the_camera_nothing_seen():
    behind = plane(1.0, 10.0)
    for faces in (behind.faces, np.zeros((0, 3), np.int32)):
        inverse, face = rasterise(behind.vertices, faces, look_at([0, 0, 4]))
        assert not inverse.any()
        assert (face == -1).all()


def test_a_vertex_that_is_not_a_number_hides_its_faces_only():
    mesh, camera = sphere(12), look_at([0, 0.5, 3])
    broken = mesh.vertices.copy()
    broken[137] = np.nan
    whole = mesh.faces[~(mesh.faces == 137).any(1)]
    np.testing.assert_array_equal(
        rasterise(broken, mesh.faces, camera)[0], rasterise(mesh.vertices, whole, camera)[0]
    )


def test_triangle_that_reaches_far_out_of_the_image_is_seen_inside():
    """Corners that project 1e12 pixels away still cover what they cover."""
    huge = np.array([[-1e9, -1e9, 1e-3], [1e9, -1e9, 1e-3], [0, 3e9, 2e-3]])
    inverse, _ = rasterise(huge, np.array([[0, 1, 2]], np.int32), ODD)
    expected, _ = brute_force(huge, np.array([[0, 1, 2]]), ODD)
    np.testing.assert_allclose(inverse, expected, rtol=1e-6)
    assert (inverse > 0).all()


@pytest.mark.parametrize("size", [0.02, 0.2, 2.0])
def test_faces_of_every_size_are_where_the_brute_force_has_them(size):
    """Some narrower than eight pixels, some wider, in every orientation."""
    rng = np.random.default_rng(5)
    camera = look_at([0, 0, 4], width=90, height=70, fx=80.0)
    vertices = (rng.uniform(-1, 1, (60, 1, 3)) + rng.normal(0, size, (60, 3, 3))).reshape(-1, 3)
    vertices[:, 2] = np.minimum(vertices[:, 2], 3.0)
    faces = np.arange(180, dtype=np.int32).reshape(-1, 3)
    expected, _ = brute_force(vertices, faces, camera)
    inverse, face = rasterise(vertices, faces, camera)
    depth = rasterise_depth(vertices, faces, camera)
    np.testing.assert_array_equal(inverse, depth)
    off = ~np.isclose(inverse, expected, rtol=1e-4)
    assert off.mean() < 1e-3  # pixel centres on an edge, to a 100 000th of a pixel
    assert ((face >= 0) == (inverse > 0)).all()


def test_of_a_closed_surface_the_fronts_are_enough():
    mesh = sphere(32)
    assert mesh.is_closed()
    assert not replace(mesh, faces=mesh.faces[1:]).is_closed()
    assert not replace(mesh, faces=np.vstack([mesh.faces, mesh.faces[:1]])).is_closed()
    camera = look_at([0, 0, 4], width=80, height=80, fx=120.0)
    both = rasterise_depth(mesh.vertices, mesh.faces, camera)
    front = DepthMaps(mesh.vertices, mesh.faces, -mesh.winding()).of(camera)
    assert (both > 0).sum() > 500
    np.testing.assert_array_equal(front, both)


@pytest.mark.parametrize("seed", range(4))
def test_depth_maps_of_many_views_are_those_of_all_faces(seed):
    """Whatever the order of faces and the side; vertices may be unused, or no numbers."""
    rng = np.random.default_rng(seed)
    mesh = sphere(40)
    vertices = np.vstack([mesh.vertices * rng.uniform(0.3, 1.0, 3), [[np.nan, 0, 0], [9, 9, 9]]])
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    broken = np.vstack([faces, [[0, 1, len(vertices) - 2]]]).astype(np.int32)
    maps = DepthMaps(vertices, broken, -mesh.winding()), DepthMaps(vertices, faces, 0)
    for _ in range(6):
        eye = rng.normal(size=3)
        camera = look_at(eye / np.linalg.norm(eye) * rng.uniform(1.1, 5), width=90, height=70)
        expected = rasterise_depth(vertices, faces, camera)
        assert expected.any()
        for prepared in maps:
            np.testing.assert_array_equal(prepared.of(camera), expected)


def test_no_hole_opens_between_small_faces():
    """A fine plane across the whole image, at any angle: every pixel is covered."""
    n = 60
    u, v = np.meshgrid(np.linspace(-3, 3, n), np.linspace(-3, 3, n))
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]).astype(np.int32)
    for seed in range(8):
        turn = Rotation.random(random_state=seed).as_matrix()[:, :2]
        turn[2] *= 0.3
        vertices = np.stack([u.ravel(), v.ravel()], 1) @ turn.T
        normal = np.cross(*turn.T)
        eye = 3 * normal / np.linalg.norm(normal)
        camera = look_at(eye, width=96, height=80, fx=400.0)
        assert (rasterise_depth(vertices, faces, camera) > 0).all()
