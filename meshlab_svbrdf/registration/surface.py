"""The mesh as frames see it: depth where the object is, and what lies safely on its surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.raster import DepthMaps

JUMP = 0.03  # depth step between neighbouring pixels that counts as a jump, in radii


@dataclass(frozen=True)
class View:
    """The part of an image in which the object may be, and its depth there.

    camera : of the crop, in the scaled world
    left, top : the crop's first column and row in the whole image
    inverse_depth : (h, w) float32, 1/z; 0 where nothing is seen
    inside : (h, w) float32, pixels to the nearest depth jump, silhouette or border of the image
    """

    camera: Camera
    left: int
    top: int
    inverse_depth: np.ndarray
    inside: np.ndarray

    def crop(self, image: np.ndarray) -> np.ndarray:
        """This part of a whole image."""
        h, w = self.inverse_depth.shape
        return image[self.top : self.top + h, self.left : self.left + w]


class Surface:
    """A mesh prepared for many renderings, moved to the origin and scaled to radius 1.

    So no threshold depends on where the scan lies, nor on its units. All cameras but those that
    `inner` takes and `outer` gives are in this scaled world.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        given = Mesh(np.asarray(vertices, float), np.ascontiguousarray(faces, np.int32))
        if not given.radius > 0:
            raise ValueError("vertices: expected a mesh that has an extent")
        self.center, self.scale = given.center, given.radius
        self.mesh = replace(given, vertices=(given.vertices - self.center) / self.scale)
        self.vertices, self.faces = self.mesh.vertices, self.mesh.faces
        front = -_outward(self.vertices, self.faces) if self.mesh.is_closed() else 0
        self.depth_maps = DepthMaps(self.vertices, self.faces, front)
        low, high = self.vertices.min(0), self.vertices.max(0)
        self.box = np.stack(np.meshgrid(*np.stack([low, high], 1)), -1).reshape(-1, 3)

    def inner(self, camera: Camera) -> Camera:
        """A camera of the world as one of the scaled world."""
        camera = camera.about(self.center)
        return replace(camera, t=camera.t / self.scale)

    def outer(self, camera: Camera) -> Camera:
        """The inverse of `inner`."""
        return replace(camera, t=camera.t * self.scale).about(-self.center)

    def view(self, camera: Camera, jumps: bool = True) -> View | None:
        """What a camera sees; None where the object is out of its sight.

        jumps : find depth jumps; else `inside` is left empty
        """
        left, top, right, bottom = self.window(camera)
        if right - left < 2 or bottom - top < 2:
            return None
        camera = camera.cropped(left, top, right, bottom)
        inverse_depth = self.depth_maps.of(camera)
        inside = np.zeros((0, 0), np.float32)
        if jumps:
            smooth = _smooth(inverse_depth, JUMP)
            inside = np.asarray(cv2.distanceTransform(smooth, cv2.DIST_L2, 3))
        return View(camera, left, top, inverse_depth, inside)

    def window(self, camera: Camera) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the image's pixels (half open) that enclose the object."""
        u, v, z = camera.project(self.box).T
        if z.min() <= 0:
            return 0, 0, camera.width, camera.height
        left, top = (max(int(np.floor(min(x.min(), 1e9))) - 1, 0) for x in (u, v))
        right, bottom = (
            min(int(np.ceil(max(x.max(), -1e9))) + 2, size)
            for x, size in ((u, camera.width), (v, camera.height))
        )
        return left, top, right, bottom

    def visible_points(self, camera: Camera, count: int = 1000) -> np.ndarray:
        """About so many points (n, 3) of the surface, spread over what a camera sees of it."""
        view = self.view(camera, jumps=False)
        if view is None:
            return np.zeros((0, 3))
        row, col = np.nonzero(view.inverse_depth)
        some = slice(0, None, max(len(row) // count, 1))
        row, col, c = row[some], col[some], view.camera
        ray = np.column_stack([(col - c.cx) / c.fx, (row - c.cy) / c.fy, np.ones(len(col))])
        return (ray / view.inverse_depth[row, col, None] - c.t) @ c.R


def _outward(vertices: np.ndarray, faces: np.ndarray) -> int:
    """1 where a closed surface's faces turn counter-clockwise seen from outside; −1: inside out."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return -1 if np.einsum("ij,ij->", a, np.cross(b, c)) < 0 else 1


def _smooth(inverse_depth: np.ndarray, step: float) -> np.ndarray:
    """1 where surface is seen and no neighbour is nearer or farther by `step`, (h, w) uint8."""
    kernel = np.ones((3, 3), np.uint8)
    near = cv2.dilate(inverse_depth, kernel)
    far = cv2.erode(inverse_depth, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    smooth = (far > 0) & (near - far <= step * near * far)
    # The image's border: what lies beyond is unknown
    smooth[[0, -1]], smooth[:, [0, -1]] = False, False
    return smooth.view(np.uint8)
