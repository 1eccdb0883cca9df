"""All samples of a texel at once, as rows of single precision: compilers make vectors of them."""

from __future__ import annotations

import numpy as np

from ..jit import inner
from ..samples.observations import relative_luminance

SATURATED = 98.0
"""Luminance, 0..100 on the frame's own scale, above which a sample is clipped (paper §7.2)."""


@inner
def clips(quality, r, g, b):
    """A sample of this colour, linear 0..1 before dividing by exposure, and stored quality."""
    return quality >= 128 or np.float32(100) * relative_luminance(r, g, b) > SATURATED


@inner
def read_row(block, view, first, n, red, green, blue, quality, bound):
    """Colour and quality of the samples first..first + n, and whether they are clipped.

    red, green, blue : (n,) linear, 0..100 of the median exposure; quality : (n,) 0..1
    bound : (n,) 0 for a clipped sample, whose luminance is a lower bound, −∞ for the others
    """
    value, frame = block.value[first : first + n], block.frame[first : first + n]
    for j in range(n):
        red[j], green[j] = view.linear[value[j, 0]], view.linear[value[j, 1]]
        blue[j] = view.linear[value[j, 2]]
    for j in range(n):
        clipped = clips(value[j, 3], red[j], green[j], blue[j])
        bound[j] = np.float32(0) if clipped else np.float32(-np.inf)
        quality[j] = np.float32(value[j, 3] & 127) / np.float32(127)
    if view.even:
        r, g, b = view.scale[0, 0], view.scale[0, 1], view.scale[0, 2]
        for j in range(n):
            red[j], green[j], blue[j] = red[j] * r, green[j] * g, blue[j] * b
    else:
        for j in range(n):
            f = np.uint32(frame[j])
            red[j], green[j] = red[j] * view.scale[f, 0], green[j] * view.scale[f, 1]
            blue[j] = blue[j] * view.scale[f, 2]


@inner
def luminances(n, red, green, blue, y):
    """Linear Y (Rec. 709) of a row's colours."""
    for j in range(n):
        y[j] = relative_luminance(red[j], green[j], blue[j])
