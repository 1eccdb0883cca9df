"""Brackets: what is merged is what was there; a response that is known is found, or refused."""

import numpy as np
import pytest

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.samples.brackets import merge
from meshlab_svbrdf.samples.luminance import decode, encode
from meshlab_svbrdf.samples.response import estimate_response

EXPOSURES = (1.0, 4.0, 0.25)
CLIPPED = float(decode(np.array(254 / 255)))


def radiance(rng, shape=(60, 80, 3)):
    """Light over four decades, brighter than the middle exposure can show."""
    grey = np.exp(rng.uniform(np.log(5e-3), np.log(3.0), (*shape[:2], 1)))
    return (grey * rng.uniform(0.8, 1.2, shape)).astype(np.float32)


def shot(light, exposure, rng, noise=0.0, curve=encode):
    codes = 255 * curve(np.clip(light * exposure, 0, 1)) + noise * rng.standard_normal(light.shape)
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8)


def test_a_bracket_tells_the_light_within_its_noise():
    rng = np.random.default_rng(1)
    true = radiance(rng)
    shots = [decode(shot(true, e, rng, 0.7) / 255).astype("f4") for e in EXPOSURES]
    merged, clipped = merge(shots, [CLIPPED] * 3, EXPOSURES)
    assert clipped == pytest.approx(4 * CLIPPED)
    error = np.log(merged / true)
    for low, high, worst in ((0.006, 0.05, 0.05), (0.05, 0.5, 0.02), (0.5, 3.6, 0.02)):
        own = error[(true > low) & (true < high)]
        assert abs(np.median(own)) < 0.004
        assert np.std(own) < worst
    # Each exposure alone is worse, or clipped
    single = np.log(shots[0] / true)
    dark = (true > 0.006) & (true < 0.02)
    assert np.std(error[dark]) < 0.5 * np.std(single[dark])


def test_exact_light_is_merged_exactly():
    true = radiance(np.random.default_rng(2))
    shots = [true * np.float32(e) for e in EXPOSURES]
    merged, clipped = merge(shots, [np.inf] * 3, EXPOSURES)
    np.testing.assert_allclose(merged, true, rtol=1e-5)
    assert clipped == np.inf


def test_what_is_clipped_everywhere_is_told_as_such():
    light = np.full((2, 2, 3), 50, np.float32)
    merged, clipped = merge([np.ones_like(light)] * 3, [0.99] * 3, EXPOSURES)
    assert (merged >= clipped).all()
    assert clipped == pytest.approx(4 * 0.99)
    assert light.min() > clipped


def curve(light):
    """A camera's: steep in the dark, with a shoulder."""
    return (1 - np.exp(-2.2 * light**0.6)) / (1 - np.exp(-2.2))


def test_a_known_response_is_found():
    rng = np.random.default_rng(3)
    stacks = []
    for _ in range(2):
        true = np.exp(rng.uniform(np.log(2e-3), np.log(3.0), (800, 3)))
        stacks.append(np.stack([shot(true, e, rng, 0.5, curve) for e in EXPOSURES]))
    found = estimate_response(stacks, EXPOSURES)
    light = np.linspace(1e-6, 1, 200_001)
    true = np.interp(np.arange(256) / 255, curve(light), light)
    true *= decode(np.array(128 / 255)) / true[128]
    inner = slice(20, 240)
    assert np.abs(np.log(found.light[inner] / true[inner, None])).max() < 0.08
    assert np.median(np.abs(np.log(found.light[inner] / true[inner, None]))) < 0.02
    assert found.disagreement < 0.05
    assert (np.diff(found.light, axis=0) >= 0).all()


def test_a_response_that_cannot_be_told_is_refused():
    rng = np.random.default_rng(4)
    true = np.exp(rng.uniform(np.log(2e-3), np.log(3.0), (800, 3)))
    flat = np.stack([shot(np.full_like(true, 0.2), e, rng) for e in (1, 1.5)])
    moved = [shot(rng.permutation(true), e, rng) for e in EXPOSURES]
    with pytest.raises(SvbrdfError, match=r"1\.10 times the shortest"):
        estimate_response([np.stack([shot(true, e, rng) for e in (1, 1.1)])], (1, 1.1))
    with pytest.raises(SvbrdfError, match="neither dark nor clipped in two"):
        estimate_response([np.stack([shot(true, e, rng) for e in (1, 400)])], (1, 400))
    with pytest.raises(SvbrdfError, match="neither dark nor clipped in two"):
        estimate_response([flat], (1, 1.5))
    with pytest.raises(SvbrdfError, match="disagree"):
        estimate_response([np.stack(moved)], EXPOSURES)
