"""The mesh's lines over a frame: whether a camera is right can be seen at a glance.

feature_edges   the mesh's edges, each with the faces beside it
draw_overlay    silhouette and sharp edges over a frame
contact_sheet   many of them in one picture
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..geometry.camera import Camera
from ..geometry.raster import rasterise_depth

SHARP = np.cos(np.radians(35))  # between the faces of an edge that is drawn wherever it is seen
SILHOUETTE, FEATURE = (255, 220, 0), (0, 255, 200)
GOOD, BRIDGED, BAD = (70, 200, 90), (240, 180, 40), (230, 60, 50)
CAPTION = 22  # pixels


class Edges(NamedTuple):
    """Of a mesh: ends (E, 2) vertices, faces (E, 2), −1 where an edge has one; sharp (E,) bool."""

    ends: np.ndarray
    faces: np.ndarray
    sharp: np.ndarray
    normals: np.ndarray
    centers: np.ndarray


class Picture(NamedTuple):
    """One of a contact sheet: (H, W, 3) uint8, what to write under it, and the frame's colour."""

    image: np.ndarray
    caption: str
    color: tuple[int, int, int]


def feature_edges(vertices: np.ndarray, faces: np.ndarray) -> Edges:
    """The edges of a mesh; vertices at the same place count as one."""
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    welded = first[same.ravel()][faces]
    pairs = np.sort(welded[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, owner = pairs[order], owner[order]
    starts = np.flatnonzero(np.r_[True, (pairs[1:] != pairs[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(pairs)])
    beside = np.stack([owner[starts], np.where(counts > 1, owner[starts + (counts > 1)], -1)], 1)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    cos = np.einsum("ij,ij->i", normals[beside[:, 0]], normals[beside[:, 1]])
    sharp = (beside[:, 1] < 0) | (cos < SHARP)
    return Edges(pairs[starts], beside, sharp, normals, (a + b + c) / 3)


def draw_overlay(
    image: np.ndarray, camera: Camera, vertices: np.ndarray, faces: np.ndarray, edges: Edges
) -> np.ndarray:
    """A frame (H, W, 3) uint8 of the camera's size with the lines that the camera would see.

    The silhouette is yellow, sharp edges and rims are green.
    """
    seen = camera.project(vertices)
    depth = rasterise_depth(vertices, faces, camera)
    front = np.einsum("ij,ij->i", edges.normals, camera.center - edges.centers) > 0
    left, right = front[edges.faces[:, 0]], front[edges.faces[:, 1]]
    outline = (edges.faces[:, 1] < 0) | (left != right)
    drawn = outline | (edges.sharp & (left | right))
    visible = _visible(seen, depth)
    ends = edges.ends[drawn]
    shown = visible[ends].any(axis=1) & (seen[ends, 2] > 0).all(axis=1)
    lines = np.rint(seen[ends][shown][:, :, :2] * 16)
    inside = (abs(lines) < 2**20).all(axis=(1, 2))
    lines = lines[inside].astype(np.int32)
    kind = outline[drawn][shown][inside]
    result = image.copy()
    for color, chosen in ((FEATURE, ~kind), (SILHOUETTE, kind)):
        cv2.polylines(result, list(lines[chosen]), False, color, 1, cv2.LINE_AA, 4)
    return result


def contact_sheet(pictures: Sequence[Picture], columns: int = 6) -> np.ndarray:
    """Pictures of one size in rows, each with its caption and a border in its colour."""
    if not pictures:
        raise ValueError("a contact sheet needs a picture")
    height = max(p.image.shape[0] for p in pictures) + CAPTION + 8
    width = max(p.image.shape[1] for p in pictures) + 8
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = np.full((rows * height, columns * width, 3), 24, np.uint8)
    for k, (image, caption, color) in enumerate(pictures):
        top, left = k // columns * height, k % columns * width
        cell = sheet[top : top + height, left : left + width]
        h, w = image.shape[:2]
        cell[1 : h + 7, 1 : w + 7] = color
        cell[4 : h + 4, 4 : w + 4] = image
        cv2.putText(
            cell, caption, (5, h + 21), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (230,) * 3, 1, cv2.LINE_AA
        )  # fmt: skip
    return sheet


def _visible(seen: np.ndarray, inverse_depth: np.ndarray) -> np.ndarray:
    """Which projected vertices the depth map shows, looked up around each: outlines are rims."""
    height, width = inverse_depth.shape
    nearest = cv2.erode(inverse_depth, np.ones((3, 3)))
    with np.errstate(invalid="ignore", divide="ignore"):
        col, row = np.rint(seen[:, 0]), np.rint(seen[:, 1])
        inside = (seen[:, 2] > 0) & (abs(col) < 1e6) & (abs(row) < 1e6)
        inside &= (col >= 0) & (col < width) & (row >= 0) & (row < height)
        found = np.zeros(len(seen), bool)
        w = nearest[row[inside].astype(int), col[inside].astype(int)]
        found[inside] = 1 / seen[inside, 2] >= w * 0.99
    return found
