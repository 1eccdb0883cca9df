"""The ambient light: found from D where its truth is known, and its highlight by an integral."""

import numpy as np
import pytest
from analytic import bumpy_ball, free_texels, lamp, observations_of, orbit, unit

from meshlab_svbrdf.geometry.harmonics import COEFFICIENTS, basis
from meshlab_svbrdf.reflectance.ambient import (
    ambient_light,
    highlight_share,
    irradiance,
    openness,
)
from meshlab_svbrdf.reflectance.finish import finish_diffuse
from meshlab_svbrdf.samples.observations import Observations, observe

LAMPS = [lamp([0.5, 0.6, 0.6], 1.2), lamp([-0.8, 0.3, 0.2], 1 / 1.2)]
RHO, ALPHA = np.array([20.0, 60.0]), np.array([12.0, 80.0])


def ball_of(tmp_path, count: int = 6000) -> Observations:
    texels = bumpy_ball(count)
    cameras = orbit(2)
    return observations_of(
        tmp_path, np.full((count, 2, 3), 100), np.full((count, 2), 127), texels, cameras
    )


def albedo_of(observations: Observations, depth: float = 0.1) -> np.ndarray:
    """Clouds of colour that have nothing to do with the light, .3 ± 3 depth; (T, 3) in 0..1."""
    x = observations.texels.position.astype(float)
    clouds = [np.sin(9 * x @ unit(d)) for d in ([1, 2, 3], [3, -1, 1], [-1, 1, 4])]
    return 0.3 + depth * np.stack(clouds, 1)


def shade(observations, lights, radiance, material, depth=0.1):
    """D and the ambient highlight that is in it, both (T, 3) in 0..100."""
    n = observations.view.normal.astype(float)
    lit = sum(light.gain * np.maximum(n @ light.direction, 0) for light in lights)
    sheen = (RHO * 2 / (ALPHA + 1))[material][:, None] * radiance
    return 100 * albedo_of(observations, depth) * (lit[:, None] + radiance) + sheen, sheen


def openness_of(o):
    return openness(o.texels, o.view.faces, o.view.coefficients, o.view.normal)


def find(observations, diffuse, material, lights=LAMPS, tint=((1, 1, 1), (1, 1, 1))):
    open_ = openness_of(observations)
    return ambient_light(
        observations, diffuse, material, RHO, ALPHA, np.array(tint, float), lights, open_
    )


@pytest.fixture(name="scene")
def _scene(tmp_path):
    observations = ball_of(tmp_path)
    material = (observations.texels.position[:, 1] > 0).astype(np.int32)
    return observations, material


@pytest.mark.parametrize(("depth", "within"), [(0.0, 1e-3), (0.02, 0.05), (0.1, 0.25)])
def test_ambient_light_is_found_in_every_channel(scene, depth, within):
    """Exactly on an even albedo; the stronger its texture, the less so."""
    observations, material = scene
    radiance = np.array([0.2, 0.1, 0.05])
    diffuse, _ = shade(observations, LAMPS, radiance, material, depth)
    found = find(observations, diffuse, material)
    np.testing.assert_allclose(found.radiance, radiance, rtol=within)


def test_metals_are_not_asked(scene):
    """What is left in the D of gold is not shaded by the lamps."""
    observations, material = scene
    radiance = np.array([0.2, 0.1, 0.05])
    diffuse, _ = shade(observations, LAMPS, radiance, material, 0.02)
    diffuse[material == 1] = 8 + 3 * albedo_of(observations)[material == 1]
    gold = find(observations, diffuse, material, tint=((1, 1, 1), (1.2, 1, 0.4)))
    np.testing.assert_allclose(gold.radiance, radiance, rtol=0.1)
    as_paint = find(observations, diffuse, material)
    assert not (np.abs(as_paint.radiance / radiance - 1) < 0.5).all()


def test_exposure_does_not_matter(scene):
    """Twice the light: D and ρ double, the ambient light's share stays."""
    observations, material = scene
    diffuse, _ = shade(observations, LAMPS, np.full(3, 0.1), material)
    once = find(observations, diffuse, material).radiance
    open_ = openness_of(observations)
    twice = ambient_light(
        observations, 2 * diffuse, material, 2 * RHO, ALPHA, np.ones((2, 3)), LAMPS, open_
    )
    np.testing.assert_allclose(twice.radiance, once, rtol=1e-3)


