"""How much a frame and a rendering of the geometry tell about each other.

Corsini et al. 2009 ("Image-to-geometry registration: a mutual information method exploiting
illumination-related geometric properties") render normals and ambient occlusion, and count colours.
Here the same quantities predict the frame: on the object, a colour is expected that is linear in
harmonics of the normal, in the ambient occlusion and in products of both, which is what distant
light makes of a matt surface; beside the object, one colour. What the prediction leaves unexplained
is taken as normally distributed, so that the information has a closed form without bins:

    2 I = log |C| − share_on log |C_on| − share_off log |C_off|

C : covariance of the colours; C_on, C_off : of what is unexplained on and beside the object. Near
the goal both are taken as one, C_on = C_off: a pixel on the silhouette holds both colours, and must
not belong to either before it is half the other's.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numba import njit

from ..geometry.camera import Camera
from ..geometry.raster import rasterise
from ..geometry.visibility import Rays, spread_directions
from .surface import Surface

RAYS = 128  # per vertex, over the sphere
OFF_SURFACE = 1e-3  # radii
CODE_NOISE = 6.0  # codes of 255 that nothing explains
FEWEST = 50  # pixels of object, below which nothing is told


def face_predictors(surface: Surface) -> np.ndarray:
    """What each face's colour depends on, (F, 13) float64: harmonics of the normal up to the second
    band, ambient occlusion, and its products with the normal."""
    normals = surface.mesh.vertex_normals()
    n = normals[surface.faces].sum(1)
    n /= np.linalg.norm(n, axis=1, keepdims=True).clip(1e-300)
    ambient = ambient_occlusion(surface)[surface.faces].mean(1)
    x, y, z = n.T
    columns = [1 + 0 * x, x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
    return np.column_stack([*columns, ambient, ambient * x, ambient * y, ambient * z])


def ambient_occlusion(surface: Surface) -> np.ndarray:
    """The cosine-weighted share of the upper hemisphere that each vertex sees, (V,) float64."""
    rays, normals = Rays(surface.mesh), surface.mesh.vertex_normals()
    origins = surface.vertices + OFF_SURFACE * normals
    total, free = np.zeros(len(normals)), np.zeros(len(normals))
    for direction in spread_directions(RAYS):
        cos = normals @ direction
        up = np.flatnonzero(cos > 0)
        total[up] += cos[up]
        free[up] += cos[up] * ~rays.blocked(origins[up], direction[None])
    return free / np.maximum(total, 1e-12)


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(face, image, predictors, sums, beside):
    """Products of predictors and colours on the object to `sums` (n + 3, n + 3), upper triangle;
    products of 1 and colours beside it to `beside` (4, 4)."""
    n = predictors.shape[1]
    height, width = face.shape
    value = np.empty(n + 3)
    for row in range(height):
        for col in range(width):
            f = face[row, col]
            if f < 0:
                value[0] = 1.0
                for c in range(3):
                    value[1 + c] = image[row, col, c]
                for a in range(4):
                    for b in range(a, 4):
                        beside[a, b] += value[a] * value[b]
                continue
            for a in range(n):
                value[a] = predictors[f, a]
            for c in range(3):
                value[n + c] = image[row, col, c]
            for a in range(n + 3):
                for b in range(a, n + 3):
                    sums[a, b] += value[a] * value[b]


class Comparison:
    """A frame, at one size, to be compared with renderings; larger values are better.

    Parameters
    ----------
    predictors : see `face_predictors`
    image : (h, w, 3) uint8; camera : of whole frames, in the scaled world
    times : by which the frame is reduced
    window : left, top, right, bottom of the part of the whole frame that is compared
    alike : what is unexplained on and beside the object is taken as one
    """

    def __init__(
        self, surface: Surface, predictors: np.ndarray, image: np.ndarray, times: int,
        window: tuple[int, int, int, int], alike: bool,
    ) -> None:  # fmt: skip
        self.surface, self.predictors, self.times = surface, predictors, times
        self.alike = alike
        left, top, right, bottom = window
        self.left, self.top = left, top
        self.size = max((right - left) // times, 1), max((bottom - top) // times, 1)
        part = image[top : top + times * self.size[1], left : left + times * self.size[0]]
        self.image = cv2.resize(part, self.size, interpolation=cv2.INTER_AREA).astype(np.float32)
        pixels = self.image.reshape(-1, 3).astype(float)
        self.entropy = _log_spread(np.atleast_2d(np.cov(pixels.T, bias=True)))

    def camera(self, camera: Camera) -> Camera:
        """A whole frame's camera as that of this picture."""
        width, height = self.size
        cropped = camera.cropped(
            self.left, self.top, self.left + self.times * width, self.top + self.times * height
        )
        return replace(cropped.reduced(self.times), width=width, height=height)

    def faces(self, camera: Camera) -> np.ndarray:
        """The face that a whole frame's camera sees at each pixel of this picture, −1 for none."""
        return rasterise(self.surface.vertices, self.surface.faces, self.camera(camera))[1]

    def information(self, face: np.ndarray) -> float:
        """In nats per pixel, of this picture and the faces (h, w) seen."""
        n = self.predictors.shape[1]
        sums, beside = np.zeros((n + 3, n + 3)), np.zeros((4, 4))
        _accumulate(face, self.image, self.predictors, sums, beside)
        on, off = sums[0, 0], beside[0, 0]
        if on < FEWEST:
            return 0.0
        sums = np.triu(sums) + np.triu(sums, 1).T
        A, B, C = sums[:n, :n], sums[:n, n:], sums[n:, n:]
        unexplained = (C - B.T @ np.linalg.solve(A + 1e-6 * on * np.eye(n), B)) / on
        share = on / (on + off)
        total, around = beside[0, 1:] / max(off, 1), beside[1:, 1:] / max(off, 1)
        around = np.triu(around) + np.triu(around, 1).T - np.outer(total, total)
        if self.alike:
            left = _log_spread(share * unexplained + (1 - share) * around)
        else:
            left = share * _log_spread(unexplained) + (1 - share) * _log_spread(around)
        return (self.entropy - left) / 2

    def shifted(self, face: np.ndarray, columns: int, rows: int) -> float:
        """As `information`, of the faces moved to the right and down by so many pixels."""
        moved = np.full_like(face, -1)
        h, w = face.shape
        to = np.s_[max(rows, 0) : h + min(rows, 0), max(columns, 0) : w + min(columns, 0)]
        of = np.s_[max(-rows, 0) : h + min(-rows, 0), max(-columns, 0) : w + min(-columns, 0)]
        moved[to] = face[of]
        return self.information(moved)


def _log_spread(covariance: np.ndarray) -> float:
    return float(np.linalg.slogdet(covariance + CODE_NOISE**2 * np.eye(3))[1])
