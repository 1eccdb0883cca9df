"""Long lamps: how far a light reaches along the axis of its blob.

How wide a compact lamp is cannot be told from the lobe; how long a tube is can, since highlights
are longer along it than across.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .lights import Light, tangents

ELONGATED = 1.25
"""Ratio of a blob's axes from which a lamp is tried as a long one."""
LENGTHS = (0.0, 0.35, 0.7, 1.0, 1.4)
"""Half lengths tried, of √3 times the blob's standard deviation along its axis, a uniform bar's."""
WORTHWHILE = 1e-3
"""Share of what is left unexplained, most of it noise, that a length must take away."""


def long_axis(light: Light) -> np.ndarray | None:
    """The half bar (3,) of the variance of a light's blob along its axis; None for a round one."""
    variance, axes = np.linalg.eigh(light.covariance)
    if variance[1] < ELONGATED**2 * variance[0]:
        return None
    return np.sqrt(3 * variance[1]) * (axes[:, 1] @ tangents(light.direction))


def fit_lengths(lights: list[Light], unexplained: Callable[[list[Light]], float]) -> list[Light]:
    """Give each elongated light the length that leaves least unexplained, one after the other.

    unexplained : the fit's residual sum of squares under some lights
    """
    lights = list(lights)
    for k in sorted(range(len(lights)), key=lambda k: -lights[k].gain):
        axis = long_axis(lights[k])
        if axis is None:
            continue

        def rest(length: float, k=k, axis=axis) -> float:
            return unexplained(
                [*lights[:k], replace(lights[k], bar=length * axis), *lights[k + 1 :]]
            )

        # Go on while it gets better, then put a parabola through the best and its neighbours
        rests = [rest(LENGTHS[0])]
        for length in LENGTHS[1:]:
            rests.append(rest(length))
            if rests[-1] > rests[-2]:
                break
        best = min(max(int(np.argmin(rests)), 1), len(rests) - 2)
        if len(rests) < 3 or min(rests) > (1 - WORTHWHILE) * rests[0]:
            lights[k] = replace(lights[k], bar=np.zeros(3))
            continue
        bend, slope, _ = np.polyfit(LENGTHS[best - 1 : best + 2], rests[best - 1 : best + 2], 2)
        length = -slope / (2 * bend) if bend > 0 else LENGTHS[int(np.argmin(rests))]
        length = float(np.clip(length, LENGTHS[best - 1], LENGTHS[best + 1]))
        lights[k] = replace(lights[k], bar=length * axis)
    return lights


def as_seen(rho_s: float, alpha: float, lights: list[Light]) -> tuple[float, float]:
    """ρs and α of the round lobe that comes nearest to a lobe under long lamps.

    1/α_seen = 1/α + σ²/2, σ² the bars' variance (length²/3) averaged over the lights by their gain.
    """
    if not lights:
        return rho_s, alpha
    gains = np.array([light.gain for light in lights])
    spread = np.array([light.bar @ light.bar / 3 for light in lights])
    seen = 1 / (1 / alpha + float(gains @ spread / gains.sum()) / 2)
    return rho_s * seen / alpha, seen
