"""The diffuse colour once the highlights S are known: D_i = Σ w'(I − c_m S) / Σ w'.

S is what pixels show of the lobe (`pixel_blur`): around a highlight on a curved surface that is
more than the lobe itself, and would be left in D.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..blocks import places, rowwise
from ..geometry.surface_shape import steepest_turn
from ..jit import inner, kernel
from ..power import FAST
from ..ranks import quantile
from ..samples.observations import Observations, View, longest, mirrors
from ..samples.store import Block
from .footprint import SPREAD
from .lights import Light
from .lobes import add_blurred, add_sharp, clear
from .microfacet import PHONG, Gloss, specular
from .phong import Lamps, cast_shadows, lamps, light_texel
from .pixel_blur import pixel_blur
from .rows import luminances, read_row

FELT = 0.1
"""Blur by a pixel that sees the surface from straight above, of the lobe's own variance, from which
on a texel's highlights are blurred ones."""
LEAST_SCALE = 0.3
"""Of the residuals, 0..100: the noise of eight bits."""


@inner(fastmath=FAST)
def _trust(n, shine, quality, h0, h, trust):
    """Huber's threshold h = h0 + .2 S, and q / (1 + (S/10)²), what weights are before it."""
    for j in range(n):
        tenth = np.float32(0.1) * shine[j]
        h[j] = h0 + np.float32(0.2) * shine[j]
        trust[j] = quality[j] / (np.float32(1) + tenth * tenth)


@inner(fastmath=FAST)
def _weigh(n, e, d, h, trust, bound, w):
    """w' = trust · huber; a clipped sample, a `bound`, counts only if d is too dark for it.

    Returns Σ w' e and Σ w'.
    """
    top, weight = 0.0, 0.0
    for j in range(n):
        away = e[j] - d
        a = trust[j] * h[j] / max(h[j], abs(away))
        w[j] = a if away > bound[j] else np.float32(0)
        top += w[j] * e[j]
        weight += w[j]
    return top, weight


@inner(fastmath=FAST)
def _sums(n, red, green, blue, shine, w):
    """Σ w' I of each channel, and Σ w' S."""
    r, g, b, s = 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        r += w[j] * red[j]
        g += w[j] * green[j]
        b += w[j] * blue[j]
        s += w[j] * shine[j]
    return r, g, b, s


@inner
def _solve(i, m, n, red, green, blue, quality, bound, shine, rows, tint, diffuse):
    """Texel i's D from its samples without their highlights `shine`; rows (4, n) : room."""
    e, w, h, trust = rows[0], rows[1], rows[2], rows[3]
    # Subtract the lobes; weigh by the residual against the diffuse colour so far
    d = 0.2126 * diffuse[i, 0] + 0.7152 * diffuse[i, 1] + 0.0722 * diffuse[i, 2]
    luminances(n, red, green, blue, e)
    for j in range(n):
        e[j] -= shine[j]
        w[j] = abs(e[j] - np.float32(d))
    h0 = np.float32(max(LEAST_SCALE, 1.68 * quantile(w[:n], 0.5)))
    _trust(n, shine, quality, h0, h, trust)
    weight = 0.0
    for _ in range(2):
        top, weight = _weigh(n, e, np.float32(d), h, trust, bound, w)
        if weight > 0:
            d = top / weight
    if weight > 0:
        r, g, b, s = _sums(n, red, green, blue, shine, w)
        diffuse[i, 0] = max((r - tint[m, 0] * s) / weight, 0.0)
        diffuse[i, 1] = max((g - tint[m, 1] * s) / weight, 0.0)
        diffuse[i, 2] = max((b - tint[m, 2] * s) / weight, 0.0)


@kernel
def _refit(block, view, material, blurred, gloss, tint, bulbs, diffuse):
    """D of the texels whose highlights are as sharp as their lobes."""
    coefficients = np.empty(36, np.float32)
    count = len(bulbs.gain)
    rays, gains = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    rows = np.empty((13, longest(block.offsets, 0, block.stop - block.first)), np.float32)
    x, y, z, red, green, blue = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    shine, quality, bound = rows[6], rows[7], rows[8]
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        m = material[t]
        if m < 0 or not gloss.facing[m] + gloss.grazing[m] > 0 or not diffuse[i, 0] >= 0:
            continue
        if blurred[t]:
            continue
        light_texel(view, t, bulbs, coefficients, rays, gains)
        read_row(block, view, first, n, red, green, blue, quality, bound)
        mirrors(view, t, block.frame[first : first + n], x, y, z)
        clear(n, shine)
        if gloss.kind[m] == PHONG:
            add_sharp(x[:n], y[:n], z[:n], rays, gains, gloss.shape[m], gloss.facing[m], shine)
        else:
            for j in range(n):
                shine[j] = specular(gloss, m, 0.0, view.normal[t], x[j], y[j], z[j], rays, gains)
        _solve(i, m, n, red, green, blue, quality, bound, shine, rows[9:], tint, diffuse)


