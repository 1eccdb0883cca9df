"""The diffuse colour once the highlights S are known: D_i = Σ w'(I − c_m S) / Σ w'."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..samples.observations import (
    Observations,
    color,
    mirror_direction,
    sample_luminance,
    sample_quality,
)
from .fit_samples import is_clipped
from .lights import Light
from .microfacet import Gloss, specular
from .phong import cast_shadows, lamps, light_texel


@njit(cache=True, nogil=True)
def _refit(block, view, material, gloss, tint, bulbs, minimum_scale, diffuse):
    coefficients = np.empty(36, np.float32)
    count = len(bulbs.gain)
    rays, gains = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    longest = 0
    for i in range(block.stop - block.first):
        longest = max(longest, block.offsets[i + 1] - block.offsets[i])
    shine, e, w = np.empty(longest), np.empty(longest), np.empty(longest)
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        m = material[t]
        if m < 0 or not gloss.facing[m] + gloss.grazing[m] > 0 or not diffuse[t, 0] >= 0:
            continue
        light_texel(view, t, bulbs, coefficients, rays, gains)
        # Subtract the lobes; weigh by the residual against the diffuse colour so far
        d = 0.2126 * diffuse[t, 0] + 0.7152 * diffuse[t, 1] + 0.0722 * diffuse[t, 2]
        for j in range(n):
            x, y, z = mirror_direction(view, t, block.frame[first + j])
            shine[j] = specular(gloss, m, 0.0, view.normal[t], x, y, z, rays, gains)
            e[j] = sample_luminance(block, view, first + j) - shine[j]
        for _ in range(2):
            for j in range(n):
                w[j] = abs(e[j] - d)
            h0 = max(minimum_scale, 1.68 * np.median(w[:n]))
            top, weight = 0.0, 0.0
            for j in range(n):
                a = w[j]
                w[j] = sample_quality(block, first + j) / (1.0 + (0.1 * shine[j]) ** 2)
                w[j] *= min(1.0, (h0 + 0.2 * shine[j]) / max(a, 1e-9))
                if is_clipped(block, view, first + j) and e[j] <= d:
                    w[j] = 0.0
                top, weight = top + w[j] * e[j], weight + w[j]
            if weight > 0:
                d = top / weight
        if weight > 0:
            red, green, blue = 0.0, 0.0, 0.0
            for j in range(n):
                r, g, b = color(block, view, first + j)
                red += w[j] * (r - tint[m, 0] * shine[j])
                green += w[j] * (g - tint[m, 1] * shine[j])
                blue += w[j] * (b - tint[m, 2] * shine[j])
            diffuse[t, 0] = max(red / weight, 0.0)
            diffuse[t, 1] = max(green / weight, 0.0)
            diffuse[t, 2] = max(blue / weight, 0.0)


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

    def work(block):
        _refit(
            block,
            observations.view,
            material,
            gloss,
            np.asarray(tint, np.float64),
            bulbs,
            0.3,
            out,
        )

    observations.store.map(work, progress)
    return out
