"""Maps of directions as far lights: an environment cut into regions of equal energy.

Debevec, "A Median Cut Algorithm for Light Probe Sampling", 2005; the paper renders with 256.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.visibility import spread_directions
from ..reflectance.directions import directions, solid_angles

LIGHTS = 256
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Illumination:
    """Lights that shade an object.

    direction : (L, 3) unit, from the object's centre to the light
    curvature : (L,) the object's radius over the light's distance; 0 where it is far
    color : (L, 3) linear: a white surface of albedo 1 that faces the light at the centre has this
        brightness
    soft : (L,) bool, of lights that are one of many, whose own shadows do not show
    """

    direction: np.ndarray
    curvature: np.ndarray
    color: np.ndarray
    soft: np.ndarray

    def __len__(self) -> int:
        return len(self.direction)

    def only(self, some: np.ndarray) -> Illumination:
        """Some of the lights, (L,) bool."""
        return Illumination(
            self.direction[some], self.curvature[some], self.color[some], self.soft[some]
        )


def cut_environment(radiance: np.ndarray, count: int = LIGHTS, turn: float = 0.0) -> Illumination:
    """An environment map's light, from about `count` directions, (1/π) ∫ Env dω kept exactly.

    Parameters
    ----------
    radiance : (H, 2H, 3) linear, latitude-longitude, the pole +Y; what is negative is black
    count : of regions; each is cut along its longer side, where half of its energy lies
    turn : degrees by which the surroundings turn about +Y, from +Z towards +X
    """
    shape = np.shape(radiance)
    if len(shape) != 3 or shape[1:] != (2 * shape[0], 3) or not np.isfinite(radiance).all():
        raise ValueError(f"radiance: expected (H, 2 H, 3) finite numbers, not {shape}")
    height, width = radiance.shape[:2]
    power = np.maximum(radiance, 0) * (solid_angles(height) / np.pi)[..., None]
    energy = power @ LUMINANCE
    rows = np.sin(np.pi * (np.arange(height) + 0.5) / height)

    # Cut the region of most energy again and again
    regions = [(0, height, 0, width)]
    total = [float(energy.sum())]
    while len(regions) < count and max(total) > 0:
        k = int(np.argmax(total))
        parts = _halves(energy, rows, regions[k])
        if parts is None:
            total[k] = 0.0  # a single pixel
            continue
        regions[k : k + 1] = parts
        total[k : k + 1] = [float(energy[_window(part)].sum()) for part in parts]

    # One light for each, at the centre of its energy
    rays = directions(height)
    found = []
    for region in regions:
        w = _window(region)
        color, weight = power[w].sum((0, 1)), energy[w]
        if color.any():
            centre = (weight[..., None] * rays[w]).sum((0, 1))
            found.append((centre / np.linalg.norm(centre), color))
    direction = np.array([d for d, _ in found]).reshape(-1, 3)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    around = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    color = np.array([c for _, c in found]).reshape(-1, 3)
    return Illumination(
        direction @ around.T, np.zeros(len(found)), color, np.ones(len(found), bool)
    )


def uniform_light(radiance: np.ndarray, count: int = LIGHTS) -> Illumination:
    """The same radiance (3,) from everywhere, as `count` far lights."""
    color = np.tile(np.asarray(radiance, float) * 4 / count, (count, 1))
    return Illumination(spread_directions(count), np.zeros(count), color, np.ones(count, bool))


def together(parts: Sequence[Illumination]) -> Illumination:
    """All that shines at once."""
    columns = zip(*((p.direction, p.curvature, p.color, p.soft) for p in parts), strict=True)
    return Illumination(*(np.concatenate(column) for column in columns))


Region = tuple[int, int, int, int]


def _window(region: Region) -> tuple[slice, slice]:
    top, bottom, left, right = region
    return slice(top, bottom), slice(left, right)


def _halves(energy: np.ndarray, rows: np.ndarray, region: Region) -> list[Region] | None:
    """A region's halves of equal energy; None where it is a pixel."""
    top, bottom, left, right = region
    tall, wide = bottom - top, (right - left) * rows[top:bottom].mean() * 2
    own = energy[_window(region)]
    if tall >= wide and tall > 1:
        at = top + _middle(own.sum(1))
        return [(top, at, left, right), (at, bottom, left, right)]
    if right - left > 1:
        at = left + _middle(own.sum(0))
        return [(top, bottom, left, at), (top, bottom, at, right)]
    if tall > 1:
        at = top + _middle(own.sum(1))
        return [(top, at, left, right), (at, bottom, left, right)]
    return None


def _middle(energy: np.ndarray) -> int:
    """Where to cut: half of the energy on either side, and at least one pixel."""
    sums = np.cumsum(energy)
    return int(np.clip(np.searchsorted(sums, sums[-1] / 2) + 1, 1, len(energy) - 1))
