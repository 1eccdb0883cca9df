"""All samples of a texel at once, as rows of single precision: compilers make vectors of them."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..samples.observations import relative_luminance
from .fit_samples import is_clipped


@njit(cache=True, nogil=True, error_model="numpy")
def read_row(block, view, first, n, red, green, blue, quality):
    """Linear RGB, 0..100 of the median exposure, and quality of the samples first..first + n."""
    for j in range(n):
        f, k = block.frame[first + j], first + j
        red[j] = view.linear[block.rgb[k, 0]] * view.scale[f, 0]
        green[j] = view.linear[block.rgb[k, 1]] * view.scale[f, 1]
        blue[j] = view.linear[block.rgb[k, 2]] * view.scale[f, 2]
    for j in range(n):
        quality[j] = np.float32(block.quality[first + j] & 127) / np.float32(127)


@njit(cache=True, nogil=True, error_model="numpy")
def luminances(n, red, green, blue, y):
    """Linear Y (Rec. 709) of a row's colours."""
    for j in range(n):
        y[j] = relative_luminance(red[j], green[j], blue[j])


@njit(cache=True, nogil=True, error_model="numpy")
def bounds(block, view, first, n, bound):
    """0 for a clipped sample, whose luminance is a lower bound, and −∞ for the others."""
    for j in range(n):
        bound[j] = np.float32(0) if is_clipped(block, view, first + j) else np.float32(-np.inf)
