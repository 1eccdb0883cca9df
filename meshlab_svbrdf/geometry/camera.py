"""A pinhole camera in OpenCV's convention: x ~ K (R X + t), y down, z forward.

Pixel centres are whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """One frame's camera.

    width, height : int, pixels
    fx, fy, cx, cy : float, pixels; pixel centres lie at whole numbers
    R : (3, 3) float64, world to camera; t : (3,) float64
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    R: np.ndarray
    t: np.ndarray

    @property
    def center(self) -> np.ndarray:
        """Where the camera stands in the world, (3,) float64."""
        return -self.R.T @ self.t

    @property
    def K(self) -> np.ndarray:
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def about(self, origin: np.ndarray) -> Camera:
        """The same camera in a world whose origin has moved to `origin` (float32 needs it near)."""
        return Camera(
            self.width, self.height, self.fx, self.fy, self.cx, self.cy,
            self.R, self.t + self.R @ origin,
        )  # fmt: skip

    def cropped(self, left: int, top: int, right: int, bottom: int) -> Camera:
        """The camera of the image's columns left..right and rows top..bottom (half open)."""
        return Camera(
            right - left, bottom - top, self.fx, self.fy, self.cx - left, self.cy - top,
            self.R, self.t,
        )  # fmt: skip

    def reduced(self, times: int) -> Camera:
        """The camera of an image whose pixels are the means of times × times of this one's."""
        return Camera(
            -(-self.width // times), -(-self.height // times), self.fx / times, self.fy / times,
            (self.cx + 0.5) / times - 0.5, (self.cy + 0.5) / times - 0.5, self.R, self.t,
        )  # fmt: skip

    def scaled(self, factor: float) -> Camera:
        """The same view in an image of `factor` times as many columns and rows."""
        return Camera(
            max(round(self.width * factor), 1), max(round(self.height * factor), 1),
            self.fx * factor, self.fy * factor,
            (self.cx + 0.5) * factor - 0.5, (self.cy + 0.5) * factor - 0.5, self.R, self.t,
        )  # fmt: skip

    def project(self, points: np.ndarray) -> np.ndarray:
        """World points (N, 3) to (N, 3): column and row (pixels), depth (world, > 0 in front)."""
        p = points @ self.R.T + self.t
        z = p[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.column_stack(
                [self.fx * p[:, 0] / z + self.cx, self.fy * p[:, 1] / z + self.cy, z]
            )
