"""How near renderings come to views that no frame has: PSNR and SSIM, highlights apart."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from skimage.color import deltaE_ciede2000, rgb2lab
from skimage.metrics import structural_similarity

from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance

_FIVE = np.ones((5, 5), np.uint8)


def unseen_views(rendered: Path, truth: Path) -> dict[str, Any]:
    """PSNR and SSIM in sRGB, and mean CIEDE2000, over the object's pixels.

    rendered : folder of PNG files under the views' names; truth : ground_truth.
    psnr_highlights, ssim_highlights : over the brightest tenth
    psnr_inner : away from silhouettes and from the borders of materials, which are sharper than
        the frames' pixels
    """
    everywhere, highlights, inner, similar, similar_highlights = [], [], [], [], []
    differences = []
    project = read_project(truth / "views" / "project.mlp")
    for raster, inside in zip(project.rasters, _inner(truth), strict=True):
        expected, got = (
            read_image(p)[..., :3].astype(np.float64)
            for p in (raster.path, rendered / raster.path.name)
        )
        on = (np.abs(expected - expected[0, 0]).max(-1) > 2).astype(np.uint8)
        whole = cv2.morphologyEx(on, cv2.MORPH_CLOSE, _FIVE)
        on = cv2.erode(whole, _FIVE) > 0
        got = np.where(whole[..., None] > 0, got, expected)  # what is around does not count
        square, bright = ((expected - got) ** 2).mean(-1), expected.mean(-1)[on]
        everywhere.append(_psnr(square[on]))
        labs = (rgb2lab(image[on] / 255) for image in (expected, got))
        differences.append(deltaE_ciede2000(*labs).mean())
        high = bright >= np.quantile(bright, 0.9)
        highlights.append(_psnr(square[on][high]))
        inner.append(_psnr(square[on & inside]))
        _, map_ = structural_similarity(expected, got, channel_axis=2, data_range=255, full=True)
        similar.append(map_.mean(-1)[on].mean())
        similar_highlights.append(map_.mean(-1)[on][high].mean())
    return {
        "psnr": float(np.mean(everywhere)),
        "psnr_worst": float(min(everywhere)),
        "dE_views": float(np.mean(differences)),
        "psnr_highlights": float(np.mean(highlights)),
        "psnr_inner": float(np.mean(inner)),
        "ssim": float(np.mean(similar)),
        "ssim_highlights": float(np.mean(similar_highlights)),
    }


@lru_cache(maxsize=2)
def _inner(truth: Path) -> list[np.ndarray]:
    """Of each view, the pixels away from silhouettes and from borders of materials, (H, W) bool."""
    project = read_project(truth / "views" / "project.mlp")
    renderer = _border_renderer(read_mesh(project.meshes[0].path).mesh, truth)
    found = []
    for raster in project.rasters:
        border, coverage = renderer.render(raster.camera, 1)
        inside = (coverage > 0) & (border[..., 0] == 0)
        found.append(cv2.erode(inside.astype(np.uint8), _FIVE) > 0)
    return found


def _border_renderer(mesh: Mesh, truth: Path) -> AcquisitionRenderer:
    """Shows white where a material borders on another, black elsewhere."""
    ids = read_image(truth / "material_id.png")
    border = cv2.morphologyEx(ids, cv2.MORPH_GRADIENT, _FIVE) > 0
    white = np.repeat(border[..., None], 3, -1).astype(float)
    matte = np.full(ids.shape, np.nan)
    return AcquisitionRenderer(mesh, [Appearance(white, matte, matte, white)], [])


def _psnr(square: np.ndarray) -> float:
    return 10 * math.log10(255**2 / max(float(square.mean()), 1e-9))
