"""ρs and α of a material from those of its texels: the bell of the highest mode (paper §7.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MINIMUM_TEXELS = 16
"""Materials with fewer texels that show a peak are unobserved."""


@dataclass(frozen=True)
class Bell:
    """The statistical bell of ρs: (x, density) to plot, limits at half maximum, what lies in it."""

    rho_s: float
    alpha: float
    low: float
    high: float
    texels: int
    x: np.ndarray
    density: np.ndarray


def silverman(values: np.ndarray) -> float:
    """Bandwidth .9 · min(σ, IQR / 1.34) · n^−⅕; where the IQR is 0, σ alone."""
    sigma = float(values.std())
    iqr = float(np.subtract(*np.quantile(values, [0.75, 0.25]))) / 1.34
    return 0.9 * (min(sigma, iqr) if iqr > 0 else sigma) * len(values) ** -0.2


def highest_bell(
    rho_s: np.ndarray, alpha: np.ndarray, *, density: str = "log", bell: str = "median"
) -> Bell | None:
    """The average of ρs and α inside the bell of the highest mode; None for too few texels.

    Parameters
    ----------
    rho_s, alpha : (n,) of a material's texels, NaN where they do not tell
    density : of "log" ρs, or of ρs itself ("linear", the letter)
    bell : "median" of the values inside, or "mean" (the letter)
    """
    known = np.isfinite(rho_s) & np.isfinite(alpha) & (rho_s > 0)
    rho_s, alpha = rho_s[known].astype(float), alpha[known].astype(float)
    if len(rho_s) < MINIMUM_TEXELS:
        return None
    values = np.log(rho_s) if density == "log" else rho_s
    low, high = np.quantile(values, [0.01, 0.99])
    inner = values[(values >= low) & (values <= high)]
    width = silverman(inner)
    if not width > 1e-9 * max(abs(low), abs(high), 1e-9):
        x, f = np.array([low, high]), np.array([np.inf, np.inf])
    else:
        from KDEpy import FFTKDE  # takes most of a second

        x = np.linspace(low - 3 * width, high + 3 * width, 1024)
        f = FFTKDE(bw=width).fit(inner).evaluate(x)
        peak = int(np.argmax(f))
        under = f < f[peak] / 2
        left = np.flatnonzero(under[:peak])
        right = np.flatnonzero(under[peak:])
        low = x[left[-1]] if len(left) else x[0]
        high = x[peak + right[0]] if len(right) else x[-1]
    inside = (values >= low) & (values <= high)
    average = np.median if bell == "median" else np.mean
    back = np.exp if density == "log" else np.asarray
    return Bell(
        float(average(rho_s[inside])), float(average(alpha[inside])),
        float(back(low)), float(back(high)), int(inside.sum()), back(x), f,
    )  # fmt: skip
