"""Colours and materials, procedural in space and so continuous over all seams, baked into maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.spatial import cKDTree

from meshlab_svbrdf.geometry.mesh import Mesh
from sample_projects.procedural.paint import Atlas, decode_srgb, encode_srgb

from .variant import Variant

PATCHES = 5  # areas that each material has


@dataclass(frozen=True)
class Maps:
    """albedo : (S, S, 3) linear, exactly what its 8-bit PNG holds; material : (S, S) uint8.

    Both are filled beyond the charts from the nearest texel. inside : (S, S) bool, the charts.
    """

    albedo: np.ndarray
    material: np.ndarray
    inside: np.ndarray

    @property
    def albedo_code(self) -> np.ndarray:
        return np.round(255 * encode_srgb(self.albedo)).astype(np.uint8)


def paint(mesh: Mesh, variant: Variant) -> Maps:
    """Cut the surface into patches around random points, a material each, and colour them."""
    rng = np.random.default_rng([variant.seed, 2])
    atlas = Atlas.of(mesh, variant.texture)
    inside = atlas.face >= 0
    corners = mesh.vertices[mesh.faces[atlas.face[inside]]]
    point = (atlas.barycentric[inside][..., None] * corners).sum(1)
    lattice = rng.uniform(-1, 1, (32, 32, 32))

    # Choose middles of patches far from each other; patches have wavy borders
    count = PATCHES * len(variant.materials)
    middle = point[[rng.integers(len(point))]]
    far = np.full(len(point), np.inf)
    for _ in range(count - 1):
        far = np.minimum(far, np.linalg.norm(point - middle[-1], axis=1))
        middle = np.vstack([middle, point[far.argmax()]])
    wavy = point + 0.04 * np.stack([_cloud(lattice, point + s, 5.0) for s in (0, 11, 23)], -1)
    material = (np.arange(count) % len(variant.materials))[cKDTree(middle).query(wavy)[1]]

    dark, bright = (
        np.array([getattr(m, k) for m in variant.materials]) for k in ("dark", "bright")
    )
    share = np.clip(0.5 + 0.8 * _cloud(lattice, point, 6.0), 0, 1)[:, None]
    color = (1 - share) * dark[material] + share * bright[material]
    around = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    albedo, identity = np.zeros((*inside.shape, 3)), np.zeros(inside.shape, np.uint8)
    albedo[inside], identity[inside] = np.round(255 * encode_srgb(color)) / 255, material
    return Maps(decode_srgb(albedo[tuple(around)]), identity[tuple(around)], inside)


def _cloud(lattice: np.ndarray, points: np.ndarray, frequency: float) -> np.ndarray:
    """Three octaves of an interpolated random lattice, about -1..1."""
    return sum(
        map_coordinates(lattice, (points * frequency * 2**k + 7.3 * k).T, order=1, mode="grid-wrap")
        / 2**k
        for k in range(3)
    )
