"""The main light sources, found in the environment map (paper §7.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from skimage.measure import label

from .directions import directions, solid_angles
from .environment import EnvironmentMap

TRUSTED_SAMPLES = 6
"""Samples of a texel, median, below which lights may be false or far off (docs/sequences.md)."""
LEAST_RESULTANT = 0.1
"""|mean direction| of a blob below which it comes from all around and is no light."""


@dataclass(frozen=True)
class Light:
    """A light source.

    direction : (3,) float64 unit vector from the object's centre
    covariance : (2, 2) float64, its shape in the tangent plane (`tangents`), radians²
    gain : relative intensity at the centre; geometric mean 1 over the lights
    curvature : 1/distance from the centre in units of the object's radius; 0 where it is far (κ)
    energy : what it adds up to in the map, for ranking
    bar : (3,) float64, half of a long lamp's length as seen from the centre: a tangent vector, in
        units of the distance; 0 for a compact lamp
    breadth : half of its other side, at right angles to the bar, in the same units; 0 for a row
    """

    direction: np.ndarray
    covariance: np.ndarray
    gain: float = 1.0
    curvature: float = 0.0
    energy: float = 0.0
    bar: np.ndarray = field(default_factory=lambda: np.zeros(3))
    breadth: float = 0.0

    @property
    def side(self) -> np.ndarray:
        """Unit vector (3,) along its breadth, at right angles to the bar; 0 without a bar."""
        across = np.cross(self.direction, self.bar)
        return across / max(float(np.linalg.norm(across)), 1e-300)

    def position(self, center: np.ndarray, radius: float) -> np.ndarray | None:
        """Where it stands in the world, (3,), or None where it is far."""
        return None if self.curvature == 0 else center + self.direction * (radius / self.curvature)


def tangents(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors, (2, 3), that span the tangent plane at a direction (Duff et al. 2017)."""
    x, y, z = direction
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    return np.array(
        [[1 + sign * x * x * a, sign * x * y * a, -sign * x], [x * y * a, sign + y * y * a, -y]]
    )


def blob_light(rays: np.ndarray, energy: np.ndarray, pixel: float) -> Light:
    """Centroid and covariance of a blob of directions.

    rays : (N, 3) unit; energy : (N,); pixel : the map's pixel in radians. The centroid is taken in
    3-D, never in latitude and longitude; the covariance gets a pixel's own, pixel²/12, so that a
    blob of one pixel is not singular; only directions with l·r > .1 are projected.
    """
    direction = energy @ rays
    direction = direction / np.linalg.norm(direction)
    cos = rays @ direction
    near = cos > 0.1
    flat = rays[near] @ tangents(direction).T / cos[near, None]
    covariance = (energy[near, None] * flat).T @ flat / energy[near].sum() + np.eye(
        2
    ) * pixel**2 / 12
    return Light(direction, covariance, energy=float(energy.sum()))


def _connect(mask: np.ndarray, diagonal: bool = True) -> np.ndarray:
    """Components of a map's mask, wrapping around in azimuth and over the poles; 0 is none."""
    ids = label(mask, connectivity=2 if diagonal else 1)
    parent = np.arange(ids.max() + 1)

    def root(i):
        while parent[i] != i:
            i = parent[i]
        return i

    steps = (-1, 0, 1) if diagonal else (0,)
    pairs = [(ids[:, -1], np.roll(ids[:, 0], k)) for k in (0,)]
    for k in steps:
        if k:
            shifted = np.zeros_like(ids[:, 0])
            shifted[max(k, 0) : len(shifted) + min(k, 0)] = ids[
                max(-k, 0) : len(shifted) + min(-k, 0), 0
            ]
            pairs.append((ids[:, -1], shifted))
    for row in (0, -1):
        first = ids[row][ids[row] > 0]
        pairs.append((first, np.full(len(first), first[0] if len(first) else 0)))
    for a, b in pairs:
        for i, j in {(int(i), int(j)) for i, j in zip(a, b, strict=True) if i and j}:
            parent[max(root(i), root(j))] = min(root(i), root(j))
    return np.array([root(i) for i in range(len(parent))])[ids]


