"""Colour scales: ends, order, and what lies beyond."""

import numpy as np
import pytest

from meshlab_svbrdf.rendering.colors import inferno, scale_of, viridis


@pytest.mark.parametrize("scale", [viridis, inferno])
def test_scales_rise_and_end(scale):
    colors = scale(np.array([-1, 0, 0.25, 0.5, 0.75, 1, 9]))
    assert colors.dtype == np.uint8
    luminance = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance[1:-1]) > 0).all()
    np.testing.assert_array_equal(colors[[0, -1]], colors[[1, -2]])
    assert scale(np.zeros((3, 4))).shape == (3, 4, 3)
    assert inferno(np.zeros(1)).max() < 10


def test_a_scale_runs_from_the_first_to_the_last_percent():
    values = np.append(np.random.default_rng(0).permutation(np.arange(101.0)) + 1, np.nan)
    even, logs = scale_of(values), scale_of(values, True)
    assert even == (2, 100, False)
    assert logs == (2, 100, True)
    asked = np.array([1, 2, 51, np.sqrt(200), 100, 1000, np.nan])
    np.testing.assert_allclose(even.share(asked)[[0, 1, 2, 4, 5]], [0, 0, 0.5, 1, 1])
    np.testing.assert_allclose(logs.share(asked)[[0, 1, 3, 4, 5]], [0, 0, 0.5, 1, 1])
    assert np.isnan(even.share(asked)[-1])
    assert scale_of(np.full(9, 0.4)).share(np.array([0.4]))[0] == pytest.approx(0.5)
    assert not scale_of(values - 50, True).log
    assert scale_of(np.full(3, np.nan)) == (0, 1, False)
