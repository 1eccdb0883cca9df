"""One material and equation 1 in numpy, which the renderers are held against."""

from __future__ import annotations

import numpy as np
from analytic import ORIGIN, unit

from meshlab_svbrdf.rendering.surface import Appearance

D = np.array([0.2, 0.1, 0.05])
RHO, ALPHA = 0.4, 30.0


def look(size: int = 16, *, rho_s=RHO, alpha=ALPHA, tint=(1.0, 1.0, 1.0), diffuse=D, turn=None):
    """One material over a whole texture."""
    full = lambda value: np.tile(np.asarray(value, float), (size, size, 1))  # noqa: E731
    return Appearance(
        full(diffuse),
        np.full((size, size), rho_s),
        np.full((size, size), alpha),
        full(tint),
        turn,
    )


def rays(camera) -> np.ndarray:
    """Directions through the pixels' centres, (H, W, 3) unit, world."""
    row, col = np.mgrid[: camera.height, : camera.width]
    x, y = (col - camera.cx) / camera.fx, (row - camera.cy) / camera.fy
    return unit(np.stack([x, y, np.ones_like(x)], -1) @ camera.R)


def on_plane(camera, z: float = 0.0) -> np.ndarray:
    """Where each pixel's ray meets the plane, (H, W, 3)."""
    ray = rays(camera)
    return camera.center + ((z - camera.center[2]) / ray[..., 2])[..., None] * ray


def eq1(points, normals, eye, lights, radius, center=ORIGIN, rho_s=RHO, alpha=ALPHA) -> np.ndarray:
    """Σ ρ g (l·r)^α, with near lights: g/|L|², L = d − κ (x − c) / radius."""
    view = unit(eye - points)
    mirror = 2 * np.sum(normals * view, -1, keepdims=True) * normals - view
    total = np.zeros(points.shape[:-1])
    for light in lights:
        toward = light.direction - light.curvature * (points - center) / radius
        length = np.linalg.norm(toward, axis=-1)
        cos = np.maximum(np.sum(mirror * toward, -1) / length, 0)
        above = np.sum(normals * toward, -1) > 0
        total += np.where(above, rho_s * light.gain * cos**alpha / length**2, 0)
    return total
