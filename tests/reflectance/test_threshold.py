"""The luminance threshold against numpy, and the bound that it is for."""

import numpy as np
import pytest
from analytic import ball, grey, observations_of, orbit
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp
from numba import njit

from meshlab_svbrdf.reflectance.threshold import (
    MINIMUM_SAMPLES,
    _deviation,
    _total,
    luminance_threshold,
)
from meshlab_svbrdf.samples.luminance import REC709, decode

T, F = 200, 30


@pytest.fixture(scope="module")
def samples():
    """Texels of all sorts: uniform, dark, peaked, constant; seen from 0 to F times."""
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 256, (T, F, 3))
    codes[::4] = codes[::4] // 16
    codes[1::4] = np.where(rng.random((len(codes[1::4]), F, 1)) < 0.1, 250, 60)
    codes[2::8] = codes[2::8, :1]
    quality = rng.integers(13, 128, (T, F)) * (rng.random((T, F)) < rng.random((T, 1)))
    quality[:, 0] *= np.arange(T) > 0
    return codes.astype(np.uint8), quality.astype(np.uint8)


def luminances(codes):
    return 100 * decode(codes / 255) @ REC709


def test_is_numpys_mean_and_mean_deviation(tmp_path, samples):
    codes, quality = samples
    s = luminance_threshold(observations_of(tmp_path, codes, quality, ball(T), orbit(F)))
    y = luminances(codes)
    for t in range(T):
        good = quality[t] > 0
        assert s.samples[t] == good.sum()
        if good.sum() < MINIMUM_SAMPLES:
            assert np.isnan([s.threshold[t], s.mean[t], s.minimum[t], *s.color[t]]).all()
            continue
        own = y[t, good]
        expected = own.mean() + np.abs(own - own.mean()).mean()
        assert s.threshold[t] == pytest.approx(expected, rel=1e-6)
        assert s.mean[t] == pytest.approx(own.mean(), rel=1e-6)
        assert s.minimum[t] == pytest.approx(own.min(), rel=1e-6)
        np.testing.assert_allclose(
            s.color[t], 100 * decode(codes[t, good] / 255).mean(0), rtol=1e-6
        )
    assert (s.observed == (s.samples >= MINIMUM_SAMPLES)).all()
    assert 0 < s.observed.sum() < T


@settings(max_examples=40)
@given(hnp.arrays(np.uint8, (6, 11)))
def test_bounds_the_median_of_any_samples(tmp_path_factory, values):
    codes = np.repeat(values[..., None], 3, -1)
    folder = tmp_path_factory.mktemp("store")
    s = luminance_threshold(
        observations_of(folder, codes, np.full((6, 11), 127), ball(6), orbit(11))
    )
    median = np.median(luminances(codes), axis=1)
    assert (s.threshold >= median * (1 - 1e-6)).all()
    assert (s.minimum <= s.mean * (1 + 1e-6)).all()
    assert (s.mean <= s.threshold * (1 + 1e-6)).all()


def test_doubling_the_light_doubles_it(tmp_path, samples):
    codes, quality = samples
    once = luminance_threshold(observations_of(tmp_path / "a", codes, quality, ball(T), orbit(F)))
    twice = luminance_threshold(
        observations_of(tmp_path / "b", codes, quality, ball(T), orbit(F), gains=np.full(F, 0.5))
    )
    for name in ("threshold", "mean", "minimum", "color"):
        np.testing.assert_allclose(getattr(twice, name), 2 * getattr(once, name), rtol=1e-6)
    np.testing.assert_array_equal(once.samples, twice.samples)


def test_a_frames_gain_is_divided_out(tmp_path):
    """The same surface at two exposures is constant: its threshold is its luminance."""
    gains = np.where(np.arange(F) % 2, 0.5, 1.0)
    codes = grey(np.tile(40 * gains, (3, 1)))
    s = luminance_threshold(
        observations_of(tmp_path, codes, np.full((3, F), 127), ball(3), orbit(F), gains=gains)
    )
    np.testing.assert_allclose(s.threshold, 40, rtol=0.01)


def test_permuting_texels_permutes_it(tmp_path, samples):
    codes, quality = samples
    order = np.random.default_rng(1).permutation(T)
    a = luminance_threshold(observations_of(tmp_path / "a", codes, quality, ball(T), orbit(F)))
    b = luminance_threshold(
        observations_of(tmp_path / "b", codes[order], quality[order], ball(T), orbit(F))
    )
    np.testing.assert_array_equal(b.threshold, a.threshold[order])


def test_permuting_frames_changes_nothing(tmp_path, samples):
    codes, quality = samples
    order = np.random.default_rng(1).permutation(F)
    a = luminance_threshold(observations_of(tmp_path / "a", codes, quality, ball(T), orbit(F)))
    b = luminance_threshold(
        observations_of(tmp_path / "b", codes[:, order], quality[:, order], ball(T), orbit(F))
    )
    np.testing.assert_allclose(b.threshold, a.threshold, rtol=1e-6)


@pytest.mark.parametrize("least", [MINIMUM_SAMPLES, 3])
@pytest.mark.parametrize("short", [1, 0])
def test_fewer_samples_than_asked_for_are_unobserved(tmp_path, least, short):
    quality, seen = np.zeros((1, F)), least - short
    quality[0, :seen] = 127
    s = luminance_threshold(
        observations_of(tmp_path, np.full((1, F, 3), 99), quality, ball(1), orbit(F)),
        **({} if least == MINIMUM_SAMPLES else {"minimum_samples": least}),
    )
    assert s.observed[0] == (seen >= least)
    assert s.samples[0] == seen


def test_only_samples_of_the_least_quality_count(tmp_path):
    """In seven bits .1 is 12.7: 13 counts and 12 does not."""
    quality = np.full((2, F), 127)
    quality[0, 10:], quality[1, 10:] = 12, 13
    codes = np.where(np.arange(F)[None, :, None] < 10, 60, 200) * np.ones((2, 1, 3))
    o = observations_of(tmp_path, codes, quality, ball(2), orbit(F))
    np.testing.assert_array_equal(luminance_threshold(o).samples, [10, F])
    np.testing.assert_array_equal(luminance_threshold(o, 0.0).samples, [F, F])
    np.testing.assert_array_equal(luminance_threshold(o, 0.5).samples, [10, 10])


def test_the_mark_of_clipping_is_no_quality(tmp_path):
    quality = np.full((1, F), 128 | 5)
    o = observations_of(tmp_path, np.full((1, F, 3), 255), quality, ball(1), orbit(F))
    assert luminance_threshold(o).samples[0] == 0


def test_store_without_samples(tmp_path):
    o = observations_of(tmp_path, np.zeros((4, F, 3)), np.zeros((4, F)), ball(4), orbit(F))
    assert not luminance_threshold(o).observed.any()


@njit
def _sums(y):
    return _deviation(y, 0.0), _total(len(y), y, y, y, y)


def test_sums_of_millions_lose_nothing():
    """Single precision would be off by parts in a thousand: its steps are .03 at half a million."""
    y = np.full(4_000_000, 12.3, np.float32)
    deviation, totals = _sums(y)
    np.testing.assert_allclose(deviation, float(y[0]), rtol=1e-9)
    np.testing.assert_allclose(np.array(totals) / len(y), float(y[0]), rtol=1e-9)
