"""Light from everywhere, mirrored in metal: found with the normals that show it, or not claimed."""

import numpy as np
import pytest
from analytic import angle, ball, free_texels, grey, mirror, observations_of, orbit, unit

from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.reflectance.sheen import find_sheen, fit_harmonics, harmonic_table
from meshlab_svbrdf.reflectance.sheen_search import gather, tilts

T, F = 500, 60
ONE_MATERIAL = np.zeros(T, np.int32)


def room(seed=3):
    """ln of what comes from each direction: two bands of harmonics."""
    k = np.zeros(36)
    k[1:9] = np.random.default_rng(seed).normal(size=8) * 0.5
    return k


def seen(folder, *, off=12.0, strength=1.0, noise=0.01, seed=0):
    """A mirroring ball in a room, with normals that the mesh lacks; texels of random level."""
    rng = np.random.default_rng(seed)
    smooth = ball(T)
    true = unit(smooth.normal + np.radians(off) * rng.normal(size=(T, 3)))
    cameras = orbit(F, turns=5, climb=140)
    r = mirror(free_texels(smooth.position, true), cameras)
    shine = strength * (basis(r.reshape(-1, 3)) @ room()).reshape(T, F)
    level = rng.uniform(8, 20, (T, 1))
    y = level * np.exp(shine + noise * rng.normal(size=shine.shape))
    toward = np.array([c.center for c in cameras])[None] - smooth.position[:, None]
    facing = np.einsum("tfd,td->tf", unit(toward), smooth.normal)
    quality = np.where(facing > 0.2, 100 * facing, 0)
    observations = observations_of(folder, grey(np.minimum(y, 99)), quality, smooth, cameras)
    return observations, true, level[:, 0]


@pytest.fixture(scope="module")
def metal(tmp_path_factory):
    return seen(tmp_path_factory.mktemp("metal"))


def test_normals_that_the_mesh_lacks_are_found(metal):
    observations, true, level = metal
    found = find_sheen(observations, ONE_MATERIAL, np.array([True]))
    assert found is not None
    assert found.sigma > 0
    assert found.gains[0] > 0.8
    before = np.median(angle(observations.view.normal, true))
    assert np.median(angle(found.normal, true)) < 0.3 * before
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1, atol=1e-5)
    # The level is what a texel shows on average, up to one factor for all
    ratio = found.level[:, 1] / level
    assert np.std(np.log(ratio)) < 0.1
    # ... and the colours hold what was filmed: grey stays grey
    np.testing.assert_allclose(found.level[:, 0], found.level[:, 2], rtol=1e-5)


def test_good_normals_are_kept(tmp_path):
    observations, _, _ = seen(tmp_path, off=0)
    found = find_sheen(observations, ONE_MATERIAL, np.array([True]))
    assert found.sigma <= np.radians(6)
    assert np.median(angle(found.normal, observations.view.normal)) < 1.5


def test_matte_objects_have_none(tmp_path):
    observations, _, _ = seen(tmp_path, strength=0.0, noise=0.1)
    assert find_sheen(observations, ONE_MATERIAL, np.array([True])) is None


def test_frames_without_any_noise_have_none(tmp_path):
    observations, _, _ = seen(tmp_path, strength=0.0, noise=0.0)
    assert find_sheen(observations, ONE_MATERIAL, np.array([True])) is None


def test_only_materials_that_are_tried_get_it(metal):
    observations, _, _ = metal
    material = (np.arange(T) % 3).astype(np.int32) - 1
    found = find_sheen(observations, material, np.array([True, False]))
    assert np.isfinite(found.strength[material == 0]).all()
    assert np.isnan(found.strength[material != 0]).all()
    assert np.isnan(found.level[material != 0]).all()
    np.testing.assert_array_equal(
        found.normal[material != 0], observations.view.normal[material != 0]
    )
    assert find_sheen(observations, material, np.array([False, False])) is None


def test_harmonics_are_exact_where_the_normals_are(metal):
    observations, true, _ = metal
    samples = gather(observations, np.arange(T))
    rays = samples.ray
    texel = np.repeat(np.arange(T), np.diff(samples.offsets))
    n = true[texel]
    r = 2 * np.sum(n * rays, 1, keepdims=True) * n - rays
    exact = samples._replace(y=(basis(r) @ room()).astype(np.float32))
    found = fit_harmonics(exact, samples.quality, true, np.ones(T))
    np.testing.assert_allclose(found[1:9], room()[1:9], atol=0.01)
    assert np.average(basis(r) @ found, weights=samples.quality) == pytest.approx(0, abs=1e-6)


def test_candidates_reach_two_deviations():
    rays = tilts(0.2)
    assert len(rays) == 61
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-6)
    assert angle(rays, [0, 0, 1]).max() == pytest.approx(np.degrees(0.4), abs=1e-3)
    assert len(tilts(0.0)) == 1
    assert harmonic_table(room()).shape == (128, 128)
