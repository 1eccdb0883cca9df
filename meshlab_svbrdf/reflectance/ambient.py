"""The light that comes from everywhere, and its own faint highlight, which D must not keep.

D = a (E + A·o) + c ρ A κ: a texel's albedo a, the lamps' irradiance E, the ambient radiance A, the
openness o of the texel to it, and the lobe's share of it, κ = 2 o/(α + 1) (the integral of a
Phong lobe over a uniform surrounding, over π). A is what makes neighbouring texels of a material
most alike in albedo, whatever the lamps do between them: the sum of |ln a_i − ln a_j| is least.
Metals, which their coloured highlights give away, have no albedo: what is left in their D is no
shading, and is not asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ..blocks import in_pieces, places, room, rowwise, taken
from ..geometry.adjacency import neighbours, thin
from ..geometry.harmonics import COEFFICIENTS, evaluate
from ..geometry.texels import Texels
from ..jit import kernel
from ..samples.observations import Observations
from .lights import Light
from .phong import cast_shadows, lamps, light_texels

TEXELS = 5000
"""Spread over the object: far enough apart that a penumbra lies between few of them."""
NEIGHBOURS, REACH = 12, 3.0
DARKEST = 0.5
"""Luminance units, below which D tells no ratio."""
COLORED = 0.3
"""Of a highlight's colour, between its channels: from here on it is a metal's."""
GROUPS = 8
CERTAIN = 3.0
"""Standard errors, from which on the ambient light counts as seen."""
LEAST, MOST = 1e-3, 10.0
"""Of a lamp of gain 1, where the ambient light is searched."""
_COSINE = (1.0, 2 / 3, 1 / 4, 0.0, -1 / 24, 0.0)
"""A clamped cosine in zonal harmonics, over π (Ramamoorthi and Hanrahan 2001)."""


@dataclass(frozen=True)
class Ambient:
    """radiance : (3,) of the surroundings for lamps of mean gain 1; 0 where it is not seen
    error : (3,) its standard error; infinite where it cannot be told
    """

    radiance: np.ndarray
    error: np.ndarray


def openness(
    texels: Texels, faces: np.ndarray, coefficients: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """The cosine-weighted share of the hemisphere that each texel sees, (T,) in 0..1.

    coefficients : (V, 36) of the visibility, or (0, 36): all is visible
    """
    if len(coefficients) == 0:
        return np.ones(len(normal))
    zonal = np.repeat(_COSINE, [2 * l + 1 for l in range(len(_COSINE))])[:COEFFICIENTS]
    share = room(len(normal), np.float64)
    weighted = rowwise(lambda some: some * zonal, coefficients)

    def work(first: int, stop: int) -> None:
        _openness(first, stop, faces, texels.face, texels.barycentric, weighted, normal, share)

    in_pieces(work, len(normal))
    return np.clip(share, 0, 1, out=share)


@kernel
def _openness(first, stop, faces, face, barycentric, coefficients, normal, share):
    """The harmonics (V, 36) at the normals of the texels first..stop."""
    own = np.empty(coefficients.shape[1])
    for t in range(first, stop):
        for k in range(len(own)):
            own[k] = 0.0
            for c in range(3):
                own[k] += barycentric[t, c] * coefficients[faces[face[t], c], k]
        share[t] = evaluate(own, normal[t, 0], normal[t, 1], normal[t, 2])


def irradiance(observations: Observations, texels: np.ndarray, lights: list[Light]) -> np.ndarray:
    """The lamps' irradiance over π at some texels (n,): Σ g_k V_k (n·l_k)."""
    bulbs = lamps(lights, observations.texels.radius, cast_shadows(observations, texels, lights))
    rays, gains = light_texels(observations.view, texels, bulbs)
    cos = np.einsum("npd,nd->np", rays, observations.view.normal[texels])
    return (gains * np.maximum(cos, 0)).sum(1)


def highlight_share(open_: np.ndarray, rho_s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """What a uniform surrounding of radiance 1 adds by its highlight: ρ·2 o/(α + 1)."""
    return rho_s * 2 / (alpha + 1) * open_


def ambient_light(
    observations: Observations,
    diffuse: np.ndarray,
    material: np.ndarray,
    rho_s: np.ndarray,
    alpha: np.ndarray,
    tint: np.ndarray,
    lights: list[Light],
    open_: np.ndarray,
) -> Ambient:
    """Find A from D.

    Parameters
    ----------
    diffuse : (T, 3) linear RGB 0..100, the lamps' lobes taken off
    material : (T,) int32, -1 for none; rho_s, alpha : (M,), 0 and 1 where unobserved
    tint : (M, 3), the highlights' colours
    open_ : (T,), from `openness`

    Each channel is searched alone; A is in units of that channel's lamps. It counts as seen where
    it is three standard errors (a jackknife over parts of the object) away from none.
    """
    unknown = Ambient(np.zeros(3), np.full(3, np.inf))
    bright = rowwise(lambda some: np.nan_to_num(some).min(1) > DARKEST, diffuse)
    shaded = np.append(np.ptp(tint, axis=1) < COLORED, False)
    usable = places(shaded[material] & bright)
    if not lights or len(usable) < TEXELS // 10:
        return unknown
    texels = observations.texels
    chosen = usable[thin(taken(texels.position, usable), taken(texels.normal, usable), TEXELS)]
    indptr, second = neighbours(
        texels.position[chosen], texels.normal[chosen], k=NEIGHBOURS, reach=REACH
    )
    first = np.repeat(np.arange(len(chosen)), np.diff(indptr))
    own = material[chosen]
    same = (first < second) & (own[first] == own[second])
    first, second = first[same], second[same]
    if len(first) < GROUPS:
        return unknown
    group = (first * GROUPS) // len(chosen)
    lit = irradiance(observations, chosen, lights)
    around = open_[chosen]
    share = highlight_share(around, rho_s[own], alpha[own])
    radiance, error = np.zeros(3), np.full(3, np.inf)
    for channel in range(3):
        color, sheen = diffuse[chosen, channel], share * tint[own, channel]

        def unlike(logarithm: float, pairs: np.ndarray, color=color, sheen=sheen) -> float:
            a = np.exp(logarithm)
            albedo = np.maximum(color - a * sheen, 0.1 * DARKEST) / (lit + a * around + 1e-9)
            ratio = np.log(albedo)
            return float(np.abs(ratio[first[pairs]] - ratio[second[pairs]]).mean())

        def best(pairs: np.ndarray, unlike=unlike) -> float:
            bounds = (np.log(LEAST), np.log(MOST))
            return minimize_scalar(unlike, bounds=bounds, args=(pairs,), method="bounded").x

        found = best(np.ones(len(first), bool))
        without = np.array([best(group != g) for g in range(GROUPS)])
        spread = np.sqrt((GROUPS - 1) / GROUPS * ((without - without.mean()) ** 2).sum())
        radiance[channel], error[channel] = np.exp(found), np.exp(found) * spread
        if not LEAST * 1.1 < radiance[channel] < MOST / 1.1:
            error[channel] = np.inf
    seen = (radiance > CERTAIN * error).all()
    return Ambient(radiance, error) if seen else Ambient(np.zeros(3), error)
