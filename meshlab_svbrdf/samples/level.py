"""How bright a project's frames show the object: what results call 1 follows from it."""

from __future__ import annotations

import numpy as np

from .gains import Groups
from .luminance import luminance
from .radiance_code import decode_radiance
from .store import SampleStore

LOOKED_AT = 2_000_000  # samples, about
FLAT = 0.002
"""Of the samples: so many that are the brightest alike have been clipped."""
LEAST, MOST = 0.05, 1.0
"""Of the brightest diffuse light: what 8-bit textures hold well."""
BRIGHTEST = 0.99  # quantile over texels


def plateau(store: SampleStore) -> tuple[float, float]:
    """The share of samples that are exactly as bright as the brightest, though not marked as
    clipped, and that light; (0, 0) where nothing is seen."""
    tops, counts, total = [], [], 0
    for block in store.map_texels(lambda block, own: block, _some(store)):
        top = block.rgb[block.quality < 128].max(axis=1, initial=0)
        total += len(block.frame)
        tops.append(int(top.max(initial=0)))
        counts.append(int((top == tops[-1]).sum()))
    highest = max(tops, default=0)
    same = sum(n for n, top in zip(counts, tops, strict=True) if top == highest)
    return same / max(total, 1), float(decode_radiance(np.array([highest]))[0])


def _some(store: SampleStore) -> np.ndarray:
    """Evenly spaced texels with about LOOKED_AT samples."""
    return np.arange(0, store.texels, max(1, len(store) // LOOKED_AT))


def brightest_diffuse(store: SampleStore, exposure: np.ndarray) -> float:
    """The 99th percentile over texels of their samples' median light, 1 being the frames' white.

    exposure : (F,) relative, by which the samples of a 16-bit store are divided. 0 where nothing is
    seen.
    """
    medians = []

    def work(block, own):
        light = luminance(decode_radiance(block.rgb)) / exposure[block.frame].astype(np.float32)
        counts = np.diff(block.offsets)
        of = np.repeat(np.arange(len(counts)), counts)
        medians.append(Groups(of, len(counts)).median(light))

    store.map_texels(work, _some(store))
    every = np.concatenate(medians) if medians else np.zeros(0)
    every = every[np.isfinite(every)]
    return float(np.quantile(every, BRIGHTEST)) if len(every) else 0.0


def white_of(level: float) -> float:
    """The light that results call 1, so that the brightest diffuse texels lie in .05..1: the
    frames' own white where that does, else the power of two above them."""
    if level == 0 or LEAST <= level <= MOST:
        return 1.0
    return float(2.0 ** np.ceil(np.log2(level)))
