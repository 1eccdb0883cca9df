"""Visibility where it is known exactly: sphere, plane, corner, bowl, a lamp behind a screen."""

import os
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from meshlab_svbrdf.geometry import visibility
from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.visibility import (
    Rays,
    _edges,
    _hemispheres,
    _Obstacles,
    directional_visibility,
    needs_visibility,
    remap,
    spread_directions,
    vertex_visibility,
)

UP = np.array([0, 0, 1.0])


def grid(n, m):
    """Faces of an n × m grid of vertices."""
    i = np.arange(n * m).reshape(n, m)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)


def cap(theta_max, n=33, m=65):
    """A part of the unit sphere around −z; polygons inscribed."""
    theta, phi = np.meshgrid(
        np.linspace(0, theta_max, n), np.linspace(0, 2 * np.pi, m), indexing="ij"
    )
    r = np.sin(theta)
    xyz = np.stack([r * np.cos(phi), r * np.sin(phi), -np.cos(theta)], -1)
    return xyz.reshape(-1, 3), grid(n, m)


def ball():
    v, f = cap(np.pi)
    return Mesh(v, f, v)


def bowl():
    v, f = cap(np.pi / 2)
    return Mesh(v, f, -v)


def square(size=1.0, z=0.0, n=2):
    a = np.linspace(-size, size, n)
    x, y = np.meshgrid(a, a, indexing="ij")
    return Mesh(np.column_stack([x.ravel(), y.ravel(), np.full(n * n, z)]), grid(n, n))


def corner():
    """A wide floor (z = 0) and a wall (x = 0), for x, z ≥ 0."""
    v = np.array([[0, -9, 0], [9, -9, 0], [9, 9, 0], [0, 9, 0], [0, -9, 9], [0, 9, 9]], float)
    return Mesh(v, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]], np.int32))


def test_directions_are_even_and_integrate_the_harmonics():
    omega = spread_directions(512)
    np.testing.assert_allclose(np.linalg.norm(omega, axis=1), 1, rtol=1e-14)
    y = basis(omega)
    np.testing.assert_allclose(y.T @ y * (4 * np.pi / 512), np.eye(36), atol=0.02)


def test_a_convex_object_sees_its_hemispheres():
    """Within what the sum over a million directions leaves of the integral."""
    omega = spread_directions(1_000_000)
    weights = basis(omega) * (4 * np.pi / len(omega))
    for mesh in (ball(), square(n=5)):
        found, normals = vertex_visibility(mesh), mesh.vertex_normals()
        for i in range(0, len(normals), 400):
            np.testing.assert_allclose(found[i], (omega @ normals[i] > 0) @ weights, atol=3e-4)
        assert needs_visibility(mesh) == (False, 0.0)


def test_between_vertices_that_agree_no_rays_are_needed(monkeypatch):
    """In a fine bowl a fraction of the rays tells the same."""
    v, f = cap(np.pi / 2, 65, 129)
    mesh = Mesh(v, f, -v)
    shot, shoot = [], _Obstacles.taken

    def counted(self, vertices, progress):
        shot.append(len(vertices))
        return shoot(self, vertices, progress)

    monkeypatch.setattr(_Obstacles, "taken", counted)
    found, all_of_them = vertex_visibility(mesh), np.arange(len(v))
    assert sum(shot) < 0.65 * len(v)
    taken = shoot(_Obstacles(mesh, -v, 512, Rays(mesh)), all_of_them, lambda share: None)
    every = _hemispheres(-v) - taken
    assert np.sqrt(np.mean((found - every) ** 2)) < 0.008
    assert np.sqrt(((found - every) ** 2).sum(axis=1).max() / (4 * np.pi)) < 0.05


def test_the_bottom_of_a_bowl_sees_the_sky_through_its_rim():
    k = vertex_visibility(bowl(), 4096, bands=1)
    share = k[:65, 0] / (2 * np.sqrt(np.pi))
    np.testing.assert_allclose(share, (1 - np.sqrt(0.5)) / 2, atol=0.003)
    needed, blocked = needs_visibility(bowl())
    assert needed
    assert 0.1 < blocked < 0.9


def test_a_wall_takes_its_half_of_the_sky():
    points, normals = np.array([[0.05, 0, 0.0]]), UP[None]
    omega = spread_directions(400)
    omega = omega[np.abs(omega[:, 0]) > 0.02]
    seen = directional_visibility(corner(), points, normals, [(d, None) for d in omega], 1e-4)
    np.testing.assert_array_equal(seen[0], (omega[:, 2] > 0) & (omega[:, 0] > 0))


def test_harmonics_agree_with_rays():
    mesh = bowl()
    omega = spread_directions(300)
    rays = directional_visibility(
        mesh, mesh.vertices, mesh.vertex_normals(), [(d, None) for d in omega], 1e-4
    )
    harmonics = remap(vertex_visibility(mesh) @ basis(omega).T)
    assert np.mean((harmonics > 0.5) != rays) < 0.02
    assert np.mean(np.abs(harmonics - rays)) < 0.05


@pytest.mark.parametrize("bands", [1, 2, 3, 6])
def test_fewer_bands_leave_the_rest_zero(bands):
    k = vertex_visibility(bowl(), 64, bands)
    np.testing.assert_array_equal(k[:, : bands**2], vertex_visibility(bowl(), 64)[:, : bands**2])
    assert not k[:, bands**2 :].any()


@pytest.mark.parametrize("bands", [0, 7])
def test_other_bands_are_refused(bands):
    with pytest.raises(ValueError, match="1 to 6"):
        vertex_visibility(bowl(), 8, bands)


