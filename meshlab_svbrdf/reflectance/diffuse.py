"""The diffuse colour of every texel, without the highlights (paper §6, eq. 3-6)."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..samples.observations import (
    Observations,
    color,
    fill_visibility,
    mirror_direction,
    sample_luminance,
    sample_quality,
    visibility,
)
from .directions import look_up, octahedral_cell, octahedral_directions
from .threshold import LuminanceStatistics

_CELLS = 512  # of the octahedral map along a side: .35° a cell, against a cone of 5°
_STATISTICAL, _TRIMMED, _QUANTILE = range(3)
METHODS = ("statistical", "trimmed", "quantile")


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


@njit(cache=True, nogil=True)
def specular_weight(y, b, threshold, minimum):
    """Eq. 3 and 5, guarded: s = b^(w²) / w in [0, 1], w = (t − min) / (Y − min) in [¼, 4]."""
    if not (y > minimum and b > 0):
        return 0.0
    w = (threshold - minimum) / (y - minimum) if threshold - minimum >= 1e-6 else 1.0
    w = min(max(w, 0.25), 4.0)
    return min(b ** (w * w) / w, 1.0)


@njit(cache=True, nogil=True)
def _cone_with_visibility(
    probability, coefficients, x, y, z, cosines, sines, phis, weights, height
):
    """Eq. 4 to the letter: V(ω) for each direction of the cone."""
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


@njit(cache=True, nogil=True)
def _diffuse(
    block, view, threshold, minimum, averaged, plain, cone, per_direction, letter, method, out
):
    coefficients = np.empty(36, np.float32)
    longest = 0
    for i in range(block.stop - block.first):
        longest = max(longest, block.offsets[i + 1] - block.offsets[i])
    ys, ws = np.empty(longest, np.float32), np.empty(longest, np.float32)
    for i in range(block.stop - block.first):
        t, first = block.first + i, block.offsets[i]
        n = block.offsets[i + 1] - first
        if not threshold[t] >= 0:
            continue
        for j in range(n):
            ys[j] = sample_luminance(block, view, first + j)
        if method == _STATISTICAL:
            # Weigh each sample by how surely it is diffuse
            has = fill_visibility(view, t, coefficients)
            for j in range(n):
                x, y, z = mirror_direction(view, t, block.frame[first + j])
                row, col = octahedral_cell(x, y, z, averaged.shape[0])
                b = averaged[row, col]
                if b > 0 and per_direction and has:
                    b = _cone_with_visibility(
                        plain,
                        coefficients,
                        x,
                        y,
                        z,
                        cone[0],
                        cone[1],
                        cone[2],
                        cone[3],
                        plain.shape[0],
                    )
                elif b > 0 and not visibility(has, coefficients, x, y, z) > 0:
                    b = np.float32(0)
                s = specular_weight(ys[j], b, threshold[t], minimum[t])
                ws[j] = s if letter else 1.0 - s
            # Bound the diffuse samples by the weighted mean and deviation
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
        red, green, blue, weight = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            if ys[j] <= bound + 1e-4:
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
    rays = cone_directions(np.array([0, 0, 1.0]), cone)
    table = (
        rays[:, 2], np.hypot(rays[:, 0], rays[:, 1]), np.arctan2(rays[:, 1], rays[:, 0]),
        cone_weights(cone, cone_kernel),
    )  # fmt: skip
    out = np.full((len(observations.texels), 3), np.nan, np.float32)

    def work(block):
        _diffuse(
            block, observations.view, statistics.threshold, statistics.minimum, averaged,
            plain.astype(np.float32), table, cone_visibility, weights == "s",
            METHODS.index(method), out,
        )  # fmt: skip

    observations.store.map(work, progress)
    return out
