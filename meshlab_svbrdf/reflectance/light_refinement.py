"""Gauss-Newton on the lights: direction, ln gain, κ, bar and breadth of each, texel-centred.

Every texel's D_i is eliminated by centring, so that only what varies among a texel's samples
counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..jit import kernel
from .fit_samples import FitSamples
from .lights import Light, tangents
from .phong import Lamps

PARAMETERS = 7  # per light: two angles, ln gain, κ, the bar's two components, and the breadth


@kernel
def _normal_equations(
    first, stop, offsets, material, mirror, w, residual, position, rays, gains,
    lamps, frames, rho, alpha, matrix, vector,
):  # fmt: skip
    """Add Σ w J̃ᵀJ̃ and Σ w J̃ᵀẽ of the texels first..stop, J̃ and ẽ centred per texel."""
    lights = len(frames)
    size = lights * PARAMETERS
    mean_j, jac = np.empty(size), np.empty(size)
    active = np.empty(lights, np.int64)
    for i in range(first, stop):
        m = material[i]
        if not rho[m] > 0:
            continue
        sw, se, touched = 0.0, 0.0, False
        for u in range(size):
            mean_j[u] = 0.0
        for j in range(offsets[i], offsets[i + 1]):
            if w[j] <= 0:
                continue
            sw += w[j]
            se += w[j] * residual[j]
            count = 0
            for k in range(gains.shape[1]):
                if gains[i, k] <= 0:
                    continue
                lx, ly, lz = rays[i, k, 0], rays[i, k, 1], rays[i, k, 2]
                rx, ry, rz = mirror[j, 0], mirror[j, 1], mirror[j, 2]
                cos = lx * rx + ly * ry + lz * rz
                if cos <= 0.01:
                    continue
                e = alpha[m] * np.log(min(cos, np.float32(1)))
                if e < -12.0:
                    continue
                # Differentiate S = ρ g |L|⁻² (l·r)^α by L, then by the parameters of L = d − κ x
                s = rho[m] * gains[i, k] * np.exp(e)
                kx = lamps.curvature[k] / lamps.radius
                px, py, pz = (position[i, 0], position[i, 1], position[i, 2])
                dx, dy, dz = (
                    lamps.direction[k, 0] - kx * px,
                    lamps.direction[k, 1] - kx * py,
                    lamps.direction[k, 2] - kx * pz,
                )
                inverse = 1.0 / np.sqrt(dx * dx + dy * dy + dz * dz)
                a = s * inverse
                gx = a * (alpha[m] * (rx / cos - lx) - 2.0 * lx)
                gy = a * (alpha[m] * (ry / cos - ly) - 2.0 * ly)
                gz = a * (alpha[m] * (rz / cos - lz) - 2.0 * lz)
                light = lamps.light[k]
                f, b = frames[light], PARAMETERS * light
                if count == 0 or active[count - 1] != light:
                    active[count] = light
                    count += 1
                    for u in range(b, b + PARAMETERS):
                        jac[u] = 0.0
                across = gx * f[0, 0] + gy * f[0, 1] + gz * f[0, 2]
                up = gx * f[1, 0] + gy * f[1, 1] + gz * f[1, 2]
                # Bar and breadth turn with the direction
                qx, qy, qz = lamps.direction[k, 0], lamps.direction[k, 1], lamps.direction[k, 2]
                away = gx * f[5, 0] + gy * f[5, 1] + gz * f[5, 2]
                jac[b] += across - away * (qx * f[0, 0] + qy * f[0, 1] + qz * f[0, 2])
                jac[b + 1] += up - away * (qx * f[1, 0] + qy * f[1, 1] + qz * f[1, 2])
                jac[b + 2] += s
                jac[b + 3] -= (gx * px + gy * py + gz * pz) / lamps.radius
                # The breadth turns with the bar, and the points' shares of the gain change
                c = s / (qx * qx + qy * qy + qz * qz)
                gx, gy, gz = gx - c * qx, gy - c * qy, gz - c * qz
                across = gx * f[0, 0] + gy * f[0, 1] + gz * f[0, 2]
                up = gx * f[1, 0] + gy * f[1, 1] + gz * f[1, 2]
                beside = gx * f[2, 0] + gy * f[2, 1] + gz * f[2, 2]
                turn = lamps.across[k] * (gx * f[3, 0] + gy * f[3, 1] + gz * f[3, 2])
                jac[b + 4] += lamps.along[k] * across - turn * f[4, 0] + s * f[6, 0]
                jac[b + 5] += lamps.along[k] * up - turn * f[4, 1] + s * f[6, 1]
                jac[b + 6] += lamps.across[k] * beside + s * f[6, 2]
            if count > 0:
                touched = True
                for p in range(count):
                    for u in range(PARAMETERS * active[p], PARAMETERS * (active[p] + 1)):
                        wj = w[j] * jac[u]
                        mean_j[u] += wj
                        vector[u] += wj * residual[j]
                        for q in range(count):
                            for v in range(PARAMETERS * active[q], PARAMETERS * (active[q] + 1)):
                                matrix[u, v] += wj * jac[v]
        if touched:
            for u in range(size):
                if mean_j[u] != 0.0:
                    vector[u] -= mean_j[u] * se / sw
                    for v in range(size):
                        matrix[u, v] -= mean_j[u] * mean_j[v] / sw


def _frame(light: Light, lamps: Lamps, k: int) -> np.ndarray:
    """(7, 3): two tangents; the breadth's direction, how it turns with the bar, by which tangent;
    the direction; how ln gain of all points changes with the bar's components and the breadth."""
    u, v = tangents(light.direction)
    turn = light.breadth / max(float(light.bar @ light.bar), 1e-300) * light.bar
    by = np.array([light.side @ u, light.side @ v, 0.0])
    own = lamps.light == k
    row, along, across = lamps.direction[own], lamps.along[own], lamps.across[own]
    cosine2 = 1 / np.sum(row**2, axis=1)
    moves = np.stack([
        along * (row @ u) - across * (row @ turn) * by[0],
        along * (row @ v) - across * (row @ turn) * by[1],
        across * (row @ light.side),
    ])  # fmt: skip
    swell = 4 * (moves @ cosine2**3) / np.sum(cosine2**2)
    return np.stack([u, v, light.side, turn, by, light.direction, swell])


