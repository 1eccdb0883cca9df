"""Texture images of per-texel results, as people look at them."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.blocks import blocks, room, rowwise
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.geometry.gutters import fill_gutters
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.rendering.colors import scale_of, viridis
from meshlab_svbrdf.samples.luminance import to_srgb8
from meshlab_svbrdf.threads import side_by_side

from ._stages import UNOBSERVED_GREY, share

LOGARITHMIC = ("alpha", "roughness")
"""Maps whose scale of colours is so."""
TOO_BRIGHT = 0.001
"""Of the texels: that so many are clipped in the 8-bit texture is not worth a word."""


def set_texture(document: Document, name: str, texels: Texels, colors: np.ndarray) -> None:
    """maps/NAME.png of 8-bit colours (T, 3), gutters filled."""
    inside = texels.images(np.ones(len(texels), bool), False)
    images = texels.images(colors, 0)
    document.set_map(
        name, (fill_gutters(i, m) for i, m in zip(images, inside, strict=True)), kind="png"
    )


def set_diffuse_maps(document: Document, texels: Texels, diffuse: np.ndarray) -> list[str]:
    """diffuse.exr and .png, and valid.png, of D (T, 3) in 0..100; unobserved is grey in the PNG.

    What is to be said of texels brighter than a PNG shows, if any.
    """
    linear = rowwise(lambda some: (some / 100).astype(np.float32), diffuse)
    observed = np.asarray(np.isfinite(linear).all(axis=1))

    def shown() -> None:
        colors = room(linear.shape, np.uint8)
        colors[:] = UNOBSERVED_GREY
        for own in blocks(len(linear)):
            colors[own][observed[own]] = to_srgb8(linear[own][observed[own]])
        set_texture(document, "diffuse", texels, colors)
        valid = np.where(observed, np.uint8(255), np.uint8(0))
        document.set_map("valid", texels.images(valid, np.uint8(0)), kind="png")

    side_by_side(shown, lambda: document.set_map("diffuse", texels.images(linear)))
    brighter = np.asarray(linear.max(axis=1) > 1)
    if brighter.sum() <= TOO_BRIGHT * observed.sum():
        return []
    return [f"{share(brighter)} of the texels exceed 1: clipped in the PNG, not in the EXR"]


def set_scalar_map(
    document: Document,
    name: str,
    texels: Texels,
    values: np.ndarray,
    *,
    shown: str,
) -> None:
    """maps/NAME.exr of (T,), NaN where unobserved, and a coloured layer `map: SHOWN`."""
    document.set_map(name, texels.images(rowwise(lambda some: some.astype(np.float32), values)))
    known = np.isfinite(values)
    scale = scale_of(values, name in LOGARITHMIC)
    colors = room((len(values), 3), np.uint8)
    colors[:] = UNOBSERVED_GREY
    for own in blocks(len(values)):
        colors[own][known[own]] = viridis(scale.share(values[own][known[own]]))
    set_texture(document, name, texels, colors)
    document.show_map(shown, name)