def _blob_lights(ids: np.ndarray, energy: np.ndarray) -> list[Light]:
    """A light for each component of a map unless its directions cancel: an even sky has none."""
    rays, pixel = directions(len(ids)), np.pi / len(ids)
    blobs = [(rays[ids == k], energy[ids == k]) for k in np.unique(ids) if k]
    return [
        blob_light(r, e, pixel)
        for r, e in blobs
        if np.linalg.norm(e @ r) > LEAST_RESULTANT * e.sum()
    ]


def _rank(lights: list[Light], minimum_energy: float) -> list[Light]:
    """Strongest first, without those far below the strongest."""
    lights = sorted(lights, key=lambda light: -light.energy)
    return [light for light in lights if light.energy >= minimum_energy * lights[0].energy]


def lights_by_peaks(
    environment: EnvironmentMap,
    level: float = 0.3,
    minimum_energy: float = 0.05,
    faint: float = 0.1,
) -> list[Light]:
    """Blobs of the unclipped map above `level` times its 99.95th percentile, strongest first.

    Parameters
    ----------
    level : .5 instead of .3 loses a light on short arcs
    faint : blobs above this that hold none of those above `level` are lights too: weak or large
        lamps beside a strong one
    minimum_energy : blobs with less than this share of the strongest one's energy are dropped
    """
    radiance, seen = environment.radiance, environment.seen
    if not (radiance[seen] > 0).any():
        return []
    top, energy = np.quantile(radiance[seen], 0.9995), radiance * solid_angles(len(radiance))
    ids = _connect(seen & (radiance > level * top))
    others = _connect(seen & (radiance > min(faint, level) * top))
    others[np.isin(others, others[ids > 0])] = 0
    blobs = _blob_lights(ids, energy) + _blob_lights(others, energy)
    return _rank(blobs, minimum_energy)


def median_cut(energy: np.ndarray, count: int) -> list[tuple[int, int, int, int]]:
    """Median cut of a latitude-longitude map into `count` regions of like energy [Deb05].

    energy : (H, W) ≥ 0, radiance times solid angle. Returns (top, bottom, left, right) half open.
    A region of one pixel is not cut further.
    """
    height, width = energy.shape
    integral = np.zeros((height + 1, width + 1))
    integral[1:, 1:] = energy.cumsum(0).cumsum(1)
    row_width = np.sin(np.pi * (np.arange(height) + 0.5) / height)
    regions = [(0, height, 0, width)]
    while len(regions) < count:
        halves = []
        for top, bottom, left, right in regions:
            tall, wide = bottom - top, (right - left) * row_width[(top + bottom) // 2]
            if bottom - top == 1 and right - left == 1:
                halves.append((top, bottom, left, right))
            elif right - left == 1 or (tall >= wide and tall > 1):
                line = integral[top : bottom + 1, right] - integral[top : bottom + 1, left]
                cut = top + _halve(line)
                halves += [(top, cut, left, right), (cut, bottom, left, right)]
            else:
                line = integral[bottom, left : right + 1] - integral[top, left : right + 1]
                cut = left + _halve(line)
                halves += [(top, bottom, left, cut), (top, bottom, cut, right)]
        if len(halves) == len(regions):
            break
        regions = halves
    return regions


def _halve(cumulative: np.ndarray) -> int:
    middle = (cumulative[0] + cumulative[-1]) / 2
    return int(np.clip(np.searchsorted(cumulative, middle), 1, len(cumulative) - 2))


def lights_by_median_cut(
    environment: EnvironmentMap, count: int = 4096, minimum_energy: float = 0.05
) -> list[Light]:
    """The paper's way: `count` directional lights, those on cells larger than 4π/`count` dropped,
    the rest joined where their cells touch. In effect a threshold at the map's mean."""
    probability = environment.probability
    if not (probability > 0).any():
        return []
    solid = solid_angles(len(probability))
    energy = probability * solid
    kept = np.zeros(probability.shape, bool)
    for top, bottom, left, right in median_cut(energy, count):
        if solid[top:bottom, left:right].sum() <= 4 * np.pi / count:
            kept[top:bottom, left:right] = True
    return _rank(_blob_lights(_connect(kept & (energy > 0)), energy), minimum_energy)
