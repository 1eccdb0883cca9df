"""ρs and α of single texels, from the slope of a luminance peak in time (paper §7.2, eq. 7-9)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ..jit import inner, kernel
from ..samples.observations import Observations, mirror_direction, sample_luminance
from ..samples.store import Block
from .fit_samples import is_clipped
from .lights import Light, tangents

GAP = 2
"""Frames in which a texel is not seen, after which its peak ends."""
FARTHEST = 2.5
"""Mahalanobis distance from its light beyond which a peak belongs to none."""
EXCESS_MAX, EXCESS_MIN, CONTRAST = 3.0, 0.5, 1.3
SHININESS = (1.0, 2000.0)
RHO_MOST = 1000.0
LN_RATIO = 1e-4


class Shapes(NamedTuple):
    """Lights as Mahalanobis distances: direction (K, 3), tangents (K, 2, 3), inverse covariance
    (K, 2, 2), least and largest variance (K,)."""

    direction: np.ndarray
    frame: np.ndarray
    inverse: np.ndarray
    least: np.ndarray
    most: np.ndarray


@dataclass(frozen=True)
class TexelSpecular:
    """Per texel, (T,) float32, NaN where its peaks do not tell.

    rho_s : 0..100; alpha : shininess; distance : Mahalanobis distance of the peak from its light
    light : (T,) int16, which light; -1 for none
    """

    rho_s: np.ndarray
    alpha: np.ndarray
    distance: np.ndarray
    light: np.ndarray


def shapes(lights: list[Light]) -> Shapes:
    variances = np.array([np.linalg.eigvalsh(light.covariance) for light in lights]).reshape(-1, 2)
    return Shapes(
        np.array([light.direction for light in lights]).reshape(-1, 3),
        np.array([tangents(light.direction) for light in lights]).reshape(-1, 2, 3),
        np.array([np.linalg.inv(light.covariance) for light in lights]).reshape(-1, 2, 2),
        variances[:, 0].copy(),
        variances[:, 1].copy(),
    )


@kernel
def mahalanobis2(x, y, z, k, shapes):
    """Squared Mahalanobis distance of a direction from light k in its tangent plane, or inf."""
    cos = x * shapes.direction[k, 0] + y * shapes.direction[k, 1] + z * shapes.direction[k, 2]
    if cos <= 0.1:
        return np.inf
    f = shapes.frame[k]
    u = (x * f[0, 0] + y * f[0, 1] + z * f[0, 2]) / cos
    v = (x * f[1, 0] + y * f[1, 1] + z * f[1, 2]) / cos
    c = shapes.inverse[k]
    return u * u * c[0, 0] + 2.0 * u * v * c[0, 1] + v * v * c[1, 1]


@kernel
def solve_peak(excess_max, excess_min, d2_max, d2_min, variance):
    """ρs and α of two samples of one lobe (eq. 7), or NaN where the guards reject them.

    Each direction is moved on its ellipse of equal distance to where the variance is `variance`:
    ln cos θ = −½ log1p(d² λ).
    """
    if not (
        excess_max > EXCESS_MAX and excess_min > EXCESS_MIN and excess_max / excess_min > CONTRAST
    ):
        return np.nan, np.nan
    ln_max, ln_min = -0.5 * np.log1p(d2_max * variance), -0.5 * np.log1p(d2_min * variance)
    if not abs(ln_max - ln_min) > LN_RATIO:
        return np.nan, np.nan
    alpha = np.log(excess_max / excess_min) / (ln_max - ln_min)
    if not (SHININESS[0] < alpha < SHININESS[1]):
        return np.nan, np.nan
    rho = excess_max * np.exp(-alpha * ln_max)
    if not rho < RHO_MOST:
        return np.nan, np.nan
    return rho, alpha


@inner
def _judge_run(block, view, t, run, n, d, shapes, least_of_peak, farthest_point, nearer_than):
    """ρs, α, d²_max and light of one peak, whose samples are run[:n], and its two samples c_max and
    c_min (-1: none); α NaN if it does not tell."""
    nothing = (np.nan, np.nan, np.inf, -1, -1, -1)
    # Take the highest sample that is not clipped, and its nearest light
    top, high = -1, 0.0
    for k in range(n):
        excess = sample_luminance(block, view, run[k]) - d
        if excess > high and not is_clipped(block, view, run[k]):
            top, high = run[k], excess
    if top < 0:
        return nothing
    x, y, z = mirror_direction(view, t, block.frame[top])
    lamp, d2_max = -1, FARTHEST * FARTHEST
    for k in range(len(shapes.least)):
        d2 = mahalanobis2(x, y, z, k, shapes)
        if d2 < d2_max:
            lamp, d2_max = k, d2
    if lamp < 0 or d2_max >= nearer_than:
        return np.nan, np.nan, np.inf, lamp, top, -1
    # Take the sample nearest to half its excess (or, to the letter, the least)
    low, nearest = -1, np.inf
    for k in range(n):
        excess = sample_luminance(block, view, run[k]) - d
        away = excess if least_of_peak else abs(excess - 0.5 * high)
        if run[k] != top and away < nearest and not is_clipped(block, view, run[k]):
            low, nearest = run[k], away
    if low < 0:
        return np.nan, np.nan, np.inf, lamp, top, -1
    x, y, z = mirror_direction(view, t, block.frame[low])
    d2_min = mahalanobis2(x, y, z, lamp, shapes)
    if not d2_max <= d2_min < np.inf:
        return np.nan, np.nan, np.inf, lamp, top, low
    variance = shapes.most[lamp] if farthest_point else shapes.least[lamp]
    rho, alpha = solve_peak(high, sample_luminance(block, view, low) - d, d2_max, d2_min, variance)
    return rho, alpha, d2_max, lamp, top, low


@inner
def _next_run(block, view, d, sequence, order, j, stop, run):
    """The next run of consecutive frames brighter than d from sample j on: its length and end."""
    n = 0
    while j < stop:
        if sample_luminance(block, view, j) > d:
            if n > 0:
                f, g = block.frame[j - 1], block.frame[j]
                skipped = order[g] - order[f] != g - f
                if sequence[f] != sequence[g] or skipped or g - f > GAP + 1:
                    break
            run[n] = j
            n += 1
        elif n > 0:
            break
        j += 1
    return n, j


@inner
def _about_light(block, view, t, d, lamp, shapes, j, stop, run):
    """The samples brighter than d whose nearest light is `lamp`: how many."""
    n = 0
    for k in range(j, stop):
        if sample_luminance(block, view, k) > d:
            x, y, z = mirror_direction(view, t, block.frame[k])
            own = mahalanobis2(x, y, z, lamp, shapes)
            for other in range(len(shapes.least)):
                if mahalanobis2(x, y, z, other, shapes) < own:
                    own = np.inf
            if own < np.inf:
                run[n] = k
                n += 1
    return n


@kernel
def _specular(
    block, view, sequence, order, diffuse, shapes, by_direction, least_of_peak, farthest_point,
    rho, alpha, dist, light,
):  # fmt: skip
    longest = 0
    for i in range(block.stop - block.first):
        longest = max(longest, block.offsets[i + 1] - block.offsets[i])
    run = np.empty(longest, np.int64)
    for i in range(block.stop - block.first):
        t = block.first + i
        d = diffuse[t]
        if not d >= 0:
            continue
        best, lamp = np.inf, 0
        j, stop = block.offsets[i], block.offsets[i + 1]
        while (lamp < len(shapes.least)) if by_direction else (j < stop):
            if by_direction:
                n = _about_light(block, view, t, d, lamp, shapes, j, stop, run)
                lamp += 1
            else:
                n, j = _next_run(block, view, d, sequence, order, j, stop, run)
            r, a, d2, k, _, _ = _judge_run(
                block, view, t, run, n, d, shapes, least_of_peak, farthest_point, best
            )
            if a > 0:
                best = d2
                rho[i], alpha[i], dist[i], light[i] = r, a, np.sqrt(d2), k


def texel_specular(
    observations: Observations,
    diffuse: np.ndarray,
    lights: list[Light],
    *,
    peaks: str = "time",
    c_min: str = "half",
    p: str = "nearest",
    progress=lambda done, total: None,
) -> TexelSpecular:
    """ρs and α of every texel that shows a peak near a light.

    Parameters
    ----------
    diffuse : (T,) luminance of the diffuse colour, 0..100, NaN where unobserved
    peaks : "time" takes runs of consecutive frames (a video); "direction" the samples whose mirror
        direction is nearest to one light (photographs from all around)
    c_min : "half" takes the sample nearest to half the peak's excess; "least" the lowest (the
        letter; it lies in the noise)
    p : "nearest" takes the point of the ellipse of equal distance nearest to the light, "farthest"
        the paper's text
    """
    if not lights:
        return TexelSpecular(*_nothing(len(observations.texels)))
    how = (peaks == "direction", c_min == "least", p == "farthest")
    work = partial(
        _block_specular, observations.view, observations.sequence, observations.order,
        diffuse.astype(np.float32), shapes(lights), how,
    )  # fmt: skip
    return TexelSpecular(*observations.store.rows(work, progress))


def _block_specular(view, sequence, order, diffuse, table, how, block: Block):
    """The fields of `TexelSpecular` for a block's texels."""
    found = _nothing(block.stop - block.first)
    _specular(block, view, sequence, order, diffuse, table, *how, *found)
    return found


def _nothing(count: int) -> tuple[np.ndarray, ...]:
    rho, alpha, distance = (np.full(count, np.nan, np.float32) for _ in range(3))
    return rho, alpha, distance, np.full(count, -1, np.int16)
