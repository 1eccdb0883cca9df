"""Which frames of a long film to use: evenly by where the cameras stand, never by what they show.

Choosing by brightness would bias every statistic of a texel; a choice by the cameras alone cannot.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.camera import Camera

NEARNESS = 0.5
"""What a factor e in distance counts, in radians of orbit: a close-up is another view."""
AIM = 0.5
"""What a radian of turning the camera on the spot counts, in radians of orbit."""


def choose_frames(
    cameras: Sequence[Camera], center: np.ndarray, radius: float, limit: int
) -> np.ndarray:
    """About `limit` frames that leave the smallest gaps between them, ascending.

    The frame that is farthest from all chosen ones comes next (Gonzalez 1985). So no frame is
    farther from a chosen one than the chosen ones are from each other, gaps are at most twice those
    of the best choice, and a higher limit only adds frames. Frames that stand in the same place
    twice are used once, and frames that cannot see the object last.

    Parameters
    ----------
    cameras : of all frames
    center, radius : of the object
    limit : frames to use at most; 0 or as many as there are: all

    Returns
    -------
    (K,) int64
    """
    if limit <= 0 or limit >= len(cameras):
        return np.arange(len(cameras))
    places = view_places(cameras, center, radius)
    sees = np.array([_sees(camera, center, radius) for camera in cameras], bool)
    candidates = np.flatnonzero(sees)
    chosen = candidates[_farthest_first(places[candidates], limit)] if len(candidates) else []
    return np.sort(np.asarray(chosen, np.int64))


def view_places(cameras: Sequence[Camera], center: np.ndarray, radius: float) -> np.ndarray:
    """Where the cameras stand and look, as seen from the object: (F, 7).

    Distances between rows are those between views, about in radians of orbit.
    """
    views = np.array([camera.center - center for camera in cameras]).reshape(-1, 3)
    distance = np.maximum(np.linalg.norm(views, axis=1, keepdims=True), 1e-9 * radius)
    axes = np.array([camera.R[2] for camera in cameras]).reshape(-1, 3)
    return np.hstack([views / distance, NEARNESS * np.log(distance / radius), AIM * axes])


def run_order(places: Sequence[int]) -> np.ndarray:
    """Places of chosen frames in a film, as runs of peaks need them: (K,) int32.

    places : of the chosen frames in their film, ascending

    Chosen frames follow each other without a gap, but where more than twice as many frames as usual
    were left out between two of them.
    """
    steps = np.diff(np.asarray(places, np.int64))
    if not len(steps):
        return np.zeros(len(places), np.int32)
    usual = max(float(np.median(steps)), 1.0)
    gaps = np.where(steps / usual > 2, 2, 1)
    return np.concatenate([[0], np.cumsum(gaps)]).astype(np.int32)


def _farthest_first(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of up to `count` distinct points (N, D), each the farthest from those before it."""
    apart = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [int(np.argmax(apart))]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        following = int(np.argmax(nearest))
        if not nearest[following] > 0.0:
            break
        chosen.append(following)
        nearest = np.minimum(nearest, np.linalg.norm(points - points[following], axis=1))
    return np.array(chosen, np.int64)


def _sees(camera: Camera, center: np.ndarray, radius: float) -> bool:
    """Whether the object's bounding sphere reaches into the image."""
    x, y, z = camera.project(center[None])[0]
    if z <= radius:
        return bool(np.linalg.norm(camera.center - center) <= radius)
    reach = max(camera.fx, camera.fy) * radius / z
    return bool(-reach <= x <= camera.width + reach and -reach <= y <= camera.height + reach)
