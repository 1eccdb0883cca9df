"""A lens that distorts, in OpenCV's model, and the pinhole camera of its undistorted frames.

    x = X/Z, y = Y/Z, r² = x² + y²,  radial = 1 + k1 r² + k2 r⁴ + k3 r⁶
    x' = x radial + 2 p1 x y + p2 (r² + 2 x²)
    y' = y radial + p1 (r² + 2 y²) + 2 p2 x y
    column = fx x' + cx,  row = fy y' + cy

All other rooms know pinhole cameras only: frames and points are undistorted at the door.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from .camera import Camera

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")
NEWTON = 20  # steps; five do for lenses that photographs are taken with
RIM = 257  # points along each side of a frame whose undistorted places bound the result


@dataclass(frozen=True)
class Lens:
    """A frame as the lens made it.

    width, height : int, pixels
    fx, fy, cx, cy : float, pixels; pixel centres at whole numbers
    coefficients : k1, k2, p1, p2, k3
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def K(self) -> np.ndarray:
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def distorts(self) -> bool:
        return any(self.coefficients)

    def distort(self, rays: np.ndarray) -> np.ndarray:
        """Where the lens shows directions (N, 2), X/Z and Y/Z: pixels (N, 2)."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = np.asarray(rays, np.float64).T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.column_stack([self.fx * u + self.cx, self.fy * v + self.cy])

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """The inverse of `distort`, by Newton's steps; NaN where no direction leads there."""
        pixels = np.asarray(pixels, np.float64).reshape(-1, 2)
        found = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        for _ in range(NEWTON):
            wrong = pixels - self.distort(found)
            J = self._slopes(found) * np.array([self.fx, self.fy])[:, None]
            det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
            det[det == 0] = np.nan
            step = np.stack(
                [
                    J[:, 1, 1] * wrong[:, 0] - J[:, 0, 1] * wrong[:, 1],
                    J[:, 0, 0] * wrong[:, 1] - J[:, 1, 0] * wrong[:, 0],
                ],
                axis=1,
            )
            found = found + step / det[:, None]
        with np.errstate(invalid="ignore"):
            lost = ~(np.linalg.norm(self.distort(found) - pixels, axis=1) < 1e-6)
        found[lost] = np.nan
        return found

    def _slopes(self, rays: np.ndarray) -> np.ndarray:
        """The derivatives of x', y' by x, y: (N, 2, 2)."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = rays.T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
        J = np.empty((len(rays), 2, 2))
        J[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        J[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        J[:, 0, 1] = J[:, 1, 0] = slope * x * y + 2 * p1 * x + 2 * p2 * y
        return J

    def undistort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of the lens's frame as pixels of the undistorted one."""
        camera = self.pinhole()
        return self.rays(pixels) * [camera.fx, camera.fy] + [camera.cx, camera.cy]

    def pinhole(self, R: np.ndarray | None = None, t: np.ndarray | None = None) -> Camera:
        """The camera of the undistorted frame: of the same size, every pixel seen by the lens.

        The picture's middle stays; a lens that widens the corners costs some focal length.

        Raises
        ------
        ValueError : the coefficients fold the frame over itself: no undistorted frame exists.
        """
        R = np.eye(3) if R is None else R
        t = np.zeros(3) if t is None else t
        plain = Camera(self.width, self.height, self.fx, self.fy, self.cx, self.cy, R, t)
        if not self.distorts:
            return plain
        # Find how much larger the picture has to be for its rim to lie within the frame
        s = np.linspace(0, 1, RIM)
        zero, one = np.zeros(RIM), np.ones(RIM)
        rim = np.vstack([np.c_[s, zero], np.c_[s, one], np.c_[zero, s], np.c_[one, s]])
        edge = rim * [self.width - 1, self.height - 1]
        rays = self.rays(edge)
        asked = (edge - [self.cx, self.cy]) / [self.fx, self.fy]
        if not np.isfinite(rays).all() or (np.einsum("ij,ij->i", rays, asked) < 0).any():
            raise ValueError(f"coefficients {self.coefficients} fold the frame over itself")
        sides = np.repeat([1, 1, 0, 0], RIM)
        rows = np.arange(len(edge))
        reach = rays[rows, sides] / asked[rows, sides]
        scale = 1 / min(1.0, float(np.min(reach)))
        return Camera(
            self.width, self.height, self.fx * scale, self.fy * scale, self.cx, self.cy, R, t
        )

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """The frame (H, W) or (H, W, 3) as its `pinhole` camera sees it; uint8, uint16, float32."""
        return cv2.remap(image, *_maps(self), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@lru_cache(maxsize=4)
def _maps(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Where each pixel of the undistorted frame lies in the lens's."""
    camera = lens.pinhole()
    found = cv2.initUndistortRectifyMap(
        lens.K, np.array(lens.coefficients), np.eye(3), camera.K,
        (camera.width, camera.height), cv2.CV_16SC2,
    )  # fmt: skip
    return found[0], found[1]


def with_coefficients(camera: Camera, coefficients: Sequence[float]) -> Lens:
    """The lens of a camera whose frames are not undistorted; missing coefficients are 0."""
    k = (*map(float, coefficients), 0.0, 0.0, 0.0, 0.0, 0.0)
    return Lens(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy,
        (k[0], k[1], k[2], k[3], k[4]),
    )  # fmt: skip
