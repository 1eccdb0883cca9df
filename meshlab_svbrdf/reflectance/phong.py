"""Phong lobes under near lights: what a texel should show of each light (paper eq. 1).

A light k stands towards d_k as seen from the object's centre c, at the distance 1/κ_k radii. At x
it is seen along L = d − κ (x − c)/radius, l = L/|L|, with the gain g/|L|². A long lamp is a row of
points, a wide one a grid of them, on a plane that faces c. Their gain falls with the cosine at
which they send light to c; together they give a surface there that faces the lamp what one would.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..blocks import blocks, room
from ..geometry.visibility import directional_visibility
from ..jit import inner, kernel
from ..samples.observations import Observations, View, fill_visibility, visibility
from .lights import Light

SHADOWED = 1 << 21  # texels whose shadows are cast at once
SPACING = 0.07
"""Radians between the points of a long lamp: about the width of the sharpest lobes."""
COARSER = 1.5
"""Times that apart are the points of a wide lamp."""
POINTS_MOST = 12
"""Along each side."""


class Lamps(NamedTuple):
    """The lights' points as arrays; P points of K lights.

    direction : (P, 3) float64; gain, curvature : (P,) float64; light : (P,) which light's they are
    along, across : (P,) float64, place on the light's bar and breadth, -1 to 1
    lit : (T, K) uint8, which light reaches which texel; or (0, K): the harmonics tell
    """

    direction: np.ndarray
    gain: np.ndarray
    curvature: np.ndarray
    light: np.ndarray
    along: np.ndarray
    across: np.ndarray
    radius: float
    lit: np.ndarray


def lamps(lights: list[Light], radius: float, lit: np.ndarray | None = None) -> Lamps:
    """The arrays that kernels read."""
    places = [_places(light) for light in lights]
    rows = [
        g.direction + x[:, :1] * g.bar + x[:, 1:] * g.breadth * g.side
        for g, x in zip(lights, places, strict=True)
    ]
    cosines = [1 / np.linalg.norm(row, axis=1) for row in rows]
    shares = [g.gain * c / (c**4).sum() for g, c in zip(lights, cosines, strict=True)]
    counts = np.array([len(x) for x in places], np.int64)
    along, across = np.concatenate([*places, np.zeros((0, 2))]).T
    return Lamps(
        np.concatenate([*rows, np.zeros((0, 3))]),
        np.concatenate([*shares, np.zeros(0)]),
        np.repeat(np.array([light.curvature for light in lights], np.float64), counts),
        np.repeat(np.arange(len(lights)), counts),
        along,
        across,
        float(radius),
        np.zeros((0, len(lights)), np.uint8) if lit is None else lit,
    )


def _places(light: Light) -> np.ndarray:
    """Points evenly along the bar and the breadth: (P, 2) in -1 to 1, across slowest."""
    apart = SPACING * (COARSER if light.breadth > 0 else 1)
    along, across = (
        (np.arange(count) + 0.5) / count * 2 - 1
        for half in (float(np.linalg.norm(light.bar)), light.breadth)
        for count in [int(np.clip(np.ceil(2 * half / apart), 1, POINTS_MOST))]
    )
    return np.stack(np.meshgrid(along, across), -1).reshape(-1, 2)


def cast_shadows(
    observations: Observations, texels: np.ndarray, lights: list[Light]
) -> np.ndarray | None:
    """Which light reaches which texel, by rays: (T, K) uint8, filled at the given texels (n,).

    None where the observations have no rays to shoot.
    """
    if observations.rays is None:
        return None
    own = observations.texels
    lit = room((len(own), len(lights)), np.uint8)
    lit[:] = 0
    places = [(light.direction, light.position(own.center, own.radius)) for light in lights]
    for block in blocks(len(texels), SHADOWED):
        some = texels[block]
        lit[some] = directional_visibility(
            observations.rays, own.position[some] + own.center, own.normal[some], places
        )
    return lit


@inner
def light_texel(view, t, lamps, coefficients, rays, gains):
    """Fill rays (P, 3) with l_k at texel t, gains (P,) with g_k V_k /|L|²; 0 below the horizon."""
    has = fill_visibility(view, t, coefficients)
    for k in range(len(lamps.gain)):
        s = lamps.curvature[k] / lamps.radius
        x = lamps.direction[k, 0] - s * view.position[t, 0]
        y = lamps.direction[k, 1] - s * view.position[t, 1]
        z = lamps.direction[k, 2] - s * view.position[t, 2]
        length2 = x * x + y * y + z * z
        scale = 1.0 / np.sqrt(length2)
        x, y, z = x * scale, y * scale, z * scale
        rays[k, 0], rays[k, 1], rays[k, 2] = x, y, z
        above = view.normal[t, 0] * x + view.normal[t, 1] * y + view.normal[t, 2] * z
        if lamps.lit.shape[0] > 0:
            seen = np.float32(lamps.lit[t, lamps.light[k]])
        else:
            seen = visibility(has, coefficients, np.float32(x), np.float32(y), np.float32(z))
        gains[k] = lamps.gain[k] / length2 * seen if above > 0 else 0.0


@kernel
def lobe(x, y, z, rays, gains, alpha):
    """φ = Σ_k g_k V_k (l_k·r)₊^α of the mirror direction (x, y, z)."""
    total = 0.0
    for k in range(len(gains)):
        if gains[k] > 0:
            cos = rays[k, 0] * x + rays[k, 1] * y + rays[k, 2] * z
            if cos > 0:
                e = alpha * np.log(min(cos, 1.0))
                if e > -20.0:
                    total += gains[k] * np.exp(e)
    return total


@kernel
def _light_texels(view, texels, lamps, rays, gains):
    coefficients = np.empty(36, np.float32)
    for i in range(len(texels)):
        light_texel(view, texels[i], lamps, coefficients, rays[i], gains[i])


def light_texels(view: View, texels: np.ndarray, lamps: Lamps) -> tuple[np.ndarray, np.ndarray]:
    """l_k (N, P, 3) and g_k V_k/|L|² (N, P), float32, at some texels (N,)."""
    rays = np.empty((len(texels), len(lamps.gain), 3), np.float32)
    gains = np.empty(rays.shape[:2], np.float32)
    _light_texels(view, texels, lamps, rays, gains)
    return rays, gains
