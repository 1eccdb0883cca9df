"""Gutters: what is outside the charts takes the colour of what is nearest inside."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from meshlab_svbrdf.geometry.gutters import fill_gutters
from meshlab_svbrdf.geometry.texels import rasterise_texels
from sample_projects.procedural.shape import totem


def islands(seed: int, size: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Some islands and an image of noise."""
    rng = np.random.default_rng(seed)
    inside = cv2.GaussianBlur(rng.random((size, size)), (0, 0), 4) > 0.52
    return rng.integers(0, 255, (size, size, 3), np.uint8), inside


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_inside_nothing_changes_and_types_stay(dtype, channels):
    _, inside = islands(0)
    image = np.random.default_rng(1).random((64, 64, *channels)) * 200
    image = image.astype(dtype)
    filled = fill_gutters(image, inside)
    assert filled.dtype == dtype
    assert filled.shape == image.shape
    np.testing.assert_array_equal(filled[inside], image[inside])


@given(st.integers(0, 1000))
def test_every_pixel_outside_takes_the_nearest_one_inside(seed):
    """Within the 5×5 distance transform's error, measured 4 %."""
    _, inside = islands(seed)
    if not inside.any():
        return
    row, col = np.mgrid[:64, :64]
    places = np.stack([row, col], -1).astype(np.float64)
    taken = fill_gutters(places, inside)
    assert inside[tuple(taken.astype(int).reshape(-1, 2).T)].all()
    distance = np.linalg.norm(taken - places, axis=-1)
    nearest = distance_transform_edt(~inside)
    assert (distance <= 1.05 * nearest + 1e-9).all()


def test_without_inside_or_outside_it_is_a_copy():
    image, _ = islands(0)
    for inside in (np.zeros((64, 64), bool), np.ones((64, 64), bool)):
        filled = fill_gutters(image, inside)
        np.testing.assert_array_equal(filled, image)
        assert filled is not image


def test_not_a_number_outside_is_overwritten():
    _, inside = islands(0)
    image = np.where(inside, np.float32(0.5), np.float32(np.nan))
    assert (fill_gutters(image, inside) == 0.5).all()


def test_no_seam_shows_at_lower_mip_levels():
    """Charts of one colour stay of that colour however often the texture is halved."""
    mesh, _, _ = totem(48, gutter=3 / 128)
    texels = rasterise_texels(mesh, ((128, 128),))
    color = np.array([40, 90, 200], np.uint8)
    (image,) = texels.to_images(np.tile(color, (len(texels), 1)), 0)
    (inside,) = texels.to_images(np.ones(len(texels), bool), False)
    filled = fill_gutters(image, inside)
    while len(filled) > 1:
        assert (filled == color).all()
        filled = cv2.resize(filled, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        image = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    assert (image != color).any()  # as it would be with black around
