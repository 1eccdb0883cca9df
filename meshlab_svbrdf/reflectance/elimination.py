"""ρs and α of every material by eliminating each texel's diffuse term exactly.

y_ij = D_i + ρ_m φ_ij(α_m) is linear in D_i and ρ_m. For a grid of shininesses the sums
N = Σ_i [Σwφy − Σwφ Σwy/W], Q = Σ_i [Σwφ² − (Σwφ)²/W], T = Σ_i [Σwy² − (Σwy)²/W] give
ρ = N/Q and RSS = T − N²/Q; α is at the least RSS.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import inner, kernel
from ..power import FAST
from ..samples.observations import longest
from .fit_samples import FitSamples
from .lobes import NOTHING, add, clear, part, soften, take

ALPHAS = 2.0 ** (np.arange(34) / 3)
"""The grid: 1 to 2048, three an octave."""
REACH = 3
"""Cells to both sides of a shininess that is already known."""


@inner(fastmath=FAST)
def _luminances(n, y, origin, w, d):
    """y − origin to d (n,); Σw, Σwd and Σwd²."""
    sw, sy, syy = 0.0, 0.0, 0.0
    for j in range(n):
        d[j] = y[j] - origin
        a, b = np.float64(w[j]), np.float64(d[j])
        sw, sy, syy = sw + a, sy + a * b, syy + a * b * b
    return sw, sy, syy


@inner(fastmath=FAST)
def _lobe_sums(n, phi, w, d):
    """Σwφ, Σwφd and Σwφ²."""
    sp, spy, spp = 0.0, 0.0, 0.0
    for j in range(n):
        p = np.float64(phi[j])
        wp = np.float64(w[j]) * p
        sp, spy, spp = sp + wp, spy + wp * d[j], spp + wp * p
    return sp, spy, spp


@kernel
def _eliminate(first, stop, offsets, material, y, w, mirror, blur, rays, gains, window, sums):
    """Add N, Q, T of the texels first..stop to sums (M, 3, A)."""
    most, lamps = longest(offsets, first, stop), gains.shape[1]
    columns = np.empty((8, most), np.float32)
    rows, u = np.empty((5, most), np.float32), np.empty((2, lamps, most), np.float32)
    h1, h2, height, phi, d = rows[0], rows[1], rows[2], rows[3], rows[4]
    least = np.empty(lamps)
    for i in range(first, stop):
        j, n = offsets[i], offsets[i + 1] - offsets[i]
        if n == 0:
            continue
        m, weight = material[i], w[j : j + n]
        sw, sy, syy = _luminances(n, y[j : j + n], y[j], weight, d)
        if sw <= 0:
            continue
        for a in range(len(ALPHAS)):
            sums[m, 2, a] += syy - sy * sy / sw
        blurriest = take(mirror, blur, j, n, columns)
        nearest = np.inf
        for k in range(lamps):
            least[k] = np.inf
            if gains[i, k] > 0:
                least[k] = part(columns, n, rays[i, k], u[0, k], u[1, k])
            nearest = min(nearest, least[k])
        for a in range(window[m, 0], window[m, 1]):
            # Leave the lamps out whose lobes have ended before all of the texel's samples
            reach = NOTHING * (1.0 / ALPHAS[a] + blurriest)
            if nearest > reach:
                break
            soften(columns, n, ALPHAS[a], h1, h2, height)
            clear(n, phi)
            for k in range(lamps):
                if least[k] <= reach:
                    add(n, gains[i, k], h1, h2, height, u[0, k], u[1, k], phi)
            sp, spy, spp = _lobe_sums(n, phi, weight, d)
            sums[m, 0, a] += spy - sp * sy / sw
            sums[m, 1, a] += spp - sp * sp / sw


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
