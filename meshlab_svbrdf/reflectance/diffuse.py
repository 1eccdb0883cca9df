"""The diffuse colour of every texel, without the highlights (paper §6, eq. 3-6)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from ..geometry.harmonics import evaluate_all, scale_coefficients
from ..jit import inner, kernel
from ..power import FAST, exp
from ..ranks import quantile
from ..samples.observations import (
    VISIBLE,
    Observations,
    fill_visibility,
    longest,
    mirrors,
    visibility,
)
from ..samples.store import Block
from ..threads import thread_count
from .directions import (
    look_up,
    octahedral_cell,
    octahedral_cells,
    octahedral_directions,
    pixel,
)
from .rows import luminances, read_row
from .threshold import LuminanceStatistics

_CELLS = 512  # of the octahedral map along a side: .35° a cell, against a cone of 5°
_STATISTICAL, _TRIMMED, _QUANTILE = range(3)
METHODS = ("statistical", "trimmed", "quantile")
DARK = np.float32(-1e6)
"""ln b where no light comes from."""


class _Lit(NamedTuple):
    """Where light comes from, as the kernel looks it up.

    averaged : (C²,) float32, ln of eq. 4 without visibility, or `DARK`, cell by cell
    plain : (C, C) float32, the map; per_direction : eq. 4 to the letter, in `plain`
    cosines, sines, phis, weights : (16,) float32, the cone's directions and g
    """

    averaged: np.ndarray
    plain: np.ndarray
    per_direction: bool
    cosines: np.ndarray
    sines: np.ndarray
    phis: np.ndarray
    weights: np.ndarray


def cone_directions(axis: np.ndarray, cone: float, rings: int = 4) -> np.ndarray:
    """rings² directions stratified over the cone of `cone` degrees about unit axes.

    axis : (..., 3); returns (..., rings², 3), equal solid angles around each.
    """
    k = (np.arange(rings) + 0.5) / rings
    cos = 1 - k * (1 - np.cos(np.radians(cone)))
    cos, phi = (m.ravel() for m in np.meshgrid(cos, 2 * np.pi * k, indexing="ij"))
    sin = np.sqrt(1 - cos**2)
    x, y, z = np.moveaxis(axis, -1, 0)
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    u = np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x], -1)
    v = np.stack([x * y * a, sign + y * y * a, -y], -1)
    return (
        axis[..., None, :] * cos[:, None]
        + u[..., None, :] * (sin * np.cos(phi))[:, None]
        + v[..., None, :] * (sin * np.sin(phi))[:, None]
    )


def cone_weights(cone: float, kernel: str, rings: int = 4) -> np.ndarray:
    """g of each cone direction: "angle" exp(−θ²/2σ²) with σ the cone's angle; "literal" on the dot
    product with σ = cos of the angle, as printed."""
    axis = np.array([0, 0, 1.0])
    cos = cone_directions(axis, cone, rings) @ axis
    if kernel == "angle":
        return np.exp(-0.5 * (np.arccos(np.clip(cos, -1, 1)) / np.radians(cone)) ** 2)
    return np.exp(-0.5 * ((1 - cos) / np.cos(np.radians(cone))) ** 2)


@inner
def _across(x, y, z):
    """The two axes across (x, y, z) of `cone_directions`."""
    sign = 1.0 if z >= 0 else -1.0
    a = -1.0 / (sign + z)
    return (
        1.0 + sign * x * x * a, sign * x * y * a, -sign * x,
        x * y * a, sign + y * y * a, -y,
    )  # fmt: skip


def cone_average(probability: np.ndarray, cone: float, kernel: str = "angle") -> np.ndarray:
    """Eq. 4 without visibility, for every mirror direction: an octahedral map (C, C) float32."""
    out = np.empty((_CELLS, _CELLS), np.float32)
    rays = cone_directions(np.array([0, 0, 1.0]), cone)
    weights = cone_weights(cone, kernel)
    axes = octahedral_directions(_CELLS)

    def work(row: int) -> None:
        _cone_averages(probability, axes[row], rays, weights / weights.sum(), out[row])

    with ThreadPoolExecutor(thread_count()) as pool:
        list(pool.map(work, range(_CELLS)))
    return out


@kernel
def _cone_averages(probability, axes, rays, weights, out):
    """The map's weighted means over cones about unit axes (N, 3), to out (N,).

    rays : (16, 3), a cone's directions about +z
    """
    for i in range(len(axes)):
        x, y, z = axes[i, 0], axes[i, 1], axes[i, 2]
        ux, uy, uz, vx, vy, vz = _across(x, y, z)
        total = 0.0
        for k in range(len(rays)):
            a, b, c = rays[k, 0], rays[k, 1], rays[k, 2]
            row, col = pixel(
                c * x + a * ux + b * vx, c * y + a * uy + b * vy, c * z + a * uz + b * vz,
                probability.shape[0],
            )  # fmt: skip
            total += weights[k] * probability[row, col]
        out[i] = total


@kernel
def specular_weight(y, log_b, threshold, minimum):
    """Eq. 3 and 5, guarded: s = b^(w²) / w in [0, 1], w = (t − min) / (Y − min) in [¼, 4]; float32.

    log_b : ln b, `DARK` where no light comes from
    """
    zero, one = np.float32(0), np.float32(1)
    w = np.float32((threshold - minimum) / (y - minimum))
    w = w if threshold - minimum >= 1e-6 else one
    w = min(max(w, np.float32(0.25)), np.float32(4))
    exponent = np.float32(w * w * log_b)
    s = min(exp(exponent) / w, one)
    return s if (y > minimum) & (exponent > DARK / 16) else zero


@inner
def _cone_with_visibility(lit, coefficients, x, y, z):
    """Eq. 4 to the letter: V(ω) for each direction of the cone."""
    probability, cosines, sines, phis, weights = (
        lit.plain, lit.cosines, lit.sines, lit.phis, lit.weights,
    )  # fmt: skip
    height = probability.shape[0]
    ux, uy, uz, vx, vy, vz = _across(x, y, z)
    top, bottom = 0.0, 0.0
    for k in range(len(weights)):
        c, s1, s2 = cosines[k], sines[k] * np.cos(phis[k]), sines[k] * np.sin(phis[k])
        dx, dy, dz = c * x + s1 * ux + s2 * vx, c * y + s1 * uy + s2 * vy, c * z + s1 * uz + s2 * vz
        ray = np.float32(dx), np.float32(dy), np.float32(dz)
        g = weights[k] * visibility(True, coefficients, ray[0], ray[1], ray[2])
        row, col = octahedral_cell(dx, dy, dz, height)
        top += g * probability[row, col]
        bottom += g
    return top / bottom if bottom > 0 else 0.0


@inner
def _specular_weights(block, view, i, threshold, minimum, ys, lit, letter, rows, cell, ws):
    """Weigh each sample of the block's texel i by how surely it is diffuse, or by s to the letter.

    Whole rows of samples at a time, for the compiler makes vector instructions of such loops.
    """
    t, first, stop = block.first + i, block.offsets[i], block.offsets[i + 1]
    n, coefficients, one = stop - first, np.empty(36, np.float32), np.float32(1)
    x, y, z, log_b, seen = rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n], rows[4, :n]
    mirrors(view, t, block.frame[first:stop], x, y, z)
    octahedral_cells(x, y, z, lit.plain.shape[0], cell)
    for j in range(n):
        log_b[j] = lit.averaged[cell[j]]
    if fill_visibility(view, t, coefficients):
        if lit.per_direction:
            for j in range(n):
                b = _cone_with_visibility(lit, coefficients, x[j], y[j], z[j])
                log_b[j] = np.log(b) if b > 0 else DARK
        else:
            scale_coefficients(coefficients, coefficients)
            evaluate_all(coefficients, x, y, z, seen)
            for j in range(n):
                log_b[j] = log_b[j] if seen[j] > VISIBLE else DARK
    for j in range(n):
        s = specular_weight(ys[j], log_b[j], threshold, minimum)
        ws[j] = s if letter else one - s


@inner(fastmath=FAST)
def _weighted_bound(ys, ws, otherwise):
    """Weighted mean and deviation, added; `otherwise` where nothing has weight."""
    total, weight, deviation = 0.0, 0.0, 0.0
    for j in range(len(ys)):
        total += ws[j] * ys[j]
        weight += ws[j]
    if not weight > 0:
        return otherwise
    mu = np.float32(total / weight)
    for j in range(len(ys)):
        deviation += ws[j] * abs(ys[j] - mu)
    return np.float32(mu + deviation / weight)


@inner(fastmath=FAST)
def _mean_below(ys, bound, quality, red, green, blue):
    """Mean colour, weighted by quality, where Y is no more than the bound; NaN for none."""
    r = g = b = weight = np.float64(0)
    for j in range(len(ys)):
        q = quality[j] if ys[j] <= bound else np.float32(0)
        r += q * red[j]
        g += q * green[j]
        b += q * blue[j]
        weight += q
    if not weight > 0:
        return np.nan, np.nan, np.nan
    return r / weight, g / weight, b / weight


@kernel
def _diffuse(block, view, threshold, minimum, lit, letter, method, out):
    most = longest(block.offsets, 0, block.stop - block.first)
    buffer, rows = np.empty((6, most), np.float32), np.empty((5, most), np.float32)
    cell = np.empty(most, np.uint32)
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        if not threshold[t] >= 0:
            continue
        red, green, blue, quality = buffer[0, :n], buffer[1, :n], buffer[2, :n], buffer[3, :n]
        ys, ws = buffer[4, :n], buffer[5, :n]
        read_row(block, view, first, n, red, green, blue, quality, ws)
        luminances(n, red, green, blue, ys)
        # Bound the diffuse samples
        if method == _STATISTICAL:
            _specular_weights(
                block, view, i, threshold[t], minimum[t], ys, lit, letter, rows, cell, ws
            )
            bound = float(_weighted_bound(ys, ws, threshold[t]))
        elif method == _TRIMMED:
            median = quantile(ys, 0.5)
            for j in range(n):
                ws[j] = abs(ys[j] - median)
            bound = float(median + 1.5 * quantile(ws, 0.5))
        else:
            bound = float(quantile(ys, 0.25))
        # Average the colours below the bound (eq. 6)
        limit = np.float32(bound + 1e-4)
        out[i, 0], out[i, 1], out[i, 2] = _mean_below(ys, limit, quality, red, green, blue)


def diffuse_color(
    observations: Observations,
    statistics: LuminanceStatistics,
    probability: np.ndarray,
    *,
    method: str = "statistical",
    cone: float = 5.0,
    cone_kernel: str = "angle",
    cone_visibility: bool = False,
    weights: str = "1-s",
    progress=lambda done, total: None,
) -> np.ndarray:
    """D of every texel, (T, 3) float32, linear RGB 0..100; NaN where unobserved.

    Parameters
    ----------
    probability : (H, 2H), the normalised environment map
    method : "statistical" is the paper's; "trimmed" averages the samples below median + 1.5 MAD;
        "quantile" averages those below the first quartile. The last two need no environment map.
    cone : half angle of the cone of directions about the mirror direction, degrees
    cone_kernel : "angle" or "literal", see `cone_weights`
    cone_visibility : V(ω) in each of the 16 directions (eq. 4's letter) instead of V(r) once; slow
    weights : mean and deviation weighted with "1-s" or, to the letter, "s", which biases upward
    """
    averaged = cone_average(probability, cone, cone_kernel)
    plain = look_up(probability, octahedral_directions(_CELLS).reshape(-1, 3)).reshape(
        _CELLS, _CELLS
    )
    rays = cone_directions(np.array([0, 0, 1.0]), cone).astype(np.float32)
    lit = _Lit(
        np.log(averaged, out=np.full_like(averaged, DARK), where=averaged > 0).ravel(),
        plain.astype(np.float32), cone_visibility,
        rays[:, 2].copy(), np.hypot(rays[:, 0], rays[:, 1]), np.arctan2(rays[:, 1], rays[:, 0]),
        cone_weights(cone, cone_kernel).astype(np.float32),
    )  # fmt: skip
    work = partial(
        _block_diffuse, observations.view, statistics.threshold, statistics.minimum, lit,
        weights == "s", METHODS.index(method),
    )  # fmt: skip
    return observations.store.rows(work, progress)[0]


def _block_diffuse(view, threshold, minimum, lit, letter, method, block: Block):
    """D of a block's texels."""
    out = np.full((block.stop - block.first, 3), np.nan, np.float32)
    _diffuse(block, view, threshold, minimum, lit, letter, method, out)
    return (out,)
