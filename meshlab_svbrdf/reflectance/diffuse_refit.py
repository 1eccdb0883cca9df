"""The diffuse colour once the highlights S are known: D_i = Σ w'(I − c_m S) / Σ w'."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..samples.observations import Observations, color, longest, mirrors, sample_quality
from .fit_samples import is_clipped
from .lights import Light
from .lobes import add_sharp
from .microfacet import PHONG, Gloss, specular
from .phong import cast_shadows, lamps, light_texel
from .power import FAST

LEAST_SCALE = 0.3
"""Of the residuals, 0..100: the noise of eight bits."""


@njit(cache=True, nogil=True, fastmath=FAST)
def _weigh(n, e, d, shine, quality, bound, h0, w):
    """w' = q · huber / (1 + (S/10)²); a clipped sample, a `bound`, counts if d is too dark for it.

    Returns Σ w' e and Σ w'.
    """
    top, weight = 0.0, 0.0
    for j in range(n):
        away = e[j] - d
        h = (h0 + np.float32(0.2) * shine[j]) / max(abs(away), np.float32(1e-9))
        tenth = np.float32(0.1) * shine[j]
        a = quality[j] * min(np.float32(1), h) / (np.float32(1) + tenth * tenth)
        w[j] = a if away > bound[j] else np.float32(0)
        top += w[j] * e[j]
        weight += w[j]
    return top, weight


@njit(cache=True, nogil=True, fastmath=FAST)
def _mean(n, value, shine, tint, w):
    """Σ w' (I − c S) of a channel."""
    total = 0.0
    for j in range(n):
        total += w[j] * (value[j] - tint * shine[j])
    return total


@njit(cache=True, nogil=True)
def _refit(block, view, material, gloss, tint, bulbs, diffuse):
    coefficients = np.empty(36, np.float32)
    count = len(bulbs.gain)
    rays, gains = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    most = longest(block.offsets, 0, block.stop - block.first)
    x, y, z, red, green, blue, shine, e, w, quality, bound = np.empty((11, most), np.float32)
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        m = material[t]
        if m < 0 or not gloss.facing[m] + gloss.grazing[m] > 0 or not diffuse[t, 0] >= 0:
            continue
        light_texel(view, t, bulbs, coefficients, rays, gains)
        for j in range(n):
            red[j], green[j], blue[j] = color(block, view, first + j)
            quality[j] = sample_quality(block, first + j)
            bound[j] = 0.0 if is_clipped(block, view, first + j) else -np.inf
        mirrors(view, t, block.frame[first : first + n], x, y, z)
        if gloss.kind[m] == PHONG:
            shine[:n] = 0.0
            add_sharp(x[:n], y[:n], z[:n], rays, gains, gloss.shape[m], shine)
            for j in range(n):
                shine[j] *= np.float32(gloss.facing[m])
        else:
            for j in range(n):
                shine[j] = specular(gloss, m, 0.0, view.normal[t], x[j], y[j], z[j], rays, gains)
        # Subtract the lobes; weigh by the residual against the diffuse colour so far
        d = 0.2126 * diffuse[t, 0] + 0.7152 * diffuse[t, 1] + 0.0722 * diffuse[t, 2]
        for j in range(n):
            e[j] = (
                np.float32(0.2126) * red[j] + np.float32(0.7152) * green[j]
                + np.float32(0.0722) * blue[j] - shine[j]
            )  # fmt: skip
        for j in range(n):
            w[j] = abs(e[j] - np.float32(d))
        h0 = np.float32(max(LEAST_SCALE, 1.68 * np.median(w[:n])))
        for _ in range(2):
            top, weight = _weigh(n, e, np.float32(d), shine, quality, bound, h0, w)
            if weight > 0:
                d = top / weight
        if weight > 0:
            diffuse[t, 0] = max(_mean(n, red, shine, np.float32(tint[m, 0]), w) / weight, 0.0)
            diffuse[t, 1] = max(_mean(n, green, shine, np.float32(tint[m, 1]), w) / weight, 0.0)
            diffuse[t, 2] = max(_mean(n, blue, shine, np.float32(tint[m, 2]), w) / weight, 0.0)


def refit_diffuse(
    observations: Observations,
    diffuse: np.ndarray,
    material: np.ndarray,
    gloss: Gloss,
    tint: np.ndarray,
    lights: list[Light],
    progress=lambda done, total: None,
) -> np.ndarray:
    """D of every texel with its material's highlights taken off, (T, 3) float32, linear RGB 0..100.

    Parameters
    ----------
    diffuse : (T, 3), the statistical D; it stays where the material has no gloss
    material : (T,) int32, -1 for none
    gloss : of the M materials; tint : (M, 3), the highlights' colours
    """
    out = diffuse.astype(np.float32).copy()
    everywhere = np.arange(len(observations.texels))
    bulbs = lamps(
        lights, observations.texels.radius, cast_shadows(observations, everywhere, lights)
    )
    tint = np.asarray(tint, np.float64)
    observations.store.map(
        lambda block: _refit(block, observations.view, material, gloss, tint, bulbs, out), progress
    )
    return out
