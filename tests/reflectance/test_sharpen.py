"""D as sharp as the surface: footprints against geometry, blur undone exactly, noise left alone."""

import numpy as np
import pytest
from analytic import free_texels, look_at, observations_of, plane, rotation, unit

from meshlab_svbrdf.geometry.tangents import tangents
from meshlab_svbrdf.geometry.texels import Texels, rasterise_texels
from meshlab_svbrdf.reflectance import sharpen as module
from meshlab_svbrdf.reflectance.footprint import SPREAD, footprints
from meshlab_svbrdf.reflectance.sharpen import Blur, sharpen
from meshlab_svbrdf.samples.luminance import to_srgb8

FOCAL = 150.0


def seen_from(tmp_path, eyes, codes=None, texels=None):
    """Observations of texels (one at the origin, facing +z) from cameras that look at it."""
    texels = free_texels([[0, 0, 0]], [[0, 0, 1]]) if texels is None else texels
    cameras = [look_at(eye, up=(0.3, 1, 0.1), fx=FOCAL) for eye in eyes]
    shape = (len(texels), len(cameras))
    codes = np.full((*shape, 3), 100) if codes is None else codes
    return observations_of(tmp_path, codes, np.full(shape, 127), texels, cameras)


def in_space(covariance, normal) -> np.ndarray:
    """The (3, 3) matrix that (aa, ab, bb) means in the texel's tangents."""
    basis = np.array(tangents(*np.asarray(normal, float))).reshape(2, 3)
    aa, ab, bb = covariance
    return basis.T @ np.array([[aa, ab], [ab, bb]]) @ basis


# Footprints


def test_a_pixel_straight_above_is_a_square(tmp_path):
    covariance = footprints(seen_from(tmp_path, [[0, 0, 3]])).covariance
    np.testing.assert_allclose(covariance[0], (3 / FOCAL) ** 2 * np.array([1, 0, 1]), rtol=1e-5)


def test_a_tilted_pixel_is_as_long_as_its_cosine_says(tmp_path):
    """60°: twice as long towards the camera's side, as wide as ever across."""
    eye = 2 * np.array([np.sin(np.pi / 3), 0, 0.5])
    covariance = footprints(seen_from(tmp_path, [eye])).covariance
    found = in_space(covariance[0], [0, 0, 1])
    np.testing.assert_allclose(found, (2 / FOCAL) ** 2 * np.diag([4, 1, 0]), atol=1e-9)


def test_footprints_turn_with_the_world(tmp_path):
    turn = rotation(np.random.default_rng(3))
    eyes = np.array([[0.5, 1, 3], [-2, 0.3, 1], [0, -1, 2]])
    here = footprints(seen_from(tmp_path / "a", eyes)).covariance
    normal = turn @ [0, 0, 1]
    texels = free_texels([[0, 0, 0]], [normal])
    there = footprints(seen_from(tmp_path / "b", eyes @ turn.T, texels=texels)).covariance
    expected = turn @ in_space(here[0], [0, 0, 1]) @ turn.T
    np.testing.assert_allclose(in_space(there[0], normal), expected, rtol=1e-4, atol=1e-9)


def test_noise_is_the_standard_error_of_the_mean(tmp_path):
    rng = np.random.default_rng(0)
    luminance = 30 + 4 * rng.standard_normal((400, 400))
    codes = np.repeat(to_srgb8(luminance / 100)[..., None], 3, -1)
    texels = free_texels(np.zeros((400, 3)), np.tile([0, 0, 1.0], (400, 1)))
    noise = footprints(seen_from(tmp_path, np.tile([[0, 0, 3.0]], (400, 1)), codes, texels)).noise
    assert np.median(noise) == pytest.approx(4 / np.sqrt(400), rel=0.03)


def test_texels_without_samples_have_no_footprint(tmp_path):
    texels = free_texels([[0, 0, 0]] * 2, [[0, 0, 1]] * 2)
    quality = np.array([[127], [0]])
    o = observations_of(
        tmp_path, np.full((2, 1, 3), 100), quality, texels, [look_at([0, 0, 3], fx=FOCAL)]
    )
    found = footprints(o)
    covariance, noise = found.covariance, found.noise
    assert covariance[0, 0] > 0
    assert not covariance[1].any()
    assert not noise.any()  # one sample tells no noise


# Sharpening


def board(size: int = 48) -> Texels:
    return rasterise_texels(plane(), ((size, size),))


def footprint_of(texels: Texels, pixels: float) -> np.ndarray:
    """Round footprints, `pixels` texels of the board wide."""
    side = pixels * 2 / texels.sizes[0][0]
    return np.tile(np.float32([side**2, 0, side**2]), (len(texels), 1))


