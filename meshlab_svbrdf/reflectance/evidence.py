"""Do the samples determine a material's gloss? Else it is "unobserved", not a number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import kernel

Z_LEAST = 3.0
WIDTH_MOST = 1.5
EXPLAINED_LEAST = 0.3
COLOR_ERROR_MOST = 0.1
SUMS = 14


@dataclass(frozen=True)
class Evidence:
    """What speaks for a material's ρs and α.

    z : ρQ / √Σ w²φ̃²e², ρ over its own error
    explained : share of the variance of the texels that should show the lobe that it explains;
        NaN where none shows more of it than three times the noise
    color : (3,) of the highlight, luminance 1; color_error : (3,) standard errors
    """

    z: float
    explained: float
    color: np.ndarray
    color_error: np.ndarray


@kernel
def _evidence(first, stop, offsets, material, rgb, y, w, specular, residual, noise, sums):
    """Add to sums (M, 5 + 3 + 3 + 3): ΣwS̃² and Σw²S̃²e²; over the texels that show the lobe,
    Σwe² and Σwỹ²; Σw²S̃⁴; then, per channel, ΣwS̃c̃, Σw²S̃²c̃² and Σw²S̃³c̃.
    """
    for i in range(first, stop):
        m = material[i]
        sw, ss, sy, top = 0.0, 0.0, 0.0, 0.0
        sc = np.zeros(3)
        for j in range(offsets[i], offsets[i + 1]):
            sw, ss, sy = sw + w[j], ss + w[j] * specular[j], sy + w[j] * y[j]
            for c in range(3):
                sc[c] += w[j] * rgb[j, c]
            if w[j] > 0:
                top = max(top, specular[j])
        if sw <= 0:
            continue
        shows = top > 3 * noise[m]
        for j in range(offsets[i], offsets[i + 1]):
            s, d, e = specular[j] - ss / sw, y[j] - sy / sw, residual[j]
            sums[m, 0] += w[j] * s * s
            sums[m, 1] += w[j] * w[j] * s * s * e * e
            if shows:
                sums[m, 2] += w[j] * e * e
                sums[m, 3] += w[j] * d * d
            sums[m, 4] += w[j] * w[j] * s**4
            for c in range(3):
                v = rgb[j, c] - sc[c] / sw
                sums[m, 5 + c] += w[j] * s * v
                sums[m, 8 + c] += w[j] * w[j] * s * s * v * v
                sums[m, 11 + c] += w[j] * w[j] * s**3 * v


def weigh_evidence(
    samples, weight, specular, residual, noise: np.ndarray, chunks
) -> list[Evidence]:
    """The evidence of every material.

    samples : FitSamples, best held out of the fit; weight, specular, residual : (N,) of them
    noise : (M,) robust standard deviation of the residuals
    """

    def work(first, stop):
        sums = np.zeros((len(noise), SUMS))
        _evidence(
            first, stop, samples.offsets, samples.material, samples.rgb, samples.luminance, weight,
            specular, residual, noise, sums,
        )  # fmt: skip
        return sums

    out = []
    for row in sum(chunks(work), np.zeros((len(noise), SUMS))):
        q, error, unexplained, variance = row[:4]
        if q <= 0:
            out.append(Evidence(0.0, np.nan, np.ones(3), np.full(3, np.inf)))
            continue
        explained = 1 - unexplained / variance if variance > 0 else np.nan
        # The colour's error is what its own highlight leaves: Σw²S̃² (c̃ − color S̃)²
        color = row[5:8] / q
        left = row[8:11] - 2 * color * row[11:14] + color**2 * row[4]
        out.append(
            Evidence(
                q / np.sqrt(error) if error > 0 else np.inf,
                explained,
                color,
                np.sqrt(np.maximum(left, 0)) / q,
            )
        )
    return out


def highlight_color(evidence: Evidence) -> tuple[float, float, float]:
    """The highlight's colour, luminance 1: white unless the samples clearly say otherwise."""
    deviation = np.abs(evidence.color - 1)
    clear = (evidence.color_error <= COLOR_ERROR_MOST).all() and (evidence.color > 0).all()
    if clear and ((deviation > 3 * evidence.color_error) & (deviation > COLOR_ERROR_MOST)).any():
        color = evidence.color / (evidence.color @ np.array([0.2126, 0.7152, 0.0722]))
        return float(color[0]), float(color[1]), float(color[2])
    return 1.0, 1.0, 1.0


def verdict(rho_s: float, at_end: bool, evidence: Evidence, width: float) -> str:
    """Why a material's gloss is unobserved; empty where it is observed."""
    if not rho_s > 0:
        return "no highlight under the lights found"
    if at_end:
        return "the samples do not determine the shininess (best at an end of the range)"
    if not evidence.z > Z_LEAST:
        return f"rho_s is only {evidence.z:.1f} times its error (needs {Z_LEAST:g})"
    if not width < WIDTH_MOST:
        return f"the shininess is uncertain by a factor of {np.exp(width):.1f}"
    if np.isnan(evidence.explained):
        return "no highlight stands out of the noise"
    if not evidence.explained > EXPLAINED_LEAST:
        return (
            f"the highlights explain {max(evidence.explained, 0):.0%} of what the texels' "
            f"brightness varies by (needs {EXPLAINED_LEAST:.0%})"
        )
    return ""
