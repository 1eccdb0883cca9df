"""Small motions of cameras, and the motion that best explains matched points.

A motion is a twist ξ = (ω, v), (6,): a point p in camera coordinates goes to exp(ω) p + v, to first
order p + ω × p + v.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..geometry.camera import Camera

ITERATIONS = 12
OUTLIER = 3.0  # standard deviations


def moved(camera: Camera, twist: np.ndarray) -> Camera:
    """The camera after a motion of its points by a twist (6,)."""
    turn = Rotation.from_rotvec(twist[:3]).as_matrix()
    return replace(camera, R=turn @ camera.R, t=turn @ camera.t + twist[3:])


def twist_between(a: Camera, b: Camera) -> np.ndarray:
    """The twist (6,) that takes `a` to `b`: the inverse of `moved`."""
    turn = b.R @ a.R.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), b.t - turn @ a.t])


def predicted(before: Camera, last: Camera, steps: float = 1.0) -> Camera:
    """The camera after `last` if it goes on as it came from `before`, about the world's origin."""
    turn = Rotation.from_matrix(last.R @ before.R.T).as_rotvec() * steps
    t = last.t + steps * (last.t - before.t)
    return replace(last, R=Rotation.from_rotvec(turn).as_matrix() @ last.R, t=t)


def point_motion(points: np.ndarray) -> np.ndarray:
    """d (moved point) / d twist of points (n, 3) in camera coordinates, (n, 3, 6)."""
    x, y, z = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [zero, z, -y, one, zero, zero],
        [-z, zero, x, zero, one, zero],
        [y, -x, zero, zero, zero, one],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def pixel_motion(points: np.ndarray, camera: Camera) -> np.ndarray:
    """d (column, row) / d point of points (n, 3) in camera coordinates, (n, 2, 3)."""
    x, y, z = points.T
    zero = np.zeros_like(x)
    rows = [
        [camera.fx / z, zero, -camera.fx * x / z**2],
        [zero, camera.fy / z, -camera.fy * y / z**2],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def motion_cost(camera: Camera, points: np.ndarray, pixels: float) -> np.ndarray:
    """What a twist of a camera costs, (6, 6): 1 where points (n, 3) move by so many pixels, RMS."""
    local = points @ camera.R.T + camera.t
    J = pixel_motion(local, camera) @ point_motion(local)
    return np.einsum("nij,nik->jk", J, J) / (max(len(J), 1) * pixels**2)


@dataclass(frozen=True)
class Fit:
    """A camera fitted to points.

    residual : (n, 2) pixels, found − predicted; deviation : (n,) in standard deviations
    inlier : (n,) bool; covariance : (6, 6) of the twist
    """

    camera: Camera
    residual: np.ndarray
    deviation: np.ndarray
    inlier: np.ndarray
    covariance: np.ndarray

    def uncertainty(self, points: np.ndarray) -> float:
        """RMS error, pixels, that the covariance leaves to points (n, 3)."""
        local = points @ self.camera.R.T + self.camera.t
        J = pixel_motion(local, self.camera) @ point_motion(local)
        return float(np.sqrt(np.einsum("nij,jk,nik->", J, self.covariance, J) / max(len(J), 1)))


def fit_camera(
    points: np.ndarray, found: np.ndarray, whitener: np.ndarray, camera: Camera
) -> Fit | None:
    """The camera that predicts points where they were found, outliers aside.

    Gauss–Newton with Geman and McClure's weights, whose width shrinks from that of all residuals to
    what the points' own uncertainty allows (Yang et al. 2020, graduated non-convexity).

    Parameters
    ----------
    points : (n, 3); found : (n, 2) pixels
    whitener : (n, 2, 2) makes a residual's covariance 1: deviation = |whitener @ residual|
    camera : roughly right

    Returns
    -------
    None where too few points lie before the camera, or nothing holds the camera in some direction.
    """
    width: float | None = None
    for _ in range(ITERATIONS):
        local = points @ camera.R.T + camera.t
        front = local[:, 2] > 1e-9
        if front.sum() < 4:
            return None
        local = np.where(front[:, None], local, [0, 0, 1.0])
        residual = found - (
            local[:, :2] / local[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        )
        J = whitener @ (pixel_motion(local, camera) @ point_motion(local))
        r = np.einsum("nij,nj->ni", whitener, residual)
        deviation = np.where(front, np.linalg.norm(r, axis=1), np.inf)
        # Rayleigh's median is 1.18 standard deviations per coordinate
        scale = max(float(np.median(deviation[front])) / 1.18, 1.0)
        target = OUTLIER * scale
        if width is None:
            width = max(target, float(np.quantile(deviation[front], 0.8)))
        else:
            width = max(0.6 * width, target)
        weight = np.where(front, 1 / (1 + np.minimum(deviation, 1e6) ** 2 / width**2) ** 2, 0)
        A = np.einsum("n,nij,nik->jk", weight, J, J)
        b = np.einsum("n,nij,ni->j", weight, J, np.where(front[:, None], r, 0))
        try:
            twist = np.linalg.solve(A, b)
            covariance = np.linalg.inv(A) * scale**2
        except np.linalg.LinAlgError:
            return None
        camera = moved(camera, twist)
        if width == target and np.einsum("j,jk,k->", twist, A, twist) < 1e-4:
            break
    if not np.isfinite(covariance).all():
        return None
    return Fit(camera, residual, deviation / scale, deviation < OUTLIER * scale, covariance)
