"""Colour scales: ends, order, and what lies beyond."""

import numpy as np
import pytest

from meshlab_svbrdf.rendering.colors import inferno, viridis


@pytest.mark.parametrize("scale", [viridis, inferno])
def test_scales_rise_and_end(scale):
    colors = scale(np.array([-1, 0, 0.25, 0.5, 0.75, 1, 9]))
    assert colors.dtype == np.uint8
    luminance = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance[1:-1]) > 0).all()
    np.testing.assert_array_equal(colors[[0, -1]], colors[[1, -2]])
    assert scale(np.zeros((3, 4))).shape == (3, 4, 3)
    assert inferno(np.zeros(1)).max() < 10
