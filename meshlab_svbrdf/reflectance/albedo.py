"""Albedo: the diffuse colour with the acquisition's light divided out, a = D/(E + A·o).

D = a (E + A·o): the lamps' irradiance E over π, of lamps of geometric mean gain 1, the ambient
radiance A (reflectance/ambient.py) and the openness o of the texel to it. So a surface of albedo a
that faces a lamp of gain 1 at the object's centre has the brightness a, in units in which ρs is
the height of the highlight that this lamp would give: albedo and ρs go together under any light,
up to one scale, which nothing in the frames tells.
"""

from __future__ import annotations

import numpy as np

from ..geometry.texels import Texels
from ..geometry.visibility import Rays
from .lamp_shadows import lamp_share
from .lights import Light
from .phong import lamps

DARKEST = 0.03
"""Of what faces a lamp of gain 1, below which noise and stray light are divided by too little."""


def lamp_irradiance(
    texels: Texels, normal: np.ndarray, rays: Rays, lights: list[Light], lamp_radius: float = 0.0
) -> np.ndarray:
    """The lamps' irradiance over π, Σ g_k V_k (n·l_k)/|L_k|², (T,) float64.

    Parameters
    ----------
    texels : about their centre; normal : (T, 3) unit
    rays : the mesh that casts shadows
    lights : with gains of geometric mean 1
    lamp_radius : degrees, of compact lamps as seen from the centre: shadows have penumbrae then
    """
    bulbs = lamps(lights, texels.radius)
    position, normal = texels.position.astype(float), np.asarray(normal, float)
    total = np.zeros(len(texels))
    for k, (direction, gain) in enumerate(zip(bulbs.direction, bulbs.gain, strict=True)):
        curvature = bulbs.curvature[k] / texels.radius
        toward = direction - curvature * position
        length2 = np.einsum("td,td->t", toward, toward)
        cos = np.maximum(np.einsum("td,td->t", toward, normal), 0) / np.sqrt(length2)
        lit = np.flatnonzero(cos > 0)
        compact = (bulbs.light == bulbs.light[k]).sum() == 1
        size = np.radians(lamp_radius) if compact else 0.0
        points = position[lit] + texels.center
        seen = lamp_share(rays, points, normal[lit], direction, curvature, size)
        total[lit] += gain * cos[lit] / length2[lit] * seen
    return total


def divide_light(
    diffuse: np.ndarray, irradiance: np.ndarray, openness: np.ndarray, ambient: np.ndarray
) -> np.ndarray:
    """a = D/(E + A·o), linear RGB (T, 3), 1 = 100; NaN where too little light arrives to tell.

    Parameters
    ----------
    diffuse : (T, 3) linear RGB 0..100, NaN where unobserved
    irradiance : (T,) from `lamp_irradiance`; openness : (T,) in 0..1
    ambient : (3,) radiance from everywhere, in units of each channel's lamps
    """
    light = irradiance[:, None] + ambient * openness[:, None]
    enough = light.min(axis=1, keepdims=True) >= DARKEST
    return np.divide(diffuse, light, out=np.full(light.shape, np.nan), where=enough)
