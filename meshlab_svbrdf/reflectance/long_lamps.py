"""Long and wide lamps: how far a light reaches along the axes of its blob.

How wide a compact lamp is cannot be told from the lobe; how long a tube is can, since highlights
are longer along it than across, and how wide a window is, since its highlights are flat inside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .lights import Light, tangents

ELONGATED = 1.25
"""Ratio of a blob's axes from which a lamp is tried as a long one."""
LENGTHS = (0.0, 0.35, 0.7, 1.0, 1.4, 2.0)
"""Half lengths tried, of √3 times the blob's standard deviation along its axis, a uniform bar's."""
WORTHWHILE = 1e-3
"""Share of what is left unexplained, most of it noise, that a length must take away."""
WIDE_WORTHWHILE = 0.03
"""The same of a breadth: round highlights, which lobes explain as well, speak against one."""


def blob_axes(light: Light) -> np.ndarray:
    """The half bars (2, 3) of the variance of a light's blob along its axes, the longer first."""
    variance, axes = np.linalg.eigh(light.covariance)
    half = np.sqrt(3 * np.maximum(variance[::-1], 0))
    return half[:, None] * (axes.T[::-1] @ tangents(light.direction))


def fit_lengths(lights: list[Light], unexplained: Callable[[list[Light]], float]) -> list[Light]:
    """Give each light the length and breadth that leave least unexplained, one after the other.

    An elongated one is tried as a bar; one that is a bar, or is round, also as a plate. What a
    light has of them stays where it serves.

    unexplained : the fit's residual sum of squares under some lights
    """
    lights = list(lights)
    compact = unexplained(lights)
    for k in sorted(range(len(lights)), key=lambda k: -lights[k].gain):

        def rest(light: Light, k=k) -> float:
            return unexplained([*lights[:k], light, *lights[k + 1 :]])

        lights[k], compact = _extend(lights[k], compact, rest)
    return lights


def _extend(light: Light, present: float, rest: Callable[[Light], float]) -> tuple[Light, float]:
    """A light with the length and breadth that leave least, and what they leave.

    present : what the light leaves as it is
    """
    point = replace(light, bar=np.zeros(3), breadth=0.0)
    least = present if not light.bar.any() else rest(point)
    if light.bar.any() and present < (1 - WORTHWHILE) * least:
        return light, present
    major, minor = blob_axes(light)
    best = point
    if major @ major >= ELONGATED**2 * (minor @ minor):
        best, least = _stretch(best, least, WORTHWHILE, rest, lambda x: (x * major, 0.0))
    half = float(np.linalg.norm(minor))
    if best.bar.any():
        return _stretch(best, least, WIDE_WORTHWHILE, rest, lambda x: (best.bar, x * half))
    return _stretch(best, least, WIDE_WORTHWHILE, rest, lambda x: (x * major, x * half))


def _stretch(
    light: Light, least: float, worthwhile: float, rest: Callable[[Light], float],
    shape: Callable[[float], tuple[np.ndarray, float]],
) -> tuple[Light, float]:  # fmt: skip
    """The light in the best of some shapes, and what it leaves; itself if none is worth it."""

    def made(length: float) -> Light:
        bar, breadth = shape(length)
        return replace(light, bar=bar, breadth=breadth)

    # Go on while it gets better, then put a parabola through the best and its neighbours
    rests = [least]
    for length in LENGTHS[1:]:
        rests.append(rest(made(length)))
        if rests[-1] > rests[-2]:
            break
    if len(rests) < 3 or min(rests) > (1 - worthwhile) * least:
        return light, least
    best = min(max(int(np.argmin(rests)), 1), len(rests) - 2)
    bend, slope, _ = np.polyfit(LENGTHS[best - 1 : best + 2], rests[best - 1 : best + 2], 2)
    length = -slope / (2 * bend) if bend > 0 else LENGTHS[int(np.argmin(rests))]
    return made(float(np.clip(length, LENGTHS[best - 1], LENGTHS[best + 1]))), min(rests)


def as_seen(rho_s: float, alpha: float, lights: list[Light]) -> tuple[float, float]:
    """ρs and α of the round lobe that comes nearest to a lobe under long and wide lamps.

    1/α_seen = 1/α + σ²/2, σ² the variance of bars and breadths (half²/3 each) averaged over the
    lights by their gain.
    """
    if not lights:
        return rho_s, alpha
    gains = np.array([light.gain for light in lights])
    spread = np.array([(light.bar @ light.bar + light.breadth**2) / 3 for light in lights])
    seen = 1 / (1 / alpha + float(gains @ spread / gains.sum()) / 2)
    return rho_s * seen / alpha, seen
