"""ρs and α of every material by eliminating each texel's diffuse term exactly.

y_ij = D_i + ρ_m φ_ij(α_m) is linear in D_i and ρ_m. For a grid of shininesses the sums
N = Σ_i [Σwφy − Σwφ Σwy/W], Q = Σ_i [Σwφ² − (Σwφ)²/W], T = Σ_i [Σwy² − (Σwy)²/W] give
ρ = N/Q and RSS = T − N²/Q; α is at the least RSS.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .fit_samples import FitSamples
from .pixel_blur import along_and_across, blurred_lobe

ALPHAS = 2.0 ** (np.arange(34) / 3)
"""The grid: 1 to 2048, three an octave."""
REACH = 3
"""Cells to both sides of a shininess that is already known."""


@njit(cache=True, nogil=True)
def _add_lobes(u1, u2, s1, s2, gain, start, end, phi):
    """Add gain times the lobe of every α of the grid from start to end; returns how many count."""
    for a in range(start, end):
        value = blurred_lobe(ALPHAS[a], u1, u2, s1, s2)
        if value == 0.0:
            return a
        phi[a] += gain * value
    return end


@njit(cache=True, nogil=True)
def _eliminate(first, stop, offsets, material, y, w, mirror, blur, rays, gains, window, sums):
    """Add N, Q, T of the texels first..stop to sums (M, 3, A)."""
    count = sums.shape[2]
    phi, sp, spy, spp = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for i in range(first, stop):
        if offsets[i] == offsets[i + 1]:
            continue
        sw, sy, syy, most = 0.0, 0.0, 0.0, 0
        sp[:], spy[:], spp[:] = 0.0, 0.0, 0.0
        origin = y[offsets[i]]
        start, end = window[material[i]]
        for j in range(offsets[i], offsets[i + 1]):
            if w[j] <= 0:
                continue
            d = np.float64(y[j] - origin)
            sw, sy, syy = sw + w[j], sy + w[j] * d, syy + w[j] * d * d
            used, s1 = 0, 0.0
            for k in range(gains.shape[1]):
                if gains[i, k] > 0:
                    cos = (
                        rays[i, k, 0] * mirror[j, 0]
                        + rays[i, k, 1] * mirror[j, 1]
                        + rays[i, k, 2] * mirror[j, 2]
                    )
                    if cos > 0.01:
                        if used == 0:
                            phi[start:end] = 0.0
                            s1 = blur[j, 0] ** 2 + blur[j, 1] ** 2 + blur[j, 2] ** 2
                        u1, u2 = along_and_across(
                            cos, blur[j, 0], blur[j, 1], blur[j, 2], rays[i, k], s1
                        )
                        last = _add_lobes(u1, u2, s1, blur[j, 3], gains[i, k], start, end, phi)
                        used = max(used, last)
            for a in range(start, used):
                wp = w[j] * phi[a]
                sp[a] += wp
                spy[a] += wp * d
                spp[a] += wp * phi[a]
            most = max(most, used)
        if sw <= 0:
            continue
        m = material[i]
        total = syy - sy * sy / sw
        for a in range(count):
            sums[m, 2, a] += total
            if start <= a < most:
                sums[m, 0, a] += spy[a] - sp[a] * sy / sw
                sums[m, 1, a] += spp[a] - sp[a] * sp[a] / sw


@dataclass(frozen=True)
class Profile:
    """One material's fit over the grid of shininesses.

    rho_s : 0..100; alpha : at the least RSS, by a parabola in ln α; rss : (A,) over ALPHAS
    at_end : the least RSS is at an end of the grid, so α is not determined
    """

    rho_s: float
    alpha: float
    rss: np.ndarray
    total: float
    at_end: bool


def profile(sums: np.ndarray) -> Profile:
    """N, Q, T over the grid, (3, A), to ρs and α."""
    n, q, t = sums
    rho = np.divide(n, q, out=np.zeros_like(n), where=q > 1e-12 * max(float(q.max()), 1e-300))
    rho = np.maximum(rho, 0)
    rss = t - rho * (2 * n - rho * q)
    best = int(np.argmin(rss))
    at_end = best in (0, len(rss) - 1)
    shift = 0.0
    if not at_end:
        left, middle, right = rss[best - 1 : best + 2]
        bend = left - 2 * middle + right
        shift = float(np.clip(0.5 * (left - right) / bend, -1, 1)) if bend > 0 else 0.0
    grid = np.arange(len(rss))
    alpha = float(np.exp(np.interp(best + shift, grid, np.log(ALPHAS))))
    rho_s, other = float(rho[best]), float(rho[best + int(np.sign(shift))])
    if rho_s > 0 and other > 0:
        rho_s *= (other / rho_s) ** abs(shift)
    return Profile(rho_s, alpha, rss, float(t[0]), at_end)


def eliminate(
    samples: FitSamples,
    weight: np.ndarray,
    rays: np.ndarray,
    gains: np.ndarray,
    materials: int,
    chunks,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """The sums of all materials, (M, 3, A) float64.

    weight : (N,) float32; rays, gains : of the n texels, from `phong.light_texels`
    chunks : maps a function over ranges of texels and returns the results in order
    """

    window = np.tile([0, len(ALPHAS)], (materials, 1))
    if near is not None:
        nearest = np.rint(np.interp(np.log(near), np.log(ALPHAS), np.arange(len(ALPHAS))))
        inside = nearest > 0
        window[inside, 0] = np.maximum(nearest[inside] - REACH, 0)
        window[inside, 1] = np.minimum(nearest[inside] + REACH + 1, len(ALPHAS))

    def work(first, stop):
        sums = np.zeros((materials, 3, len(ALPHAS)))
        _eliminate(
            first, stop, samples.offsets, samples.material, samples.luminance, weight,
            samples.mirror, samples.blur, rays, gains, window, sums,
        )  # fmt: skip
        return sums

    return sum(chunks(work), np.zeros((materials, 3, len(ALPHAS))))
