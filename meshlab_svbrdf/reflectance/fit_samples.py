"""The samples that the joint fit works on, held in memory: some texels of every material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..blocks import blocks, places, room, rowwise, taken
from ..jit import inner, kernel
from ..samples.observations import (
    Observations,
    color,
    mirror_direction,
    sample_luminance,
    sample_quality,
)
from .pixel_blur import pixel_blur
from .rows import clips
from .threshold import MINIMUM_SAMPLES

FLAT_SHARE, FLAT_LEAST = 0.05, 400
"""Of a material, by share and number, what the fit works on at least, flat or not."""


@dataclass(frozen=True)
class FitSamples:
    """n texels with N samples, texel by texel.

    texel : (n,) indices; material : (n,) int32; offsets : (n+1,) int64
    luminance : (N,) float32, 0..100; rgb : (N, 3) float32; quality : (N,) float32
    clipped : (N,) bool; mirror : (N, 3) float32, mirror directions
    blur : (N, 4) float32, how far their pixels spread the mirror direction, from `pixel_blur`
    """

    texel: np.ndarray
    material: np.ndarray
    offsets: np.ndarray
    luminance: np.ndarray
    rgb: np.ndarray
    quality: np.ndarray
    clipped: np.ndarray
    mirror: np.ndarray
    blur: np.ndarray

    def __len__(self) -> int:
        return len(self.luminance)

    def blurred(self, times: float) -> FitSamples:
        """The same samples, blurred by so many times the variance."""
        if times == 1:
            return self
        return replace(self, blur=self.blur * np.array([times**0.5] * 3 + [times], np.float32))

    @cached_property
    def mean_blur(self) -> np.ndarray:
        """Variance by which pixels spread the mirror direction, mean of both axes, (N,)."""
        return 0.5 * (np.einsum("na,na->n", self.blur[:, :3], self.blur[:, :3]) + self.blur[:, 3])


@inner
def is_clipped(block, view, j):
    """Any tap of sample j was clipped, or its luminance before dividing by exposure is above 98."""
    red, green, blue = block.value[j, 0], block.value[j, 1], block.value[j, 2]
    return clips(block.value[j, 3], view.linear[red], view.linear[green], view.linear[blue])


@kernel
def _collect(
    block, view, pixel, shape, chosen, start, luminance, rgb, quality, clipped, mirror, blur
):
    """Copy the chosen texels' samples from `start` on."""
    n = start
    for i in range(len(chosen)):
        for j in range(block.offsets[i], block.offsets[i + 1]):
            luminance[n] = sample_luminance(block, view, j)
            rgb[n, 0], rgb[n, 1], rgb[n, 2] = color(block, view, j)
            quality[n] = sample_quality(block, j)
            clipped[n] = is_clipped(block, view, j)
            mirror[n, 0], mirror[n, 1], mirror[n, 2] = mirror_direction(
                view, chosen[i], block.frame[j]
            )
            if len(shape):
                blur[n, 0], blur[n, 1], blur[n, 2], blur[n, 3] = pixel_blur(
                    view, pixel, shape[chosen[i]], chosen[i], block.frame[j]
                )
            n += 1


def collect(observations: Observations, texel: np.ndarray, material: np.ndarray) -> FitSamples:
    """Read the samples of some texels (n,), ascending, of the given materials (n,)."""
    shape = (
        observations.shape if observations.shape is not None else np.zeros((0, 3, 3), np.float32)
    )
    counts = observations.store.counts()[texel]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    total = int(offsets[-1])
    columns = (
        np.empty(total, np.float32), np.empty((total, 3), np.float32), np.empty(total, np.float32),
        np.empty(total, bool), np.empty((total, 3), np.float32), np.zeros((total, 4), np.float32),
    )  # fmt: skip

    def work(block, own):
        _collect(
            block, observations.view, observations.pixel, shape, texel[own], offsets[own.start],
            *columns,
        )  # fmt: skip

    observations.store.map_texels(work, texel)
    return FitSamples(texel, material.astype(np.int32), offsets, *columns)


def flat_limits(alpha: np.ndarray, curvature: float, footprint: float) -> np.ndarray:
    """The largest turn of a normal that lobes of shininess α (M,) bear, radians per radius.

    curvature : c of "twice the normal's turn per pixel < c/√α"; 0: any; footprint : a pixel, radii
    """
    if curvature == 0:
        return np.full(len(alpha), np.inf)
    return curvature / np.sqrt(alpha) / (2 * footprint)


def choose_texels(
    material: np.ndarray,
    counts: np.ndarray,
    turn: np.ndarray,
    limits: np.ndarray,
    samples: int,
    offset: int = 0,
) -> tuple[np.ndarray, list[int]]:
    """Evenly spaced texels of every material, the flat ones only.

    Parameters
    ----------
    material : (T,) int32, -1 for none; counts : (T,) samples per texel; turn : (T,) radians per
        radius
    limits : (M,) largest turn; where less than 5 % of a material (or 400 texels) has it, its
        flattest are taken
    samples : about how many samples to choose altogether; the materials share them evenly
    offset : another one chooses other texels (for samples held out of the fit)

    Returns
    -------
    texels : (n,) ascending
    lacking : the materials of which less are flat enough
    """
    chosen, lacking = [np.zeros(0, np.int64)], []
    usable, first, stop = _by_material(material, counts, len(limits))
    ids = np.flatnonzero(stop > first)
    for m in ids:
        own = usable[first[m] : stop[m]]
        share = min(max(FLAT_SHARE, FLAT_LEAST / len(own)), 1)
        flattest = np.quantile(taken(turn, own), share, overwrite_input=True)
        if flattest > limits[m]:
            lacking.append(int(m))
        most = max(limits[m], flattest)
        flat = places(rowwise(lambda some, most=most: turn[some] <= most, own))
        count = sum(int(counts[own[flat[block]]].sum()) for block in blocks(len(flat)))
        stride = max(2, int(np.ceil(count * len(ids) / samples)))
        chosen.append(own[flat[offset % stride :: stride]])
    return np.sort(np.concatenate(chosen)), lacking


def _by_material(
    material: np.ndarray, counts: np.ndarray, materials: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The texels (n,) with enough samples, material by material, ascending, and where each
    material's (M,) begin and end."""

    def own(block: slice) -> np.ndarray:
        return np.flatnonzero((counts[block] >= MINIMUM_SAMPLES) & (material[block] >= 0))

    sizes = np.zeros(materials, np.int64)
    for block in blocks(len(material)):
        sizes += np.bincount(material[block][own(block)], minlength=materials)
    stop = np.cumsum(sizes)
    cursor, usable = stop - sizes, room(int(sizes.sum()), np.int64)
    for block in blocks(len(material)):
        here = own(block)
        of = material[block][here].astype(np.min_scalar_type(materials))  # small ones sort by radix
        order = np.argsort(of, kind="stable")
        here, of = here[order], of[order]
        size = np.bincount(of, minlength=materials)
        usable[cursor[of] + np.arange(len(of)) - (np.cumsum(size) - size)[of]] = here + block.start
        cursor += size
    return usable, stop - sizes, stop
