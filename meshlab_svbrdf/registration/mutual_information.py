"""How much a frame and a rendering of the geometry tell about each other.

Corsini et al. 2009 ("Image-to-geometry registration: a mutual information method exploiting
illumination-related geometric properties") render normals and ambient occlusion, and count colours.
Here the same quantities predict the frame: on the object, a colour is expected that is linear in
harmonics of the normal, in the ambient occlusion and in products of both, which is what distant
light makes of a matt surface; beside the object, one colour. What the prediction leaves unexplained
is taken as normally distributed, so that the information has a closed form without bins:

    2 I = log |C| − share_on log |C_on| − share_off log |C_off|

C : covariance of the colours; C_on, C_off : of what is unexplained on and beside the object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from ..geometry.raster import rasterise
from ..geometry.visibility import Rays, spread_directions
from ..jit import kernel
from .surface import Surface

RAYS = 128  # per vertex, over the sphere
OFF_SURFACE = 1e-3  # radii
CODE_NOISE = 6.0  # codes of 255 that nothing explains
CREASE = 0.7  # cosine between a vertex's and a face's normal below which the latter counts
FEWEST = 50  # pixels of object, below which nothing is told


def face_predictors(surface: Surface) -> np.ndarray:
    """What each face's colour depends on, (F, 13) float64: harmonics of the normal up to the second
    band, ambient occlusion, and its products with the normal."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    own = _unit(np.cross(b - a, c - a))
    # At a sharp edge a vertex has no normal
    n = surface.mesh.vertex_normals()[surface.faces]
    n = _unit(np.where((n * own[:, None]).sum(2, keepdims=True) > CREASE, n, own[:, None]).sum(1))
    ambient = ambient_occlusion(surface)[surface.faces].mean(1)
    x, y, z = n.T
    columns = [1 + 0 * x, x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
    return np.column_stack([*columns, ambient, ambient * x, ambient * y, ambient * z])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True).clip(1e-300)


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


@dataclass(frozen=True)
class Shape:
    """A surface as it is rendered to be compared.

    vertices : (V, 3); faces : (F, 3) int32; predictors : see `face_predictors`
    """

    vertices: np.ndarray
    faces: np.ndarray
    predictors: np.ndarray


def simplified(shape: Shape, cell: float) -> Shape:
    """Vertices within cells of so many radii become one: what small pictures can show."""
    key = np.floor(shape.vertices / cell).astype(np.int64)
    _, same, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    same = same.ravel()
    sums = np.zeros((len(count), 3))
    np.add.at(sums, same, shape.vertices)
    faces = same[shape.faces].astype(np.int32)
    a, b, c = faces.T
    kept = (a != b) & (b != c) & (c != a)
    if 2 * kept.sum() > len(kept):
        return shape
    return Shape(sums / count[:, None], faces[kept], shape.predictors[kept])


@kernel
def _accumulate(face, image, predictors, seen, sums, beside):
    """Products of predictors and colours on the object to `sums` (n + 3, n + 3), upper triangle;
    products of 1 and colours beside it to `beside` (4, 4). seen : (F, 4) of zeros, for use."""
    n = predictors.shape[1]
    height, width = face.shape
    for row in range(height):
        for col in range(width):
            f = face[row, col]
            r, g, b = image[row, col, 0], image[row, col, 1], image[row, col, 2]
            if f < 0:
                beside[0, 0] += 1
                beside[0, 1] += r
                beside[0, 2] += g
                beside[0, 3] += b
                beside[1, 1] += r * r
                beside[1, 2] += r * g
                beside[1, 3] += r * b
                beside[2, 2] += g * g
                beside[2, 3] += g * b
                beside[3, 3] += b * b
            else:
                seen[f, 0] += 1
                seen[f, 1] += r
                seen[f, 2] += g
                seen[f, 3] += b
                sums[n, n] += r * r
                sums[n, n + 1] += r * g
                sums[n, n + 2] += r * b
                sums[n + 1, n + 1] += g * g
                sums[n + 1, n + 2] += g * b
                sums[n + 2, n + 2] += b * b
    for f in range(len(predictors)):
        if seen[f, 0] > 0:
            for a in range(n):
                value = predictors[f, a]
                for c in range(a, n):
                    sums[a, c] += seen[f, 0] * value * predictors[f, c]
                for c in range(3):
                    sums[a, n + c] += value * seen[f, 1 + c]


class Comparison:
    """A frame, at one size, to be compared with renderings; larger values are better.

    Parameters
    ----------
    image : (h, w, 3) uint8; camera : of whole frames, in the scaled world
    times : by which the frame is reduced
    window : left, top, right, bottom of the part of the whole frame that is compared
    """

    def __init__(
        self, shape: Shape, image: np.ndarray, times: int, window: tuple[int, int, int, int]
    ) -> None:
        self.shape, self.times = shape, times
        left, top, right, bottom = window
        self.left, self.top = left, top
        self.size = max((right - left) // times, 1), max((bottom - top) // times, 1)
        part = image[top : top + times * self.size[1], left : left + times * self.size[0]]
        self.image = cv2.resize(part, self.size, interpolation=cv2.INTER_AREA).astype(np.float32)
        pixels = self.image.reshape(-1, 3).astype(float)
        self.entropy = _log_spread(np.atleast_2d(np.cov(pixels.T, bias=True)))

    def faces(self, camera: Camera, beyond: int = 0) -> np.ndarray:
        """The face that a whole frame's camera sees at each pixel of this picture, −1 for none, and
        at so many pixels beyond each side."""
        width, height = (n + 2 * beyond for n in self.size)
        left, top = (at - beyond * self.times for at in (self.left, self.top))
        cropped = camera.cropped(left, top, left + self.times * width, top + self.times * height)
        own = replace(cropped.reduced(self.times), width=width, height=height)
        return rasterise(self.shape.vertices, self.shape.faces, own)[1]

    def information(self, face: np.ndarray) -> float:
        """In nats per pixel, of this picture and the faces (h, w) seen."""
        predictors = self.shape.predictors
        n = predictors.shape[1]
        sums, beside = np.zeros((n + 3, n + 3)), np.zeros((4, 4))
        seen = np.zeros((len(predictors), 4))
        _accumulate(face, self.image, predictors, seen, sums, beside)
        on, off = sums[0, 0], beside[0, 0]
        if on < FEWEST:
            return 0.0
        sums = np.triu(sums) + np.triu(sums, 1).T
        A, B, C = sums[:n, :n], sums[:n, n:], sums[n:, n:]
        unexplained = (C - B.T @ np.linalg.solve(A + 1e-6 * on * np.eye(n), B)) / on
        share = on / (on + off)
        total, around = beside[0, 1:] / max(off, 1), beside[1:, 1:] / max(off, 1)
        around = np.triu(around) + np.triu(around, 1).T - np.outer(total, total)
        left = share * _log_spread(unexplained) + (1 - share) * _log_spread(around)
        return (self.entropy - left) / 2

    def shifted(self, face: np.ndarray, columns: int, rows: int) -> float:
        """As `information`, of faces seen beyond each side too, which are moved to the right and
        down by so many pixels."""
        width, height = self.size
        top, left = (face.shape[0] - height) // 2 - rows, (face.shape[1] - width) // 2 - columns
        moved = face[top : top + height, left : left + width]
        return self.information(np.ascontiguousarray(moved))


def _log_spread(covariance: np.ndarray) -> float:
    return float(np.linalg.slogdet(covariance + CODE_NOISE**2 * np.eye(3))[1])
