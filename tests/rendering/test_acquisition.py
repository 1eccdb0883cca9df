"""The renderer against equation 1, evaluated pixel by pixel in numpy."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import lamp, look_at, plane, sphere, unit
from looks import ALPHA, RHO, D, eq1, look, on_plane, rays

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.reflectance.microfacet import GGX
from meshlab_svbrdf.rendering.acquisition import NEGLIGIBLE, AcquisitionRenderer

EYES = [(0.01, 0.02, 4), (1.5, -0.5, 3), (-2, 1, 2)]  # no pixel's centre on the plane's border


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("curvature", [0.0, 0.4])
def test_a_plane_is_equation_1_at_every_pixel(eye, curvature):
    mesh = plane(1.0)
    lights = [lamp((0.3, 0.2, 1), 1.6, curvature), lamp((-0.5, 0.3, 1), 0.625, curvature / 2)]
    camera = look_at(eye)
    image, coverage = AcquisitionRenderer(mesh, [look()], lights).render(camera, 1)
    points = on_plane(camera)
    inside = np.abs(points[..., :2]).max(-1) < 1
    np.testing.assert_array_equal(coverage > 0, inside)
    expected = eq1(points, np.array([0, 0, 1.0]), camera.center, lights, mesh.radius)
    expected[expected < NEGLIGIBLE] = 0
    error = image[inside] - (D + expected[inside][:, None])
    assert np.abs(error).max() < 2.1 * NEGLIGIBLE
    assert np.abs(error).mean() < NEGLIGIBLE / 10
    assert image.max() > 0.35


def test_a_sphere_is_equation_1_at_every_pixel():
    mesh = sphere(96)
    lights = [lamp((0.4, 0.5, 1), 1.0, 0.2)]
    camera = look_at((0.5, 0.3, 4))
    renderer = AcquisitionRenderer(mesh, [look()], lights, shadows=False)
    image, coverage = renderer.render(camera, 1)

    # Meet the unit sphere
    ray, eye = rays(camera), camera.center
    b = ray @ eye
    discriminant = b**2 - (eye @ eye - 1)
    hit = discriminant > 0.02  # off the silhouette, which is a polygon's
    assert (coverage[hit] == 1).all()
    points = eye + (-b - np.sqrt(np.maximum(discriminant, 0)))[..., None] * ray
    expected = eq1(points[hit], points[hit], eye, lights, mesh.radius)
    error = image[hit] - (D + expected[:, None])
    assert np.abs(error).max() < 0.005  # facets of 2°
    assert image[hit].max() > 0.5


@pytest.mark.parametrize("eye", EYES)
def test_microfacets_stand_for_the_lobe(eye):
    """GGX with Schlick's Fresnel and Smith's shadowing, pixel by pixel; Phong's texels beside."""
    a, b, roughness = 0.02, 0.4, 0.3
    mesh, light, camera = plane(1.0), lamp((0.3, 0.2, 1), 1.6), look_at(eye)
    half = np.zeros((16, 16), int)
    half[:, 8:] = GGX
    phong = look()
    mixed = replace(
        phong,
        rho_s=np.where(half == GGX, a, RHO),
        alpha=np.where(half == GGX, roughness, ALPHA),
        kind=half,
        grazing=np.where(half == GGX, b, 0.0),
    )
    image, coverage = AcquisitionRenderer(mesh, [mixed], [light]).render(camera, 1)
    points = on_plane(camera)
    v, l = unit(camera.center - points), light.direction
    h = unit(l + v)
    d = roughness**2 / np.pi / (h[..., 2] ** 2 * (roughness**2 - 1) + 1) ** 2
    g = 1.0
    for c in (l[2], v[..., 2]):
        g = g * 2 * c / (c + np.sqrt(roughness**2 + (1 - roughness**2) * c**2))
    fresnel = a + b * (1 - (h * l).sum(-1)) ** 5
    expected = light.gain * d * g * fresnel / (4 * v[..., 2])
    right = (coverage > 0) & (points[..., 0] > 0.1)
    left = (coverage > 0) & (points[..., 0] < -0.1)
    expected[expected < NEGLIGIBLE] = 0
    np.testing.assert_allclose(image[right], D + expected[right][:, None], atol=1.1 * NEGLIGIBLE)
    same, _ = AcquisitionRenderer(mesh, [phong], [light]).render(camera, 1)
    np.testing.assert_array_equal(image[left], same[left])


