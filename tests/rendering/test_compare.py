"""What a rendering lacks of a frame, in figures whose values are known."""

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from meshlab_svbrdf.rendering.compare import (
    CLIPPED,
    channel_gain,
    psnr,
    similarity,
)


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 1, (40, 50, 3))


def test_an_image_is_like_itself(image):
    on = np.zeros((40, 50), bool)
    on[10:30, 5:45] = True
    assert psnr(image, image) == np.inf
    assert similarity(image, image, on) == 1


def test_decibels_of_an_even_error(image):
    for error in (0.1, 0.01):
        assert psnr(image + error, image) == pytest.approx(-20 * np.log10(error))


def test_similarity_is_that_of_the_library_and_knows_no_surroundings(image):
    rng = np.random.default_rng(1)
    other = np.clip(image + 0.1 * rng.standard_normal(image.shape), 0, 1)
    everywhere = np.ones((40, 50), bool)
    _, values = structural_similarity(other, image, channel_axis=2, data_range=1.0, full=True)
    assert similarity(other, image, everywhere) == pytest.approx(values.mean(), abs=1e-12)
    on = np.zeros((40, 50), bool)
    on[12:30, 8:40] = True
    noise = np.where(on[..., None], other, rng.uniform(0, 1, image.shape))
    assert similarity(noise, image, on) == similarity(other, image, on) < 1
    corner = np.zeros((40, 50), bool)
    corner[:2, -2:] = True
    assert similarity(other, image, corner) < 1
    assert np.isnan(similarity(other, image, ~everywhere))
    assert np.isnan(similarity(other[:5], image[:5], everywhere[:5]))


def test_gains_are_found_from_what_is_not_clipped():
    rng = np.random.default_rng(1)
    rendered = rng.uniform(0.05, 0.5, (1000, 3))
    gain = np.array([1.5, 0.7, 1.1])
    truth = rendered * gain
    truth[:50] = CLIPPED + 0.01
    np.testing.assert_allclose(channel_gain(rendered, truth), gain, rtol=1e-12)
    np.testing.assert_array_equal(channel_gain(rendered * 0, truth), 1)
