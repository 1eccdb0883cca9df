"""Keyframes: frames whose pixels, carried by the surface, later frames are compared with.

A feature is a pixel of its keyframe for good. Where on the surface it lies follows from the
keyframe's camera, so that it slides on the surface when that camera is adjusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from .contrast import normalise, structure
from .surface import Surface, View

MARGIN = 5.0  # pixels from depth jumps and silhouettes within which nothing is detected
STEEP = 0.25  # cosine between normal and view below which a surface is not looked at
CLIPPED = 252  # codes: a highlight has no position of its own
FEWEST = 8  # features of a keyframe
WEAKEST = 10.0  # mean squared contrast per pixel below which there is nothing to be found


@dataclass(frozen=True)
class Keyframe:
    """A frame, its camera (in the scaled world) and its features.

    index : of the frame
    image : (h, w) uint8, whole
    pixels : (n, 2) in the whole image; planes : (n, 3), q in camera coordinates with q · point = 1
    points : (n, 3) in the scaled world; normals : (n, 3) unit
    """

    index: int
    camera: Camera
    view: View
    image: np.ndarray
    pixels: np.ndarray
    planes: np.ndarray
    points: np.ndarray
    normals: np.ndarray

    def with_camera(self, camera: Camera, surface: Surface) -> Keyframe:
        """The same features after the camera was adjusted; those that fell off the surface stay."""
        view = surface.view(camera)
        if view is None:
            return replace(self, camera=camera)
        *found, ok = lift(view, self.pixels)
        planes, points, normals = (
            np.where(ok[:, None], new, old)
            for new, old in zip(found, (self.planes, self.points, self.normals), strict=True)
        )
        return replace(
            self, camera=camera, view=view, planes=planes, points=points, normals=normals
        )

    def slid(self, camera: Camera) -> Keyframe:
        """The same where the camera moved so little that the tangent planes are the surface."""
        ray = (self.pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        ray = np.column_stack([ray, np.ones(len(ray))])
        distance = np.einsum("ni,ni->n", self.normals, self.points)
        normals = self.normals @ camera.R.T
        planes = normals / (distance + normals @ camera.t)[:, None]
        local = ray / np.einsum("ni,ni->n", planes, ray)[:, None]
        points = (local - camera.t) @ camera.R
        return replace(self, camera=camera, planes=planes, points=points)

    def affinity(self, camera: Camera) -> float:
        """How much of this keyframe another camera sees, and how similarly, 0..1."""
        points, normals = self.points[::4], self.normals[::4]
        if len(points) == 0:
            return 0.0
        u, v, z = camera.project(points).T
        here, there = self.camera.center - points, camera.center - points
        near, far = np.linalg.norm(here, axis=1), np.linalg.norm(there, axis=1)
        cos = np.einsum("ni,ni->n", here, there) / (near * far)
        seen = (z > 0) & (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        seen &= np.einsum("ni,ni->n", normals, there) > STEEP * far
        turn = np.degrees(np.arccos(cos.clip(-1, 1)))
        scale = np.log2(near / far)
        alike = np.exp(-((turn / 20) ** 2) - (scale / 0.7) ** 2)
        return float((seen * alike).mean())


def make_keyframe(
    index: int, image: np.ndarray, camera: Camera, surface: Surface, count: int
) -> Keyframe | None:
    """A frame with up to `count` features spread over the object; None where it has none.

    image : (h, w) uint8, whole
    """
    view = surface.view(camera)
    if view is None:
        return None
    crop = np.ascontiguousarray(view.crop(image))
    pixels = _detect(crop, view, count) + np.array([view.left, view.top])
    if len(pixels) < FEWEST:
        return None
    planes, points, normals, ok = lift(view, pixels)
    ok &= np.einsum("ni,ni->n", normals, camera.center - points) > STEEP * np.linalg.norm(
        camera.center - points, axis=1
    )
    if ok.sum() < FEWEST:
        return None
    return Keyframe(
        index, camera, view, image, pixels[ok], planes[ok], points[ok], normals[ok]
    )  # fmt: skip


def _detect(crop: np.ndarray, view: View, count: int) -> np.ndarray:
    """The best place of each cell of a grid, (n, 2) columns and rows of the crop.

    Corners are best (Shi and Tomasi 1994), but edges count too: what they tell across is used.
    """
    surface = (view.inverse_depth > 0).view(np.uint8)
    near_clipped = cv2.dilate((crop >= CLIPPED).view(np.uint8), np.ones((7, 7), np.uint8))
    usable = (view.inside >= MARGIN) & (near_clipped == 0)
    xx, xy, yy = structure(normalise(crop, surface), 7)
    half, root = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    score = np.where(usable, (half - root) + 0.1 * (half + root), 0)
    cell = max(int(np.sqrt(usable.sum() / (1.5 * count))), 5)
    h, w = (np.array(score.shape) // cell) * cell
    if h == 0 or w == 0:
        return np.zeros((0, 2))
    blocks = score[:h, :w].reshape(h // cell, cell, w // cell, cell)
    cells = blocks.transpose(0, 2, 1, 3).reshape(h // cell, w // cell, cell * cell)
    best, at = cells.max(2), cells.argmax(2)
    row, col = np.indices(best.shape) * cell
    found = np.column_stack([(col + at % cell).ravel(), (row + at // cell).ravel()])
    order = np.argsort(-best.ravel(), kind="stable")[:count]
    return found[order[best.ravel()[order] > WEAKEST]].astype(float)


def lift(view: View, pixels: np.ndarray):
    """Pixels (n, 2) of the whole image to the surface.

    Returns
    -------
    planes : (n, 3), the tangent plane in camera coordinates, q · point = 1
    points : (n, 3) in the scaled world; normals : (n, 3) unit, towards the camera
    ok : (n,) bool, whether there is surface
    """
    camera, w = view.camera, view.inverse_depth
    at = (pixels - [view.left, view.top]).astype(np.float32)[:, None]
    smooth = cv2.blur(w, (3, 3))
    du, dv = (cv2.Scharr(smooth, cv2.CV_32F, *d) / 32 for d in ((1, 0), (0, 1)))
    value, a, b, inside = (
        np.asarray(cv2.remap(x, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=0))[
            :, 0
        ].astype(float)
        for x in (w, du, dv, view.inside)
    )
    ok = (inside >= 3) & (value > 0)
    value = np.where(ok, value, 1.0)
    u, v = at[:, 0].T.astype(float)
    planes = np.column_stack(
        [a * camera.fx, b * camera.fy, value + a * (camera.cx - u) + b * (camera.cy - v)]
    )
    ray = np.column_stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1 + 0 * u])
    local = ray / value[:, None]
    normals = -planes / np.linalg.norm(planes, axis=1, keepdims=True).clip(1e-300)
    return planes, (local - camera.t) @ camera.R, normals @ camera.R, ok
