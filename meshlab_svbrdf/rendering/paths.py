"""Cameras that nobody held: a smooth way between given ones, and a walk around the object.

upward      which way is up, from how cameras were held
smooth_way  a film from one camera over others to the last
turntable   a film around the object, which ends where it began
fitting     how far away it just shows all of it
framed      the part of views that shows the object
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ..geometry.camera import Camera
from ..reflectance.lights import tangents

AIR = 1.1
"""Times the distance at which the object, or its sphere, just fills the image."""
SPREAD = 0.02
"""Mean square of the cameras' rows across their main direction (8° of the walk) that tells up."""


def upward(cameras: Sequence[Camera]) -> np.ndarray:
    """The unit direction (3,) at right angles to the cameras' rows of pixels, on their upper side.

    Cameras that look down have no vertical column, but a horizontal row, if they are held straight.
    Where all look about the same way, the mean of their columns decides.
    """
    rows = np.array([camera.R[0] for camera in cameras])
    mean = -np.mean([camera.R[1] for camera in cameras], axis=0)
    spread, axes = np.linalg.eigh(rows.T @ rows / len(rows))
    if spread[1] > SPREAD:
        return axes[:, 0] if axes[:, 0] @ mean >= 0 else -axes[:, 0]
    up = mean - (mean @ axes[:, 2]) * axes[:, 2]
    return up / np.linalg.norm(up)


def smooth_way(keys: Sequence[Camera], frames: int) -> list[Camera]:
    """`frames` cameras from the first key to the last, through all of them at equal times.

    Positions lie on a cubic spline, rotations on a spline of SO(3) (between two keys: slerp), both
    without a jerk; focal length and centre change evenly. Raises ValueError for fewer than two
    keys, or keys of different sizes.
    """
    if len(keys) < 2:
        raise ValueError(f"a way needs two cameras or more, found {len(keys)}")
    sizes = {(key.width, key.height) for key in keys}
    if len(sizes) > 1:
        raise ValueError(f"the cameras of a way have one size, found {sorted(sizes)}")
    times, at = np.arange(len(keys)), np.linspace(0, len(keys) - 1, frames)
    rotations = RotationSpline(times, Rotation.from_matrix(np.array([k.R for k in keys])))
    centers = CubicSpline(times, np.array([key.center for key in keys]))(at)
    lens = np.array([[k.fx, k.fy, k.cx, k.cy] for k in keys])
    lenses = np.column_stack([np.interp(at, times, column) for column in lens.T])
    return [
        Camera(keys[0].width, keys[0].height, fx, fy, cx, cy, R, -R @ center)
        for (fx, fy, cx, cy), R, center in zip(
            lenses.tolist(), rotations(at).as_matrix(), centers, strict=True
        )
    ]


def turntable(
    camera: Camera, center: np.ndarray, radius: float, up: np.ndarray, frames: int,
    elevation: float = 15.0, distance: float = 0.0,
) -> list[Camera]:  # fmt: skip
    """`frames` cameras at equal angles around the object; the one after the last is the first.

    Parameters
    ----------
    camera : gives size and focal length, and the side from which the walk begins
    center, radius : of the object, whose centre is seen in the middle of the image
    up : (3,) unit, the axis
    elevation : degrees above the horizon
    distance : from the centre; 0: so that the object's sphere fits
    """
    if not distance:
        half = min(camera.width / camera.fx, camera.height / camera.fy) / 2
        distance = AIR * radius * np.sqrt(1 + 1 / half**2)
    away = camera.center - center
    ahead = away - (away @ up) * up
    if np.linalg.norm(ahead) < 1e-6 * np.linalg.norm(away):
        ahead = tangents(up)[0]
    ahead = ahead / np.linalg.norm(ahead)
    side = np.cross(up, ahead)
    e = np.radians(elevation)
    middle = replace(camera, cx=(camera.width - 1) / 2, cy=(camera.height - 1) / 2)
    found = []
    for turn in 2 * np.pi * np.arange(frames) / frames:
        out = np.cos(e) * (np.cos(turn) * ahead + np.sin(turn) * side) + np.sin(e) * up
        right = np.cross(up, out)
        right /= np.linalg.norm(right)
        R = np.array([right, np.cross(right, out), -out])
        found.append(replace(middle, R=R, t=-R @ (center + distance * out)))
    return found


def fitting(
    camera: Camera, center: np.ndarray, vertices: np.ndarray, up: np.ndarray, elevation: float
) -> float:
    """The distance from which a turntable shows the vertices (V, 3) whole, wherever it stands.

    A vertex runs on a circle of radius r at the height h. Where the camera sees it at (x, y), z
    towards the camera, it must be z + |x|/w and z + |y|/w' away, w and w' half the image over its
    focal lengths: the largest of both over the circle has a closed form.
    """
    away = np.asarray(vertices, float) - center
    h = away @ up
    r = np.linalg.norm(away - h[:, None] * up, axis=1)
    wide, tall = camera.width / camera.fx / 2, camera.height / camera.fy / 2
    c, s = np.cos(np.radians(elevation)), np.sin(np.radians(elevation))
    beside = (r * np.hypot(c, 1 / wide) + h * s).max()
    above, below = ((r * abs(c - k * s) + h * (s + k * c)).max() for k in (1 / tall, -1 / tall))
    return AIR * float(max(beside, above, below))


def framed(cameras: Sequence[Camera], vertices: np.ndarray, margin: int = 12) -> list[Camera]:
    """The cameras' images, cut (or widened) to one box in which the vertices (V, 3) lie in all of
    them, and so many pixels around. Raises ValueError where a vertex is behind a camera."""
    seen = np.concatenate([camera.project(vertices) for camera in cameras])
    if not (seen[:, 2] > 0).all():
        raise ValueError("a part of the object lies behind a camera")
    left, top = (int(v) - margin for v in np.floor(seen[:, :2].min(0)))
    right, bottom = (int(v) + margin + 1 for v in np.ceil(seen[:, :2].max(0)))
    return [camera.cropped(left, top, right, bottom) for camera in cameras]
