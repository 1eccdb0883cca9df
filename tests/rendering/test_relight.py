"""Relighting against equation 1 with albedo, and environments as lights."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import lamp, look_at, plane, rotation, sphere, unit
from hypothesis import given, settings
from hypothesis import strategies as st
from looks import ALPHA, RHO, D, eq1, look, on_plane

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.reflectance.directions import directions, solid_angles
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.environment_lights import (
    Illumination,
    cut_environment,
    together,
    uniform_light,
)
from meshlab_svbrdf.rendering.relight import RelitRenderer


def lit_by(lights, colors=None) -> Illumination:
    colors = [[light.gain] * 3 for light in lights] if colors is None else colors
    return Illumination(
        np.array([light.direction for light in lights]),
        np.array([light.curvature for light in lights]),
        np.array(colors, float),
        np.zeros(len(lights), bool),
    )


@pytest.mark.parametrize("curvature", [0.0, 0.4])
def test_a_plane_is_equation_1_with_albedo(curvature):
    mesh, camera = plane(1.0), look_at((1.5, -0.5, 3))
    lights = [lamp((0.3, 0.2, 1), 1.6, curvature), lamp((-0.5, 0.3, 1), 0.625, curvature / 2)]
    image, coverage = RelitRenderer(mesh, [look()], lit_by(lights)).render(camera, 1)
    points, inside = on_plane(camera), coverage > 0
    expected = eq1(points, np.array([0, 0, 1.0]), camera.center, lights, mesh.radius)[..., None]
    for light in lights:
        toward = light.direction - light.curvature * points / mesh.radius
        length = np.linalg.norm(toward, axis=-1, keepdims=True)
        expected = expected + D * light.gain * toward[..., 2:] / length**3
    np.testing.assert_allclose(image[inside], expected[inside], atol=2e-4)


def test_the_acquisitions_own_light_gives_the_acquisitions_picture():
    """D shaded beforehand, or albedo shaded now."""
    mesh, camera, light = plane(1.0), look_at((-2, 1, 2)), lamp((0.3, 0.2, 1), 1.2)
    relit, _ = RelitRenderer(mesh, [look()], lit_by([light])).render(camera, 2)
    shaded = look(diffuse=D * light.gain * light.direction[2])
    as_lit, _ = AcquisitionRenderer(mesh, [shaded], [light]).render(camera, 2)
    np.testing.assert_allclose(relit, as_lit, atol=2e-4)


def test_colours_add_up():
    mesh, camera = sphere(24), look_at((0.5, 0.3, 4))
    lights = [lamp((0.4, 0.5, 1)), lamp((-0.6, 0.5, 1))]
    red, blue = ([1, 0, 0], [0, 0, 1])
    show = lambda light: RelitRenderer(mesh, [look()], light).render(camera, 1)[0]  # noqa: E731
    both = show(lit_by(lights, [red, blue]))
    parts = show(lit_by(lights[:1], [red])) + show(lit_by(lights[1:], [blue]))
    np.testing.assert_allclose(both, parts, atol=1e-12)
    assert both[..., 0].max() > 0.2
    assert not both[..., 1].any()


def test_a_screen_casts_its_shadow():
    floor, screen = plane(1.0), plane(0.3, 0.5)
    mesh = Mesh(
        np.vstack([floor.vertices, screen.vertices]),
        np.vstack([floor.faces, screen.faces + 4]).astype(np.int32),
        None,
        np.concatenate([floor.uv, screen.uv]),
    )
    camera, up = look_at((3, 0, 1.5), up=(0, 0, 1)), lit_by([lamp((0, 0, 1))])
    matt = [look(rho_s=np.nan)]
    lit, _ = RelitRenderer(mesh, matt, up, shadows=False).render(camera, 1)
    shadowed, _ = RelitRenderer(mesh, matt, up).render(camera, 1)
    points = on_plane(camera)
    under = (np.abs(points[..., :2]).max(-1) < 0.25) & (lit[..., 0] > 0)
    beside = (np.abs(points[..., :2]).max(-1) < 0.95) & (np.abs(points[..., 1]) > 0.35)
    assert (shadowed[under & (points[..., 0] > 0)] == 0).mean() > 0.5
    np.testing.assert_array_equal(shadowed[beside], lit[beside])


def test_everything_is_as_bright_as_its_albedo_under_uniform_light():
    mesh, camera = sphere(48), look_at((0.5, 0.3, 4))
    matt = [look(rho_s=np.nan)]
    image, coverage = RelitRenderer(mesh, matt, uniform_light(np.ones(3), 1024)).render(camera, 1)
    inside = coverage == 1
    assert np.abs(image[inside] / D - 1).max() < 0.04
    assert np.abs((image[inside] / D).mean() - 1) < 0.005


def test_a_turned_world_looks_the_same():
    turn = rotation(np.random.default_rng(5))
    mesh, camera = sphere(24), look_at((0.5, 0.3, 4))
    light = together([lit_by([lamp((0.4, 0.5, 1), 1.0, 0.2)]), uniform_light(np.full(3, 0.1), 64)])
    moved = Mesh(mesh.vertices @ turn.T, mesh.faces, mesh.normals @ turn.T, mesh.uv)
    there = replace(light, direction=light.direction @ turn.T)
    seen = replace(camera, R=camera.R @ turn.T)
    a, _ = RelitRenderer(mesh, [look()], light).render(camera, 1)
    b, _ = RelitRenderer(moved, [look()], there).render(seen, 1)
    different = np.abs(a - b).max(-1) > 1e-4  # at the horizon and on the silhouette
    assert different.mean() < 0.01


# Environments


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 99), count=st.integers(1, 64), turn=st.floats(-360, 360))
def test_cutting_keeps_all_energy_and_its_direction(seed, count, turn):
    radiance = np.random.default_rng(seed).gamma(0.2, size=(16, 32, 3))
    light = cut_environment(radiance, count, turn)
    assert len(light) == count
    power = radiance * (solid_angles(16) / np.pi)[..., None]
    np.testing.assert_allclose(light.color.sum(0), power.sum((0, 1)), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(light.direction, axis=1), 1, rtol=1e-12)
    back = cut_environment(radiance, count)
    np.testing.assert_allclose(light.direction[:, 1], back.direction[:, 1], atol=1e-12)
    assert light.soft.all()


def test_a_lamp_in_the_map_is_a_light_there():
    radiance = np.zeros((32, 64, 3))
    radiance[5, 20] = [4.0, 2.0, 1.0]
    light = cut_environment(radiance, 16)
    np.testing.assert_allclose(light.direction, directions(32)[5, 20][None], atol=1e-12)
    np.testing.assert_allclose(light.color[0], radiance[5, 20] * solid_angles(32)[5, 20] / np.pi)


def test_a_quarter_turn_takes_front_to_the_side():
    radiance = np.zeros((32, 64, 3))
    row, col = 15, 31  # about +Z
    radiance[row, col] = 1
    before = cut_environment(radiance).direction[0]
    after = cut_environment(radiance, turn=90).direction[0]
    np.testing.assert_allclose(after, [before[2], before[1], -before[0]], atol=1e-12)
    assert after[0] > 0.99


def test_no_light_is_no_light():
    light = cut_environment(np.full((4, 8, 3), -1.0))
    assert len(light) == 0
    image, _ = RelitRenderer(plane(1.0), [look()], light).render(look_at((0, 0, 3)), 1)
    assert not image.any()


@pytest.mark.parametrize("shape", [(8, 8, 3), (8, 16), (8, 16, 4)])
def test_a_map_of_another_form_is_refused(shape):
    with pytest.raises(ValueError, match=r"\(H, 2 H, 3\)"):
        cut_environment(np.ones(shape))


def test_many_lights_converge_to_the_integral():
    """A gloss of α = 30 under a smooth sky, against the integral over the map's pixels."""
    height = 64
    rays = directions(height)
    sky = (1 + rays @ unit([0.2, 1.0, 0.4]))[..., None] ** 4 * [1.0, 0.9, 0.8]
    mesh, camera = plane(1.0), look_at((0, 0.5, 3))
    image, coverage = RelitRenderer(mesh, [look()], cut_environment(sky, 2048)).render(camera, 1)
    points, n = on_plane(camera), np.array([0, 0, 1.0])
    row, col = camera.height // 2, camera.width // 2
    view = unit(camera.center - points[row, col])
    mirror = 2 * (n @ view) * n - view
    weight = (solid_angles(height) / np.pi * (rays[..., 2] > 0))[..., None] * sky
    expected = D * (weight * rays[..., 2:]).sum((0, 1))
    lobe = np.maximum(rays @ mirror, 0) ** ALPHA
    expected = expected + RHO * (weight * lobe[..., None]).sum((0, 1))
    assert coverage[row, col] == 1
    np.testing.assert_allclose(image[row, col], expected, rtol=0.03)
