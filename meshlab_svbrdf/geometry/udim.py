"""UDIM tiles: texture coordinates beyond 0..1 that name an image by the unit square they lie in.

The square of floor(u), floor(v) is image 1001 + floor(u) + 10 floor(v), as Mari, ZBrush, Substance
and Blender number them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..blocks import blocks, room
from .mesh import Mesh

FIRST = 1001
ACROSS = 10
"""Tiles in a row; a u beyond them is no tile."""
ROUNDING = 1e-4
"""How far, in tiles, a corner may lie over its tile's border."""


def split_tiles(mesh: Mesh) -> tuple[Mesh, np.ndarray] | None:
    """The mesh with a texture for each tile, coordinates in 0..1, and the tiles' numbers (N,).

    None where the coordinates are no UDIM: all lie in 0..1, or a face reaches over its tile's
    border, or lies left of or below the first, as where one image repeats. Faces without a texture
    (-1) stay so. Where several of the mesh's textures share a tile, each gets its own, and the
    tile's number comes several times. Textures are in the order of the tiles.
    """
    if mesh.uv is None:
        return None
    count, index = len(mesh.faces), mesh.texture_index
    index = np.zeros(count, np.int32) if index is None else index
    has = (index >= 0) & np.isfinite(mesh.uv).all((1, 2))
    tile, inner = np.zeros((count, 2), np.int64), room(mesh.uv.shape, np.float64)
    for own in blocks(count):
        tile[own][has[own]] = np.floor(mesh.uv[own][has[own]].mean(1))
        inner[own] = mesh.uv[own] - tile[own, None]
        there = inner[own][has[own]]
        if ((there < -ROUNDING) | (there > 1 + ROUNDING)).any():
            return None
    if not tile.any() or tile.min() < 0 or tile[:, 0].max() >= ACROSS:
        return None
    number, textures = FIRST + tile[:, 0] + ACROSS * tile[:, 1], int(index.max()) + 1
    found, texture = np.unique((number * textures + index)[has], return_inverse=True)
    own_texture = np.full(count, -1, np.int32)
    own_texture[has] = texture
    return replace(mesh, uv=inner, texture_index=own_texture), (found // textures).astype(np.int32)
