"""Does a light explain anything? Asked of the texels that should show it, and that no fit has used.

A ghost (a reflection of the object in itself, a shadow's edge) fits the texels that made it and is
wrong at the others; a lamp is seen by nearly all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import kernel
from ..samples.observations import longest
from .fit_state import FitState


@dataclass(frozen=True)
class Testimony:
    """What the texels that should show each light say; (K,) each.

    texels : how many they are; share : of them, those that are explained better with it than
    without; taken : share of their variance without it that it explains
    """

    texels: np.ndarray
    share: np.ndarray
    taken: np.ndarray


@kernel
def _hear(
    first, stop, offsets, material, mirror, w, residual, rays, gains, owner, rho, alpha, noise, sums
):  # fmt: skip
    """Add to sums (K, 4): texels, those better with the light, Σwẽ² without and with it."""
    own = np.empty(longest(offsets, first, stop))
    for i in range(first, stop):
        m = material[i]
        if not rho[m] > 0:
            continue
        for k in range(len(sums)):
            top, sw, s0, s1, ss0, ss1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(offsets[i], offsets[i + 1]):
                s = 0.0
                for p in range(gains.shape[1]):
                    if owner[p] == k and gains[i, p] > 0:
                        cos = (
                            rays[i, p, 0] * mirror[j, 0]
                            + rays[i, p, 1] * mirror[j, 1]
                            + rays[i, p, 2] * mirror[j, 2]
                        )
                        if cos > 0.01:
                            s += gains[i, p] * np.exp(alpha[m] * np.log(min(cos, np.float32(1))))
                s *= rho[m]
                own[j - offsets[i]] = s
                if w[j] > 0:
                    top = max(top, s)
            if top < 3.0 * noise[m]:
                continue
            for j in range(offsets[i], offsets[i + 1]):
                e = residual[j]
                d = e + own[j - offsets[i]]
                sw, s0, s1 = sw + w[j], s0 + w[j] * d, s1 + w[j] * e
                ss0, ss1 = ss0 + w[j] * d * d, ss1 + w[j] * e * e
            if sw > 0:
                without, with_it = ss0 - s0 * s0 / sw, ss1 - s1 * s1 / sw
                sums[k, 0] += 1
                sums[k, 1] += with_it < without
                sums[k, 2] += without
                sums[k, 3] += with_it


def hear(
    state: FitState, lights: int, rho: np.ndarray, alpha: np.ndarray, noise: np.ndarray
) -> Testimony:
    """Ask a state, lit and predicted, of texels that the fit has not used.

    rho, alpha : (M,) of the materials, NaN where unobserved; noise : (M,) of the residuals
    """
    s, strength = state.samples, np.nan_to_num(rho)
    shininess = np.nan_to_num(alpha, nan=1.0)

    def work(first, stop):
        sums = np.zeros((lights, 4))
        _hear(
            first, stop, s.offsets, s.material, s.mirror, state.weight, state.residual, state.rays,
            state.gains, state.lamps.light, strength, shininess, noise, sums,
        )  # fmt: skip
        return sums

    texels, better, without, with_it = sum(state.chunks(work), np.zeros((lights, 4))).T
    some = np.maximum(texels, 1)
    left = np.divide(with_it, without, out=np.ones_like(without), where=without > 0)
    return Testimony(texels.astype(int), better / some, 1 - left)
