"""Where the cameras of the workload stand: turns around the object at different heights.

A frame's camera depends on its number alone: the first 300 of 3,382 frames are a workload of 300.
"""

from __future__ import annotations

import numpy as np

from ..geometry.camera import Camera

FAR = 4.5  # how far a camera stands from the object, in its units
FILLED = 0.95  # of the frame's height
HEIGHTS = (0.4, 0.0, 0.75, 0.2, 0.95, -0.2, 0.55, 0.1, 0.85, 0.3)  # radians, turn by turn
TURN = 360  # degrees


def turn_of(frame: int, step: float) -> int:
    """Which walk around the object a frame is of; each is a sequence of its own."""
    return int(frame * step // TURN)


def frame_camera(frame: int, width: int, height: int, reach: float, step: float) -> Camera:
    """The camera of one frame.

    reach : distance of the object's farthest point from the origin
    step : degrees of azimuth between neighbouring frames
    """
    turn = turn_of(frame, step)
    azimuth = np.radians(frame * step) + 0.01 * np.sin(np.radians(5 * frame * step) + turn)
    sway = [np.sin(k * azimuth + 1.7 * turn + k) for k in range(1, 6)]
    elevation = HEIGHTS[turn % len(HEIGHTS)] + 0.22 * sway[1] + 0.02 * sway[4]
    return look(
        azimuth, elevation, FAR * (1 + 0.03 * sway[2]), width, height, reach,
        target=0.012 * np.array([sway[3], sway[0], sway[4]]), roll=0.02 * sway[0],
    )  # fmt: skip


def look(
    azimuth: float,
    elevation: float,
    distance: float,
    width: int,
    height: int,
    reach: float,
    target: np.ndarray | None = None,
    roll: float = 0.0,
) -> Camera:
    """A camera that looks at the object, +Y up but for `roll`; angles in radians."""
    target = np.zeros(3) if target is None else target
    position = distance * np.array(
        [
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
            np.cos(elevation) * np.cos(azimuth),
        ]
    )
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    R = np.stack([c * right + s * down, c * down - s * right, forward])
    focal = FILLED / 2 * min(width, height) * np.sqrt(FAR**2 - reach**2) / reach
    return Camera(
        width, height, focal, focal, (width - 1) / 2 + 0.01 * width, (height - 1) / 2, R,
        -R @ position,
    )  # fmt: skip
