"""sRGB and luminance: exact inverses, and colour-science's."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.samples.luminance import REC709, decode, encode, luminance, to_srgb8

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # that its plots need matplotlib
    import colour

GRID = np.linspace(0, 1, 4097)


def test_agree_with_colour_science():
    np.testing.assert_allclose(
        encode(GRID), colour.cctf_encoding(GRID, function="sRGB"), atol=1e-14
    )
    np.testing.assert_allclose(
        decode(GRID), colour.cctf_decoding(GRID, function="sRGB"), atol=1e-14
    )


@given(st.floats(0, 1))
def test_are_inverses(value):
    """Exactly; the standard's own two pieces miss each other by 3e-8 where they meet."""
    if abs(value - 0.0031308) > 1e-7:
        assert decode(encode(value)) == pytest.approx(value, rel=1e-12)
    if abs(value - 0.04045) > 1e-6:
        assert encode(decode(value)) == pytest.approx(value, rel=1e-12)
    assert encode(decode(value)) == pytest.approx(value, abs=4e-8)
    assert decode(encode(value)) == pytest.approx(value, abs=4e-9)


def test_every_code_survives():
    codes = np.arange(256)
    np.testing.assert_array_equal(to_srgb8(decode(codes / 255)), codes)


def test_are_monotone():
    assert (np.diff(encode(GRID)) > 0).all()
    assert (np.diff(decode(GRID)) > 0).all()


@pytest.mark.parametrize("f", [encode, decode])
def test_extremes(f):
    """0 and 1 stay; signs stay; what is not a number stays none; nothing warns."""
    np.testing.assert_allclose(f([0.0, 1.0]), [0, 1], atol=1e-15)
    assert f(-1.0) < 0
    assert np.isnan(f(np.nan))
    assert f(np.inf) == np.inf
    assert f(-np.inf) == -np.inf


def test_codes_of_extremes_are_clipped():
    np.testing.assert_array_equal(
        to_srgb8([-np.inf, -1, np.nan, 0, 1, 2, np.inf]), [0] * 4 + [255] * 3
    )


def test_luminance_is_linear_and_white_is_one():
    assert REC709.sum() == pytest.approx(1)
    rgb = np.random.default_rng(0).random((5, 4, 3))
    np.testing.assert_allclose(luminance(rgb), (rgb * REC709).sum(-1))
    np.testing.assert_allclose(luminance(3 * rgb), 3 * luminance(rgb))
    assert luminance(rgb.astype(np.float32)).dtype == np.float32


def test_weights_are_colour_sciences():
    np.testing.assert_allclose(
        REC709, colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ[1], atol=5e-5
    )
