"""Lights: none, one, twenty, at the poles and on the seam of the map, and gloss under them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.reflectance.environment import EnvironmentMap, environment_map
from meshlab_svbrdf.reflectance.joint import fit
from meshlab_svbrdf.reflectance.lights import Light, lights_by_median_cut, lights_by_peaks
from meshlab_svbrdf.reflectance.threshold import luminance_threshold
from tests.analytic import angle, bumpy_ball, film, lamp, orbit, unit

from .checks import Case

HEIGHT = 64
RAYS = directions(HEIGHT)
PLACES = {
    "the pole +Y": [0, 1, 0], "the pole −Y": [0, -1, 0], "the ±180° seam": [0, 0, -1],
    "the seam, near the pole": [0, 0.999, -0.04], "+X": [1, 0, 0],
}  # fmt: skip
T, F = 1500, 120


def cases(folder: Path) -> Iterator[Case]:
    yield "a black map", "lights found", 0.0, lambda: len(lights_by_peaks(_map(RAYS[..., 0] * 0)))
    yield (
        "an even map",
        "lights found",
        0.0,
        lambda: len(lights_by_peaks(_map(RAYS[..., 0] * 0 + 1))),
    )
    for name, place in PLACES.items():
        yield f"one lamp at {name}", "degrees", 0.25, partial(_found, [place], lights_by_peaks)
        yield (
            f"one lamp at {name}, median cut",
            "degrees",
            3.0,
            partial(_found, [place], lights_by_median_cut),
        )
    yield "twenty lamps", "degrees", 0.5, partial(_found, _twenty(), lights_by_peaks)
    for name, place in PLACES.items():
        yield f"filmed under one lamp at {name}", "degrees", 0.2, partial(_filmed, folder, place)
    for alpha in (1.0, 1.5, 5.0, 50.0, 500.0, 1500.0, 2000.0):
        yield f"joint fit, α = {alpha:g}", "ln α", 0.08, partial(_gloss, folder, alpha)
    yield "joint fit without a lamp", "materials observed", 0.0, partial(_none, folder)
    yield "joint fit of twenty lamps", "ln α", 0.08, partial(_many, folder)


def _map(radiance: np.ndarray) -> EnvironmentMap:
    top = max(float(radiance.max()), 1e-12)
    return EnvironmentMap(radiance, radiance / top, np.ones_like(radiance))


def _twenty() -> list[np.ndarray]:
    k = np.arange(20) + 0.5
    z = 1 - k / 10
    phi = np.pi * (1 + 5**0.5) * k
    s = np.sqrt(1 - z * z)
    return list(np.column_stack([s * np.cos(phi), s * np.sin(phi), z]))


def _found(places, find) -> float:
    radiance = sum(50 * np.exp(-0.5 * (angle(RAYS, unit(place)) / 4) ** 2) for place in places)
    return _farthest(find(_map(radiance)), places)


def _farthest(lights: list[Light], places) -> float:
    """Degrees between the lamps and the lights; infinite where there are more or less."""
    if len(lights) != len(places):
        return np.inf
    return max(min(angle(light.direction, unit(p)) for light in lights) for p in places)


def _shoot(folder: Path, name: str, lights: list[Light], alpha: float, rho_s: float = 35.0):
    rng = np.random.default_rng(0)
    diffuse = rng.uniform(4, 40, (T, 3))
    texels = bumpy_ball(T)
    material = np.zeros(T, np.int32)
    return film(
        folder / name, texels, orbit(F, turns=4, climb=120), lights, material, [rho_s], [alpha],
        diffuse, noise=1.0,
    )  # fmt: skip


def _filmed(folder: Path, place) -> float:
    scene = _shoot(folder, f"lamp{np.round(place, 2)}".replace(" ", ""), [lamp(place)], 60.0)
    statistics = luminance_threshold(scene.observations)
    found = lights_by_peaks(environment_map(scene.observations, statistics, height=HEIGHT))[:1]
    joint = fit(scene.observations, scene.material, found, np.full(T, 1.5), 0.005)
    return _farthest(joint.lights, [place])


def _fitted(scene, lights: list[Light], alpha: float) -> float:
    (material,) = fit(scene.observations, scene.material, lights, np.full(T, 0.2), 0.0005).materials
    if not material.observed:
        return 0.0 if alpha < 2 or alpha > 1400 else np.inf
    return abs(np.log(material.alpha / alpha))


def _gloss(folder: Path, alpha: float) -> float:
    lights = [lamp([0.3, 0.5, 0.8], 1.2), lamp([-0.8, 0.3, 0.3], 1 / 1.2)]
    return _fitted(_shoot(folder, f"alpha{alpha}", lights, alpha), lights, alpha)


def _none(folder: Path) -> float:
    scene = _shoot(folder, "none", [], 60.0)
    found = fit(scene.observations, scene.material, [], np.full(T, 1.5), 0.005)
    return sum(m.observed for m in found.materials) + len(found.lights)


def _many(folder: Path) -> float:
    lights = [lamp(place) for place in _twenty()]
    return _fitted(_shoot(folder, "many", lights, 80.0, 8.0), lights, 80.0)
