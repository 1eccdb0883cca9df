"""A camera from points picked on the mesh and in the frame."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares

from ..geometry.camera import Camera
from .pose import moved


def solve_camera_from_points(
    points3d: np.ndarray,
    points2d: np.ndarray,
    size: tuple[int, int],
    focal: float | None = None,
) -> Camera:
    """The camera that sees points of the world where they were picked.

    Parameters
    ----------
    points3d : (n, 3) float64, world; n ≥ 4
    points2d : (n, 2) float64, column and row in pixels, centres at whole numbers
    size : width, height of the frame
    focal : pixels; None: estimated, which needs n ≥ 5 points that are not all in one plane, or ≥ 4
        in a plane that is seen at a slant

    Returns
    -------
    camera : principal point at the frame's centre, square pixels

    Raises
    ------
    ValueError : too few points, or no camera sees them so.
    """
    points3d, points2d = (np.ascontiguousarray(p, float) for p in (points3d, points2d))
    if points3d.shape != (len(points3d), 3) or points2d.shape != (len(points3d), 2):
        raise ValueError(
            f"points: expected (n, 3) and (n, 2), not {points3d.shape} and {points2d.shape}"
        )
    if len(points3d) < 4 or not (np.isfinite(points3d).all() and np.isfinite(points2d).all()):
        raise ValueError(f"points: expected at least 4, all finite, found {len(points3d)}")
    center = points3d.mean(0)
    local = points3d - center
    extent = np.linalg.svd(local, compute_uv=False)
    if extent[1] < 1e-6 * extent[0]:
        raise ValueError("points: they lie on one line; pick some beside it")
    focals = [focal] if focal is not None else list(max(size) * np.geomspace(0.4, 8.0, 25))
    found = [each for f in focals for each in _cameras(local, points2d, size, f)]
    if not found:
        raise ValueError("points: no camera sees them so; check that each pair is the same place")
    camera = min(found, key=lambda c: _misses(c, local, points2d))
    camera = _refined(camera, local, points2d, focal is None)
    return camera.about(-center)


def _cameras(
    points: np.ndarray, pixels: np.ndarray, size: tuple[int, int], focal: float
) -> list[Camera]:
    """Cameras of one focal length that see all points before them (Terzakis and Lourakis 2020)."""
    width, height = size
    like = Camera(
        width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, np.eye(3), np.zeros(3)
    )
    _, turns, shifts, _ = cv2.solvePnPGeneric(
        points, pixels, like.K, None, flags=cv2.SOLVEPNP_SQPNP
    )
    cameras = [
        replace(like, R=cv2.Rodrigues(turn)[0], t=t.ravel())
        for turn, t in zip(turns, shifts, strict=True)
    ]
    return [c for c in cameras if (c.project(points)[:, 2] > 0).all()]


def _misses(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> float:
    return float(((camera.project(points)[:, :2] - pixels) ** 2).sum())


def _refined(camera: Camera, points: np.ndarray, pixels: np.ndarray, free_focal: bool) -> Camera:
    """The camera nearby that misses the pixels least."""

    def at(numbers: np.ndarray) -> Camera:
        grown = np.exp(numbers[6]) if free_focal else 1.0
        scaled = np.concatenate([numbers[:3], numbers[3:6] * camera.t[2]])
        fx, fy = camera.fx * grown, camera.fy * grown
        return replace(moved(camera, scaled), fx=fx, fy=fy)

    result = least_squares(
        lambda numbers: (at(numbers).project(points)[:, :2] - pixels).ravel(),
        np.zeros(6 + free_focal),
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
    )
    return at(result.x)
