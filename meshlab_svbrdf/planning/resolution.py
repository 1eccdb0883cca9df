"""Texels against pixels: texels much finer than the frames' pixels cost time and tell nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..blocks import places, rowwise, taken
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh

NEAREST = 0.1
"""The quantile of the frames whose pixels texels are measured by: close-ups show more."""
ENOUGH = 0.9
"""Pixels that a texel is wide, with which nothing is lost that texels hold."""
LEAST_WIDTH = 640
"""Of reduced frames, in pixels: silhouettes and creases cost a few pixels whatever their size."""
FILLED = 0.6
"""The share of a texture that charts fill, where there are none yet."""


@dataclass(frozen=True)
class Resolution:
    """How fine the frames are on the object.

    pixel : a pixel's size on the surface seen head-on, world units; of the nearest tenth of frames
    exact : side of the textures, in texels, at which a texel is as large as that
    charts : the charts' area, in textures: texels = charts · side²
    width : pixels of the narrowest frame
    """

    pixel: float
    exact: float
    charts: float
    width: int

    @property
    def side(self) -> int:
        """The least power of two, 16 to 16384, whose texels are not larger than a pixel."""
        return int(np.clip(2 ** np.ceil(np.log2(max(self.exact, 1.0)) - 1e-9), 16, 16384))

    def pixels_per_texel(self, side: int) -> float:
        """How many pixels a texel is wide, at a texture of that side."""
        return self.exact / side

    def reduction(self, side: int) -> int:
        """By how much frames may be reduced, 1, 2 or 4: texels keep `ENOUGH` pixels, frames
        `LEAST_WIDTH`."""
        most = min(self.pixels_per_texel(side) / ENOUGH, self.width / LEAST_WIDTH)
        return next(k for k in (4, 2, 1) if k == 1 or k <= most)


def resolution(mesh: Mesh, cameras: Sequence[Camera]) -> Resolution:
    """How fine the frames are on the object, by geometry alone.

    The object is taken to be as far from a camera as its centre. Areas stand for lengths: charts
    that are stretched, or of different scale, count by their mean.
    """
    middle = mesh.center
    distances = [np.linalg.norm(c.center - middle) / max(c.fx, c.fy) for c in cameras]
    pixel = float(np.quantile(distances, NEAREST))
    surface = rowwise(lambda own: _area_in_space(mesh.vertices[own]), mesh.faces).sum()
    charts = FILLED
    if mesh.uv is not None:
        areas = rowwise(_area_in_texture, mesh.uv)
        charts = float(taken(areas, places(np.isfinite(areas))).sum()) or FILLED
    width = min(camera.width for camera in cameras)
    return Resolution(pixel, float(np.sqrt(surface / charts)) / pixel, charts, width)


def _area_in_space(corners: np.ndarray) -> np.ndarray:
    """The areas of faces (F, 3, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.linalg.norm(across, axis=1) / 2


def _area_in_texture(uv: np.ndarray) -> np.ndarray:
    """The areas of faces (F, 3, 2)."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
