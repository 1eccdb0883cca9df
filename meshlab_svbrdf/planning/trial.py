"""A few frames projected to a few texels: what a scene's samples will be, before there are any.

Both are spread evenly over the views and the surface, and never chosen by what the frames show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.texels import Texels
from ..samples.luminance import code_luminance

ENOUGH_SAMPLES = 8  # of a texel, to judge it
ENOUGH_TEXELS = 1000  # judged, to judge the object
RISE = 6.0  # noises above the median from which a sample may be a highlight's
LEAST_RISE = 1.0  # luminance, 0..100
RARE = 0.0005  # share of judged texels that a highlight would surely exceed


@dataclass(frozen=True)
class Highlights:
    """What a trial says of highlights.

    judged : texels with enough samples; rising : of these, texels with a sample far above their
        median; noise : the samples' usual distance from it, luminance 0..100
    """

    judged: int
    rising: int
    noise: float

    @property
    def none(self) -> bool:
        """Whether there are surely none. Where one cannot tell, there may be."""
        return self.judged >= ENOUGH_TEXELS and self.rising <= RARE * self.judged


def some_texels(texels: Texels, count: int) -> Texels:
    """About `count` texels, every n-th in their order, which is one along the surface."""
    keep = np.arange(0, len(texels), max(1, len(texels) // max(count, 1)))
    return replace(
        texels,
        **{
            name: getattr(texels, name)[keep]
            for name in ("position", "normal", "face", "barycentric", "texture", "row", "col")
        },
    )


def seek_highlights(texel: np.ndarray, rgb: np.ndarray, quality: np.ndarray, count: int):
    """Whether any of these samples rise above their texel's median by more than noise.

    Parameters
    ----------
    texel : (n,) int32; rgb : (n, 3) uint8, sRGB; quality : (n,) uint8 as the sampler gives them
    count : texels that there are

    Returns
    -------
    Highlights. A clipped sample, whatever its texel's median, may be one.
    """
    luminance, clipped = code_luminance(rgb), quality > 127
    order = np.lexsort((luminance, texel))
    texel, luminance, clipped = texel[order], luminance[order], clipped[order]
    number = np.bincount(texel, minlength=count)
    first = np.concatenate([[0], np.cumsum(number)])[:-1]
    judged = np.flatnonzero(number >= ENOUGH_SAMPLES)
    if not len(judged):
        return Highlights(0, 0, float("nan"))
    median = luminance[first[judged] + number[judged] // 2]
    low = luminance[first[judged] + number[judged] // 4]
    highest = luminance[first[judged] + number[judged] - 1]

    # Judge each texel by the lower half of its own samples, which highlights do not reach
    noise = np.maximum((median - low) / 0.6745, LEAST_RISE / RISE)
    rises = highest - median > RISE * noise
    saturated = np.bincount(texel, weights=clipped, minlength=count)[judged] > 0
    return Highlights(len(judged), int((rises | saturated).sum()), float(np.median(noise)))
