"""One texel's normal and strength of sheen, by search over all tilts (see sheen.py)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..jit import inner, kernel
from ..ranks import quantile
from ..samples.observations import Observations, color, sample_luminance, sample_quality
from .directions import octahedral_cell

RINGS = 4
"""Of candidate normals about the texel's own, out to two standard deviations of the prior."""
FINER = 3
"""Times that the best candidate's neighbourhood is searched at half the distance."""
DARK = 1.0
"""Luminance, 0..100, added before the logarithm: the noise of dark samples shall not count."""
STRENGTH = 0.5
"""Prior of a texel's strength: standard deviation about 1."""
WIDE = 2.0
"""Samples farther than this many noises from their texel's median weigh less."""


class Gathered(NamedTuple):
    """The samples of n texels, texel by texel.

    offsets : (n+1,) int64; frame : (N,) int32; y : (N,) float32, ln luminance; rgb : (N, 3) float32
    quality : (N,) float32; ray : (N, 3) float32, unit, towards the camera
    """

    offsets: np.ndarray
    frame: np.ndarray
    y: np.ndarray
    rgb: np.ndarray
    quality: np.ndarray
    ray: np.ndarray


@kernel
def _gather(block, places, view, texel, start, frame, y, rgb, quality, ray):
    """Copy the samples of some texels, at `places` in a block, from `start` on."""
    n = start
    for i, t in zip(places, texel):  # noqa: B905
        for j in range(block.offsets[i], block.offsets[i + 1]):
            f = block.frame[j]
            frame[n] = f
            y[n] = np.log(sample_luminance(block, view, j) + DARK)
            rgb[n, 0], rgb[n, 1], rgb[n, 2] = color(block, view, j)
            quality[n] = sample_quality(block, j)
            length = np.float32(0)
            for k in range(3):
                ray[n, k] = view.eyes[f, k] - view.position[t, k]
                length += ray[n, k] ** 2
            for k in range(3):
                ray[n, k] /= np.sqrt(length)
            n += 1


def _empty(sizes: np.ndarray) -> Gathered:
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    n = int(offsets[-1])
    return Gathered(
        offsets, np.empty(n, np.int32), np.empty(n, np.float32), np.empty((n, 3), np.float32),
        np.empty(n, np.float32), np.empty((n, 3), np.float32),
    )  # fmt: skip


def gather_block(block, observations: Observations, texel: np.ndarray) -> Gathered:
    """The samples of those texels of one block."""
    out = _empty(np.diff(block.offsets)[texel - block.first])
    _gather(block, texel - block.first, observations.view, texel, 0, *out[1:])
    return out


def gather(observations: Observations, texel: np.ndarray) -> Gathered:
    """The samples of some texels (n,), ascending."""
    out = _empty(observations.store.counts()[texel])

    def work(block, own):
        places = np.arange(own.stop - own.start)
        _gather(block, places, observations.view, texel[own], out.offsets[own.start], *out[1:])

    observations.store.map_texels(work, texel)
    return out


def tilts(sigma: float) -> np.ndarray:
    """Candidate normals about +z, (C, 3) float32, in rings out to 2 `sigma` radians."""
    out = [(0.0, 0.0, 1.0)]
    for ring in range(1, RINGS + 1 if sigma > 0 else 1):
        angle = 2 * sigma * ring / RINGS
        phi = 2 * np.pi * (np.arange(6 * ring) + 0.5 * (ring % 2)) / (6 * ring)
        out += [(np.sin(angle) * np.cos(p), np.sin(angle) * np.sin(p), np.cos(angle)) for p in phi]
    return np.array(out, np.float32)


@kernel
def weigh(samples, used, noise, weight):
    """q · Huber about the texel's median of y; 0 in frames that are not `used` (F,) bool."""
    for t in range(len(samples.offsets) - 1):
        first, stop = samples.offsets[t], samples.offsets[t + 1]
        if first == stop:
            continue
        center = quantile(samples.y[first:stop], 0.5)
        for j in range(first, stop):
            away = abs(samples.y[j] - center)
            weight[j] = samples.quality[j] * min(1.0, WIDE * noise / max(away, 1e-6))
            if not used[samples.frame[j]]:
                weight[j] = 0


@inner
def mirrored(n, ray, table):
    """The table's value at the mirror direction of `ray` about the normal n."""
    twice = np.float32(2) * (n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2])
    row, col = octahedral_cell(
        twice * n[0] - ray[0], twice * n[1] - ray[1], twice * n[2] - ray[2], table.shape[0]
    )
    return table[row, col]


