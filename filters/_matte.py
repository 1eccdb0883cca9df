"""Colours on the object as they are, without light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode


def matte(mesh: Mesh, images: Sequence[np.ndarray]) -> AcquisitionRenderer:
    """Renders images (H, W, 3), one per texture, linear float or sRGB uint8, as they are."""
    looks = []
    for image in images:
        linear = decode(image / 255) if image.dtype == np.uint8 else image
        none = np.full(image.shape[:2], np.nan)
        looks.append(Appearance(linear, none, none, np.ones_like(linear)))
    return AcquisitionRenderer(mesh, looks, [])


def matte_texels(document: Document, color: np.ndarray) -> AcquisitionRenderer:
    """The same of the texels' linear colours (T, 3), NaN where unobserved."""
    return matte(document.mesh(), document.texels().to_images(color.astype(np.float32)))
