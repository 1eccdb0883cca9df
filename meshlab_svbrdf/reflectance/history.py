"""One texel's luminance over the frames, with its peaks: the paper's temporal plot (§7.2).

What a filter takes for all texels is told here of one, or of some, so that people can look at it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..jit import kernel
from ..samples.luminance import to_srgb8
from ..samples.observations import Observations, View, sample_luminance
from ..samples.store import Block
from .fit_samples import is_clipped
from .lights import Light
from .specular import _about_light, _judge_run, _next_run, _specular, shapes

MOST_PEAKS = 256


@dataclass(frozen=True)
class Peak:
    """A run of samples above the diffuse level.

    samples : (k,) int64, indices into the history
    light : the nearest light, -1 for none; distance : Mahalanobis, NaN where it does not tell
    c_max, c_min : the two samples that the slope is taken from, -1 for none
    rho_s, alpha : 0..100; NaN where the peak does not tell
    """

    samples: np.ndarray
    light: int
    distance: float
    c_max: int
    c_min: int
    rho_s: float
    alpha: float


@dataclass(frozen=True)
class History:
    """frame : (n,) int32; luminance : (n,) float32, 0..100; quality : (n,) float32, 0..1
    clipped : (n,) bool; rgb : (n, 3) uint8, sRGB as filmed, or as it would be seen at 8 bits
    peaks : in the order of time, or of the lights
    """

    frame: np.ndarray
    luminance: np.ndarray
    quality: np.ndarray
    clipped: np.ndarray
    rgb: np.ndarray
    peaks: list[Peak]


@kernel
def _luminances(block, view, luminance, clipped):
    for j in range(len(luminance)):
        luminance[j] = sample_luminance(block, view, j)
        clipped[j] = is_clipped(block, view, j)


@kernel
def _peaks(block, view, sequence, order, d, table, by_direction, numbers, ends, run, runs):
    """Judge every run of the only texel of the block; how many there are.

    numbers : (P, 3) ρs, α, d²; ends : (P, 4) light, c_max, c_min, samples; runs : (P, n) samples
    """
    count, lamp = 0, 0
    j, stop = block.offsets[0], block.offsets[1]
    while ((lamp < len(table.least)) if by_direction else (j < stop)) and count < len(numbers):
        if by_direction:
            n = _about_light(block, view, 0, d, lamp, table, j, stop, run)
            lamp += 1
        else:
            n, j = _next_run(block, view, d, sequence, order, j, stop, run)
        if n == 0:
            continue
        r, a, d2, k, top, low = _judge_run(block, view, 0, run, n, d, table, False, False, np.inf)
        numbers[count, 0], numbers[count, 1], numbers[count, 2] = r, a, d2
        ends[count, 0], ends[count, 1], ends[count, 2], ends[count, 3] = k, top, low, n
        runs[count, :n] = run[:n]
        count += 1
    return count


def history(
    observations: Observations,
    texel: int,
    diffuse: float,
    lights: list[Light],
    *,
    by_direction: bool = False,
) -> History:
    """The samples of a texel, and the peaks above its diffuse luminance (0..100).

    by_direction : as of `specular.texel_specular`: photographs from all around have no time
    """
    observations = of_texels(observations, np.array([texel]))
    block = observations.store.read_texels(np.array([texel]))
    count = len(block.frame)
    luminance, clipped = np.empty(count, np.float32), np.empty(count, bool)
    _luminances(block, observations.view, luminance, clipped)
    quality, rgb = (block.quality & 127) / np.float32(127), _as_seen(block, observations.view)
    if not diffuse >= 0 or not count:
        return History(block.frame, luminance, quality, clipped, rgb, [])
    most = len(lights) if by_direction else MOST_PEAKS
    numbers, ends = np.full((most, 3), np.nan), np.full((most, 4), -1, np.int64)
    runs, run = np.empty((most, count), np.int64), np.empty(count, np.int64)
    found = _peaks(
        block, observations.view, observations.sequence, observations.order, np.float32(diffuse),
        shapes(lights), by_direction, numbers, ends, run, runs,
    )  # fmt: skip
    peaks = [
        Peak(
            runs[p, : ends[p, 3]].copy(), int(ends[p, 0]),
            float(np.sqrt(numbers[p, 2])) if np.isfinite(numbers[p, 1]) else np.nan,
            int(ends[p, 1]), int(ends[p, 2]), float(numbers[p, 0]), float(numbers[p, 1]),
        )
        for p in range(found)
    ]  # fmt: skip
    return History(block.frame, luminance, quality, clipped, rgb, peaks)


def peaks_of(
    observations: Observations,
    texels: np.ndarray,
    diffuse: np.ndarray,
    lights: list[Light],
    *,
    by_direction: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """ρs (0..100) and α of some texels (n,), as `specular.texel_specular` has them of all.

    diffuse : (n,) luminance, 0..100
    """
    rho, alpha, distance = (np.full(len(texels), np.nan, np.float32) for _ in range(3))
    if lights and len(texels):
        some = of_texels(observations, texels)
        _specular(
            some.store.read_texels(texels), some.view, some.sequence, some.order,
            diffuse.astype(np.float32), shapes(lights), by_direction, False, False, rho, alpha,
            distance, np.full(len(texels), -1, np.int16),
        )  # fmt: skip
    return rho, alpha


def _as_seen(block: Block, view: View) -> np.ndarray:
    """The samples' colours as 8-bit sRGB, (n, 3)."""
    if block.rgb.dtype == np.uint8:
        return block.rgb
    return to_srgb8(view.linear[block.rgb] * view.scale[block.frame] / 100)


def of_texels(observations: Observations, texels: np.ndarray) -> Observations:
    """With the geometry of some texels, as `store.read_texels` numbers them; the store is whole."""
    view = observations.view
    return replace(
        observations,
        view=view._replace(
            position=view.position[texels], normal=view.normal[texels], face=view.face[texels],
            barycentric=view.barycentric[texels],
        ),
    )  # fmt: skip
