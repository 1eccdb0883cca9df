"""The `environment` layer: a sphere around the object with the map on it and the lights marked."""

from __future__ import annotations

import cv2
import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.samples.luminance import to_srgb8

_COLUMNS, _ROWS = 64, 32
_SCALE = 1.25  # radii of the object: MeshLab fits its view to hidden layers too


def _sphere() -> Mesh:
    """A unit sphere whose texture coordinates are those of a latitude-longitude map."""
    u, v = np.meshgrid(np.linspace(0, 1, _COLUMNS + 1), np.linspace(0, 1, _ROWS + 1))
    phi, theta = 2 * np.pi * u, np.pi * v
    grid = np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], -1)
    index = np.arange(grid.size // 3).reshape(u.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    uv = np.stack([u, 1 - v], -1).reshape(-1, 2)
    vertices = grid.reshape(-1, 3)
    return Mesh(
        vertices, faces.astype(np.int32), vertices, uv[faces], np.zeros(len(faces), np.int32)
    )


def marked_map(probability: np.ndarray, lights: list[Light], height: int = 512) -> np.ndarray:
    """The map for people, (height, 2·height, 3) uint8: grey, lights ringed in orange."""
    grey = cv2.resize(
        probability.astype(np.float32), (2 * height, height), interpolation=cv2.INTER_LINEAR
    )
    image = np.repeat(to_srgb8(grey)[..., None], 3, axis=-1)
    rays = directions(height)
    for light in lights:
        angle = np.degrees(np.arccos(np.clip(rays @ light.direction, -1, 1)))
        image[(angle > 7) & (angle < 8)] = (255, 140, 0)
        image[angle < 0.7] = (255, 60, 0)
    return image


def set_environment_layer(document: Document, probability: np.ndarray, lights: list[Light]) -> None:
    """Stage the picture of the map and the sphere around the object that wears it."""
    texels_center = document.array("texels_center")
    document.set_image("environment", marked_map(probability, lights), kind="png")
    matrix = np.eye(4)
    matrix[:3, :3] *= _SCALE * float(document.array("texels_radius"))
    matrix[:3, 3] = texels_center
    content = MeshFile(mesh=_sphere(), textures=(document.folder / "environment.png",))
    document.set_layer(Layer("environment", None, matrix, False, content))
