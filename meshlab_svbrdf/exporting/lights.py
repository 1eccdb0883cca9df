"""The lamps for other programs: as they stand around the object, and as a map of directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..reflectance.directions import directions, solid_angles
from ..reflectance.lights import Light
from ..reflectance.phong import lamps
from ..rendering.environment_lights import Illumination

DISC = 1.0
"""Degrees: the radius of a lamp in a map of directions; its own is not known."""
HEIGHT = 512


def found_lights(lights: list[Light], radius: float) -> Illumination:
    """The recovered lamps as points; long ones are several."""
    bulbs = lamps(lights, radius)
    length = np.linalg.norm(bulbs.direction, axis=1)
    return Illumination(
        bulbs.direction / length[:, None],
        bulbs.curvature / length,
        np.repeat((bulbs.gain / length**2)[:, None], 3, axis=1),
        np.zeros(len(length), bool),
    )


def light_file(
    light: Illumination, ambient: np.ndarray, center: np.ndarray, radius: float
) -> dict[str, Any]:
    """What `document.light_files` reads: direction, position or null, gain and color of each."""
    entries = []
    for direction, curvature, color in zip(
        light.direction, light.curvature, light.color, strict=True
    ):
        gain = float(color.max())
        far = not curvature > 0
        entries.append(
            {
                "direction": direction,
                "position": None if far else center + radius / curvature * direction,
                "gain": gain,
                "color": color / gain if gain > 0 else np.ones(3),
            }
        )
    return {"lights": entries, "ambient": ambient}


def light_map(light: Illumination, ambient: np.ndarray, height: int = HEIGHT) -> np.ndarray:
    """Radiance (H, 2H, 3) float32 as seen from the object's centre, latitude-longitude, pole +Y.

    A lamp is a disc whose light is kept exactly: a white surface that faces it alone shows its
    color, (1/π) ∫ Env dω. ambient : (3,) from everywhere
    """
    rays, angles = directions(height), solid_angles(height)
    radiance = np.broadcast_to(np.asarray(ambient, float), (*rays.shape[:2], 3)).copy()
    edge = np.cos(np.radians(DISC))
    for direction, color in zip(light.direction, light.color, strict=True):
        along = rays @ direction
        disc = along >= min(edge, along.max())
        radiance[disc] += np.pi * color / (angles * along)[disc].sum()
    return radiance.astype(np.float32)
