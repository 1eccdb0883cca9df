"""The lobes against numpy: near lights, horizons, visibility, and their extremes."""

import numpy as np
import pytest
from analytic import ball, free_texels, lamp, lobes, mirror, observations_of, orbit, unit
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from meshlab_svbrdf.reflectance.phong import lamps, light_texels, lobe

T, F = 80, 25
LIGHTS = [lamp([0.2, 0.5, 0.8]), lamp([-1, 0.1, 0.3], 2.0, 0.25), lamp([0, -1, 0.2], 0.5, 0.5)]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    texels, cameras = ball(T), orbit(F)
    texels = free_texels(3 * texels.position, texels.normal, radius=3.0)
    o = observations_of(
        tmp_path_factory.mktemp("s"), np.zeros((T, F, 3)), np.full((T, F), 127), texels, cameras
    )
    return o, texels, cameras


@njit
def _lobes(mirror, rays, gains, alpha, out):
    for t in range(out.shape[0]):
        for f in range(out.shape[1]):
            r = mirror[t, f]
            out[t, f] = lobe(r[0], r[1], r[2], rays[t], gains[t], alpha)


@pytest.mark.parametrize("alpha", [1.0, 12.0, 400.0])
def test_lobes_are_numpys(scene, alpha):
    o, texels, cameras = scene
    rays, gains = light_texels(o.view, np.arange(T), lamps(LIGHTS, texels.radius))
    out = np.empty((T, F))
    _lobes(mirror(texels, cameras), rays, gains, alpha, out)
    np.testing.assert_allclose(
        out, lobes(texels, cameras, LIGHTS, alpha), rtol=1e-6 * alpha + 1e-6, atol=1e-7
    )


def test_a_near_light_is_where_it_stands(scene):
    """Rays of all texels meet at c + d/κ, and fall off with the square of the distance."""
    o, texels, _ = scene
    light = lamp([0.3, 0.2, 1], 1.7, 0.4)
    rays, gains = light_texels(o.view, np.arange(T), lamps([light], texels.radius))
    place = light.position(texels.center, texels.radius)
    away = place - texels.position
    np.testing.assert_allclose(rays[:, 0], unit(away), atol=1e-6)
    above = np.sum(away * texels.normal, 1) > 0
    distance = np.linalg.norm(away, axis=1)
    expected = 1.7 * (np.linalg.norm(place) / distance) ** 2
    np.testing.assert_allclose(gains[above, 0], expected[above], rtol=1e-5)
    assert not gains[~above].any()


def test_lights_below_the_horizon_are_out_whatever_the_harmonics_say(scene):
    o, texels, _ = scene
    everywhere = np.zeros((1, 36), np.float32)
    everywhere[0, 0] = 9.0
    view = o.view._replace(coefficients=everywhere)
    rays, gains = light_texels(view, np.arange(T), lamps(LIGHTS[:1], texels.radius))
    below = np.sum(texels.normal * rays[:, 0], 1) <= 0
    assert below.any()
    np.testing.assert_array_equal(gains[:, 0] == 0, below)


def test_visibility_multiplies_the_gain(scene):
    o, texels, _ = scene
    half = np.zeros((1, 36), np.float32)
    half[0, 0] = 0.5 * np.sqrt(4 * np.pi)
    bulbs = lamps(LIGHTS, texels.radius)
    plain = light_texels(o.view, np.arange(T), bulbs)[1]
    shaded = light_texels(o.view._replace(coefficients=half), np.arange(T), bulbs)[1]
    np.testing.assert_allclose(shaded, plain / 2, rtol=1e-5)


def test_no_lights_no_lobes(scene):
    o, _, _ = scene
    rays, gains = light_texels(o.view, np.arange(T), lamps([], 1.0))
    assert rays.shape == (T, 0, 3)
    assert lobe(0.0, 0.0, 1.0, rays[0], gains[0], 10.0) == 0


Z = np.array([[0, 0, 1.0]], np.float32)
ONE = np.ones(1, np.float32)


@pytest.mark.parametrize("alpha", [1.0, 2000.0, 1e300])
def test_top_of_the_lobe_is_the_gain(alpha):
    assert lobe(0.0, 0.0, 1.0, Z, ONE, alpha) == 1
    assert lobe(0.0, 0.0, 1.0 + 1e-6, Z, ONE, alpha) == 1


@pytest.mark.parametrize("z", [0.0, -0.0, -1.0, -1e-9, np.nan])
def test_beside_and_behind_the_light_is_nothing(z):
    assert lobe(1.0, 0.0, z, Z, ONE, 3.0) == 0


@given(st.floats(1e-6, 1), st.floats(1, 2000))
def test_lobe_falls_with_the_angle_and_is_exact_to_its_cut(cos, alpha):
    value = lobe(0.0, 0.0, cos, Z, ONE, alpha)
    assert value == pytest.approx(cos**alpha, rel=1e-9, abs=2.1e-9)


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("z", [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan])
def test_extremes_raise_nothing(alpha, z):
    value = lobe(0.0, 0.0, z, Z, ONE, alpha)
    assert np.isnan(value) or value >= 0
    assert lobe(0.0, 0.0, z, Z, np.float32([np.nan]), alpha) == 0
    assert lobe(0.0, 0.0, z, Z, np.float32([0.0]), alpha) == 0
