"""What a camera sees of a textured object: where, which way it faces, what it is made of.

Appearance         texture images of the reflectance
Seen               the surface behind some pixels
SurfaceRenderer    pixels to surface, surface to image; how it is lit is a subclass's matter
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..geometry.camera import Camera
from ..geometry.gutters import fill_gutters
from ..geometry.mesh import Mesh
from ..geometry.raster import rasterise
from ..geometry.visibility import Rays
from ..jit import kernel
from ..reflectance.microfacet import PHONG

AT_ONCE = 1 << 19
"""Rays shaded together: about 250 MB."""


@dataclass(frozen=True)
class Appearance:
    """What a texture image holds, one entry per texture of the mesh.

    diffuse : (H, W, 3) linear, 1 = 255, NaN where unobserved
    rho_s, alpha : (H, W), NaN where there is no gloss
    tint : (H, W, 3), the highlight's colour, luminance 1
    turn : (H, W, 3) world, what is added to the mesh's interpolated normal, NaN outside the charts;
        or None. (Normals looked up themselves would be as coarse as the texture.)
    inside : (H, W) bool, the charts: what lies outside takes its nearest neighbour's gloss; or
        None: all of the image
    kind, grazing : (H, W), microfacets' as in `microfacet.Gloss`, whose facing is in rho_s and
        whose roughness in alpha; or None: Phong's lobe everywhere
    sheen : (H, W), the strength s of what it mirrors of its surroundings, NaN for none; harmonics :
        (36,) of ℓ: D is multiplied by exp(s ℓ(r)) (reflectance/sheen.py); or None
    """

    diffuse: np.ndarray
    rho_s: np.ndarray
    alpha: np.ndarray
    tint: np.ndarray
    turn: np.ndarray | None = None
    inside: np.ndarray | None = None
    kind: np.ndarray | None = None
    grazing: np.ndarray | None = None
    sheen: np.ndarray | None = None
    harmonics: np.ndarray | None = None


@dataclass(frozen=True)
class Seen:
    """The surface behind N pixels, about the object's centre.

    face : (N,), and barycentric : (N, 3) on it; position, normal, view : (N, 3) float64
    diffuse, tint : (N, 3); kind, facing, grazing, shape : (N,), the gloss as in `Appearance`
    sheen : (N,), and harmonics : (36,), or None
    """

    face: np.ndarray
    barycentric: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    view: np.ndarray
    diffuse: np.ndarray
    tint: np.ndarray
    kind: np.ndarray
    facing: np.ndarray
    grazing: np.ndarray
    shape: np.ndarray
    sheen: np.ndarray
    harmonics: np.ndarray | None


@kernel
def _barycentric(points, faces, fx, fy, cx, cy, rows, cols, face, out):
    """Perspective-correct barycentric coordinates of the pixel centres on their faces."""
    p, e = np.empty((3, 3)), np.empty(3)
    for n in range(len(face)):
        for i in range(3):
            x, y, z = points[faces[face[n], i]]
            p[i, 0], p[i, 1], p[i, 2] = fx * x + cx * z, fy * y + cy * z, z
        total = 0.0
        for i in range(3):
            a, b = p[(i + 1) % 3], p[(i + 2) % 3]
            e[i] = (
                (a[1] * b[2] - a[2] * b[1]) * cols[n]
                + (a[2] * b[0] - a[0] * b[2]) * rows[n]
                + (a[0] * b[1] - a[1] * b[0])
            )
            total += e[i]
        for i in range(3):
            out[n, i] = e[i] / total


def _bilinear(image: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Values of (H, W, C) at fractional pixels, clamped at the border."""
    height, width = image.shape[:2]
    col, row = np.clip(col, 0, width - 1), np.clip(row, 0, height - 1)
    c, r = np.minimum(col.astype(int), width - 2), np.minimum(row.astype(int), height - 2)
    a, b = (col - c)[:, None], (row - r)[:, None]
    top = (1 - a) * image[r, c] + a * image[r, c + 1]
    bottom = (1 - a) * image[r + 1, c] + a * image[r + 1, c + 1]
    return (1 - b) * top + b * bottom


