"""Single precision against double: each kernel's formula, on the same inputs, both ways."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.geometry.harmonics import COEFFICIENTS, basis, evaluate
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.power import exp, ln
from meshlab_svbrdf.reflectance.directions import octahedral_cell, octahedral_directions
from meshlab_svbrdf.reflectance.elimination import ALPHAS, profile
from meshlab_svbrdf.reflectance.lights import tangents
from meshlab_svbrdf.reflectance.phong import lobe
from meshlab_svbrdf.reflectance.specular import solve_peak
from meshlab_svbrdf.samples.luminance import decode, encode
from meshlab_svbrdf.samples.observations import mirror_direction
from tests.analytic import ball, mirror, observations_of, orbit, rotation, sphere, unit

from .checks import Case

SHININESS = (1.0, 2.0, 10.0, 100.0, 500.0, 2000.0)


def cases(folder: Path) -> Iterator[Case]:
    yield "sRGB to linear and back, all codes", "codes", 1e-9, _srgb
    yield "ln, 10⁻³⁰ to 10³⁰", "relative", 3e-7, _ln
    yield "e^x, −80 to 80", "relative", 1e-5, _exp
    yield "mirror directions", "radians", 1e-6, partial(_mirror, folder, 1.0)
    yield (
        "mirror directions, camera a thousand radii away",
        "radians",
        1e-6,
        partial(_mirror, folder, 1000.0),
    )
    for alpha in SHININESS:
        yield f"lobe, α = {alpha:g}", "of the peak", 1.5e-6 * alpha + 1e-6, partial(_lobe, alpha)
    for alpha in SHININESS:
        yield f"peak of one texel, α = {alpha:g}", "ln α, ln ρs", 1e-6, partial(_peak, alpha)
    for alpha in SHININESS:
        yield f"elimination, α = {alpha:g}", "ln α", 0.03, partial(_profile, alpha)
    yield "harmonics of six bands", "of V", 1e-6, _harmonics
    yield "octahedral cells, seam and poles", "cells", 0.0, _cells
    yield "tangents, 10⁻¹² from the poles", "orthogonality", 1e-9, _tangents
    for scale in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        yield (
            f"texels of a sphere, radius {scale:g}",
            "of the radius",
            1e-6,
            partial(_texels, scale, 0.0),
        )
    for away in (1e3, 1e6):
        yield (
            f"texels of a unit sphere at {away:g}",
            "of the radius",
            1e-6,
            partial(_texels, 1.0, away),
        )


def _srgb() -> float:
    codes = np.arange(256) / 255
    return np.abs(encode(decode(codes)) - codes).max() * 255


def _ln() -> float:
    x = np.float32(10.0) ** np.linspace(-30, 30, 20_001, dtype=np.float32)
    found = np.array([ln(v) for v in x], float)
    return (
        np.abs(found - np.log(x.astype(float))) / np.maximum(np.abs(np.log(x.astype(float))), 1)
    ).max()


def _exp() -> float:
    x = np.linspace(-80, 80, 20_001, dtype=np.float32)
    return np.abs(np.array([exp(v) for v in x], float) / np.exp(x.astype(float)) - 1).max()


def _mirror(folder: Path, away: float) -> float:
    texels, cameras = ball(50), orbit(8, distance=4.0 * away)
    seen = np.full((50, 8), 127, np.uint8)
    codes = np.zeros((50, 8, 3), np.uint8)
    view = observations_of(folder / f"mirror{away:g}", codes, seen, texels, cameras).view
    found = np.array([[mirror_direction(view, i, f) for f in range(8)] for i in range(50)], float)
    return np.linalg.norm(found - mirror(texels, cameras), axis=-1).max()


def _lobe(alpha: float) -> float:
    """Near the peak and far from it, rays in single precision."""
    rng = np.random.default_rng(1)
    light = unit(rng.normal(size=3))
    away = np.concatenate([[0.0], 10.0 ** np.linspace(-4, np.log10(1.5), 200)])
    side = tangents(light)[0]
    worst = 0.0
    for angle in away:
        r = np.cos(angle) * light + np.sin(angle) * side
        cos = max(float(light @ r), 0.0)
        found = lobe(*r.astype(np.float32), light.astype(np.float32)[None], np.float32([1]), alpha)
        worst = max(worst, abs(found - cos**alpha))
    return worst


def _peak(alpha: float) -> float:
    """Where the guards let a peak through it is exact; those within them by 0.1 %."""
    width = 1.0 / np.sqrt(alpha)
    d2_max, d2_min, rho = 0.1, 1.5, 40.0
    high, low = (rho * (1 + d2 * width**2) ** (-alpha / 2) for d2 in (d2_max, d2_min))
    found_rho, found = solve_peak(high, low, d2_max, d2_min, width**2)
    if np.isnan(found) and alpha in (SHININESS[0], SHININESS[-1]):
        return 0.0  # an end of the range is not observed
    return max(abs(np.log(found / alpha)), abs(np.log(found_rho / rho)))


def _profile(alpha: float) -> float:
    """N, Q, T of exact lobes over the grid; an end of it says so."""
    away = np.linspace(0, 1.2, 400)
    lobes = np.cos(away)[None] ** ALPHAS[:, None]
    truth = 30.0 * np.cos(away) ** alpha
    y, phi = truth - truth.mean(), lobes - lobes.mean(1, keepdims=True)
    found = profile(np.array([phi @ y, (phi**2).sum(1), np.full(len(ALPHAS), y @ y)]))
    if found.at_end:
        return 0.0 if alpha <= ALPHAS[0] or alpha >= 0.9 * ALPHAS[-1] else np.inf
    return abs(np.log(found.alpha / alpha))


def _harmonics() -> float:
    rng = np.random.default_rng(2)
    rays = unit(np.concatenate([rng.normal(size=(500, 3)), np.eye(3), -np.eye(3)]))
    coefficients = rng.normal(size=COEFFICIENTS) / COEFFICIENTS
    exact = basis(rays) @ coefficients
    single = coefficients.astype(np.float32)
    found = [evaluate(single, *ray.astype(np.float32)) for ray in rays]
    return np.abs(np.array(found) - exact).max()


def _cells() -> float:
    size = 64
    rays = octahedral_directions(size).reshape(-1, 3).astype(np.float32)
    found = np.array([octahedral_cell(*ray, size) for ray in rays])
    expected = np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), -1)
    axes = np.float32([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0]])
    inside = all(0 <= k < size for ray in axes for k in octahedral_cell(*ray, size))
    return float(np.abs(found - expected.reshape(-1, 2)).max()) if inside else np.inf


def _tangents() -> float:
    worst = 0.0
    for sign in (1.0, -1.0):
        for off in (0.0, 1e-300, 1e-12, 1e-6):
            d = unit([off, off, sign])
            frame = np.array([*tangents(d), d])
            worst = max(worst, np.abs(frame @ frame.T - np.eye(3)).max())
    return worst


def _texels(scale: float, away: float) -> float:
    """Texels lie on the sphere's facets, wherever in the world it is: turned, and far away."""
    rng = np.random.default_rng(3)
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = scale * rotation(rng), away
    near = rasterise_texels(sphere(), ((64, 64),))
    far = rasterise_texels(sphere().transformed(world), ((64, 64),))
    if len(near) != len(far):
        return np.inf
    order, other = (np.lexsort((t.col, t.row)) for t in (near, far))
    center = far.center - (world[:3, :3] @ near.center + world[:3, 3])
    expected = near.position[order].astype(float) @ world[:3, :3].T - center
    return np.abs(far.position[other] - expected).max() / scale