@pytest.mark.parametrize(("scale", "shift"), [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e6)])
def test_size_and_place_do_not_matter(scale, shift):
    mesh = bowl()
    moved = Mesh(mesh.vertices * scale + shift, mesh.faces, mesh.normals)
    difference = vertex_visibility(moved, 256) - vertex_visibility(mesh, 256)
    # A ray that grazes the rim may go either way: single rays, not many
    assert np.mean(np.abs(difference) > 1e-5) < 0.01
    assert np.abs(difference).max() < 0.2


def test_runs_are_alike_and_progress_ends_at_one():
    done = []
    first = vertex_visibility(bowl(), 128, progress=done.append)
    np.testing.assert_array_equal(first, vertex_visibility(bowl(), 128))
    assert done == sorted(done)
    assert done[-1] == 1


def test_a_vertex_without_normal_sees_nothing():
    mesh = square()
    lonely = Mesh(np.vstack([mesh.vertices, [[0, 0, 0.5]]]), mesh.faces)
    k = vertex_visibility(lonely, 64)
    assert not k[-1].any()
    assert k[:-1].any(axis=1).all()
    assert needs_visibility(lonely) == (False, 0.0)


def test_a_mesh_without_area_needs_nothing():
    assert needs_visibility(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))) == (False, 0.0)


def test_a_near_lamp_is_hidden_only_by_what_is_in_front_of_it():
    floor, screen = square(4.0, 0.0), square(1.0, 1.0)
    mesh = Mesh(
        np.vstack([floor.vertices, screen.vertices]), np.vstack([floor.faces, screen.faces + 4])
    )
    points, normals = np.array([[0.3, 0.2, 0], [3.9, 0, 0]]), np.array([UP, UP])
    lights = [(UP, np.array([0, 0, h])) for h in (0.5, 2.0, -1.0)] + [(UP, None), (-UP, None)]
    np.testing.assert_array_equal(
        directional_visibility(mesh, points, normals, lights),
        [[True, False, False, False, False], [True, True, False, True, False]],
    )


def test_no_lights_and_no_points():
    assert (
        directional_visibility(ball(), np.zeros((0, 3)), np.zeros((0, 3)), [(UP, None)]).size == 0
    )
    assert directional_visibility(ball(), UP[None], UP[None], []).shape == (1, 0)


def test_nearest_hit_is_exact_to_single_precision():
    """Embree 3 gave these very numbers, Embree 4 is off by 1e-7."""
    face, barycentric, length = Rays(square()).nearest([[0.25, 0.5, 3]], [-UP])
    mesh = square()
    np.testing.assert_allclose(
        barycentric[0] @ mesh.vertices[mesh.faces[face[0]]], [0.25, 0.5, 0], atol=5e-7
    )
    np.testing.assert_allclose(length, 3)
    assert Rays(square()).nearest([[0, 0, 3]], [UP])[0] == -1


def test_remap():
    v = np.array([-np.inf, -1, 0, 0.25, 0.5, 0.75, 1, np.inf])
    np.testing.assert_array_equal(remap(v), [0, 0, 0, 0, 0.5, 1, 1, 1])


@pytest.fixture
def bust():
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of real scenes")
    ply = PlyData.read(Path(scenes) / "bust_floods" / "mesh.ply")
    vertices = np.column_stack([ply["vertex"][axis] for axis in "xyz"]).astype(np.float64)
    return Mesh(vertices, np.vstack(ply["face"]["vertex_indices"]).astype(np.int32))


def test_a_bust_needs_visibility_and_its_harmonics_agree_with_rays(bust):
    """15 % of the front-facing rays are blocked; six bands get all but 3 % of the answers right."""
    needed, blocked = needs_visibility(bust)
    assert needed
    assert 0.13 < blocked < 0.17
    omega = spread_directions(101)
    some = np.arange(0, len(bust.vertices), 10)
    normals = bust.vertex_normals()[some]
    rays = directional_visibility(
        bust, bust.vertices[some], normals, [(d, None) for d in omega], 1e-4
    )
    harmonics = remap(vertex_visibility(bust, 256)[some] @ basis(omega).T)
    upper = normals @ omega.T > 0
    assert np.mean((harmonics > 0.5)[upper] != rays[upper]) < 0.03


def test_where_memory_lacks_that_is_said_in_place_of_a_crash(monkeypatch):
    monkeypatch.setattr(visibility, "ROOM", 1 << 60)
    with pytest.raises(MemoryError):
        visibility.Rays(bowl())


def test_a_large_tree_is_built_when_it_is_wanted_and_rests_after(monkeypatch):
    origins, directions = [[0.25, 0.5, 3], [0, 0, 3]], [-UP, UP]
    held = Rays(square())
    held.rest()
    assert held._scene is not None
    monkeypatch.setattr(visibility, "RESTING", 0)
    rays = Rays(square())
    for _ in range(2):
        assert rays._scene is None
        assert rays.blocked(origins, directions).tolist() == [True, False]
        assert held.blocked(origins, directions).tolist() == [True, False]
        assert rays._scene is not None
        rays.rest()


def test_edges_are_those_of_the_faces_once_each_way():
    mesh = bowl()
    indptr, indices = _edges(mesh)
    rows = np.repeat(np.arange(len(mesh.vertices)), np.diff(indptr))
    told = list(zip(rows.tolist(), indices.tolist(), strict=True))
    sides = {(int(f[k]), int(f[k - 1])) for f in mesh.faces for k in range(3)}
    assert told == sorted(sides | {(b, a) for a, b in sides})
