"""Where the cameras stand: two unsteady orbits, held-out views, and errors of registration."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from meshlab_svbrdf.geometry.camera import Camera

from .variant import Variant

DISTANCE = 4.2  # radii
FILL = 0.95  # of the frame's smaller side


def orbits(variant: Variant, reach: float) -> list[Camera]:
    """The frames' cameras; `reach`: how far the object extends from its centre, radii."""
    rng = np.random.default_rng([variant.seed, 3])
    cameras = []
    for k, elevation in enumerate(variant.elevations):
        count = variant.frames // 2 + (variant.frames % 2 if k == 0 else 0)
        turn = np.radians(variant.arc) * np.arange(count) / count
        phase, amplitude = rng.uniform(0, 2 * np.pi, (5, 1)), rng.uniform(0.5, 1, (5, 1))
        sway = amplitude * np.sin(np.arange(3, 8)[:, None] * turn + phase)
        azimuth = turn + 0.6 * k + 0.01 * sway[0]
        height = np.radians(elevation + 2 * sway[1])
        for a, h, s in zip(azimuth, height, sway.T, strict=True):
            distance = DISTANCE * (1 + 0.05 * s[2])
            target = 0.02 * np.array([s[3], s[4], -s[3]])
            cameras.append(_look(variant, reach, a, h, distance, target, 0.03 * s[0]))
    return cameras


def views(variant: Variant, reach: float) -> list[Camera]:
    """Held-out cameras, between and beside the orbits, within the arc."""
    rng = np.random.default_rng([variant.seed, 4])
    low, high = np.radians(variant.elevations)
    share = (np.arange(variant.views) + 0.5) / variant.views
    heights = rng.permutation(np.linspace(low - 0.05, high + 0.1, variant.views))
    return [
        _look(variant, reach, np.radians(variant.arc) * s + 0.3, h, DISTANCE, np.zeros(3), 0.0)
        for s, h in zip(share, heights, strict=True)
    ]


def misregistered(cameras: list[Camera], variant: Variant, reach: float) -> list[Camera]:
    """Cameras turned so that the object's pixels err by `pose_error`, independently per frame."""
    rng = np.random.default_rng([variant.seed, 5])
    wrong = []
    for camera in cameras:
        angle = rng.standard_normal(3) * variant.pose_error / camera.fx
        angle[2] *= DISTANCE / reach
        turn = cv2.Rodrigues(angle)[0]
        wrong.append(replace(camera, R=turn @ camera.R, t=turn @ camera.t))
    return wrong


def in_world(camera: Camera, world: np.ndarray) -> Camera:
    """The camera after the object's frame was moved by a rigid (4, 4)."""
    R = camera.R @ world[:3, :3].T
    return replace(camera, R=R, t=camera.t - R @ world[:3, 3])


def _look(
    variant: Variant, reach: float, azimuth: float, elevation: float,
    distance: float, target: np.ndarray, roll: float,
) -> Camera:  # fmt: skip
    c, s = np.cos(elevation), np.sin(elevation)
    position = distance * np.array([c * np.sin(azimuth), s, c * np.cos(azimuth)])
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    turned = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    R = np.stack([*turned, forward])
    width, height = variant.width, variant.height
    focal = FILL * min(width, height) / 2 * DISTANCE / reach
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, R, -R @ position)
