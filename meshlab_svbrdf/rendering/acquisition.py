"""The object as it was lit when it was filmed: D + Σ_k ρ g_k V_k (l_k·r)₊^α, from any camera.

Where microfacets describe a material better, their highlights stand for the lobe.

D holds the lights' shading already, so it is never shaded again. Lights may stand near, and what
stands between a light and the surface takes its highlight away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ..geometry.camera import Camera
from ..geometry.gutters import fill_gutters
from ..geometry.harmonics import basis
from ..geometry.mesh import Mesh
from ..geometry.raster import rasterise
from ..geometry.visibility import Rays, directional_visibility
from ..reflectance.lights import Light
from ..reflectance.microfacet import PHONG, facets
from ..reflectance.phong import lamps

AT_ONCE = 1 << 19
"""Rays shaded together: about 250 MB."""
NEGLIGIBLE = 1e-4
"""Highlights below this share of white are not looked into."""


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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _highlight(kind, facing, grazing, shape, normal, view, toward, gain, out):
    """What one light of `gain` adds by its highlight; toward (N, 3) is L, not of unit length."""
    for n in range(len(out)):
        out[n] = 0.0
        if not facing[n] + grazing[n] > 0:
            continue
        nl, nv, lv, length2 = 0.0, 0.0, 0.0, 0.0
        for a in range(3):
            nl += normal[n, a] * toward[n, a]
            nv += normal[n, a] * view[n, a]
            lv += view[n, a] * toward[n, a]
            length2 += toward[n, a] * toward[n, a]
        scale = 1.0 / np.sqrt(length2)
        nl, lv = nl * scale, lv * scale
        if nl <= 0:
            continue
        if kind[n] == PHONG:
            out[n] = facing[n] * gain / length2 * max(2.0 * nv * nl - lv, 0.0) ** shape[n]
        elif nv > 1e-3 and nl > 1e-3:
            value, fresnel = facets(kind[n], shape[n], nl, nv, lv)
            out[n] = gain / length2 * value * (facing[n] + grazing[n] * fresnel)


def _bilinear(image: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Values of (H, W, C) at fractional pixels, clamped at the border."""
    height, width = image.shape[:2]
    col, row = np.clip(col, 0, width - 1), np.clip(row, 0, height - 1)
    c, r = np.minimum(col.astype(int), width - 2), np.minimum(row.astype(int), height - 2)
    a, b = (col - c)[:, None], (row - r)[:, None]
    top = (1 - a) * image[r, c] + a * image[r, c + 1]
    bottom = (1 - a) * image[r + 1, c] + a * image[r + 1, c + 1]
    return (1 - b) * top + b * bottom


class AcquisitionRenderer:
    """Renders one object from many cameras.

    Parameters
    ----------
    mesh : world coordinates, with texture coordinates
    appearance : one per texture
    lights : with gains of geometric mean 1; directions as seen from the mesh's centre
    shadows : whether lights are tested against the mesh
    """

    def __init__(
        self,
        mesh: Mesh,
        appearance: Sequence[Appearance],
        lights: list[Light],
        shadows: bool = True,
    ):
        if mesh.uv is None:
            raise ValueError("the mesh has no texture coordinates")
        self.center, self.radius = mesh.center, mesh.radius
        vertices = mesh.vertices - self.center
        self.mesh = replace(mesh, vertices=vertices, normals=mesh.vertex_normals())
        self.appearance = [_filled(each) for each in appearance]
        self.lights, self.shadows, self.rays = lights, shadows, Rays(self.mesh)
        faces = len(mesh.faces)
        index = np.zeros(faces, np.int32) if mesh.texture_index is None else mesh.texture_index
        self.texture = np.maximum(index, 0)

    def render(self, camera: Camera, supersampling: int = 2) -> tuple[np.ndarray, np.ndarray]:
        """The view (H, W, 3) float64, linear, 1 = 255, black around; and coverage (H, W) in [0, 1].

        supersampling : rays per pixel and direction; the pixel is their mean in linear light
        """
        s = supersampling
        fine = Camera(
            camera.width * s, camera.height * s, camera.fx * s, camera.fy * s,
            (camera.cx + 0.5) * s - 0.5, (camera.cy + 0.5) * s - 0.5, camera.R, camera.t,
        ).about(self.center)  # fmt: skip
        _, face_index = rasterise(self.mesh.vertices, self.mesh.faces, fine)
        rows, cols = np.nonzero(face_index >= 0)
        image, coverage = np.zeros((*face_index.shape, 3)), np.zeros(face_index.shape)
        for first in range(0, len(rows), AT_ONCE):
            row, col = rows[first : first + AT_ONCE], cols[first : first + AT_ONCE]
            image[row, col] = np.clip(self._shade(fine, row, col, face_index[row, col]), 0, None)
            coverage[row, col] = 1
        shape = (camera.height, s, camera.width, s)
        return image.reshape(*shape, 3).mean((1, 3)), coverage.reshape(shape).mean((1, 3))

    def _shade(self, camera: Camera, rows, cols, face) -> np.ndarray:
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

        # Brighten D by what it mirrors of its surroundings
        view = camera.center - position
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        mirroring = np.flatnonzero(sheen)
        if harmonics is not None and len(mirroring):
            n, v = normal[mirroring], view[mirroring]
            mirror = 2 * np.einsum("nd,nd->n", n, v)[:, None] * n - v
            diffuse[mirroring] *= np.exp(sheen[mirroring] * (basis(mirror) @ harmonics))[:, None]

        # Add the highlights of the lights that are seen
        specular, amount = np.zeros(len(face)), np.empty(len(face))
        bulbs = lamps(self.lights, self.radius)
        for k, (direction, gain) in enumerate(zip(bulbs.direction, bulbs.gain, strict=True)):
            toward = direction - bulbs.curvature[k] / self.radius * position
            _highlight(kind, rho_s, grazing, alpha, normal, view, toward, gain, amount)
            amount[amount < NEGLIGIBLE] = 0
            lit = np.flatnonzero(amount)
            if self.shadows and len(lit):
                kappa = bulbs.curvature[k]
                place = None if kappa == 0 else direction * (self.radius / kappa)
                lights = [(direction, place)]
                visible = directional_visibility(self.rays, position[lit], normal[lit], lights)
                amount[lit] *= visible[:, 0]
            specular += amount
        return diffuse + specular[:, None] * tint


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
