"""Highlights of one material under the lights, by Phong or by microfacets: S = a ψ + b ψ₅.

A rough surface is many small mirrors. Seen along v under a light along l, those whose normal is the
half vector h reflect, D(h) of them; G are not hidden (Smith), and each mirrors Schlick's share
F = F₀ + (1 − F₀)(1 − l·h)⁵. With the cosine at the surface, the highlight is k g V D G F/(4 n·v):

    ψ = Σ_k g_k V_k D G/(4 n·v)     ψ₅ = the same with (1 − l·h)⁵     a = k F₀, b = k (1 − F₀)

so strength and F₀ are linear. D is GGX's or Beckmann's of a roughness (Walter et al. 2007). Phong
has ψ = Σ_k g_k V_k (l·r)₊^α and no ψ₅.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..jit import inner, kernel
from .phong import lobe

PHONG, GGX, BECKMANN = 0, 1, 2
NAMES = ("phong", "ggx", "beckmann")


class Gloss(NamedTuple):
    """What kernels read, per material.

    kind : (M,) int64, PHONG, GGX or BECKMANN
    facing, grazing : (M,) float64, a and b, 0..100; a is ρ of Phong's; 0 where there is no gloss
    shape : (M,) float64, α of Phong's, else the roughness
    """

    kind: np.ndarray
    facing: np.ndarray
    grazing: np.ndarray
    shape: np.ndarray


@dataclass(frozen=True)
class Microfacets:
    """A material that microfacets describe better than Phong's lobe.

    kind : GGX or BECKMANN; facing, grazing : a and b, 0..100, for a light of gain 1
    roughness : as seen (a lamp's size widens it); color : (3,) of the highlight, luminance 1
    gain_db : by how much they predict samples better that no fit has used; noise : as Phong's
    """

    kind: int
    facing: float
    grazing: float
    roughness: float
    color: tuple[float, float, float]
    gain_db: float
    noise: float

    @property
    def strength(self) -> float:
        """k, 0..100."""
        return self.facing + self.grazing

    @property
    def f0(self) -> float:
        """The share that is mirrored at normal incidence."""
        return self.facing / self.strength


def phong_gloss(rho_s: np.ndarray, alpha: np.ndarray) -> Gloss:
    """Phong's lobes as gloss; NaN is none."""
    rho = np.nan_to_num(np.asarray(rho_s, np.float64))
    shape = np.nan_to_num(np.asarray(alpha, np.float64), nan=1.0)
    return Gloss(np.zeros(len(rho), np.int64), rho, np.zeros_like(rho), shape)


@inner
def _unshadowed(kind, cos, roughness):
    """Smith's G₁: the share of the microfacets that is not hidden along a direction."""
    tan2 = (1.0 - cos * cos) / (cos * cos)
    if kind == GGX:
        return 2.0 / (1.0 + np.sqrt(1.0 + roughness * roughness * tan2))
    x = 1.0 / (roughness * np.sqrt(max(tan2, 1e-12)))
    if x >= 1.6:
        return 1.0
    return (3.535 * x + 2.181 * x * x) / (1.0 + 2.276 * x + 2.577 * x * x)


@kernel
def facets(kind, roughness, nl, nv, lv):
    """D G/(4 n·v) and (1 − l·h)⁵ from the cosines n·l, n·v > 0 and l·v."""
    length2 = max(2.0 + 2.0 * lv, 1e-9)
    nh2 = min((nl + nv) * (nl + nv) / length2, 1.0)
    a2 = roughness * roughness
    if kind == GGX:
        slope = nh2 * (a2 - 1.0) + 1.0
        d = a2 / (np.pi * slope * slope)
    else:
        exponent = (1.0 - nh2) / (nh2 * a2)
        if exponent > 20.0:
            return 0.0, 0.0
        d = np.exp(-exponent) / (np.pi * a2 * nh2 * nh2)
    g = _unshadowed(kind, nl, roughness) * _unshadowed(kind, nv, roughness)
    away = 1.0 - min(0.5 * np.sqrt(length2), 1.0)
    return d * g / (4.0 * nv), away * away * away * away * away


@kernel
def columns(kind, shape, blur, normal, x, y, z, rays, gains):
    """ψ and ψ₅ of a texel's normal (3,) and the mirror direction (x, y, z).

    blur : variance per axis of the mirror directions that a pixel covers (`pixel_blur`); a mirror
        direction turns twice as far as a microfacet, whose variance is roughness²/2
    """
    if kind == PHONG:
        kept = 1.0 / (1.0 + shape * blur)
        return kept * lobe(x, y, z, rays, gains, kept * shape), 0.0
    roughness = np.sqrt(shape * shape + 0.5 * blur)
    # v is the mirror direction's mirror
    nv = normal[0] * x + normal[1] * y + normal[2] * z
    if nv <= 1e-3:
        return 0.0, 0.0
    vx = 2.0 * nv * normal[0] - x
    vy = 2.0 * nv * normal[1] - y
    vz = 2.0 * nv * normal[2] - z
    facing, grazing = 0.0, 0.0
    for k in range(len(gains)):
        if gains[k] > 0:
            nl = normal[0] * rays[k, 0] + normal[1] * rays[k, 1] + normal[2] * rays[k, 2]
            if nl > 1e-3:
                lv = rays[k, 0] * vx + rays[k, 1] * vy + rays[k, 2] * vz
                value, fresnel = facets(kind, roughness, nl, nv, lv)
                facing += gains[k] * value
                grazing += gains[k] * value * fresnel
    return facing, grazing


@kernel
def specular(gloss, m, blur, normal, x, y, z, rays, gains):
    """S of material m, 0..100."""
    facing, grazing = columns(gloss.kind[m], gloss.shape[m], blur, normal, x, y, z, rays, gains)
    return gloss.facing[m] * facing + gloss.grazing[m] * grazing
