"""The steps by which a texel's normal is fitted to its highlights (see normal_refinement.py)."""

from __future__ import annotations

import numpy as np

from ..geometry.tangents import tangents
from ..jit import inner, kernel
from ..ranks import quantile
from ..samples.observations import longest, sample_luminance, sample_quality
from .fit_samples import is_clipped
from .phong import light_texel
from .pixel_blur import along_and_across, blurred_lobe, pixel_blur

STEPS = 4
ALL, FIRST, SECOND = 0, 1, 2
"""Halves of the film."""


@kernel
def predict(
    block, view, pixel, shape, t, first, n, rays, gains, rho, alpha, e, slope, s, normal
):  # fmt: skip
    """Per sample: lobe, residual y − S, and dS/d(normal) as a 3-vector."""
    bx, by, bz, s2, away = 0.0, 0.0, 0.0, 0.0, np.empty(3)
    for j in range(n):
        f = block.frame[first + j]
        vx = view.eyes[f, 0] - view.position[t, 0]
        vy = view.eyes[f, 1] - view.position[t, 1]
        vz = view.eyes[f, 2] - view.position[t, 2]
        scale = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        nv = normal[0] * vx + normal[1] * vy + normal[2] * vz
        x = 2.0 * nv * normal[0] - vx
        y = 2.0 * nv * normal[1] - vy
        z = 2.0 * nv * normal[2] - vz
        total, dx, dy, dz = 0.0, 0.0, 0.0, 0.0
        if len(shape) > 0:
            bx, by, bz, s2 = pixel_blur(view, pixel, shape[t], t, f)
        s1 = bx * bx + by * by + bz * bz
        for k in range(len(gains)):
            if gains[k] <= 0:
                continue
            cos = rays[k, 0] * x + rays[k, 1] * y + rays[k, 2] * z
            if cos <= 0.01:
                continue
            # The axes are those of the first normal: what counts is where l stands from r
            away[0], away[1], away[2] = rays[k, 0] - x, rays[k, 1] - y, rays[k, 2] - z
            u1, u2 = along_and_across(cos, bx, by, bz, away, s1)
            kept = blurred_lobe(alpha, u1, u2, s1, s2)
            if kept == 0.0:
                continue
            lobe = rho * gains[k] * kept
            total += lobe
            # Blur makes the slope less, along each axis by its own share: w takes the place of l
            h1, h2 = 1.0 / (1.0 + alpha * s1), 1.0 / (1.0 + alpha * s2)
            part = (h1 - h2) * (away[0] * bx + away[1] * by + away[2] * bz)
            part = part / s1 if s1 > 0.0 else 0.0
            wx = h2 * rays[k, 0] + part * bx
            wy = h2 * rays[k, 1] + part * by
            wz = h2 * rays[k, 2] + part * bz
            # dr = 2 (δ·v) n + 2 (n·v) δ, so d(w·r) = 2 δ·((w·n) v + (n·v) w)
            wn = wx * normal[0] + wy * normal[1] + wz * normal[2]
            a = 2.0 * lobe * alpha / cos
            dx += a * (wn * vx + nv * wx)
            dy += a * (wn * vy + nv * wy)
            dz += a * (wn * vz + nv * wz)
        s[j], slope[j, 0], slope[j, 1], slope[j, 2] = total, dx, dy, dz
        e[j] = sample_luminance(block, view, first + j) - total


@inner
def _weigh(block, view, first, n, half, e, s, h0, w):
    """q · huber of the residuals about their median; the other half of the film gets 0."""
    center = quantile(e[:n], 0.5)
    for j in range(n):
        w[j] = 0.0
        if half != ALL and (2 * j < n) != (half == FIRST):
            continue
        d = e[j] - center
        if is_clipped(block, view, first + j) and d <= 0:
            continue
        w[j] = sample_quality(block, first + j) * min(1.0, (h0 + 0.2 * s[j]) / max(abs(d), 1e-9))


@inner
def _variance(e, w, n):
    """Weighted sum of squares of e about its weighted mean."""
    sw, se, see = 0.0, 0.0, 0.0
    for j in range(n):
        sw, se, see = sw + w[j], se + w[j] * e[j], see + w[j] * e[j] * e[j]
    return see - se * se / sw if sw > 0 else 0.0


