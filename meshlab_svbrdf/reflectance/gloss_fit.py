"""The joint fit's steps for any kind of gloss: eliminate, predict, and move the lights.

y_ij = D_i + a_m ψ_ij + b_m ψ₅_ij is linear in D_i, a and b, as it is with Phong's lobe: D_i drops
out exactly, and a and b follow from five sums for each roughness tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..jit import kernel
from .fit_state import FitState
from .lights import Light, tangents
from .microfacet import Gloss, columns, specular
from .phong import lamps, light_texels

STEP = 0.05
"""Largest move of a light in a round, radians; κ takes three of them."""
DAMPING = 0.01
LEAST_F0 = 0.02
"""Water's: hardly anything mirrors less."""
NUDGE = 1e-3
"""By which a light's parameters are moved to see what its highlights do."""


@kernel
def _sums(
    first, stop, offsets, material, normal, y, w, mirror, blur, rays, gains, kind, shape, sums
):  # fmt: skip
    """Add Σwψ̃², Σwψ̃ψ̃₅, Σwψ̃₅², Σwψ̃ỹ, Σwψ̃₅ỹ and Σwỹ² of the texels first..stop to sums (M, 6)."""
    for i in range(first, stop):
        m = material[i]
        if kind[m] < 0 or offsets[i] == offsets[i + 1]:
            continue
        sw, sp, sq, sy = 0.0, 0.0, 0.0, 0.0
        pp, pq, qq, py, qy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        origin = y[offsets[i]]
        for j in range(offsets[i], offsets[i + 1]):
            if w[j] <= 0:
                continue
            p, q = columns(
                kind[m], shape[m], blur[j], normal[i], mirror[j, 0], mirror[j, 1], mirror[j, 2],
                rays[i], gains[i],
            )  # fmt: skip
            d = np.float64(y[j] - origin)
            sw, sy, yy = sw + w[j], sy + w[j] * d, yy + w[j] * d * d
            sp, pp, py = sp + w[j] * p, pp + w[j] * p * p, py + w[j] * p * d
            sq, qq, qy = sq + w[j] * q, qq + w[j] * q * q, qy + w[j] * q * d
            pq += w[j] * p * q
        if sw > 0:
            sums[m, 0] += pp - sp * sp / sw
            sums[m, 1] += pq - sp * sq / sw
            sums[m, 2] += qq - sq * sq / sw
            sums[m, 3] += py - sp * sy / sw
            sums[m, 4] += qy - sq * sy / sw
            sums[m, 5] += yy - sy * sy / sw


def strengths(sums: np.ndarray) -> tuple[float, float, float]:
    """a, b and what they leave, from one material's sums (6,); b ≥ 0 and F₀ = a/(a + b) ≥ .02."""
    pp, pq, qq, py, qy, yy = sums
    best = (0.0, 0.0, yy)

    def rest(a: float, b: float) -> tuple[float, float, float]:
        return a, b, yy - 2 * (a * py + b * qy) + a * a * pp + 2 * a * b * pq + b * b * qq

    candidates = []
    if pp > 0:
        candidates.append(rest(max(py / pp, 0), 0.0))
    f, g = LEAST_F0, 1 - LEAST_F0
    if qq > 0:
        k = max((f * py + g * qy) / (f * f * pp + 2 * f * g * pq + g * g * qq), 0)
        candidates.append(rest(f * k, g * k))
    determinant = pp * qq - pq * pq
    if determinant > 1e-9 * pp * qq:
        a, b = (py * qq - qy * pq) / determinant, (qy * pp - py * pq) / determinant
        if b >= 0 and a >= f * (a + b):
            candidates.append(rest(a, b))
    return min([best, *candidates], key=lambda c: c[2])