@kernel
def _refit_blurred(block, view, pixel, shape, material, blurred, gloss, tint, bulbs, diffuse):
    """D of the others, whose highlights pixels blur."""
    coefficients = np.empty(36, np.float32)
    count = len(bulbs.gain)
    rays, gains = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    most = longest(block.offsets, 0, block.stop - block.first)
    rows, scratch = np.empty((13, most), np.float32), np.empty((13, most), np.float32)
    mirror, blur = np.empty((most, 3), np.float32), np.empty((most, 4), np.float32)
    x, y, z, red, green, blue = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    shine, quality, bound = rows[6], rows[7], rows[8]
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        m = material[t]
        if m < 0 or not gloss.facing[m] + gloss.grazing[m] > 0 or not diffuse[i, 0] >= 0:
            continue
        if not blurred[t]:
            continue
        light_texel(view, t, bulbs, coefficients, rays, gains)
        read_row(block, view, first, n, red, green, blue, quality, bound)
        mirrors(view, t, block.frame[first : first + n], x, y, z)
        for j in range(n):
            mirror[j, 0], mirror[j, 1], mirror[j, 2] = x[j], y[j], z[j]
            blur[j, 0], blur[j, 1], blur[j, 2], blur[j, 3] = pixel_blur(
                view, pixel, shape[t], t, block.frame[first + j]
            )
        clear(n, shine)
        if gloss.kind[m] == PHONG:
            add_blurred(mirror, blur, 0, n, rays, gains, gloss.shape[m], scratch, shine)
            for j in range(n):
                shine[j] *= np.float32(gloss.facing[m])
        else:
            for j in range(n):
                s1 = blur[j, 0] ** 2 + blur[j, 1] ** 2 + blur[j, 2] ** 2
                both = 0.5 * (s1 + blur[j, 3])
                shine[j] = specular(gloss, m, both, view.normal[t], x[j], y[j], z[j], rays, gains)
        _solve(i, m, n, red, green, blue, quality, bound, shine, rows[9:], tint, diffuse)


def refitting(
    observations: Observations,
    diffuse: np.ndarray,
    material: np.ndarray,
    gloss: Gloss,
    tint: np.ndarray,
    lights: list[Light],
) -> Callable[[Block], tuple[np.ndarray]]:
    """What gives D of a block's texels with their material's highlights taken off, (B, 3) float32,
    linear RGB 0..100 (`SampleStore.rows`).

    diffuse : (T, 3), the statistical D; it stays where the material has no gloss
    material : (T,) int32, -1 for none
    gloss : of the M materials; tint : (M, 3), the highlights' colours
    """
    everywhere = places(np.ones(len(observations.texels), bool))
    bulbs = lamps(
        lights, observations.texels.radius, cast_shadows(observations, everywhere, lights)
    )
    tint, diffuse = np.asarray(tint, np.float64), np.asarray(diffuse, np.float32)
    shape = observations.shape
    shape = np.zeros((0, 3, 3), np.float32) if shape is None else shape
    return partial(
        _block_refit, observations.view, observations.pixel, shape, material,
        _blurred(observations, material, gloss), gloss, tint, bulbs, diffuse,
    )  # fmt: skip


def _blurred(observations: Observations, material: np.ndarray, gloss: Gloss) -> np.ndarray:
    """Which texels' highlights pixels blur, (T,) bool."""
    if observations.shape is None or not len(gloss.shape):
        return np.zeros(len(material), bool)
    pixel = observations.footprint * observations.texels.radius
    alpha = np.where(gloss.kind == PHONG, gloss.shape, 0.5 / np.maximum(gloss.shape, 1e-6) ** 2)

    def felt(turn: np.ndarray, own: np.ndarray) -> np.ndarray:
        blur = alpha[np.maximum(own, 0)] * SPREAD * (2 * turn * pixel) ** 2
        return np.isfinite(turn) & (blur > FELT)

    return rowwise(felt, steepest_turn(observations.shape), material)


def _block_refit(
    view: View, pixel: np.ndarray, shape: np.ndarray, material: np.ndarray, blurred: np.ndarray,
    gloss: Gloss, tint: np.ndarray, bulbs: Lamps, diffuse: np.ndarray, block: Block,
) -> tuple[np.ndarray]:  # fmt: skip
    own = diffuse[block.first : block.stop].copy()
    _refit(block, view, material, blurred, gloss, tint, bulbs, own)
    if blurred[block.first : block.stop].any():
        _refit_blurred(block, view, pixel, shape, material, blurred, gloss, tint, bulbs, own)
    return (own,)
