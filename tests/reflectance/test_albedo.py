"""Albedo: light added up as the renderer shades it, and divided out exactly."""

import numpy as np
import pytest
from analytic import lamp, plane, rotation, sphere

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.visibility import Rays
from meshlab_svbrdf.reflectance.albedo import DARKEST, divide_light, lamp_irradiance
from meshlab_svbrdf.reflectance.lights import Light


def shaded(mesh, lights, lamp_radius=0.0, side=64):
    texels = rasterise_texels(mesh, ((side, side),))
    normal = texels.normal.astype(float)
    return texels, lamp_irradiance(texels, normal, Rays(mesh), lights, lamp_radius)


@pytest.mark.parametrize("curvature", [0.0, 0.3])
def test_a_plane_receives_the_cosine_over_the_distance_squared(curvature):
    lights = [lamp((0.3, 0.2, 1), 1.4, curvature), lamp((-1, 0, 0.5), 0.7, curvature / 2)]
    texels, found = shaded(plane(), lights)
    expected = np.zeros(len(texels))
    for light in lights:
        toward = light.direction - light.curvature * texels.position / texels.radius
        length = np.linalg.norm(toward, axis=1)
        expected += light.gain * toward[:, 2] / length**3
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_convex_object_has_no_shadow_but_its_dark_side():
    light = lamp((0.2, 0.5, 1))
    texels, found = shaded(sphere(48), [light])
    cos = texels.normal @ light.direction
    bright = cos > 0.1
    np.testing.assert_allclose(found[bright], cos[bright], atol=1e-5)
    assert not found[cos < 0].any()


def under_a_screen(size=0.4, height=0.5) -> Mesh:
    floor, screen = plane(1.0, cells=8), plane(size, height)
    vertices = np.vstack([floor.vertices, screen.vertices])
    faces = np.vstack([floor.faces, screen.faces + len(floor.vertices)]).astype(np.int32)
    uv = np.concatenate([floor.uv * [0.5, 1], screen.uv * [0.5, 1] + [0.5, 0]])
    return Mesh(vertices, faces, None, uv)


def test_a_large_lamps_shadow_has_a_soft_edge():
    """Straight above: within a penumbra height · tan(radius) wide, half of it at the edge."""
    mesh, up = under_a_screen(), [Light(np.array([0, 0, 1.0]), np.eye(2) * 1e-4)]
    texels, hard = shaded(mesh, up, side=128)
    _, soft = shaded(mesh, up, 5.0, side=128)
    place = texels.position + texels.center
    floor = place[:, 2] < 0.1
    edge = np.abs(place[:, :2]).max(1) - 0.4
    reach = 0.5 * np.tan(np.radians(5))
    np.testing.assert_array_equal(hard[floor & (edge < -0.01)], 0)
    np.testing.assert_allclose(hard[floor & (edge > 0.01)], 1, rtol=1e-6)
    np.testing.assert_allclose(soft[floor & (edge > reach + 0.01)], 1, rtol=1e-6)
    np.testing.assert_array_equal(soft[floor & (edge < -reach - 0.01)], 0)
    middle = floor & (np.abs(edge) < 0.01) & (np.abs(place[:, :2]).min(1) < 0.3)
    assert soft[middle].mean() == pytest.approx(0.5, abs=0.1)


def test_a_turned_world_receives_the_same():
    turn = rotation(np.random.default_rng(3))
    mesh, light = under_a_screen(), lamp((0.3, 0.2, 1))
    moved = Mesh(mesh.vertices @ turn.T + [5, -3, 9], mesh.faces, None, mesh.uv)
    texels, here = shaded(mesh, [light])
    others, there = shaded(moved, [lamp(turn @ light.direction)])
    here, there = texels.to_images(here, 0.0)[0], others.to_images(there, 0.0)[0]
    assert np.mean(np.abs(there - here) > 1e-4) < 0.005  # a texel at the shadow's very edge


def test_dividing_is_the_inverse_of_shading():
    rng = np.random.default_rng(0)
    albedo, ambient = rng.uniform(0, 90, (500, 3)), np.array([0.1, 0.12, 0.2])
    received, open_ = rng.uniform(0, 0.5, 500), rng.uniform(0, 1, 500)
    light = received[:, None] + ambient * open_[:, None]
    found = divide_light(albedo * light, received, open_, ambient)
    told = light.min(1) >= DARKEST
    np.testing.assert_allclose(found[told], albedo[told], rtol=1e-12)
    assert np.isnan(found[~told]).all()
    assert 0 < (~told).sum() < 100


def test_what_is_unobserved_stays_so():
    diffuse = np.array([[10.0, 10, 10], [np.nan] * 3, [10, 10, 10]])
    found = divide_light(diffuse, np.array([1.0, 1.0, 0.0]), np.ones(3), np.zeros(3))
    np.testing.assert_array_equal(np.isfinite(found).all(1), [True, False, False])


def test_no_lamps_no_light():
    texels, found = shaded(plane(), [])
    assert len(found) == len(texels)
    assert not found.any()
