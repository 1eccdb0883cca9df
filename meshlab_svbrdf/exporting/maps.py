"""Texture images of 8 bits as other programs read them, of what the object is made of.

Made        what a texture's texels are made of, as numbers
gltf_maps   glTF 2.0: base colour, roughness, KHR_materials_specular
pbr_maps    one image per quantity, for Blender, Substance, Unreal
phong_maps  OBJ's MTL: Kd, Ks, Ns

Colours are sRGB, all else is linear. Gutters take their nearest neighbours' values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.gutters import fill_gutters
from ..rendering.surface import Appearance
from ..samples.luminance import to_srgb8
from .gloss import HALF_VECTOR, Ggx, ggx_of

DIELECTRIC = 0.04
"""Share that glTF's default index of refraction, 1.5, mirrors at normal incidence."""
LEVEL = 0.08
"""Share that a "specular level" of 1 means in Blender, Substance and Unreal."""
ROUGH = 1.0
"""Where there is no gloss at all."""
BLACKEST = 0.05
"""Least share of light that is left to the diffuse layer under a mirroring one."""


class Made(NamedTuple):
    """color : (H, W, 3) float32 linear, may exceed 1, NaN where unobserved and not filled
    ggx : (H, W) each; 0 where there is no gloss; tint : (H, W, 3) of the highlight, luminance 1
    inside : (H, W) the charts; known, glossy : (H, W) where colour, and gloss, were observed
    """

    color: np.ndarray
    ggx: Ggx
    tint: np.ndarray
    inside: np.ndarray
    known: np.ndarray
    glossy: np.ndarray


class GltfMaps(NamedTuple):
    """base : (H, W, 3) uint8; rough : (H, W, 3) uint8, green counts, times rough_factor
    specular : (H, W, 4) uint8, alpha times specular_factor is the mirrored share at grazing
        incidence; color times color_factor times 0.04 the part of it at normal incidence
    """

    base: np.ndarray
    rough: np.ndarray
    rough_factor: float
    specular: np.ndarray
    specular_factor: float
    color_factor: float


class PhongMaps(NamedTuple):
    """ks : (H, W, 3) uint8 linear, times ks_factor; ns : (H, W) uint8, times ns_factor"""

    ks: np.ndarray
    ks_factor: float
    ns: np.ndarray
    ns_factor: float


def made_of(look: Appearance, scale: float = 1.0, fill: bool = False) -> Made:
    """The quantities of one texture, brightness times `scale`.

    fill : give unobserved texels their nearest neighbour's colour
    """
    inside = np.ones(look.rho_s.shape, bool) if look.inside is None else look.inside
    known = inside & np.isfinite(look.diffuse).all(-1)
    color = np.where(known[..., None], look.diffuse * scale, np.nan).astype(np.float32)
    facing, grazing, roughness = (each.astype(np.float32) for each in ggx_of(look))
    return Made(
        fill_gutters(color, known) if fill else color,
        Ggx(facing * np.float32(scale), grazing * np.float32(scale), roughness),
        look.tint.astype(np.float32),
        inside,
        known,
        inside & np.isfinite(look.rho_s),
    )


def gltf_maps(made: Made, grey: int) -> GltfMaps:
    """Images and factors of a glTF material; unobserved colour is `grey`, an sRGB code.

    glTF takes from the diffuse layer what the specular one mirrors: the base colour is the albedo
    over 1 − F, with F at normal incidence. A lobe without Fresnel is F at all angles: then what
    glTF shows is albedo and highlight, exactly.
    """
    facing = np.minimum(made.ggx.facing[..., None] * made.tint, 1)
    top = facing.max(-1)
    grazing = np.minimum(np.maximum(made.ggx.grazing, top), 1)
    share, mirrors = np.ones_like(facing), top > 0
    share[mirrors] = facing[mirrors] / grazing[mirrors][:, None]
    base = made.color / np.maximum(1 - top, BLACKEST)[..., None]
    perceptual, rough_factor = _perceptual(made)
    specular, specular_factor = _ratio(grazing)
    largest = float(share[mirrors].max(initial=0)) or 1.0
    share[~mirrors] = largest
    white = bool((share == largest).all())
    tint = np.full_like(facing, 255, np.uint8) if white else to_srgb8(share / largest)
    base, perceptual, tint, specular = _finished(
        made.inside, _colors(base, grey), perceptual, tint, specular
    )
    return GltfMaps(
        base,
        np.dstack([np.full_like(perceptual, 255), perceptual, np.zeros_like(perceptual)]),
        rough_factor,
        np.dstack([tint, specular]),
        specular_factor,
        largest / DIELECTRIC,
    )


def pbr_maps(made: Made, grey: int) -> dict[str, np.ndarray]:
    """Images by their usual names. Observed: red 255 where the colour is, green where the gloss."""
    perceptual = np.sqrt(np.nan_to_num(made.ggx.roughness, nan=ROUGH))
    color, rough, specular = _finished(
        made.inside, _colors(made.color, grey), _codes(perceptual), _codes(made.ggx.facing / LEVEL)
    )
    nothing = np.zeros_like(made.known)
    images = {
        "BaseColor": color,
        "Roughness": rough,
        "Specular": specular,
        "Observed": _codes(np.dstack([made.known, made.glossy, nothing])),
    }
    if (made.tint[made.glossy] != 1).any():
        tint = to_srgb8(made.tint / made.tint.max(-1, keepdims=True))
        (images["SpecularTint"],) = _finished(made.inside, tint)
    return images


def phong_maps(look: Appearance, scale: float = 1.0) -> PhongMaps:
    """Ks and Ns of the lobes, as the MTL format means them: Ks (n·h)^Ns."""
    inside = np.ones(look.rho_s.shape, bool) if look.inside is None else look.inside
    strength = np.nan_to_num(look.rho_s)[..., None] * look.tint * scale
    ks, ks_factor = _ratio(strength, least=1.0)
    ns, ns_factor = _ratio(HALF_VECTOR * np.nan_to_num(look.alpha))
    ks, ns = _finished(inside, ks, ns)
    return PhongMaps(ks, ks_factor, ns, ns_factor)


def _perceptual(made: Made) -> tuple[np.ndarray, float]:
    """√a, of which the largest is 255; without gloss it does not matter."""
    root = np.sqrt(made.ggx.roughness)
    largest = float(np.nanmax(root, initial=0.0)) or ROUGH
    return _ratio(np.nan_to_num(root, nan=largest))


def _ratio(values: np.ndarray, least: float = 0.0) -> tuple[np.ndarray, float]:
    """Codes of values over their largest, and that one; 1 where all are 0."""
    largest = max(float(values.max(initial=0)), least) or 1.0
    return _codes(values / largest), largest


def _codes(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def _colors(linear: np.ndarray, grey: int) -> np.ndarray:
    known = np.isfinite(linear).all(-1, keepdims=True)
    return np.where(known, to_srgb8(linear), np.uint8(grey))


def _finished(inside: np.ndarray, *images: np.ndarray) -> list[np.ndarray]:
    """The images with their gutters filled, all at once."""
    filled = fill_gutters(np.dstack(images), inside)
    ends = np.cumsum([1 if image.ndim == 2 else image.shape[2] for image in images])
    parts = np.split(filled, ends[:-1], axis=2)
    return [
        np.ascontiguousarray(part[..., 0] if image.ndim == 2 else part)
        for part, image in zip(parts, images, strict=True)
    ]