def checks(texels: Texels, cell: int = 7) -> np.ndarray:
    dark = ((texels.row // cell + texels.col // cell) % 2).astype(np.float32)
    return dark[:, None] * np.float32([40, 25, 10]) + np.float32([10, 20, 30])


QUIET = 1e-9


def kernel_of(texels, covariance):
    return Blur(texels, covariance).rows(slice(0, len(texels)))


def test_kernel_is_the_gaussian_of_pixel_and_interpolation():
    """Its variance on the surface is 1/4 of a pixel's side squared (5 % less: it is cut at three
    standard deviations), its rows sum to 1."""
    texels = board()
    kernel = kernel_of(texels, footprint_of(texels, 2.0))
    np.testing.assert_allclose(kernel.sum(1), 1, rtol=1e-6)
    middle = np.flatnonzero((texels.row == 24) & (texels.col == 24))[0]
    row = kernel[[middle]].toarray()[0]
    variance = row @ (texels.col - 24.0) ** 2
    assert variance == pytest.approx(0.95 * SPREAD * 4, rel=0.02)


def test_blur_is_undone():
    texels = board()
    covariance, sharp = footprint_of(texels, 1.5), checks(texels)
    blurred = (kernel_of(texels, covariance) @ sharp).astype(np.float32)
    found = sharpen(texels, blurred, covariance, np.full(len(texels), QUIET))
    before, after = np.abs(blurred - sharp), np.abs(found - sharp)
    assert after.mean() < 0.27 * before.mean()
    assert after.max() < 0.55 * before.max()


def test_rows_that_are_not_held_are_made_anew_to_the_bit(monkeypatch):
    texels = board()
    given = texels, checks(texels), footprint_of(texels, 1.5), np.full(len(texels), 0.3)
    whole = sharpen(*given)
    monkeypatch.setattr(module, "PIECE", 500)
    monkeypatch.setattr(module, "HELD", 20_000)  # of some pieces, not of all
    np.testing.assert_array_equal(sharpen(*given), whole)


def test_what_is_even_stays_to_the_bit_of_its_rounding():
    texels = board()
    even = np.full((len(texels), 3), 37.0, np.float32)
    found = sharpen(texels, even, footprint_of(texels, 1.5), np.zeros(len(texels)))
    np.testing.assert_allclose(found, even, rtol=1e-5)


def test_noise_is_not_amplified():
    """Noise alone grows little; without its standard error it would more than double."""
    texels = board()
    noise = np.random.default_rng(1).standard_normal((len(texels), 3)).astype(np.float32)
    blurred = 40 + 0.5 * noise
    covariance = footprint_of(texels, 1.5)
    kept = sharpen(texels, blurred, covariance, np.full(len(texels), 0.5))
    bare = sharpen(texels, blurred, covariance, np.zeros(len(texels)))
    assert kept.std() < 1.25 * blurred.std()
    assert bare.std() > 2 * blurred.std()


def test_a_footprint_below_a_texel_changes_nothing():
    texels = board()
    found = sharpen(texels, checks(texels), footprint_of(texels, 0.3), np.zeros(len(texels)))
    np.testing.assert_allclose(found, checks(texels), atol=1e-3)


def test_what_is_unobserved_stays_so_and_out_of_its_neighbours():
    texels = board()
    covariance, colors = footprint_of(texels, 1.5), np.full((len(texels), 3), 20, np.float32)
    hole = (texels.row > 20) & (texels.row < 30) & (texels.col > 20) & (texels.col < 30)
    colors[hole] = np.nan
    found = sharpen(texels, colors, covariance, np.zeros(len(texels)))
    assert np.isnan(found[hole]).all()
    np.testing.assert_allclose(found[~hole], 20, rtol=1e-5)


def test_colours_never_fall_below_black():
    texels = board()
    covariance = footprint_of(texels, 2.5)
    colors = checks(texels) * np.float32([1, 1, 0])
    assert (sharpen(texels, colors, covariance, np.zeros(len(texels))) >= 0).all()


def test_charts_that_touch_in_the_texture_only_do_not_mix():
    """Two halves of the texture lie far apart in space; one is white, one black."""
    texels = board()
    position = texels.position.copy()
    position[texels.col >= 24, 2] += 10
    apart = Texels(**{**vars(texels), "position": position})
    kernel = kernel_of(apart, footprint_of(texels, 2.0))
    left = texels.col < 24
    assert not kernel[left][:, ~left].nnz


def test_textures_do_not_mix():
    texels = board()
    twice = Texels(
        *(
            np.concatenate([getattr(texels, name)] * 2)
            for name in ("position", "normal", "face", "barycentric")
        ),
        np.repeat(np.uint8([0, 1]), len(texels)),
        np.tile(texels.row, 2), np.tile(texels.col, 2), texels.center, texels.radius,
        texels.sizes * 2,
    )  # fmt: skip
    kernel = kernel_of(twice, np.tile(footprint_of(texels, 2.0), (2, 1)))
    once = kernel_of(texels, footprint_of(texels, 2.0))
    n = len(texels)
    assert not kernel[:n, n:].nnz
    assert (kernel[n:, n:] != once).nnz == 0


def test_order_of_texels_does_not_matter():
    texels = board(24)
    order = np.random.default_rng(5).permutation(len(texels))
    names = ("position", "normal", "face", "barycentric", "texture", "row", "col")
    shuffled = Texels(
        *(getattr(texels, name)[order] for name in names), texels.center, texels.radius,
        texels.sizes,
    )  # fmt: skip
    covariance, noise = footprint_of(texels, 1.5), np.full(len(texels), 0.01)
    here = sharpen(texels, checks(texels), covariance, noise)
    there = sharpen(shuffled, checks(texels)[order], covariance, noise)
    np.testing.assert_allclose(there, here[order], rtol=1e-4, atol=1e-4)


def test_tangents_are_orthonormal_everywhere():
    for normal in unit(np.random.default_rng(2).normal(size=(200, 3))):
        a, b = np.array(tangents(*normal)).reshape(2, 3)
        np.testing.assert_allclose(
            np.array([a, b, normal]) @ np.array([a, b, normal]).T, np.eye(3), atol=1e-12
        )
