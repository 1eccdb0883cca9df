"""The environment map against numpy, on light that is known."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, ball, grey, mirror, observations_of, orbit, unit

from meshlab_svbrdf.reflectance.directions import directions, pixel
from meshlab_svbrdf.reflectance.environment import environment_map
from meshlab_svbrdf.reflectance.threshold import LuminanceStatistics
from meshlab_svbrdf.samples.luminance import REC709, decode

T, F, H = 300, 40, 16
BRIGHT = unit([0.3, 0.4, 0.8])


def statistics(threshold):
    threshold = np.asarray(threshold, np.float32)
    none = np.full((len(threshold), 3), np.nan, np.float32)
    return LuminanceStatistics(
        threshold, threshold, threshold, none, np.full(len(threshold), F, np.int32)
    )


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    rng = np.random.default_rng(0)
    texels, cameras = ball(T), orbit(F)
    codes = rng.integers(0, 256, (T, F, 3), np.uint8)
    quality = rng.integers(0, 256, (T, F), np.uint8)
    o = observations_of(tmp_path_factory.mktemp("store"), codes, quality, texels, cameras)
    return o, texels, cameras, codes, quality


def brute_force(scene, threshold, chosen=slice(None)):
    """Σ (Y − t) q, Σ q and the count of every pixel."""
    _, texels, cameras, codes, quality = scene
    amount, weight, count = np.zeros((3, H, 2 * H))
    r = mirror(texels, cameras).astype(np.float32)
    y = 100 * decode(codes / 255) @ REC709
    for t in np.arange(T)[chosen]:
        for f in np.flatnonzero(quality[t]):
            if np.isfinite(threshold[t]):
                row, col = pixel(*r[t, f], H)
                q = (quality[t, f] & 127) / 127
                amount[row, col] += max(y[t, f] - threshold[t], 0) * q
                weight[row, col] += q
                count[row, col] += 1
    return amount, weight, count


@pytest.mark.parametrize("normalisation", ["weight", "count"])
def test_is_brute_forces(scene, normalisation):
    threshold = np.where(np.arange(T) % 7, 30.0, np.nan)
    amount, weight, count = brute_force(scene, threshold)
    found = environment_map(scene[0], statistics(threshold), height=H, normalisation=normalisation)
    divisor = {"weight": weight, "count": count}[normalisation]
    expected = np.divide(amount, divisor, out=np.zeros_like(amount), where=divisor > 0)
    np.testing.assert_allclose(found.weight, weight, rtol=1e-5)
    np.testing.assert_allclose(found.radiance, expected, rtol=2e-5, atol=1e-6)
    np.testing.assert_array_equal(found.seen, weight > 0)


def test_enough_texels_are_taken_evenly(scene):
    threshold = np.full(T, 30.0)
    found = environment_map(scene[0], statistics(threshold), height=H, samples=T * F // 5)
    np.testing.assert_allclose(
        found.weight, brute_force(scene, threshold, slice(None, None, 5))[1], rtol=1e-5
    )


@pytest.mark.parametrize(("scale", "top"), [("quantile", 0.999), ("max", 1.0)])
def test_scale_is_taken_over_the_pixels_that_have_samples(scene, scale, top):
    threshold = np.full(T, 30.0)
    found = environment_map(scene[0], statistics(threshold), height=H, scale=scale)
    seen = found.radiance[found.seen]
    np.testing.assert_allclose(
        found.probability, np.clip(found.radiance / np.quantile(seen, top), 0, 1)
    )
    assert found.probability.min() == 0
    assert found.probability.max() == 1


def lit(tmp_path, spread=8.0, **kw):
    """A ball that mirrors one patch of light, `spread` degrees in radius."""
    texels, cameras = ball(2000), orbit(60)
    near = angle(mirror(texels, cameras), BRIGHT) < spread
    codes = grey(np.where(near, 80.0, 20.0))
    o = observations_of(tmp_path, codes, np.full(near.shape, 127), texels, cameras, **kw)
    return o, LuminanceStatistics(
        np.full(2000, 25, np.float32), *[np.full(2000, 20, np.float32)] * 2,
        np.full((2000, 3), 20, np.float32), np.full(2000, 60, np.int32),
    )  # fmt: skip


def test_one_bright_direction_ends_in_its_pixels(tmp_path):
    found = environment_map(*lit(tmp_path), height=64)
    d = angle(directions(64), BRIGHT)
    diagonal = 180 / 64 / np.sqrt(2)
    inside, outside = d < 8 - diagonal, d > 8 + diagonal
    np.testing.assert_allclose(found.radiance[inside & found.seen], 55, rtol=0.02)
    assert not found.radiance[outside].any()
    np.testing.assert_array_equal(found.probability[inside & found.seen], 1)
    assert (inside & found.seen).sum() > 10


def test_light_smaller_than_a_thousandth_of_the_map_is_still_light(tmp_path):
    """Without noise the 99.9th percentile is 0: what is brighter than it counts as bright."""
    found = environment_map(*lit(tmp_path, 1.0), height=64)
    assert np.quantile(found.radiance[found.seen], 0.999) == 0
    np.testing.assert_array_equal(found.probability, found.radiance > 0)
    assert found.probability.any()


def test_what_is_not_visible_contributes_nothing(tmp_path):
    hidden = np.zeros((1, 36))
    o, s = lit(tmp_path, coefficients=hidden)
    found = environment_map(o, s, height=32)
    assert not found.weight.any()
    assert not found.radiance.any()
    assert not found.probability.any()


def test_half_visible_weighs_both_sides_of_the_quotient(tmp_path):
    """V = ½ everywhere: half the weight, the same radiance."""
    half = np.zeros((1, 36))
    half[0, 0] = 0.5 * np.sqrt(4 * np.pi)
    o, s = lit(tmp_path / "a", coefficients=half)
    a, b = environment_map(o, s, height=32), environment_map(*lit(tmp_path / "b"), height=32)
    np.testing.assert_allclose(a.weight, b.weight / 2, rtol=1e-5)
    np.testing.assert_allclose(a.radiance, b.radiance, rtol=1e-5)


def test_nothing_above_the_threshold_is_dark(scene):
    found = environment_map(scene[0], statistics(np.full(T, 101.0)), height=H)
    assert found.seen.any()
    assert not found.radiance.any()
    assert not found.probability.any()


@pytest.mark.parametrize("threshold", [np.nan])
def test_texels_without_threshold_leave_no_trace(scene, threshold):
    found = environment_map(scene[0], statistics(np.full(T, threshold)), height=H)
    assert not found.weight.any()
    assert not found.probability.any()


def test_turning_the_world_turns_the_map(tmp_path):
    """A quarter turn about the pole moves columns by a quarter of the width."""
    turn = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0.0]])
    o, s = lit(tmp_path)
    before = environment_map(o, s, height=32)
    view = o.view._replace(
        position=(o.view.position @ turn.T).astype(np.float32),
        normal=(o.view.normal @ turn.T).astype(np.float32),
        eyes=(o.view.eyes @ turn.T).astype(np.float32),
    )
    after = environment_map(replace(o, view=view), s, height=32)
    back = np.roll(after.weight, -16, axis=1)
    moved = np.abs(back - before.weight).sum() / before.weight.sum()
    assert moved < 2e-3