@inner(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _cost(samples, weight, first, stop, n, table, prior):
    """Least ‖y − a − s·ℓ(r)‖² + prior·(s − 1)² over the level a and the strength s, and s."""
    w, wl, wy, ll, ly, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(first, stop):
        k = weight[j]
        e = mirrored(n, samples.ray[j], table)
        v = samples.y[j] - samples.y[first]
        w, wl, wy = w + k, wl + k * e, wy + k * v
        ll, ly, yy = ll + k * e * e, ly + k * e * v, yy + k * v * v
    w = max(w, 1e-9)
    ll, ly, yy = ll - wl * wl / w + prior, ly - wl * wy / w + prior, yy - wy * wy / w + prior
    s = max(ly / ll, 0.0)
    return yy - s * (2 * ly - s * ll), s


@kernel
def search(samples, weight, own, table, candidates, sigma, noise, normal, strength):
    """Normal and strength of every texel that explain its samples best.

    The priors: `own` ± `sigma` radians for the normal, 1 ± STRENGTH for the strength.
    """
    prior = (noise / STRENGTH) ** 2
    stiff = 2 * (noise / sigma) ** 2 if sigma > 0 else 0.0
    n, best, center = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    for t in range(len(samples.offsets) - 1):
        first, stop = samples.offsets[t], samples.offsets[t + 1]
        x, y, z = own[t]
        sign = np.float32(1) if z >= 0 else np.float32(-1)
        a = -np.float32(1) / (sign + z)
        u = (np.float32(1) + sign * x * x * a, sign * x * y * a, -sign * x)
        v = (x * y * a, sign + y * y * a, -y)
        least = np.inf
        # Try the rings, then the neighbourhood of the best
        center[0], center[1], center[2] = 0, 0, 1
        step = sigma / RINGS * 2
        for level in range(FINER + 1 if sigma > 0 else 1):
            for c in range(len(candidates) if level == 0 else 6):
                if level == 0:
                    p, q = candidates[c, 0], candidates[c, 1]
                else:
                    p = center[0] + np.float32(step * np.cos(np.pi / 3 * c))
                    q = center[1] + np.float32(step * np.sin(np.pi / 3 * c))
                r2 = np.float32(1) - p * p - q * q
                if not r2 > 0:
                    continue
                r = np.sqrt(r2)
                for k in range(3):
                    n[k] = p * u[k] + q * v[k] + r * own[t, k]
                cost, s = _cost(samples, weight, first, stop, n, table, prior)
                cost += stiff * (1 - r)
                if cost < least:
                    least, strength[t] = cost, s
                    best[0], best[1], best[2] = p, q, r
                    for k in range(3):
                        normal[t, k] = n[k]
            for k in range(3):
                center[k] = best[k]
            step /= 2


@kernel
def unexplained(samples, weight, test, normal, strength, table, before, after):
    """Per texel, of the samples with weight `test`: Σ of the squared error of a constant and of
    the sheen, each with the level that the samples with `weight` give."""
    for t in range(len(samples.offsets) - 1):
        w, level, plain = 0.0, 0.0, 0.0
        for j in range(samples.offsets[t], samples.offsets[t + 1]):
            e = mirrored(normal[t], samples.ray[j], table)
            w += weight[j]
            level += weight[j] * (samples.y[j] - strength[t] * e)
            plain += weight[j] * samples.y[j]
        before[t] = after[t] = 0.0
        if not w > 0:
            continue
        for j in range(samples.offsets[t], samples.offsets[t + 1]):
            e = mirrored(normal[t], samples.ray[j], table)
            before[t] += test[j] * (samples.y[j] - plain / w) ** 2
            after[t] += test[j] * (samples.y[j] - strength[t] * e - level / w) ** 2


@kernel
def level_color(samples, weight, normal, strength, table, out):
    """Σ w I / E^s / Σ w per texel, (n, 3): the colour without the sheen; NaN without weight."""
    for t in range(len(samples.offsets) - 1):
        w = 0.0
        for channel in range(3):
            out[t, channel] = 0.0
        for j in range(samples.offsets[t], samples.offsets[t + 1]):
            e = mirrored(normal[t], samples.ray[j], table)
            k = weight[j] * np.exp(-strength[t] * e)
            w += weight[j]
            for channel in range(3):
                out[t, channel] += k * samples.rgb[j, channel]
        for channel in range(3):
            out[t, channel] = out[t, channel] / w if w > 0 else np.nan
