"""The diffuse colour of every texel, without the highlights (paper §6, eq. 3-6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..samples.observations import (
    Observations,
    color,
    fill_visibility,
    longest_history,
    mirror_axis,
    sample_luminance,
    sample_quality,
    visibility,
)
from .directions import look_up, octahedral_cell, octahedral_directions
from .threshold import LuminanceStatistics

_CELLS = 512  # of the octahedral map along a side: .35° a cell, against a cone of 5°
_STATISTICAL, _TRIMMED, _QUANTILE = range(3)
METHODS = ("statistical", "trimmed", "quantile")
NEGLIGIBLE = np.float32(-12.0)
"""log₂ of b^(w²) below which s counts as 0: w being at least ¼, s is less than 1/1024 there."""


class _Lit(NamedTuple):
    """Where light comes from, as the kernel looks it up.

    averaged : (C, C) float32, log₂ of eq. 4 without visibility, −inf where it is dark
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


def cone_average(probability: np.ndarray, cone: float, kernel: str = "angle") -> np.ndarray:
    """Eq. 4 without visibility, for every mirror direction: an octahedral map (C, C) float32."""
    out = np.empty((_CELLS, _CELLS), np.float32)
    weights = cone_weights(cone, kernel)
    for row, axes in enumerate(octahedral_directions(_CELLS)):
        values = look_up(probability, cone_directions(axes, cone).reshape(-1, 3))
        out[row] = values.reshape(_CELLS, -1) @ weights / weights.sum()
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def specular_weight(y, log_b, threshold, minimum):
    """Eq. 3 and 5, guarded: s = b^(w²) / w in [0, 1], w = (t − min) / (Y − min) in [¼, 4].

    log_b : log₂ b, −inf where no light comes from
    """
    if not y > minimum:
        return np.float32(0)
    w = np.float32((threshold - minimum) / (y - minimum))
    if not threshold - minimum >= 1e-6:
        w = np.float32(1)
    w = min(max(w, np.float32(0.25)), np.float32(4))
    exponent = np.float32(w * w * log_b)
    if not exponent > NEGLIGIBLE:
        return np.float32(0)
    return min(np.exp2(exponent) / w, np.float32(1))


@njit(cache=True, nogil=True, error_model="numpy")
def _cone_with_visibility(lit, coefficients, x, y, z):
    """Eq. 4 to the letter: V(ω) for each direction of the cone."""
    probability, cosines, sines, phis, weights = (
        lit.plain, lit.cosines, lit.sines, lit.phis, lit.weights,
    )  # fmt: skip
    height = probability.shape[0]
    sign = 1.0 if z >= 0 else -1.0
    a = -1.0 / (sign + z)
    ux, uy, uz = 1.0 + sign * x * x * a, sign * x * y * a, -sign * x
    vx, vy, vz = x * y * a, sign + y * y * a, -y
    top, bottom = 0.0, 0.0
    for k in range(len(weights)):
        c, s1, s2 = cosines[k], sines[k] * np.cos(phis[k]), sines[k] * np.sin(phis[k])
        dx, dy, dz = c * x + s1 * ux + s2 * vx, c * y + s1 * uy + s2 * vy, c * z + s1 * uz + s2 * vz
        g = weights[k] * visibility(True, coefficients, dx, dy, dz)
        row, col = octahedral_cell(dx, dy, dz, height)
        top += g * probability[row, col]
        bottom += g
    return top / bottom if bottom > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _specular_weights(block, view, i, threshold, minimum, ys, lit, letter, ws):
    """Weigh each sample of the block's texel i by how surely it is diffuse, or by s to the letter.

    Most of the map is black: there neither visibility nor exponential are needed.
    """
    t, first = block.first + i, block.offsets[i]
    coefficients = np.empty(36, np.float32)
    filled = has = False
    one = np.float32(1)
    for j in range(block.offsets[i + 1] - first):
        x, y, z = mirror_axis(view, t, block.frame[first + j])
        row, col = octahedral_cell(x, y, z, lit.averaged.shape[0])
        s = specular_weight(ys[j], lit.averaged[row, col], threshold, minimum)
        if s > 0:
            if not filled:
                has, filled = fill_visibility(view, t, coefficients), True
            unit = one / np.sqrt(x * x + y * y + z * z)
            x, y, z = x * unit, y * unit, z * unit
            if has and lit.per_direction:
                log_b = np.log2(_cone_with_visibility(lit, coefficients, x, y, z))
                s = specular_weight(ys[j], log_b, threshold, minimum)
            elif not visibility(has, coefficients, x, y, z) > 0:
                s = np.float32(0)
        ws[j] = s if letter else one - s


@njit(cache=True, nogil=True, error_model="numpy")
def _diffuse(block, view, threshold, minimum, lit, letter, method, out):
    longest = longest_history(block)
    ys, ws = np.empty(longest, np.float32), np.empty(longest, np.float32)
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        if not threshold[t] >= 0:
            continue
        for j in range(n):
            ys[j] = sample_luminance(block, view, first + j)
        if method == _STATISTICAL:
            # Bound the diffuse samples by the weighted mean and deviation
            _specular_weights(block, view, i, threshold[t], minimum[t], ys, lit, letter, ws)
            total, weight = 0.0, 0.0
            for j in range(n):
                total, weight = total + ws[j] * ys[j], weight + ws[j]
            if weight > 0:
                mu, deviation = total / weight, 0.0
                for j in range(n):
                    deviation += ws[j] * abs(ys[j] - mu)
                bound = mu + deviation / weight
            else:
                bound = np.float64(threshold[t])
        elif method == _TRIMMED:
            median = np.median(ys[:n])
            for j in range(n):
                ws[j] = abs(ys[j] - median)
            bound = np.float64(median + 1.5 * np.median(ws[:n]))
        else:
            bound = np.float64(np.quantile(ys[:n], 0.25))
        # Average the colours below the bound (eq. 6)
        limit = np.float32(bound + 1e-4)
        red, green, blue, weight = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            if ys[j] <= limit:
                q = sample_quality(block, first + j)
                r, g, b = color(block, view, first + j)
                red, green, blue, weight = red + q * r, green + q * g, blue + q * b, weight + q
        if weight > 0:
            out[t, 0], out[t, 1], out[t, 2] = red / weight, green / weight, blue / weight


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
        np.log2(averaged, out=np.full_like(averaged, -np.inf), where=averaged > 0),
        plain.astype(np.float32), cone_visibility,
        rays[:, 2].copy(), np.hypot(rays[:, 0], rays[:, 1]), np.arctan2(rays[:, 1], rays[:, 0]),
        cone_weights(cone, cone_kernel).astype(np.float32),
    )  # fmt: skip
    out = np.full((len(observations.texels), 3), np.nan, np.float32)

    def work(block):
        _diffuse(
            block, observations.view, statistics.threshold, statistics.minimum, lit,
            weights == "s", METHODS.index(method), out,
        )  # fmt: skip

    observations.store.map(work, progress)
    return out
