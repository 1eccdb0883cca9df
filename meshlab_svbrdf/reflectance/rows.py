"""All samples of a texel at once, as rows of single precision: compilers make vectors of them."""

from __future__ import annotations

import numpy as np

from ..jit import kernel
from ..samples.observations import relative_luminance
from .fit_samples import clips


@kernel
def read_row(block, view, first, n, red, green, blue, quality, bound):
    """Colour and quality of the samples first..first + n, and whether they are clipped.

    red, green, blue : (n,) linear, 0..100 of the median exposure; quality : (n,) 0..1
    bound : (n,) 0 for a clipped sample, whose luminance is a lower bound, −∞ for the others
    """
    for j in range(n):
        k = first + j
        f = block.frame[k]
        r, g = view.linear[block.value[k, 0]], view.linear[block.value[k, 1]]
        b = view.linear[block.value[k, 2]]
        red[j], green[j], blue[j] = r * view.scale[f, 0], g * view.scale[f, 1], b * view.scale[f, 2]
        clipped = clips(block.value[k, 3], r, g, b)
        bound[j] = np.float32(0) if clipped else np.float32(-np.inf)
    for j in range(n):
        quality[j] = np.float32(block.value[first + j, 3] & 127) / np.float32(127)


@kernel
def luminances(n, red, green, blue, y):
    """Linear Y (Rec. 709) of a row's colours."""
    for j in range(n):
        y[j] = relative_luminance(red[j], green[j], blue[j])
