"""How bright a project's frames show the object: what results call 1 follows from it."""

from __future__ import annotations

import numpy as np

from .gains import Groups
from .luminance import luminance
from .radiance_code import decode_radiance
from .store import SampleStore

LOOKED_AT = 2_000_000  # samples, about
LEAST, MOST = 0.05, 1.0
"""Of the brightest diffuse light: what 8-bit textures hold well."""
BRIGHTEST = 0.99  # quantile over texels


def brightest_diffuse(store: SampleStore, exposure: np.ndarray) -> float:
    """The 99th percentile over texels of their samples' median light, 1 being the frames' white.

    exposure : (F,) relative, by which the samples of a 16-bit store are divided. 0 where nothing is
    seen.
    """
    texels = np.arange(0, store.texels, max(1, len(store) // LOOKED_AT))
    medians = []

    def work(block, own):
        light = luminance(decode_radiance(block.rgb)) / exposure[block.frame].astype(np.float32)
        counts = np.diff(block.offsets)
        of = np.repeat(np.arange(len(counts)), counts)
        medians.append(Groups(of, len(counts)).median(light))

    store.map_texels(work, texels)
    every = np.concatenate(medians) if medians else np.zeros(0)
    every = every[np.isfinite(every)]
    return float(np.quantile(every, BRIGHTEST)) if len(every) else 0.0


def white_of(level: float) -> float:
    """The light that results call 1, so that the brightest diffuse texels lie in .05..1: the
    frames' own white where that does, else the power of two above them."""
    if level == 0 or LEAST <= level <= MOST:
        return 1.0
    return float(2.0 ** np.ceil(np.log2(level)))