@inner
def _turn(normal, x, y, z):
    """Add a step to a normal (3,) and make it a unit again."""
    x, y, z = normal[0] + x, normal[1] + y, normal[2] + z
    scale = 1.0 / np.sqrt(x * x + y * y + z * z)
    normal[0], normal[1], normal[2] = x * scale, y * scale, z * scale


@kernel
def _step(n, e, slope, w, noise, sigma, start, normal):
    """Move a normal in its tangent plane, the texel's D eliminated; False where nothing tells how.

    sigma : the prior about `start`, of which the normal stays within two
    """
    ux, uy, uz, vx, vy, vz = tangents(normal[0], normal[1], normal[2])
    sw, se, sp, sq = 0.0, 0.0, 0.0, 0.0
    a, b, c, g0, g1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        p = slope[j, 0] * ux + slope[j, 1] * uy + slope[j, 2] * uz
        q = slope[j, 0] * vx + slope[j, 1] * vy + slope[j, 2] * vz
        sw, se = sw + w[j], se + w[j] * e[j]
        sp, sq = sp + w[j] * p, sq + w[j] * q
        a, b, c = a + w[j] * p * p, b + w[j] * p * q, c + w[j] * q * q
        g0, g1 = g0 + w[j] * p * e[j], g1 + w[j] * q * e[j]
    if not sw > 0:
        return False
    prior = (noise / sigma) ** 2
    x, y, z = normal[0] - start[0], normal[1] - start[1], normal[2] - start[2]
    a += prior - sp * sp / sw
    b -= sp * sq / sw
    c += prior - sq * sq / sw
    g0 -= sp * se / sw + prior * (x * ux + y * uy + z * uz)
    g1 -= sq * se / sw + prior * (x * vx + y * vy + z * vz)
    det = a * c - b * b
    if not det > 0:
        return False
    du, dv = (c * g0 - b * g1) / det, (a * g1 - b * g0) / det
    shorter = min(1.0, sigma / max(np.sqrt(du * du + dv * dv), 1e-30))
    du, dv = du * shorter, dv * shorter
    _turn(normal, du * ux + dv * vx, du * uy + dv * vy, du * uz + dv * vz)
    x, y, z = normal[0] - start[0], normal[1] - start[1], normal[2] - start[2]
    length = np.sqrt(x * x + y * y + z * z)
    if length > 2.0 * sigma:
        back = 2.0 * sigma / length - 1.0
        _turn(normal, back * x, back * y, back * z)
    return True


@kernel
def refine(
    block, texel, view, pixel, shape, material, rho, alpha, noise, bulbs, sigma, half, normals,
    sums,
):  # fmt: skip
    """Correct the normals of the block's texels; sums: residual on the other half before and
    after, and how many texels show a highlight."""
    count = len(bulbs.gain)
    rays, gains = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    coefficients = np.empty(36, np.float32)
    most = longest(block.offsets, 0, block.stop - block.first)
    e, s, w, test = np.empty(most, np.float32), np.empty(most), np.empty(most), np.empty(most)
    slope = np.empty((most, 3))
    normal, start = np.empty(3), np.empty(3)
    for i in range(block.stop - block.first):
        t, first = texel[i], block.offsets[i]
        n = block.offsets[i + 1] - first
        m = material[t]
        light_texel(view, t, bulbs, coefficients, rays, gains)
        for axis in range(3):
            start[axis] = normal[axis] = view.normal[t, axis]
        h0, before, shown = 1.68 / 1.48 * noise[m], 0.0, True
        for step in range(STEPS + 1):
            predict(
                block, view, pixel, shape, t, first, n, rays, gains, rho[m], alpha[m], e, slope, s,
                normal,
            )  # fmt: skip
            if step == 0:
                top = 0.0
                for j in range(n):
                    top = max(top, s[j])
                shown = top >= 3.0 * noise[m]
                if shown and half != ALL:
                    _weigh(block, view, first, n, SECOND, e, s, h0, test)
                    before = _variance(e, test, n)
            if not shown or step == STEPS:
                break
            _weigh(block, view, first, n, half, e, s, h0, w)
            if not _step(n, e, slope, w, noise[m], sigma, start, normal):
                break
        if not shown:
            continue
        if half != ALL:
            sums[0] += before
            sums[1] += _variance(e, test, n)
        sums[2] += 1
        for axis in range(3):
            normals[t, axis] = normal[axis]
