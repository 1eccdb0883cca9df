"""Images for other programs: they decode back to the maps, within what 8 bits tell."""

from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf.exporting.gloss import HALF_VECTOR, ggx_of_phong
from meshlab_svbrdf.exporting.maps import (
    DIELECTRIC,
    LEVEL,
    gltf_maps,
    made_of,
    pbr_maps,
    phong_maps,
)
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode

GREY, HALF = 118, 0.5 / 255
SIZE = 24


@pytest.fixture
def look() -> Appearance:
    rng = np.random.default_rng(4)
    known = np.zeros((SIZE, SIZE), bool)
    known[2:-2, 3:-3] = True
    material = np.arange(SIZE * SIZE).reshape(SIZE, SIZE) % 3
    rho_s = np.where(known, np.array([0.1, 0.7, np.nan])[material], np.nan)
    alpha = np.where(known, np.array([12.0, 90.0, np.nan])[material], np.nan)
    color = rng.uniform(0, 1, (SIZE, SIZE, 3))
    color[5, 5] = np.nan  # within the charts
    color[~known] = np.nan
    tint = np.array([[1, 1, 1], [1.6, 0.9, 0.3], [1, 1, 1]])[material]
    return Appearance(color, rho_s, alpha, tint, inside=known)


def srgb_near(codes, linear):
    """Within half a code of sRGB."""
    low, high = (decode(np.clip(codes / 255 + side, 0, 1)) for side in (-HALF, HALF))
    return (low - 1e-9 <= linear) & (linear <= high + 1e-9)


def test_gltf_shows_albedo_and_highlight(look):
    """base (1 − F) is the albedo, and F is the lobe's, as a viewer reads the images."""
    made = made_of(look)
    maps = gltf_maps(made, GREY)
    ggx = ggx_of_phong(look.rho_s, look.alpha)
    glossy = np.isfinite(look.rho_s)

    grazing = maps.specular_factor * maps.specular[..., 3] / 255
    share = DIELECTRIC * maps.color_factor * decode(maps.specular[..., :3] / 255)
    facing = np.minimum(share, 1) * grazing[..., None]
    expected = ggx.facing[..., None] * look.tint
    np.testing.assert_allclose(
        facing[glossy], expected[glossy], atol=HALF * maps.specular_factor + 4e-4
    )
    assert (grazing[look.inside & ~glossy] == 0).all()

    roughness = (maps.rough_factor * maps.rough[..., 1] / 255)[glossy]
    np.testing.assert_allclose(
        roughness, np.sqrt(ggx.roughness[glossy]), atol=HALF * maps.rough_factor
    )
    assert (maps.rough[..., 2] == 0).all()  # no metal

    top = np.nan_to_num(expected.max(-1))[..., None]
    known = np.isfinite(look.diffuse).all(-1)
    base = look.diffuse / (1 - top)
    near = srgb_near(maps.base, np.minimum(base, 1))
    assert near[known].all()
    assert (maps.base[5, 5] == GREY).all()


def test_a_lobe_without_colour_is_the_same_at_all_angles(look):
    """F at normal and at grazing incidence agree: glTF's Fresnel is a constant."""
    maps = gltf_maps(made_of(replace(look, tint=np.ones_like(look.tint))), GREY)
    assert maps.color_factor == pytest.approx(1 / DIELECTRIC)
    assert (maps.specular[..., :3] == 255).all()


def test_each_quantity_has_its_image(look):
    made = made_of(look)
    images = pbr_maps(made, GREY)
    known, glossy = np.isfinite(look.diffuse).all(-1), np.isfinite(look.rho_s)
    assert srgb_near(images["BaseColor"], np.nan_to_num(look.diffuse))[known].all()
    ggx = ggx_of_phong(look.rho_s, look.alpha)
    np.testing.assert_allclose(
        images["Roughness"][glossy] / 255, np.sqrt(ggx.roughness[glossy]), atol=HALF
    )
    np.testing.assert_allclose(
        images["Specular"][glossy] / 255, ggx.facing[glossy] / LEVEL, atol=HALF
    )
    assert (images["Specular"][look.inside & ~glossy] == 0).all()
    observed = images["Observed"] == 255
    np.testing.assert_array_equal(observed[..., 0], known)
    np.testing.assert_array_equal(observed[..., 1], glossy)
    assert "SpecularTint" in images
    assert "SpecularTint" not in pbr_maps(
        made_of(replace(look, tint=np.ones_like(look.tint))), GREY
    )


def test_mtl_has_the_lobes_themselves(look):
    maps = phong_maps(replace(look, rho_s=4 * look.rho_s))
    glossy = np.isfinite(look.rho_s)
    ks = maps.ks_factor * maps.ks[glossy] / 255
    np.testing.assert_allclose(
        ks, 4 * look.rho_s[glossy, None] * look.tint[glossy], atol=HALF * maps.ks_factor
    )
    ns = maps.ns_factor * maps.ns[glossy] / 255
    np.testing.assert_allclose(ns, HALF_VECTOR * look.alpha[glossy], atol=HALF * maps.ns_factor)
    assert phong_maps(look).ks_factor > 1  # a lobe's top may outshine white
    assert phong_maps(look, 0.1).ks_factor == 1


def test_scale_is_of_colour_and_gloss_alike(look):
    plain, half = made_of(look), made_of(look, 0.5)
    np.testing.assert_allclose(half.color, plain.color / 2)
    np.testing.assert_allclose(half.ggx.facing, plain.ggx.facing / 2)
    np.testing.assert_array_equal(half.ggx.roughness, plain.ggx.roughness)


def test_unobserved_colour_is_a_neighbours_where_that_is_asked_for(look):
    filled = made_of(look, fill=True)
    assert np.isfinite(filled.color).all()
    near = look.diffuse.astype(np.float32)
    around = {tuple(near[r, c]) for r in (4, 5, 6) for c in (4, 5, 6)}
    assert tuple(filled.color[5, 5]) in around
    assert not filled.known[5, 5]


def test_nothing_known_is_grey_without_gloss():
    nothing = np.full((4, 4), np.nan)
    look = Appearance(np.full((4, 4, 3), np.nan), nothing, nothing, np.ones((4, 4, 3)))
    made = made_of(look, fill=True)
    maps, phong = gltf_maps(made, GREY), phong_maps(look)
    assert (maps.base == GREY).all()
    assert (maps.specular[..., 3] == 0).all()
    assert (phong.ks == 0).all()
    assert (pbr_maps(made, GREY)["Observed"] == 0).all()
