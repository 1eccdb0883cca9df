"""A scene as bytes that a page reads: little-endian arrays, one after the other."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from .scene import Scene

GUTTER = 12.0
"""Pixels around charts that take the nearest texel's colour, so that no seam shows."""
NO_LABEL = 65535


def outline(scene: Scene) -> dict[str, Any]:
    """What a page needs to read the arrays."""
    texels, mesh = scene.texels, scene.mesh
    return {
        "project": scene.document.name,
        "texels": len(texels),
        "triangles": len(mesh.faces),
        "center": texels.center.tolist(),
        "radius": texels.radius,
        "textures": [
            {"height": int(h), "width": int(w), "faces": len(_faces_of(scene, k))}
            for k, (h, w) in enumerate(texels.sizes)
        ],
        "frames": scene.frames,
        "lamps": [lamp.direction.tolist() for lamp in scene.lamps],
    }


def geometry(scene: Scene) -> bytes:
    """Per texture, per corner: positions (n, 3) float32 in radii about the centre, texture
    coordinates (n, 2) float32 whose row 0 is an image's first, normals (n, 4) int8."""
    mesh, texels = scene.mesh, scene.texels
    normals = np.zeros((len(mesh.vertices), 4), np.int8)
    normals[:, :3] = np.rint(127 * mesh.vertex_normals())
    place = ((mesh.vertices - texels.center) / texels.radius).astype("<f4")
    parts = []
    for texture in range(len(texels.sizes)):
        faces = _faces_of(scene, texture)
        corners = mesh.faces[faces].ravel()
        assert mesh.uv is not None
        uv = mesh.uv[faces].reshape(-1, 2) * [1, -1] + [0, 1]
        parts += [place[corners].tobytes(), uv.astype("<f4").tobytes(), normals[corners].tobytes()]
    return b"".join(parts)


def pixels(scene: Scene, texture: int) -> bytes:
    """The texel (H, W) int32 that each pixel of a texture shows, -1 for none."""
    texels, (height, width) = scene.texels, scene.texels.sizes[texture]
    own = np.flatnonzero(texels.texture == texture)
    image = np.full((height, width), -1, "<i4")
    image[texels.row[own], texels.col[own]] = own
    outside = (image < 0).astype(np.uint8)
    if not len(own) or not outside.any():
        return image.tobytes()
    distance, nearest = cv2.distanceTransformWithLabels(
        outside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    texel_of = np.full(nearest.max() + 1, -1, np.int32)
    texel_of[nearest[outside == 0]] = image[outside == 0]
    return np.where(distance <= GUTTER, texel_of[nearest], -1).astype("<i4").tobytes()


def labels(values: np.ndarray) -> bytes:
    """Materials (T,) as uint16, NO_LABEL for none."""
    return np.where(values >= 0, np.minimum(values, NO_LABEL - 1), NO_LABEL).astype("<u2").tobytes()


def _faces_of(scene: Scene, texture: int) -> np.ndarray:
    index = scene.mesh.texture_index
    if index is None or len(scene.texels.sizes) == 1:
        return np.arange(len(scene.mesh.faces)) if texture == 0 else np.zeros(0, int)
    return np.flatnonzero(np.maximum(index, 0) == texture)
