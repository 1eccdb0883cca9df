"""Normal maps, tangent or object space, to normals per texel and back.

A colour c of full scale M (255 or 65535) means the component 2c/M − 1. Object space: the components
are x, y, z of the mesh's own coordinates, before its layer's matrix. Tangent space: red along
increasing u, green along increasing v (up in the image: "+Y", as in OpenGL and Blender;
green="down" is DirectX's "−Y"), blue along the normal. The frame is MikkTSpace's at the texel (the
tangent made orthogonal to the interpolated normal, the bitangent on dP/dv's side, so mirrored
charts and layers come out right), but with one tangent per face: maps baked with tangents smoothed
over vertices differ slightly on strongly curved charts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np

from ..errors import SvbrdfError
from .mesh import Mesh
from .texels import Texels

Space = Literal["tangent", "object"]
Green = Literal["up", "down"]


def face_tangents(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """dP/du and dP/dv of each face, both (F, 3), unit; 0 where degenerate."""
    if mesh.uv is None:
        raise SvbrdfError(
            "a normal map needs texture coordinates and the mesh has none: parametrise it first"
        )
    e1, e2 = (mesh.vertices[mesh.faces[:, i]] - mesh.vertices[mesh.faces[:, 0]] for i in (1, 2))
    d1, d2 = (mesh.uv[:, i] - mesh.uv[:, 0] for i in (1, 2))
    handedness = np.sign(d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1])[:, None]
    along_u = _unit(handedness * (d2[:, 1:] * e1 - d1[:, 1:] * e2))
    along_v = _unit(handedness * (d1[:, :1] * e2 - d2[:, :1] * e1))
    return along_u, along_v


def texel_frames(texels: Texels, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Tangent, bitangent, normal: the columns of (T, 3, 3) float64; and where they exist, (T,)."""
    along_u, along_v = face_tangents(mesh)
    n = texels.normal.astype(np.float64)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    t = along_u[texels.face]
    t = t - n * np.einsum("ij,ij->i", t, n)[:, None]
    length = np.linalg.norm(t, axis=1)
    t = np.divide(t, length[:, None], out=np.zeros_like(t), where=length[:, None] > 1e-6)
    b = np.cross(n, t)
    side = np.sign(np.einsum("ij,ij->i", b, along_v[texels.face]))
    return np.stack([t, side[:, None] * b, n], axis=2), (length > 1e-6) & (side != 0)


def apply_normal_map(
    texels: Texels,
    mesh: Mesh,
    images: Sequence[np.ndarray],
    space: Space = "tangent",
    green: Green = "up",
    matrix: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The normals that a normal map says.

    Parameters
    ----------
    texels, mesh : the geometry, with UVs
    images : one per texture, (H, W, 3) uint8 or uint16 in the order red, green, blue; resampled
        where its size is not the texture's
    space : "tangent" or "object"
    green : "up" (+Y) or "down" (−Y), tangent space only
    matrix : (4, 4) from the mesh's own coordinates to those of `mesh`, object space only

    Returns
    -------
    normals : (T, 3) float32 unit
    valid : (T,) bool; False where the UVs give no frame or the map says nothing (a zero vector):
        there the texel keeps its own normal
    """
    if len(images) != len(texels.sizes):
        raise SvbrdfError(
            f"{len(images)} normal maps for {len(texels.sizes)} textures: give one per texture"
        )
    vector = np.zeros((len(texels), 3))
    for index, (image, (height, width)) in enumerate(zip(images, texels.sizes, strict=True)):
        decoded = _decode(image)
        if decoded.shape[:2] != (height, width):
            shrinks = decoded.shape[0] > height
            method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
            decoded = cv2.resize(decoded, (width, height), interpolation=method)
        here = texels.texture == index
        vector[here] = decoded[texels.row[here], texels.col[here]]

    # Turn tangent space into the mesh's, and keep what has a direction
    valid = np.ones(len(texels), dtype=bool)
    if space == "tangent":
        if green == "down":
            vector[:, 1] *= -1
        frames, valid = texel_frames(texels, mesh)
        vector = np.einsum("tij,tj->ti", frames, vector)
    elif matrix is not None:
        said = np.linalg.norm(vector, axis=1, keepdims=True)
        vector = said * _unit(vector @ np.linalg.inv(matrix[:3, :3]))
    length = np.linalg.norm(vector, axis=1)
    valid &= length > 0.1
    normals = texels.normal.astype(np.float32)
    normals[valid] = vector[valid] / length[valid, None]
    return normals, valid


def encode_normal_map(
    texels: Texels,
    mesh: Mesh,
    normals: np.ndarray,
    space: Space = "tangent",
    green: Green = "up",
    bits: Literal[8, 16] = 8,
    matrix: np.ndarray | None = None,
) -> list[np.ndarray]:
    """The inverse of `apply_normal_map`: one (H, W, 3) image per texture, uint8 or uint16.

    Pixels outside the charts, and texels without a tangent frame, are flat: (0, 0, 1) in tangent
    space, nothing (a zero vector) in object space.
    """
    vector = np.asarray(normals, dtype=np.float64)
    flat = np.array([0.0, 0.0, 1.0 if space == "tangent" else 0.0])
    if space == "tangent":
        frames, valid = texel_frames(texels, mesh)
        vector = np.where(valid[:, None], np.einsum("tij,ti->tj", frames, vector), flat)
        if green == "down":
            vector[:, 1] *= -1
    elif matrix is not None:
        vector = _unit(vector @ matrix[:3, :3])
    scale, dtype = (255, np.uint8) if bits == 8 else (65535, np.uint16)

    def colour(v: np.ndarray) -> np.ndarray:
        return np.rint((np.clip(v, -1, 1) + 1) / 2 * scale).astype(dtype)

    images = [np.tile(colour(flat), (*size, 1)) for size in texels.sizes]
    for index, image in enumerate(images):
        here = texels.texture == index
        image[texels.row[here], texels.col[here]] = colour(vector[here])
    return images


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    good = np.isfinite(length) & (length > 0)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=good)


def _decode(image: np.ndarray) -> np.ndarray:
    if image.dtype not in (np.uint8, np.uint16) or image.ndim != 3 or image.shape[2] != 3:
        raise SvbrdfError(
            f"a normal map is an 8- or 16-bit RGB image; this one is {image.dtype} of shape "
            f"{image.shape}: save it without alpha as 8- or 16-bit PNG"
        )
    return image.astype(np.float64) / np.iinfo(image.dtype).max * 2 - 1
