"""A hand-held walk around the object: where the cameras stand, and what their sensor records."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshlab_svbrdf.geometry.camera import Camera

from .light import Floodlight, Material, Surface
from .paint import encode_srgb

BACKGROUND = 0.136  # linear: a grey backdrop, 103 of 255
FAR = 4.5  # how far the camera stands, radii
NEAR = 2.9  # where the visitor leans in and the object leaves the frame


@dataclass(frozen=True)
class Scene:
    """The object and its light, in the object's frame (centre 0, radius 1, +Y up)."""

    surface: Surface
    lights: list[Floodlight]
    ambient: float
    materials: tuple[Material, ...]


@dataclass(frozen=True)
class Lens:
    """width, height : pixels; principal : (x, y) pixels off the middle; aspect : fy / fx."""

    width: int
    height: int
    principal: tuple[float, float] = (0.0, 0.0)
    aspect: float = 1.0

    def camera(self, position: np.ndarray, target: np.ndarray, roll: float = 0.0) -> Camera:
        """Stand at `position`, look at `target`, +Y up but for `roll` (radians)."""
        forward = (target - position) / np.linalg.norm(target - position)
        right = np.cross(forward, [0, 1, 0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        c, s = np.cos(roll), np.sin(roll)
        R = np.stack([c * right + s * down, c * down - s * right, forward])
        # From FAR the object, 1.55 by .97 radii, fills at most 85 % of the frame
        focal = FAR * min(0.85 * self.height / 1.55, 0.85 * self.width / 1.0)
        cx = (self.width - 1) / 2 + self.principal[0]
        cy = (self.height - 1) / 2 + self.principal[1]
        return Camera(
            self.width, self.height, focal, focal * self.aspect, cx, cy, R, -R @ position
        )  # fmt: skip


def orbit(
    lens: Lens, frames: int, elevation: float, start: float, lean: bool, seed: list[int]
) -> list[Camera]:
    """One turn around the object with an unsteady hand.

    elevation, start : radians; lean : come close for a twelfth of the turn
    """
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 8)
    turn = np.arange(frames) / frames
    sway = [np.sin(2 * np.pi * (k + 2) * turn + phase[k]) for k in range(8)]
    azimuth = start + 2 * np.pi * turn + 0.012 * sway[0]
    height = elevation + 0.05 * sway[1] + 0.015 * sway[5]
    distance = FAR * (1 + 0.03 * sway[2])
    if lean:
        close = np.sin(np.pi * np.clip((turn - 0.55) * 8, 0, 1)) ** 2
        distance -= (FAR - NEAR) * close
    targets = 0.025 * np.stack([sway[3], sway[4], sway[6]], -1)
    around = np.cos(height) * np.array([np.sin(azimuth), 0 * turn, np.cos(azimuth)])
    around[1] = np.sin(height)
    positions = (distance * around).T
    return [
        lens.camera(p, t, r) for p, t, r in zip(positions, targets, 0.02 * sway[7], strict=True)
    ]


def picture(
    scene: Scene, camera: Camera, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Trace samples² jittered rays per pixel and average them in linear light.

    Returns
    -------
    image : (height, width, 3) float64 linear, unclipped; coverage : (height, width) 0..1
    """
    image = np.full((camera.height, camera.width, 3), BACKGROUND)
    coverage = np.zeros((camera.height, camera.width))
    rows, cols = _frame_of(scene, camera)
    row, col = np.mgrid[rows, cols].reshape(2, -1)
    total, hit = np.zeros((len(row), 3)), np.zeros(len(row))
    for i, j in np.ndindex(samples, samples):
        jitter = rng.random((2, len(row)))
        x, y = col - 0.5 + (j + jitter[0]) / samples, row - 0.5 + (i + jitter[1]) / samples
        pixel = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1 + 0 * x], -1)
        ray = pixel @ camera.R
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        face, barycentric = scene.surface.hits(np.broadcast_to(camera.center, ray.shape), ray)
        on = face >= 0
        color = scene.surface.radiance(
            face[on], barycentric[on], -ray[on], scene.lights, scene.ambient, scene.materials
        )
        total[on] += color
        total[~on] += BACKGROUND
        hit += on
    image[rows, cols] = (total / samples**2).reshape(image[rows, cols].shape)
    coverage[rows, cols] = (hit / samples**2).reshape(coverage[rows, cols].shape)
    return image, coverage


def _frame_of(scene: Scene, camera: Camera) -> tuple[slice, slice]:
    """Rows and columns that the object may touch."""
    x, y, _ = camera.project(scene.surface.mesh.vertices).T

    def span(values: np.ndarray, size: int) -> slice:
        low, high = np.clip([np.floor(values.min()) - 1, values.max() + 3], 0, size).astype(int)
        return slice(low, high)

    return span(y, camera.height), span(x, camera.width)


def exposed(scene: Scene, cameras: list[Camera], clipped: float, seed: list[int]) -> Scene:
    """The scene under light so strong that the share `clipped` of the object's pixels is over 1."""
    rng = np.random.default_rng(seed)
    brightest = []
    for camera in cameras[:: max(1, len(cameras) // 12)]:
        image, coverage = picture(scene, camera, 1, rng)
        brightest.append(image.max(-1)[coverage > 0])
    scale = 1 / float(np.quantile(np.concatenate(brightest), 1 - clipped))
    lights = [replace(light, intensity=light.intensity * scale) for light in scene.lights]
    return replace(scene, lights=lights, ambient=scene.ambient * scale)


def developed(image: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Linear light to 8-bit sRGB, clipped, with `noise` code values of sensor noise; uint8."""
    code = 255 * encode_srgb(image)
    code += noise * rng.standard_normal(code.shape)
    return np.clip(np.round(code), 0, 255).astype(np.uint8)