def test_no_ambient_light_is_none(scene):
    observations, material = scene
    diffuse, _ = shade(observations, LAMPS, np.zeros(3), material)
    assert not find(observations, diffuse, material).radiance.any()


def test_without_lamps_nothing_is_told(scene):
    observations, material = scene
    found = find(observations, np.full((len(material), 3), 30.0), material, lights=[])
    assert not found.radiance.any()
    assert np.isinf(found.error).all()


def test_a_flat_object_tells_nothing(tmp_path):
    """One normal everywhere: no texel is lit otherwise than its neighbours."""
    rng = np.random.default_rng(0)
    x = np.column_stack([rng.uniform(-1, 1, (4000, 2)), np.zeros(4000)])
    texels = free_texels(x, np.tile([0, 0, 1.0], (4000, 1)))
    o = observations_of(
        tmp_path, np.full((4000, 2, 3), 100), np.full((4000, 2), 127), texels, orbit(2)
    )
    material = np.zeros(4000, np.int32)
    diffuse, _ = shade(o, LAMPS, np.full(3, 0.1), material)
    assert not find(o, diffuse, material).radiance.any()


def test_few_texels_tell_nothing(scene):
    observations, material = scene
    diffuse, _ = shade(observations, LAMPS, np.full(3, 0.1), material)
    diffuse[300:] = np.nan
    assert not find(observations, diffuse, material).radiance.any()


def test_share_of_the_highlight_is_the_integral_over_the_hemisphere():
    """(1/π) ∫ ρ (r·ω)₊^α dω by quadrature, r away from the horizon."""
    alpha = 25.0
    cos = (np.arange(20_000) + 0.5) / 20_000
    integral = 2 * np.pi * np.mean(cos**alpha) / np.pi
    assert highlight_share(np.ones(1), 3.0, alpha)[0] == pytest.approx(3 * integral, rel=1e-6)


def test_openness_is_the_cosine_weighted_visibility():
    """A half space seen from its floor is open; a wall beside it takes half of the cosine."""
    rng = np.random.default_rng(4)
    around = unit(rng.normal(size=(400_000, 3)))
    weights = 4 * np.pi / len(around)
    floor = (around[:, 2] > 0).astype(float)
    wall = floor * (around[:, 0] > 0)
    project = basis(around) * weights
    coefficients = np.stack([project.T @ floor, project.T @ wall, project.T @ floor])
    texels = free_texels([[0, 0, 0]] * 2, [[0, 0, 1]] * 2)
    texels.barycentric[1] = [0, 1, 0]
    o = _with_coefficients(texels, coefficients)
    np.testing.assert_allclose(openness_of(o), [1, 0.5], atol=0.03)


def _with_coefficients(texels, coefficients) -> Observations:
    class Store:
        frames, texels, bits = 1, 2, 8

    assert coefficients.shape[1] == COEFFICIENTS
    return observe(texels, Store(), orbit(1), np.array([[0, 1, 2]]), coefficients=coefficients)


def test_irradiance_is_lamberts_law(scene):
    observations, _ = scene
    own = np.arange(0, 6000, 7)
    n = observations.view.normal[own]
    expected = sum(g.gain * np.maximum(n @ g.direction, 0) for g in LAMPS)
    np.testing.assert_allclose(irradiance(observations, own, LAMPS), expected, atol=1e-6)


def test_finished_and_highlight_together_are_what_was_seen(scene):
    observations, material = scene
    diffuse, sheen = shade(observations, LAMPS, np.full(3, 0.1), material, depth=0.02)
    done = finish_diffuse(
        observations, diffuse.astype(np.float32), material, RHO, ALPHA, np.ones((2, 3)), LAMPS,
    )  # fmt: skip
    np.testing.assert_allclose(done.diffuse + done.highlight, diffuse, rtol=1e-5)
    np.testing.assert_allclose(done.highlight, sheen, rtol=0.05)
    assert done.notes == [f"ambient light {done.ambient.mean():.3f} of a lamp's"]


def test_nothing_observed_leaves_diffuse_alone(scene):
    observations, material = scene
    diffuse = np.full((len(material), 3), 30, np.float32)
    none = np.full(2, np.nan)
    done = finish_diffuse(observations, diffuse, material, none, none, np.ones((2, 3)), [])
    np.testing.assert_array_equal(done.diffuse, diffuse)
    assert not done.highlight.any()
    assert done.notes == []