class SurfaceRenderer:
    """Renders one object from many cameras.

    Parameters
    ----------
    mesh : world coordinates, with texture coordinates
    appearance : one per texture
    """

    def __init__(self, mesh: Mesh, appearance: Sequence[Appearance]) -> None:
        if mesh.uv is None:
            raise ValueError("the mesh has no texture coordinates")
        self.center, self.radius = mesh.center, mesh.radius
        vertices = mesh.vertices - self.center
        self.mesh = replace(mesh, vertices=vertices, normals=mesh.vertex_normals())
        self.appearance = [_filled(each) for each in appearance]
        faces = len(mesh.faces)
        index = np.zeros(faces, np.int32) if mesh.texture_index is None else mesh.texture_index
        self.texture = np.maximum(index, 0)

    @cached_property
    def rays(self) -> Rays:
        """What shadows are looked for with."""
        return Rays(self.mesh)

    def light(self, seen: Seen) -> np.ndarray:
        """What the surface sends to the camera, (N, 3) linear."""
        raise NotImplementedError

    def render(self, camera: Camera, supersampling: int = 2) -> tuple[np.ndarray, np.ndarray]:
        """The view (H, W, 3) float64, linear, 1 = 255, black around; and coverage (H, W) in [0, 1].

        supersampling : rays per pixel and direction; the pixel is their mean in linear light
        """
        s = supersampling
        fine = camera.scaled(s).about(self.center)
        _, face_index = rasterise(self.mesh.vertices, self.mesh.faces, fine)
        rows, cols = np.nonzero(face_index >= 0)
        image, coverage = np.zeros((*face_index.shape, 3)), np.zeros(face_index.shape)
        for first in range(0, len(rows), AT_ONCE):
            row, col = rows[first : first + AT_ONCE], cols[first : first + AT_ONCE]
            image[row, col] = np.clip(
                self.light(self._seen(fine, row, col, face_index[row, col])), 0, None
            )
            coverage[row, col] = 1
        shape = (camera.height, s, camera.width, s)
        return image.reshape(*shape, 3).mean((1, 3)), coverage.reshape(shape).mean((1, 3))

    def _seen(self, camera: Camera, rows, cols, face) -> Seen:
        # Find the surface behind each pixel
        mesh = self.mesh
        assert mesh.uv is not None
        weights = np.empty((len(face), 3))
        points = np.ascontiguousarray(mesh.vertices @ camera.R.T + camera.t)
        _barycentric(
            points, mesh.faces, camera.fx, camera.fy, camera.cx, camera.cy,
            rows, cols, face, weights,
        )  # fmt: skip
        corners = mesh.faces[face]
        position = np.einsum("nc,ncd->nd", weights, mesh.vertices[corners])
        normal = np.einsum("nc,ncd->nd", weights, mesh.vertex_normals()[corners])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        uv = np.einsum("nc,ncd->nd", weights, mesh.uv[face])

        # Look up what it is made of
        diffuse, tint = np.zeros((len(face), 3)), np.zeros((len(face), 3))
        rho_s, alpha = np.zeros(len(face)), np.ones(len(face))
        kind, grazing = np.full(len(face), PHONG), np.zeros(len(face))
        sheen, harmonics = np.zeros(len(face)), None
        for index, look in enumerate(self.appearance):
            on = self.texture[face] == index
            height, width = look.rho_s.shape
            col, row = uv[on, 0] * width - 0.5, (1 - uv[on, 1]) * height - 0.5
            diffuse[on] = _bilinear(look.diffuse, col, row)
            near = (
                np.clip(np.rint(row).astype(int), 0, height - 1),
                np.clip(np.rint(col).astype(int), 0, width - 1),
            )
            rho_s[on], alpha[on], tint[on] = look.rho_s[near], look.alpha[near], look.tint[near]
            if look.kind is not None and look.grazing is not None:
                kind[on], grazing[on] = look.kind[near], look.grazing[near]
            if look.turn is not None:
                normal[on] += _bilinear(look.turn, col, row)
            if look.sheen is not None:
                sheen[on] = _bilinear(look.sheen[..., None], col, row)[:, 0]
                harmonics = look.harmonics
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        view = camera.center - position
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        return Seen(
            face, weights, position, normal, view, diffuse, tint, kind, rho_s, grazing, alpha,
            sheen, harmonics,
        )  # fmt: skip


def _filled(look: Appearance) -> Appearance:
    """Gutters take their neighbours' values, unobserved texels their colour; no gloss is ρs 0."""
    known = np.isfinite(look.diffuse).all(-1)
    inside = np.ones(look.rho_s.shape, bool) if look.inside is None else look.inside
    turn = look.turn
    if turn is not None:
        turn = fill_gutters(turn, np.isfinite(turn).all(-1))
    return Appearance(
        np.nan_to_num(fill_gutters(look.diffuse, known)).astype(np.float64),
        np.nan_to_num(fill_gutters(look.rho_s, inside)),
        np.nan_to_num(fill_gutters(look.alpha, inside), nan=1.0),
        fill_gutters(look.tint, inside),
        turn,
        kind=None if look.kind is None else fill_gutters(look.kind, inside),
        grazing=None if look.grazing is None else fill_gutters(look.grazing, inside),
        sheen=None if look.sheen is None else np.nan_to_num(fill_gutters(look.sheen, inside)),
        harmonics=look.harmonics,
    )
