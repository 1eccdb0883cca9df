"""Highlights as other programs describe them: GGX's roughness and reflectance, and back.

A lamp of perpendicular irradiance π c gives c ρ (l·r)^α by Phong's lobe, and c π F D G/(4 n·v) by
microfacets, where a white surface that faces it shows c. Seen from above, the lobe sends back
2ρ/(α + 1) of the light, and its top is ρ; GGX of the roughness a sends back F (less what its
microfacets hide, some a² of it) and has the top F/(4 a²). So

    F = 2ρ/(α + 1)     a² = 1/(2 (α + 1))

has the lobe's energy and its top. (α counts about the mirror direction. Half vectors turn half as
far: there the exponent would be 4α, and a² = 2/(4α + 2) nearly the same.) The lobe knows no
Fresnel: F is the same at all angles. Microfacets keep theirs. Beckmann and GGX of one roughness
have the same top and energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..reflectance.microfacet import PHONG
from ..rendering.surface import Appearance

HALF_VECTOR = 4.0
"""(n·h)^(4α) is as wide as (l·r)^α, near the mirror direction."""


class Ggx(NamedTuple):
    """facing, grazing : share mirrored at normal and at grazing incidence; roughness : a of GGX,
    whose square root is the "perceptual" one; all alike in shape"""

    facing: np.ndarray
    grazing: np.ndarray
    roughness: np.ndarray


def ggx_of_phong(rho_s: np.ndarray, alpha: np.ndarray) -> Ggx:
    """GGX with the energy and the top of ρs (l·r)^α; NaN stays NaN."""
    rho_s, alpha = np.asarray(rho_s, float), np.asarray(alpha, float)
    mirrored = 2 * rho_s / (alpha + 1)
    return Ggx(mirrored, mirrored, np.sqrt(0.5 / (alpha + 1)))


def phong_of_ggx(mirrored: np.ndarray, roughness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ρs and α, the inverse of `ggx_of_phong`; a rougher GGX than 1/√2 has no lobe: NaN."""
    square = np.asarray(roughness, float) ** 2
    alpha = np.where(square < 0.5, 0.5 / np.maximum(square, 1e-12) - 1, np.nan)
    return np.asarray(mirrored) * (alpha + 1) / 2, alpha


def ggx_of(look: Appearance) -> Ggx:
    """Of each texel's gloss, (H, W); 0, of roughness NaN, where there is none."""
    phong = ggx_of_phong(look.rho_s, look.alpha)
    if look.kind is None or look.grazing is None:
        found = phong
    else:
        lobes = look.kind == PHONG
        facing = look.rho_s / np.pi
        found = Ggx(
            np.where(lobes, phong.facing, facing),
            np.where(lobes, phong.grazing, facing + look.grazing / np.pi),
            np.where(lobes, phong.roughness, look.alpha),
        )
    return Ggx(np.nan_to_num(found.facing), np.nan_to_num(found.grazing), found.roughness)