def test_without_lights_or_gloss_it_is_the_diffuse_colour_alone_on_black():
    camera = look_at((0.7, 0.4, 4))
    for renderer in (
        AcquisitionRenderer(plane(), [look()], []),
        AcquisitionRenderer(plane(), [look(rho_s=np.nan, alpha=np.nan)], [lamp((0, 0, 1))]),
    ):
        image, coverage = renderer.render(camera, 1)
        np.testing.assert_allclose(image[coverage == 1], np.tile(D, ((coverage == 1).sum(), 1)))
        assert (image[coverage == 0] == 0).all()
        assert 0.1 < coverage.mean() < 0.9


def test_pixels_are_means_of_their_rays():
    """In linear light; a border pixel is as dark as it is uncovered."""
    camera, lights = look_at((0.7, 0.4, 4)), [lamp((0, 0, 1))]
    renderer = AcquisitionRenderer(plane(), [look()], lights)
    image, coverage = renderer.render(camera, 4)
    finer = look_at((0.7, 0.4, 4), width=640, height=480, fx=600)
    fine, fine_coverage = renderer.render(finer, 1)
    np.testing.assert_allclose(image, fine.reshape(120, 4, 160, 4, 3).mean((1, 3)), atol=1e-12)
    np.testing.assert_allclose(coverage, fine_coverage.reshape(120, 4, 160, 4).mean((1, 3)))
    border = (coverage > 0) & (coverage < 1)
    assert border.any()
    matte, _ = AcquisitionRenderer(plane(), [look()], []).render(camera, 4)
    np.testing.assert_allclose(matte, coverage[..., None] * D, atol=1e-12)


@pytest.mark.parametrize("curvature", [0.0, 0.5])
def test_an_occluder_takes_the_highlight_away_and_nothing_else(curvature):
    """A small square between light and plane: its shadow is where geometry says."""
    below, above = plane(1.0), plane(0.2, 0.6)
    count = len(below.vertices)
    both = Mesh(
        np.vstack([below.vertices, above.vertices]), np.vstack([below.faces, above.faces + count]),
        np.tile([0.0, 0, 1], (2 * count, 1)), np.concatenate([below.uv, above.uv]),
    )  # fmt: skip
    light = lamp((0, 0, 1.0), 1.0, curvature)
    shine = look(alpha=2.0)  # broad, so that all of the plane is lit
    camera = look_at((2.5, 0, 2.0))
    images = [
        AcquisitionRenderer(both, [shine], [light], shadows).render(camera, 1)[0]
        for shadows in (True, False)
    ]
    points = on_plane(camera)
    plain = np.abs(points[..., :2]).max(-1) < 0.98
    ray_up = on_plane(camera, 0.6)
    plain &= np.abs(ray_up[..., :2]).max(-1) > 0.22  # not behind the square

    # Project the square from the light onto the plane
    place = light.position(both.center, both.radius)
    stretch = 1.0 if place is None else place[2] / (place[2] - 0.6)
    reach = np.abs(points[..., :2]).max(-1) / (0.2 * stretch)
    dark, bright = plain & (reach < 0.93), plain & (reach > 1.07)
    assert dark.sum() > 30
    np.testing.assert_allclose(images[0][dark], np.tile(D, (dark.sum(), 1)))
    assert (images[1][dark] > D + 0.01).all()
    np.testing.assert_allclose(images[0][bright], images[1][bright])


def test_a_light_below_the_horizon_gives_nothing():
    camera = look_at((0, 0, 4))
    image, coverage = AcquisitionRenderer(
        plane(), [look(alpha=1.0)], [lamp((1, 0, -0.01))], shadows=False
    ).render(camera, 1)
    np.testing.assert_allclose(image[coverage == 1], np.tile(D, ((coverage == 1).sum(), 1)))