def refine_lights(
    lights: list[Light], samples: FitSamples, weight: np.ndarray, residual: np.ndarray,
    position: np.ndarray, rays: np.ndarray, gains: np.ndarray, lamps: Lamps, rho: np.ndarray,
    alpha: np.ndarray, chunks, *, near: np.ndarray, damping: float = 0.01, step: float = 0.05,
) -> tuple[list[Light], np.ndarray]:  # fmt: skip
    """One Gauss-Newton step on all lights.

    Parameters
    ----------
    residual : (N,) float32, Y − D − S; position : (n, 3) float32 of the texels, about the centre
    rho, alpha : (M,) of the materials, ρ 0 where a material is to be left out
    near : (K,) bool, whose κ is free
    step : largest step of a direction, radians; κ takes three of them, so that a lamp at two radii
        is reached within the rounds

    Returns
    -------
    lights : gains of geometric mean 1
    error : (K,) standard error of κ
    """
    frames = np.array([_frame(light, lamps, k) for k, light in enumerate(lights)])
    size = len(lights) * PARAMETERS

    def work(first, stop):
        matrix, vector = np.zeros((size, size)), np.zeros(size)
        _normal_equations(
            first, stop, samples.offsets, samples.material, samples.mirror, weight, residual,
            position, rays, gains, lamps, frames, rho, alpha, matrix, vector,
        )  # fmt: skip
        return matrix, vector

    parts = chunks(work)
    matrix, vector = sum(p[0] for p in parts), sum(p[1] for p in parts)
    free = np.ones(size, bool)
    free[3::PARAMETERS] = near
    free[4::PARAMETERS] = free[5::PARAMETERS] = [light.bar.any() for light in lights]
    free[6::PARAMETERS] = [light.breadth > 0 for light in lights]
    free &= np.diag(matrix) > 0
    delta, error = np.zeros(size), np.full(size, np.inf)
    if free.any():
        a = matrix[np.ix_(free, free)]
        diagonal = np.diag(np.diag(a))
        delta[free] = np.linalg.solve(a + damping * diagonal, vector[free])
        used = weight > 0
        variance = float(weight[used] @ residual[used] ** 2) / max(used.sum(), 1)
        error[free] = np.sqrt(variance * np.diag(np.linalg.inv(a + 1e-9 * diagonal)))
    moved = []
    for k, light in enumerate(lights):
        own = delta[PARAMETERS * k : PARAMETERS * (k + 1)]
        angles, gain, kappa, turn, wider = np.split(own, [2, 3, 4, 6])
        angles, turn = (
            x * min(1.0, step / max(float(np.linalg.norm(x)), 1e-12)) for x in (angles, turn)
        )
        bar = light.bar + turn @ frames[k, :2]
        direction = light.direction + angles @ frames[k, :2]
        direction = direction / np.linalg.norm(direction)
        rotation = tangents(direction) @ frames[k, :2].T
        moved.append(
            replace(
                light,
                direction=direction,
                covariance=rotation @ light.covariance @ rotation.T,
                bar=bar - (bar @ direction) * direction,
                breadth=max(0.0, light.breadth + float(np.clip(wider[0], -step, step))),
                gain=light.gain * float(np.exp(np.clip(gain[0], -1, 1))),
                curvature=float(
                    np.clip(light.curvature + np.clip(kappa[0], -3 * step, 3 * step), 0, 0.5)
                ),
            )
        )
    mean = np.exp(np.mean(np.log([light.gain for light in moved])))
    return [replace(light, gain=light.gain / mean) for light in moved], error[3::PARAMETERS]
