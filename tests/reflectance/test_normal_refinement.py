"""Normals that are off are turned back, good ones are kept."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import bumpy_ball, film, lamp, orbit

from meshlab_svbrdf.geometry.surface_shape import surface_shape
from meshlab_svbrdf.reflectance.normal_refinement import refine_normals
from meshlab_svbrdf.reflectance.normal_steps import predict
from meshlab_svbrdf.reflectance.phong import lamps, light_texels
from meshlab_svbrdf.samples.observations import with_normals

T, F = 2000, 200
LIGHTS = [lamp([0.3, 0.5, 0.8], 1.1, 0.1), lamp([-0.8, 0.3, 0.3], 1 / 1.1), lamp([0.1, -0.6, -0.8])]
RHO, ALPHA, NOISE = np.array([40.0]), np.array([60.0]), np.array([0.4])


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return film(
        tmp_path_factory.mktemp("film"), bumpy_ball(T), orbit(F, turns=6, climb=120), LIGHTS,
        np.zeros(T, np.int32), RHO, ALPHA, np.full((T, 3), 15.0), noise=1.3, seed=0,
    )  # fmt: skip


def turned(normal, degrees, seed=0):
    """Normals off by a random angle of that standard deviation per axis."""
    n = normal + np.radians(degrees) * np.random.default_rng(seed).normal(size=normal.shape)
    return (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)


def off(a, b):
    """Degrees between unit vectors, from the chord: exact near 0."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(a.astype(float) - b, axis=1) / 2))


def test_good_normals_are_kept(scene):
    found = refine_normals(scene.observations, scene.material, RHO, ALPHA, NOISE, LIGHTS)
    assert found.sigma == 0
    np.testing.assert_array_equal(found.normal, scene.observations.view.normal)


def test_poor_normals_are_turned_back(scene):
    truth = scene.observations.view.normal
    poor = with_normals(scene.observations, turned(truth, 1.0))
    found = refine_normals(poor, scene.material, RHO, ALPHA, NOISE, LIGHTS)
    assert found.sigma > 0
    assert found.gain > 0.3
    corrected = (found.normal != poor.view.normal).any(axis=1)
    assert corrected.mean() > 0.5
    before, after = (off(n[corrected], truth[corrected]) for n in (poor.view.normal, found.normal))
    assert np.median(after) < 0.5 * np.median(before)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1, atol=1e-6)


def test_no_correction_exceeds_two_sigma(scene):
    poor = with_normals(scene.observations, turned(scene.observations.view.normal, 3.0))
    found = refine_normals(poor, scene.material, RHO, ALPHA, NOISE, LIGHTS)
    assert off(found.normal, poor.view.normal).max() <= np.degrees(2 * found.sigma) * 1.01


@pytest.mark.parametrize("swell", [0.0, 3.0])
def test_slopes_are_what_a_turn_of_the_normal_does(scene, swell):
    """Of sharp lobes, and of lobes that pixels blur to three quarters of their height."""
    o = scene.observations
    shape = np.float32(swell) * surface_shape(o.view.position, o.view.normal)
    rays, gains = light_texels(o.view, np.arange(T), lamps(LIGHTS, o.texels.radius))
    block, worst = o.store.read(0, T), []
    for t in range(0, T, 100):
        first, n = block.offsets[t], block.offsets[t + 1] - block.offsets[t]
        normal = o.view.normal[t].astype(float)
        step = 1e-4 * np.cross(normal, [0.3, -0.5, 0.8])

        def lobes(turned, t=t, first=first, n=n):
            e, slope, s = np.empty(n), np.empty((n, 3)), np.empty(n)
            predict(block, o.view, o.pixel, shape, t, first, n, rays[t], gains[t], 40.0, 60.0, e,
                     slope, s, turned)  # fmt: skip
            return slope, s

        slope = lobes(normal)[0]
        rise = (lobes(normal + step)[1] - lobes(normal - step)[1]) / 2
        worst.append(np.abs(slope @ step - rise).max() / max(np.abs(rise).max(), 1e-5))
    assert np.median(worst) < (0.01 if swell == 0 else 0.1)


def test_without_gloss_or_lights_normals_are_kept(scene):
    matte = refine_normals(scene.observations, scene.material, [np.nan], [np.nan], NOISE, LIGHTS)
    dark = refine_normals(scene.observations, scene.material, RHO, ALPHA, NOISE, [])
    nobody = refine_normals(scene.observations, np.full(T, -1, np.int32), RHO, ALPHA, NOISE, LIGHTS)
    assert matte.sigma == dark.sigma == nobody.sigma == 0


def test_the_same_from_any_threads(scene, monkeypatch):
    poor = with_normals(scene.observations, turned(scene.observations.view.normal, 1.0))
    results = []
    for threads in (1, 3):
        monkeypatch.setattr("meshlab_svbrdf.samples.store.thread_count", lambda n=threads: n)
        results.append(refine_normals(poor, scene.material, RHO, ALPHA, NOISE, LIGHTS).normal)
    np.testing.assert_array_equal(*results)


def test_observations_keep_everything_else(scene):
    other = with_normals(scene.observations, turned(scene.observations.view.normal, 1.0))
    assert other.view.position is scene.observations.view.position
    assert replace(other, view=scene.observations.view, texels=scene.observations.texels) == (
        scene.observations
    )