def test_colours_of_highlights_and_several_textures():
    """The left half of the plane has one texture, the right half another with golden gloss."""
    mesh = plane(1.0, cells=2)
    right = mesh.vertices[mesh.faces].mean(1)[:, 0] > 0
    mesh = replace(mesh, texture_index=right.astype(np.int32))
    gold = np.array([1.3, 0.95, 0.4])
    looks = [look(diffuse=[0.3, 0.3, 0.3]), look(tint=gold)]
    camera, light = look_at((0, 0, 4)), lamp((0, 0, 1))
    image, coverage = AcquisitionRenderer(mesh, looks, [light]).render(camera, 1)
    points = on_plane(camera)
    lobe = eq1(points, np.array([0, 0, 1.0]), camera.center, [light], mesh.radius)[..., None]
    expected = np.where(points[..., :1] > 0, D + lobe * gold, 0.3 + lobe)
    on = (coverage == 1) & (np.abs(points[..., 0]) > 1e-6)
    np.testing.assert_allclose(image[on], expected[on], atol=2 * NEGLIGIBLE)


def test_a_normal_map_turns_the_highlight():
    tilted = unit([0.2, -0.1, 1.0])
    turn = np.tile(tilted - [0, 0, 1], (16, 16, 1))
    turn[:, :3] = np.nan  # off the charts
    camera, light = look_at((0, 0, 4)), lamp(2 * tilted[2] * tilted - np.array([0, 0, 1]))
    mesh = plane()
    image, _ = AcquisitionRenderer(mesh, [look(turn=turn)], [light]).render(camera, 1)
    row, col = np.unravel_index(image.sum(-1).argmax(), image.shape[:2])
    points = on_plane(camera)
    expected = eq1(points, tilted, camera.center, [light], mesh.radius)
    best = np.unravel_index(
        np.where(np.abs(points[..., :2]).max(-1) < 1, expected, 0).argmax(), expected.shape
    )
    assert (row, col) == best
    assert image[row, col, 0] == pytest.approx(D[0] + expected[best], abs=1e-3)


def test_unobserved_texels_take_their_neighbours_colour():
    diffuse = np.tile(D, (16, 16, 1))
    diffuse[4:9, 5:12] = np.nan
    shown = replace(look(), diffuse=diffuse)
    image, coverage = AcquisitionRenderer(plane(), [shown], []).render(look_at((0, 0, 4)), 1)
    np.testing.assert_allclose(image[coverage == 1], np.tile(D, ((coverage == 1).sum(), 1)))


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -4e5, 300)])
def test_a_world_far_away_looks_the_same(offset):
    offset = np.array(offset, float)
    camera, light = look_at((1, 0.5, 3)), lamp((0.3, 0.2, 1), 1.0, 0.4)
    mesh = plane()
    near, _ = AcquisitionRenderer(mesh, [look()], [light]).render(camera, 2)
    moved = replace(mesh, vertices=mesh.vertices + offset)
    shifted = replace(camera, t=camera.t - camera.R @ offset)
    far, _ = AcquisitionRenderer(moved, [look()], [light]).render(shifted, 2)
    np.testing.assert_allclose(far, near, atol=1e-6)


def test_principal_points_and_pixels_that_are_not_square():
    """A lens shift moves the picture by whole pixels, another aspect stretches it."""
    mesh, light = plane(), lamp((0.2, 0.1, 1))
    renderer = AcquisitionRenderer(mesh, [look()], [light])
    plain, _ = renderer.render(look_at((0, 0, 5)), 1)
    shifted, _ = renderer.render(look_at((0, 0, 5), cx=79.5 + 9, cy=59.5 - 6), 1)
    np.testing.assert_allclose(shifted[:-6, 9:], plain[6:, :-9], atol=1e-9)
    tall = look_at((0, 0, 5), fy=220.0)
    image, coverage = renderer.render(tall, 1)
    points = on_plane(tall)
    inside = np.abs(points[..., :2]).max(-1) < 1
    np.testing.assert_array_equal(coverage > 0, inside)
    lobe = eq1(points, np.array([0, 0, 1.0]), tall.center, [light], mesh.radius)
    np.testing.assert_allclose(image[inside], D + lobe[inside][:, None], atol=2 * NEGLIGIBLE)


def test_cameras_that_see_nothing_and_meshes_without_charts():
    renderer = AcquisitionRenderer(plane(), [look()], [lamp((0, 0, 1))])
    away, coverage = renderer.render(look_at((0, 0, 4), target=(0, 0, 9)), 2)
    assert (away == 0).all()
    assert (coverage == 0).all()
    with pytest.raises(ValueError, match="no texture coordinates"):
        AcquisitionRenderer(replace(plane(), uv=None), [look()], [])
