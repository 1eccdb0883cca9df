"""The environment map beside the true one: is the light where it should be, and only there?

The found map is the unclipped one; its mask is what the light stage takes for lamps, the pixels
above `level` times the 99.95th percentile. Both maps are latitude-longitude, the pole is +Y.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshlab_svbrdf import registry
from meshlab_svbrdf.document.images import read_exr, write_png
from meshlab_svbrdf.reflectance.directions import solid_angles
from meshlab_svbrdf.reflectance.lights import tangents
from meshlab_svbrdf.samples.luminance import luminance, to_srgb8

RING = np.radians(8)


def environment(result: Path, truth: Path) -> dict[str, Any]:
    """Share of the lamps' energy inside the mask; solid angle of the mask outside the lamps, sr.

    result : NAME.svbrdf; truth : ground_truth. Without a true map nothing is said.
    """
    if not (truth / "env.exr").is_file():
        return {}
    lamps, _ = _lamps(truth)
    solid = solid_angles(len(lamps))
    mask = cv2.resize(_mask(result), lamps.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return {
        "env_energy_inside": float((lamps * solid)[mask].sum() / (lamps * solid).sum()),
        "env_outside_sr": float(solid[mask & (lamps == 0)].sum()),
    }


def environment_picture(result: Path, truth: Path, path: Path) -> None:
    """Write the found map above the true one; lamps ringed, found red and true green."""
    lamps, sky = _lamps(truth)
    true = np.clip((lamps + sky) / np.quantile(lamps[lamps > 0], 0.5), 0, 1)
    found = np.clip(np.squeeze(read_exr(result / "environment.exr")), 0, 1)
    size = (512, 256)
    panels = []
    for values in (found, true):
        grey = cv2.resize(values.astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
        panels.append(np.repeat(to_srgb8(grey)[..., None], 3, -1))
    for light in _json(result / "lights.json")["lights"]:
        _ring(panels[0], np.array(light["direction"]), (255, 60, 40))
    for emitter in _json(truth / "lights.json")["emitters"]:
        for panel in panels:
            _ring(panel, np.array(emitter["direction"]), (60, 220, 60), 0.6)
    gap = np.full((8, size[0], 3), 255, np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, np.concatenate([panels[0], gap, panels[1]]))


def _lamps(truth: Path) -> tuple[np.ndarray, float]:
    """Luminance of the lamps alone, (H, 2H), and that of the light from everywhere."""
    sky = float(np.mean(_json(truth / "lights.json").get("ambient_radiance", 0)))
    radiance = read_exr(truth / "env.exr")
    radiance = luminance(radiance) if radiance.ndim == 3 else radiance
    return np.where(radiance > 1.05 * sky, radiance - sky, 0), sky


def _mask(result: Path) -> np.ndarray:
    """What the light stage takes for lamps, (H, 2H) uint8."""
    radiance = np.load(result / "arrays" / "environment_radiance.npy")
    seen = np.load(result / "arrays" / "environment_weight.npy") > 0
    if not seen.any():  # no texel is observed
        return seen.astype(np.uint8)
    parameters = registry.get("compute_svbrdf_light_sources").parameters
    level = next(p.default for p in parameters if p.name == "level")
    return (seen & (radiance > level * np.quantile(radiance[seen], 0.9995))).astype(np.uint8)


def _ring(image: np.ndarray, direction: np.ndarray, color: tuple, scale: float = 1.0) -> None:
    """Draw the directions at one angle from a direction."""
    turn = np.linspace(0, 2 * np.pi, 400)[:, None]
    across, along = tangents(direction / np.linalg.norm(direction))
    rays = np.cos(scale * RING) * direction + np.sin(scale * RING) * (
        np.cos(turn) * across + np.sin(turn) * along
    )
    height, width = image.shape[:2]
    phi = np.arctan2(rays[:, 0], -rays[:, 2]) % (2 * np.pi)
    row = np.clip(np.arccos(np.clip(rays[:, 1], -1, 1)) / np.pi * height, 0, height - 1)
    image[row.astype(int), np.clip(phi / (2 * np.pi) * width, 0, width - 1).astype(int)] = color


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
