"""The samples of the joint fit: copied whole, clipped where they are, of flat texels."""

import numpy as np
import pytest
from analytic import ball, mirror, observations_of, orbit
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance.fit_samples import FLAT_LEAST, choose_texels, collect
from meshlab_svbrdf.reflectance.threshold import MINIMUM_SAMPLES
from meshlab_svbrdf.samples.luminance import REC709, decode

T, F = 60, 30


@pytest.mark.parametrize("gains", [None, 0.5, "drifting"])
def test_collects_the_samples_of_the_chosen_texels(tmp_path, gains):
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 256, (T, F, 3))
    quality = rng.integers(0, 256, (T, F)) * (rng.random((T, F)) < 0.6)
    quality[7] = 0
    gain = {None: np.ones((F, 3)), 0.5: np.full((F, 3), 0.5)}.get(gains)
    gain = rng.uniform(0.5, 2, (F, 3)) if gain is None else gain
    texels, cameras = ball(T), orbit(F)
    o = observations_of(tmp_path, codes, quality, texels, cameras, gains=gain)
    chosen = np.array([0, 3, 7, 8, 41, T - 1])
    s = collect(o, chosen, np.array([2, 0, 1, 0, 2, 1]))
    r, linear = mirror(texels, cameras), 100 * decode(codes / 255)
    assert len(s) == s.offsets[-1] == (quality[chosen] > 0).sum()
    np.testing.assert_array_equal(s.material, [2, 0, 1, 0, 2, 1])
    for k, t in enumerate(chosen):
        own = slice(s.offsets[k], s.offsets[k + 1])
        f = np.flatnonzero(quality[t])
        np.testing.assert_allclose(s.rgb[own], linear[t, f] / gain[f], rtol=1e-6)
        np.testing.assert_allclose(s.luminance[own], (linear[t, f] / gain[f]) @ REC709, rtol=1e-6)
        np.testing.assert_allclose(s.quality[own], (quality[t, f] & 127) / 127, rtol=1e-6)
        np.testing.assert_allclose(s.mirror[own], r[t, f], atol=1e-6)
        expected = (quality[t, f] >= 128) | (linear[t, f] @ REC709 > 98)
        np.testing.assert_array_equal(s.clipped[own], expected)


def test_clipping_is_judged_before_the_exposure_is_divided_out(tmp_path):
    """A code of 253 is Y = 98.3 of what the frame could hold, whatever its gains."""
    codes = np.full((3, F, 3), 253)
    codes[1], codes[2] = 240, 120
    gains = np.random.default_rng(0).uniform(0.3, 3, (F, 3))
    o = observations_of(tmp_path, codes, np.full((3, F), 127), ball(3), orbit(F), gains=gains)
    s = collect(o, np.arange(3), np.zeros(3))
    np.testing.assert_array_equal(s.clipped.reshape(3, F).all(1), [True, False, False])
    np.testing.assert_array_equal(s.clipped.reshape(3, F).any(1), [True, False, False])


def test_no_texels_no_samples(tmp_path):
    o = observations_of(tmp_path, np.zeros((3, F, 3)), np.full((3, F), 127), ball(3), orbit(F))
    s = collect(o, np.zeros(0, np.int64), np.zeros(0, np.int32))
    assert len(s) == 0
    np.testing.assert_array_equal(s.offsets, [0])


@given(st.integers(0, 999), st.integers(100, 20000), st.floats(0.5, 20))
def test_chosen_texels_are_usable_flat_and_of_every_material(seed, samples, limit):
    rng = np.random.default_rng(seed)
    material = rng.integers(-1, 4, 500).astype(np.int32)
    counts, turn = rng.integers(0, 60, 500), rng.exponential(5, 500)
    limits = limit * np.array([0.02, 0.5, 1, 2])
    chosen, lacking = choose_texels(material, counts, turn, limits, samples)
    assert (np.diff(chosen) > 0).all()
    assert (material[chosen] >= 0).all()
    assert (counts[chosen] >= MINIMUM_SAMPLES).all()
    for m in range(4):
        own = turn[chosen][material[chosen] == m]
        usable = turn[(material == m) & (counts >= MINIMUM_SAMPLES)]
        flattest = np.quantile(usable, min(max(0.05, FLAT_LEAST / len(usable)), 1))
        assert len(own) > 0
        assert own.max() <= max(limits[m], flattest)
        assert (m in lacking) == (flattest > limits[m])
    assert counts[chosen].sum() <= 1.5 * samples + 4 * counts.max()  # evenly spaced, not counted
    other, _ = choose_texels(material, counts, turn, limits, samples, offset=1)
    assert not np.intersect1d(chosen, other).size


def test_where_nothing_is_flat_the_flattest_twentieth_is_taken():
    many = 20 * FLAT_LEAST
    turn = np.linspace(20, 40, many)
    chosen, lacking = choose_texels(
        np.zeros(many, np.int32), np.full(many, 50), turn, np.array([5.0]), 10**9
    )
    assert turn[chosen].max() <= np.quantile(turn, 0.05)
    assert len(chosen) == FLAT_LEAST / 2
    assert lacking == [0]


def test_no_limit_takes_curved_texels_too():
    turn, none = np.full(100, 1e9), np.array([np.inf])
    chosen, lacking = choose_texels(np.zeros(100, np.int32), np.full(100, 50), turn, none, 10**9)
    assert len(chosen) == 50
    assert lacking == []


@pytest.mark.parametrize(
    ("material", "counts"),
    [(-1, 50), (0, MINIMUM_SAMPLES - 1)],
    ids=["no material", "too few samples"],
)
def test_nothing_to_choose(material, counts):
    chosen, lacking = choose_texels(
        np.full(9, material, np.int32), np.full(9, counts), np.zeros(9), np.ones(1), 100
    )
    assert len(chosen) == 0
    assert lacking == []