def eliminate_gloss(state: FitState, kind: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """a, b and the residual sum of squares of every material, (M, 3).

    kind : (M,), -1 where a material is left out; shape : (M,) tried
    """
    s, normal = state.samples, state.observations.view.normal[state.samples.texel]

    def work(first, stop):
        sums = np.zeros((state.materials, 6))
        _sums(
            first, stop, s.offsets, s.material, normal, s.luminance, state.weight, s.mirror,
            s.mean_blur, state.rays, state.gains, kind, shape, sums,
        )  # fmt: skip
        return sums

    total = sum(state.chunks(work), np.zeros((state.materials, 6)))
    return np.array([strengths(row) for row in total]).reshape(-1, 3)


@kernel
def _specular(first, stop, offsets, material, normal, mirror, blur, rays, gains, gloss, out):
    for i in range(first, stop):
        for j in range(offsets[i], offsets[i + 1]):
            out[j] = 0.0
            if gloss.facing[material[i]] > 0 or gloss.grazing[material[i]] > 0:
                out[j] = specular(
                    gloss, material[i], blur[j], normal[i],
                    mirror[j, 0], mirror[j, 1], mirror[j, 2], rays[i], gains[i],
                )  # fmt: skip


def highlights(state: FitState, gloss: Gloss, rays: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """S of every sample (N,) float32 under lights given by their rays and gains."""
    s, out = state.samples, np.empty(len(state.samples), np.float32)
    normal = state.observations.view.normal[s.texel]
    state.chunks(lambda a, b: _specular(
        a, b, s.offsets, s.material, normal, s.mirror, s.mean_blur, rays, gains, gloss, out
    ))  # fmt: skip
    return out


def center(values: np.ndarray, weight: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Each texel's weighted mean subtracted, (N,) float64; texels have samples."""
    total = np.add.reduceat(np.asarray(weight, np.float64), offsets[:-1])
    mean = np.add.reduceat(weight * np.asarray(values, np.float64), offsets[:-1])
    mean /= np.maximum(total, 1e-30)
    return values - np.repeat(mean, np.diff(offsets))


def predict(state: FitState, gloss: Gloss) -> None:
    """Set the state's S and e = y − D − S, D with w/(1 + (S/10)²)."""
    s = state.samples
    state.specular = highlights(state, gloss, state.rays, state.gains)
    without = s.luminance - state.specular.astype(np.float64)
    careful = state.weight / (1 + (state.specular * 0.1) ** 2)
    state.residual = center(without, careful, s.offsets).astype(np.float32)


def moved(light: Light, change: np.ndarray) -> Light:
    """A light after a change (4,) of two angles, ln gain and κ."""
    frame = tangents(light.direction)
    direction = light.direction + change[:2] @ frame
    direction = direction / np.linalg.norm(direction)
    rotation = tangents(direction) @ frame.T
    return replace(
        light,
        direction=direction,
        covariance=rotation @ light.covariance @ rotation.T,
        bar=light.bar - (light.bar @ direction) * direction,
        gain=light.gain * float(np.exp(change[2])),
        curvature=float(np.clip(light.curvature + change[3], 0, 0.5)),
    )


def move_lights(state: FitState, lights: list[Light], gloss: Gloss) -> tuple[list[Light], float]:
    """One Gauss-Newton step on the lights the state is lit by; far ones stay far.

    The state's residuals are those under `gloss`. Gains keep their geometric mean of 1. Also
    returned: the largest change, of angles in radians, ln gain and κ.
    """
    s, lit = state.samples, state.lamps.lit
    weight = state.weight.astype(np.float64)
    free = [(k, p) for k, g in enumerate(lights) for p in range(4) if p < 3 or g.curvature > 0]
    slopes = np.empty((len(free), len(s)))
    for k, light in enumerate(lights):
        shown = lit[:, [k]] if len(lit) else None

        def under(light: Light, shown=shown) -> np.ndarray:
            bulbs = lamps([light], state.lamps.radius, shown)
            rays, gains = light_texels(state.observations.view, s.texel, bulbs)
            return highlights(state, gloss, rays, gains)

        present = under(light)
        for column, (of, p) in enumerate(free):
            if of != k:
                continue
            slope = present
            if p != 2:
                slope = (under(moved(light, NUDGE * np.eye(4)[p])) - present) / NUDGE
            slopes[column] = center(slope, weight, s.offsets)
    vector = slopes @ (weight * state.residual)
    matrix = (slopes * weight) @ slopes.T
    shows = np.diag(matrix) > 0
    change = np.zeros((len(lights), 4))
    if shows.any():
        a = matrix[np.ix_(shows, shows)] + DAMPING * np.diag(np.diag(matrix)[shows])
        delta = np.zeros(len(free))
        delta[shows] = np.linalg.solve(a, vector[shows])
        change[tuple(np.transpose(free))] = delta
    for row in change:
        row[:2] *= min(1.0, STEP / max(float(np.linalg.norm(row[:2])), 1e-12))
        row[2], row[3] = np.clip(row[2], -1, 1), np.clip(row[3], -3 * STEP, 3 * STEP)
    after = [moved(light, row) for light, row in zip(lights, change, strict=True)]
    mean = np.exp(np.mean(np.log([light.gain for light in after])))
    return [replace(light, gain=light.gain / mean) for light in after], float(np.abs(change).max())
