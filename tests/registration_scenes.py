"""Textured bodies whose frames are drawn ray by pixel, so that every camera is known exactly."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.raster import rasterise


def box(sides=(1.0, 0.7, 0.5)) -> Mesh:
    """A closed box about the origin, twelve triangles."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * sides
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])]
    return Mesh(corners, np.array(faces, np.int32))


class Print:
    """A smooth random pattern in space: what is printed on a surface that runs through it."""

    def __init__(self, seed: int = 0, waves: int = 60, finest: float = 60.0) -> None:
        rng = np.random.default_rng(seed)
        length = np.geomspace(3.0, finest, waves)
        direction = rng.normal(size=(waves, 3))
        direction *= (length / np.linalg.norm(direction, axis=1))[:, None]
        self.direction, self.phase = direction, rng.uniform(0, 2 * np.pi, waves)
        self.strength = length**-0.25

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Reflectance .1 to .9 at points (n, 3)."""
        waves = np.sin(points @ self.direction.T + self.phase) @ self.strength
        return 0.5 + 0.4 * np.tanh(2 * waves / np.linalg.norm(self.strength))


def draw(
    mesh: Mesh, camera: Camera, print_: Print, *, gain: float = 1.0, clutter: int | None = None,
    noise: float = 1.0, glint: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """A frame (h, w) uint8: the print under light from above, before grey or a cluttered wall.

    clutter : seed of the wall, which another seed moves; None: an even grey
    glint : strength of a highlight that slides over the surface with the camera
    """
    inverse_depth, face = rasterise(mesh.vertices, mesh.faces, camera)
    row, col = np.nonzero(face >= 0)
    ray = np.column_stack(
        [(col - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones(len(col))]
    )
    points = (ray / inverse_depth[row, col, None] - camera.t) @ camera.R
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-300)
    n = normals[face[row, col]]
    shade = 0.7 + 0.3 * np.clip(n @ [0.36, 0.8, 0.48], -0.5, 1)
    view = camera.center - points
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    mirrored = 2 * np.sum(n * view, 1, keepdims=True) * n - view
    lobe = np.clip(mirrored @ [0.6, 0.48, 0.64], 0, 1) ** 30
    image = np.full((camera.height, camera.width), 0.3)
    if clutter is not None:
        rng = np.random.default_rng(clutter)
        image = cv2.GaussianBlur(rng.uniform(size=image.shape), (0, 0), 2)
        image = 0.4 + 3 * (image - 0.5)
    image[row, col] = print_(points) * shade + glint * lobe
    rng = np.random.default_rng(int(abs(camera.center @ [997, 89, 13]) * 1e4))
    values = 255 * gain * image + noise * rng.normal(size=image.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def rms(true: Camera, camera: Camera, points: np.ndarray) -> float:
    """Pixels by which points (n, 3) miss their places."""
    miss = true.project(points)[:, :2] - camera.project(points)[:, :2]
    return float(np.sqrt((miss**2).sum(1).mean()))


def disturbed(camera: Camera, degrees: float, farther: float, seed: int) -> Camera:
    """Turned about the origin around a random axis, and farther away by a share."""
    axis = np.random.default_rng(seed).normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    return replace(camera, R=turn @ camera.R, t=camera.t * (1 + farther))
