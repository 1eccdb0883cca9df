"""Gains of frames from what they share, where they are known."""

import numpy as np
import pytest
from analytic import ball, observations_of, orbit
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from meshlab_svbrdf.samples.gains import _Groups, frame_gains, gain_spread
from meshlab_svbrdf.samples.luminance import to_srgb8

T, F = 1200, 24


def filmed(folder, gains, highlights=0.0, quality=None, seed=0):
    """Texels of random colours, each frame with its gain; some samples far too bright."""
    rng = np.random.default_rng(seed)
    linear = rng.uniform(0.08, 0.4, (T, 1, 3)) * gains
    linear = np.where(rng.random((T, F, 1)) < highlights, 2.2 * linear, linear)
    seen = np.where(rng.random((T, F)) < 0.5, 127, 0) if quality is None else quality
    codes = to_srgb8(linear)
    seen = np.where((codes.max(-1) >= 254) & (seen > 0), 255, seen)
    return observations_of(folder, codes, seen, ball(T), orbit(F))


@pytest.fixture(scope="module")
def truth():
    """Exposure and drifting white balance."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.6, 1.5, (F, 1)) * np.exp(0.15 * rng.normal(size=(F, 3)))


@pytest.mark.parametrize("highlights", [0.0, 0.2])
def test_gains_are_found_to_a_common_factor(tmp_path, truth, highlights):
    found, residual = frame_gains(filmed(tmp_path, truth, highlights))
    relative = found / truth
    np.testing.assert_allclose(relative / np.median(relative, 0), 1, rtol=0.02)
    np.testing.assert_allclose(np.median(found, 0), 1, rtol=0.02)
    assert residual.max() < 0.05


def test_frames_that_see_more_highlights_are_not_brighter(tmp_path):
    """Many weak highlights in some frames shift medians; the samples that agree tell."""
    rng = np.random.default_rng(3)
    linear = rng.uniform(0.08, 0.4, (T, 1, 1)) * np.exp(0.02 * rng.normal(size=(T, F, 3)))
    shiny = rng.random((T, F, 1)) < np.linspace(0, 0.45, F)[:, None]
    linear = np.where(shiny, linear * rng.uniform(1.1, 2, (T, F, 1)), linear)
    quality = np.full((T, F), 127)
    found, _ = frame_gains(observations_of(tmp_path, to_srgb8(linear), quality, ball(T), orbit(F)))
    np.testing.assert_allclose(found, 1, rtol=0.01)


def test_equal_frames_have_gain_one(tmp_path):
    found, residual = frame_gains(filmed(tmp_path, np.ones((F, 3))))
    np.testing.assert_allclose(found, 1, rtol=0.01)
    assert residual.max() < 0.02


def test_a_frame_that_shares_nothing_has_no_gain(tmp_path, truth):
    quality = np.full((T, F), 127)
    quality[:, 7] = 0
    found, residual = frame_gains(filmed(tmp_path, truth, quality=quality))
    assert np.isnan(found[7]).all()
    assert np.isnan(residual[7])
    assert np.isfinite(np.delete(found, 7, 0)).all()


def test_a_frame_that_shares_little_has_no_gain(tmp_path, truth):
    quality = np.full((T, F), 127)
    quality[99:, 7] = 0
    quality[100:, 8] = 0
    found, _ = frame_gains(filmed(tmp_path, truth, quality=quality))
    assert np.isnan(found[7]).all()
    assert np.isfinite(np.delete(found, 7, 0)).all()


def test_what_no_other_frame_sees_is_not_shared(tmp_path, truth):
    quality = np.zeros((T, F), int)
    quality[:600, :7] = 127
    quality[600:, 7] = 127
    found, _ = frame_gains(filmed(tmp_path, truth, quality=quality))
    assert np.isfinite(found[:7]).all()
    assert np.isnan(found[7:]).all()


def test_drifting_white_balance_is_spread_at_constant_mean():
    drift = np.linspace(-0.2, 0.2, 100)[:, None]
    assert gain_spread(np.exp(drift * [1, 0, -1])) == pytest.approx(0.148, rel=0.02)


def test_one_frame_that_stands_out_is_no_spread():
    logs = 0.003 * np.random.default_rng(0).normal(size=(100, 3))
    logs[40] = [2.0, 2.0, 2.0]
    logs[41] = np.nan
    assert gain_spread(np.exp(logs)) == pytest.approx(0.003, rel=0.5)
    assert np.isnan(gain_spread(np.full((4, 3), np.nan)))


def test_nothing_to_compare_gives_no_gains(tmp_path):
    """Black frames: their logarithms would be -inf."""
    dark = observations_of(tmp_path, np.zeros((T, F, 3)), np.full((T, F), 127), ball(T), orbit(F))
    found, residual = frame_gains(dark)
    assert found.shape == (F, 3)
    assert np.isnan(found).all()
    assert np.isnan(residual).all()


def test_clipped_samples_do_not_count(tmp_path):
    """A frame twice as bright clips a third of its texels: they would pull its gain down."""
    gains = np.ones((F, 3))
    gains[5] = 3.2
    found, _ = frame_gains(filmed(tmp_path, gains))
    assert found[5] / np.median(found, 0) == pytest.approx(3.2, rel=0.03)


def test_fewer_samples_find_the_same(tmp_path, truth):
    o = filmed(tmp_path, truth)
    few, _ = frame_gains(o, samples=len(o.store) // 5)
    many, _ = frame_gains(o)
    np.testing.assert_allclose(few, many, rtol=0.03)


@given(hnp.arrays(float, st.integers(0, 30), elements=st.floats(-9, 9)), st.integers(0, 99))
def test_medians_of_groups_are_numpys(values, seed):
    group = np.random.default_rng(seed).integers(0, 5, len(values))
    found = _Groups(group, 6).median(values)
    for k in range(6):
        own = values[group == k]
        assert (
            np.isnan(found[k])
            if len(own) == 0
            else found[k] == pytest.approx(np.median(own), abs=1e-5)
        )
