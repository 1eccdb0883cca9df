"""A few frames projected to a few texels: what a scene's samples will be, before there are any.

Both are spread evenly over the views and the surface, and never chosen by what the frames show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.mesh import Mesh
from ..geometry.texels import Texels
from ..samples.chunks import SampledFrame
from ..samples.luminance import decode, luminance

GOOD = 0.3  # quality of the samples that count: away from silhouettes, where pixels mix
ENOUGH_SAMPLES = 8  # of a texel, to judge it
ENOUGH_TEXELS = 1000  # judged, to judge the object
RISE = 10.0  # noises above the median from which a sample may be a highlight's
LEAST_NOISE = 1 / 6  # luminance, 0..100
ALIKE = 100  # texels, about, whose noise is pooled

# Shares of the judged texels up to which there are no highlights. On a film of matt clay they are
# .003, .006 and .04; of clay with the faintest gloss, α = 8 and ρs = .05: .04, .06 and .67.
RISING, UNSTEADY, LOPSIDED = 0.005, 0.03, 0.08
STEADY = 0.15  # of the median: a texel that varies by more may vary by a broad highlight


@dataclass(frozen=True)
class Highlights:
    """What a trial says of highlights.

    judged : texels with enough samples
    rising : of these, texels with a sample far above their median, or clipped
    unsteady : of these, texels whose samples vary throughout
    lopsided : of these, texels that reach twice as far above their median as below, less those that
        do the opposite: noise has no side, and highlights have
    """

    judged: int
    rising: int
    unsteady: int
    lopsided: int

    @property
    def none(self) -> bool:
        """Whether there are surely none. Where one cannot tell, there may be."""
        return (
            self.judged >= ENOUGH_TEXELS
            and self.rising <= RISING * self.judged
            and self.unsteady <= UNSTEADY * self.judged
            and abs(self.lopsided) <= LOPSIDED * self.judged
        )


def surface_texels(mesh: Mesh, count: int) -> Texels:
    """`count` points of the surface as texels, as dense as the texels of its charts.

    They lie at the middles of equal parts of the charts' area (of the surface's where there are no
    charts), face by face. They have no place in a texture.
    """
    weight = _areas(mesh.vertices[mesh.faces]) if mesh.uv is None else _areas(mesh.uv)
    weight = np.where(np.isfinite(weight), weight, 0.0)
    if not weight.sum() > 0:
        weight = np.ones(len(mesh.faces))
    total = np.cumsum(weight)
    face = np.searchsorted(total, (np.arange(count) + 0.5) * total[-1] / count)
    face = np.minimum(face, len(mesh.faces) - 1).astype(np.int32)

    # Spread them within the faces (the plastic number's sequence, folded into the triangle)
    u, v = ((np.arange(count)[:, None] + 1) * [0.7548776662, 0.5698402910] % 1).T
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    barycentric = np.column_stack([1 - u - v, u, v]).astype(np.float32)
    corners = mesh.faces[face]
    center = mesh.center
    position = np.einsum("tc,tcd->td", barycentric, mesh.vertices[corners] - center)
    normal = np.einsum("tc,tcd->td", barycentric, mesh.vertex_normals()[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    none = np.zeros(count, np.int32)
    return Texels(
        position.astype(np.float32), normal.astype(np.float32), face, barycentric,
        none.astype(np.uint8), none, none, center, mesh.radius, ((1, 1),),
    )  # fmt: skip


def seek_highlights(frames: Sequence[SampledFrame], count: int) -> Highlights:
    """Whether any samples rise above their texel's median by more than noise.

    frames : what the sampler found; count : texels that there are

    A texel's noise is taken from the lower half of its samples, which highlights do not reach; a
    few samples may seem quieter than they are, so it is at least what is usual at its brightness.
    """
    every = SampledFrame(*(np.concatenate(part) for part in zip(*frames, strict=True)))
    good = (every.quality & 127) >= GOOD * 127
    texel, bright = every.texel[good], 100 * luminance(decode(every.rgb[good] / 255))
    clipped = every.quality[good] > 127
    order = np.lexsort((bright, texel))
    texel, bright, clipped = texel[order], bright[order], clipped[order]
    number = np.bincount(texel, minlength=count)
    first = np.cumsum(number) - number
    judged = np.flatnonzero(number >= ENOUGH_SAMPLES)
    first, number = first[judged], number[judged]
    least, low, below, above, most = (
        bright[first + k]
        for k in (0 * number, number // 4, (number - 1) // 2, number // 2, number - 1)
    )
    median = (below + above) / 2
    own = (median - low) / 0.6745
    noise = np.maximum.reduce([own, _usual(own, median), np.full(len(own), LEAST_NOISE)])
    saturated = np.bincount(texel, weights=clipped, minlength=count)[judged] > 0
    up, down = most - median, median - least
    return Highlights(
        judged=len(judged),
        rising=int(((up > RISE * noise) | saturated).sum()),
        unsteady=int((own > np.maximum(STEADY * median, LEAST_NOISE)).sum()),
        lopsided=int((up > 2 * down + LEAST_NOISE).sum() - (down > 2 * up + LEAST_NOISE).sum()),
    )


def _usual(noise: np.ndarray, brightness: np.ndarray) -> np.ndarray:
    """Each texel's (N,) median noise among those about as bright as it."""
    usual = np.zeros(len(noise))
    for alike in np.array_split(np.argsort(brightness, kind="stable"), max(1, len(noise) // ALIKE)):
        usual[alike] = np.median(noise[alike]) if len(alike) else 0.0
    return usual


def _areas(corners: np.ndarray) -> np.ndarray:
    """Of triangles (F, 3, 2 or 3)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if corners.shape[2] == 2:
        return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    return np.linalg.norm(np.cross(a, b), axis=1) / 2
