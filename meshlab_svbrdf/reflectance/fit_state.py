"""The joint fit's samples with what it presently makes of them: weights, lobes, residuals."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..jit import kernel
from ..samples.observations import Observations, longest
from .elimination import Profile, eliminate, profile
from .evidence import Evidence, weigh_evidence
from .fit_samples import FitSamples
from .lights import Light
from .lobes import add_blurred, clear
from .phong import cast_shadows, lamps, light_texels
from .shadow_edges import alike, kept, shadow_edges


@kernel
def _predict(
    first, stop, offsets, material, y, mirror, blur, rays, gains, rho, alpha, w, specular, residual
):  # fmt: skip
    """S and e = y − D − S with each texel's D; `w` holds the weights of the round before."""
    scratch = np.empty((13, longest(offsets, first, stop)), np.float32)
    for i in range(first, stop):
        m, start, end = material[i], offsets[i], offsets[i + 1]
        shine = specular[start:end]
        clear(end - start, shine)
        if rho[m] > 0:
            add_blurred(
                mirror, blur, start, end - start, rays[i], gains[i], alpha[m], scratch, shine
            )
        top, bottom = 0.0, 0.0
        for j in range(start, end):
            specular[j] *= np.float32(rho[m])
            tenth = np.float32(0.1) * specular[j]
            weight = w[j] / (np.float32(1) + tenth * tenth)
            top += weight * (y[j] - specular[j])
            bottom += weight
        diffuse = top / bottom if bottom > 0 else 0.0
        for j in range(start, end):
            residual[j] = y[j] - diffuse - specular[j] if bottom > 0 else 0.0


@kernel
def _reweigh(
    first, stop, offsets, material, quality, clipped, specular, residual, scale, use_clipped, w
):
    """w = q · huber, h = h0 + .2 S; a clipped sample counts only if it was predicted too dark."""
    for i in range(first, stop):
        h0 = scale[material[i]]
        for j in range(offsets[i], offsets[i + 1]):
            e = residual[j]
            if clipped[j] and not (use_clipped and e > 0):
                w[j] = 0.0
                continue
            h = h0 + 0.2 * specular[j]
            w[j] = quality[j] * min(1.0, h / max(abs(e), 1e-9))


class Chunks:
    """Maps work over ranges of texels on all cores; the ranges do not depend on the threads."""

    def __init__(self, texels: int, pool: ThreadPoolExecutor, pieces: int = 16):
        edges = np.linspace(0, texels, pieces + 1).astype(int)
        self.ranges = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
        self.pool = pool

    def __call__(self, work: Callable[[int, int], object]) -> list:
        return list(self.pool.map(lambda r: work(*r), self.ranges))


@kernel
def _by_material(offsets, material, residual, weight, cursor, size):
    """|e| where there is weight, where the cursors of the materials stand; these move on."""
    size_known = len(size) > 0
    for i in range(len(material)):
        k = cursor[material[i]]
        for j in range(offsets[i], offsets[i + 1]):
            if weight[j] > 0:
                if size_known:
                    size[k] = abs(residual[j])
                k += 1
        cursor[material[i]] = k


def huber_scale(
    samples: FitSamples, residual: np.ndarray, weight: np.ndarray, materials: int
) -> np.ndarray:
    """h0 = max(.3, 1.68 · median |e|) of each material."""
    counts, given = np.zeros(materials, np.int64), (samples.offsets, samples.material)
    _by_material(*given, residual, weight, counts, np.empty(0, residual.dtype))
    ends, size = np.cumsum(counts), np.empty(counts.sum(), residual.dtype)
    _by_material(*given, residual, weight, ends - counts, size)
    scale = np.full(materials, 0.3)
    for m, e in enumerate(np.split(size, ends[:-1])):
        if len(e):
            scale[m] = max(0.3, 1.68 * float(np.median(e)))
    return scale


class FitState:
    """The arrays of one set of samples that the rounds go over."""

    def __init__(
        self,
        observations: Observations,
        samples: FitSamples,
        materials: int,
        pool: ThreadPoolExecutor,
    ):
        self.observations, self.samples, self.materials = observations, samples, materials
        self.position = observations.view.position[samples.texel]
        self.chunks = Chunks(len(samples.texel), pool)
        self.quality = samples.quality
        self.weight = np.where(samples.clipped, 0, samples.quality).astype(np.float32)
        self.specular = np.zeros(len(samples), np.float32)
        self.residual = np.zeros(len(samples), np.float32)
        self._lit: np.ndarray | None = None
        self._lit_by: list[Light] = []
        self._edges_of: list[Light] = []

    def light(self, lights: list[Light]) -> None:
        """Light the texels."""
        texels, own = self.samples.texel, self.observations
        if not alike(lights, self._lit_by):  # else shadows move between their edges alone
            self._lit, self._lit_by = cast_shadows(own, texels, lights), lights
        self.lamps = lamps(lights, own.texels.radius, self._lit)
        self.rays, self.gains = light_texels(own.view, texels, self.lamps)

    def profiles(self, near: np.ndarray | None = None) -> list[Profile]:
        """Every material's; near (M,): only about these shininesses, where they are > 1."""
        sums = eliminate(
            self.samples, self.weight, self.rays, self.gains, self.materials, self.chunks, near
        )
        return [profile(s) for s in sums]

    def predict(self, rho: np.ndarray, alpha: np.ndarray) -> None:
        s = self.samples
        self.chunks(lambda a, b: _predict(
            a, b, s.offsets, s.material, s.luminance, s.mirror, s.blur, self.rays, self.gains,
            rho, alpha, self.weight, self.specular, self.residual,
        ))  # fmt: skip

    def evidence(self, noise: np.ndarray | None = None) -> list[Evidence]:
        """What speaks for the lobes predicted; noise (M,): of the residuals, 0 where not given."""
        noise = np.zeros(self.materials) if noise is None else noise
        return weigh_evidence(
            self.samples, self.weight, self.specular, self.residual, noise, self.chunks
        )

    def reweigh(self, use_clipped: bool) -> np.ndarray:
        """Weights by residuals, none at edges of shadows; h0 (M,) of the materials."""
        self._leave_edges_out()
        s = self.samples
        scale = huber_scale(s, self.residual, self.weight, self.materials)
        self.chunks(lambda a, b: _reweigh(
            a, b, s.offsets, s.material, self.quality, s.clipped, self.specular, self.residual,
            scale, use_clipped, self.weight,
        ))  # fmt: skip
        return scale

    def _leave_edges_out(self) -> None:
        s, lights = self.samples, self._lit_by
        if self._lit is None or alike(lights, self._edges_of):
            return
        keep = kept(shadow_edges(self.observations, s.texel, lights, self._lit), s.material)
        self.quality = np.where(np.repeat(keep, np.diff(s.offsets)), s.quality, np.float32(0))
        self._edges_of = lights
