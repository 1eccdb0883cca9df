"""Plain statistics of each texel's samples: their mean, median and lower quartile.

Per channel, in linear light, the frames' gains taken off, all samples of the store alike (it holds
those of quality 0.1 and more). No model of the light.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.filters._stages import read_observations
from meshlab_svbrdf.jit import kernel
from meshlab_svbrdf.samples.observations import Observations, color
from meshlab_svbrdf.samples.store import Block

from ..scenes.score import Scores
from .capture import Capture, write_maps

QUANTILES = {"mean": -1.0, "median": 0.5, "quantile": 0.25}
CAPTURING = ("compute_svbrdf_texels", "compute_svbrdf_samples")


@kernel
def _statistic(block, view, level, out):
    """The mean (level < 0) or a quantile, linearly interpolated, of each texel's samples."""
    longest = 0
    for i in range(len(out)):
        longest = max(longest, block.offsets[i + 1] - block.offsets[i])
    values = np.empty((3, longest), np.float32)
    for i in range(len(out)):
        first, n = block.offsets[i], block.offsets[i + 1] - block.offsets[i]
        if n == 0:
            out[i] = np.nan
            continue
        for j in range(n):
            values[0, j], values[1, j], values[2, j] = color(block, view, first + j)
        for c in range(3):
            if level < 0:
                total = 0.0
                for j in range(n):
                    total += values[c, j]
                out[i, c] = total / n
                continue
            values[c, :n].sort()
            place = level * (n - 1)
            low = int(place)
            high = min(low + 1, n - 1)
            out[i, c] = values[c, low] + (place - low) * (values[c, high] - values[c, low])


def statistic(observations: Observations, name: str) -> np.ndarray:
    """Each texel's colour, (T, 3) float32 linear, 0..100; NaN where it has no sample.

    name : mean, median or quantile (the lower quartile)
    """

    def work(block: Block) -> np.ndarray:
        out = np.empty((block.stop - block.first, 3), np.float32)
        _statistic(block, observations.view, QUANTILES[name], out)
        return out

    return np.concatenate(observations.store.map(work))


def run(name: str, capture: Capture, truth: Path, folder: Path) -> Scores:
    """Seconds: those of the statistic, and what projecting the frames took in the result's run."""
    started = time.perf_counter()
    color = statistic(read_observations(capture.document, visibility=False), name)
    write_maps(folder, capture.texels.to_images(color / np.float32(100))[0])
    runs = capture.document.results.record["runs"]
    capturing = sum(runs[filter]["seconds"] for filter in CAPTURING)
    return {"seconds": capturing + time.perf_counter() - started}


mean, median, quantile = (partial(run, name) for name in QUANTILES)
