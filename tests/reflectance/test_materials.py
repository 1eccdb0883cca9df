"""Automatic materials: exact where the truth is analytic, the same however the texels come."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from skimage.color import rgb2lab

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.reflectance.labels import from_image, palette
from meshlab_svbrdf.reflectance.materials import color_space, segment, segment_surface

TERRACOTTA, SLATE, IVORY = np.array([45.0, 22, 14]), np.array([9.0, 12, 20]), np.array([80, 72, 55])


def sphere(count):
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    phi = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], 1).astype(np.float32)


@pytest.fixture(scope="module")
def globe():
    position = sphere(6000)
    return position, neighbours(position, position)


def two_colors(position):
    return np.where(position[:, 2:] > 0.3, TERRACOTTA, SLATE)


def irradiance(normal, seed=0):
    """Three lamps and a little ambient light: eightfold and more from lit side to shadow."""
    lamps = Rotation.random(3, random_state=seed).apply([0.0, 0, 1])
    return (np.maximum(normal @ lamps.T, 0) * [1.0, 0.6, 0.4]).sum(1) + 0.08


def same_partition(a, b):
    pairs = np.unique(np.stack([a, b]), axis=1)
    return pairs.shape[1] == len(np.unique(a)) == len(np.unique(b))


def agreement(labels, truth):
    """Share of the labelled texels whose label's commonest truth is theirs."""
    table = np.zeros((labels.max() + 1, truth.max() + 1))
    np.add.at(table, (labels, truth), 1)
    return table.max(1).sum() / len(labels)


def test_two_colors_are_split_exactly(globe):
    position, adjacency = globe
    labels = segment(two_colors(position), adjacency)
    assert np.array_equal(labels, position[:, 2] > 0.3)
    assert labels.dtype == np.int32


def test_shading_and_noise_do_not_move_the_border(globe):
    position, adjacency = globe
    rng = np.random.default_rng(5)
    shaded = two_colors(position) * irradiance(position)[:, None]
    noisy = shaded * rng.normal(1, 0.03, shaded.shape) + rng.normal(0, 0.1, shaded.shape)
    labels = segment(noisy, adjacency)
    truth = (position[:, 2] > 0.3).astype(int)
    assert labels.min() == 0
    assert labels.max() < 4
    assert agreement(labels, truth) > 0.98


@pytest.mark.parametrize("base", [TERRACOTTA, SLATE, IVORY, np.array([12.0, 8, 4]), np.full(3, 40)])
def test_one_shaded_material_is_not_shattered(globe, base):
    position, adjacency = globe
    rng = np.random.default_rng(6)
    diffuse = base * irradiance(position, seed=2)[:, None] * rng.normal(1, 0.04, (6000, 3))
    labels = segment(diffuse, adjacency)
    assert np.bincount(labels)[0] > 0.9 * len(labels)
    assert labels.max() <= 1


def test_stains_remain_part_of_one_material(globe):
    position, adjacency = globe
    stain = 0.5 + 0.5 * np.sin(9 * position[:, :1]) * np.sin(8 * position[:, 1:2])
    bronze = np.array([12.0, 8, 4]) * (1 - 0.35 * stain) + np.array([0, 0, 1.0]) * stain
    assert segment(bronze, adjacency).max() == 0


def test_permuted_texels_give_the_same_partition(globe):
    position, adjacency = globe
    rng = np.random.default_rng(7)
    diffuse = two_colors(position) * irradiance(position)[:, None]
    diffuse *= rng.normal(1, 0.03, diffuse.shape)
    order = rng.permutation(len(position))
    labels = segment(diffuse[order], neighbours(position[order], position[order]))
    assert same_partition(labels, segment(diffuse, adjacency)[order])


def test_rotated_world_gives_the_same_partition(globe):
    position, adjacency = globe
    diffuse = two_colors(position) * irradiance(position)[:, None]
    turned = (position @ Rotation.random(random_state=8).as_matrix().T).astype(np.float32)
    assert np.array_equal(segment(diffuse, neighbours(turned, turned)), segment(diffuse, adjacency))


def test_same_input_gives_the_same_labels(globe):
    position, adjacency = globe
    diffuse = np.random.default_rng(9).uniform(0, 100, position.shape)
    assert np.array_equal(segment(diffuse, adjacency), segment(diffuse, adjacency))


def test_brightness_of_the_whole_hardly_matters_and_never_at_weight_zero(globe):
    position, adjacency = globe
    diffuse = two_colors(position)
    options = {"lightness_weight": 0.0}
    reference = segment(diffuse, adjacency, **options)
    for factor in (0.3, 3.0):
        assert np.array_equal(segment(diffuse * factor, adjacency, **options), reference)


def test_unobserved_texels_are_unlabelled_and_the_others_are(globe):
    position, adjacency = globe
    diffuse = two_colors(position)
    unseen = np.random.default_rng(10).random(len(position)) < 0.2
    diffuse[unseen, 1] = np.nan
    labels = segment(diffuse, adjacency)
    assert np.array_equal(labels == -1, unseen)
    assert np.array_equal(labels[~unseen], position[~unseen, 2] > 0.3)


def test_like_colors_are_one_material_only_when_joined(globe):
    position, adjacency = globe
    banded = np.where(np.abs(position[:, 2:]) > 0.4, TERRACOTTA, SLATE)
    assert segment(banded, adjacency).max() == 1
    labels = segment(banded, adjacency, join=False)
    assert labels.max() == 2
    assert same_partition(labels, np.digitize(position[:, 2], [-0.4, 0.4]))


def test_small_spot_is_absorbed_and_a_large_one_is_not(globe):
    position, adjacency = globe
    spotted = np.where(position[:, 2:] > 0.9, TERRACOTTA, SLATE)  # a twentieth of the sphere
    assert segment(spotted, adjacency, minimum_share=0.03).max() == 1
    assert segment(spotted, adjacency, minimum_share=0.08).max() == 0


def test_islands_take_the_nearest_color(globe):
    position, _ = globe
    island = sphere(12) * 0.01 + np.float32([9, 0, 0])
    everything = np.concatenate([position, island])
    normal = np.concatenate([position, sphere(12)])
    diffuse = np.concatenate([two_colors(position), np.tile(TERRACOTTA * 0.9, (12, 1))])
    labels = segment(diffuse, neighbours(everything, normal), join=False, minimum_share=0.01)
    assert labels.max() == 1
    assert (labels[-12:] == labels[0]).all()


def test_grey_materials_need_lightness(globe):
    position, adjacency = globe
    grey = np.where(position[:, 2:] > 0.3, 50.0, 18.0) * np.ones(3)
    assert segment(grey, adjacency).max() == 0
    assert np.array_equal(segment(grey, adjacency, lightness_weight=1.0), position[:, 2] > 0.3)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_texels(count):
    position = sphere(max(count, 1))[:count]
    labels = segment(np.full((count, 3), 20.0), neighbours(position, position))
    assert np.array_equal(labels, np.zeros(count))
    assert np.array_equal(segment_surface(position, position, np.full((count, 3), 20.0)), labels)


def test_nothing_observed(globe):
    position, adjacency = globe
    nothing = np.full((len(position), 3), np.nan)
    assert (segment(nothing, adjacency) == -1).all()
    assert (segment_surface(position, position, nothing) == -1).all()


def test_a_mixture_along_a_border_goes_to_its_sides(globe):
    """Pixels that show both colours, in light and shade: each texel to the one it has more of."""
    position, adjacency = globe
    share = np.clip((position[:, 2:] - 0.3) / 0.14 + 0.5, 0, 1)
    mixed = share * TERRACOTTA + (1 - share) * np.array([10.0, 40, 30])
    mixed = mixed * irradiance(position, seed=4)[:, None]
    labels = segment(mixed, adjacency)
    assert labels.max() == 1
    wrong = labels != (position[:, 2] > 0.3)
    assert wrong.mean() < 0.01
    assert segment(mixed, adjacency, strip=0.0).max() >= 1


def test_a_line_of_its_own_colour_stays(globe):
    position, adjacency = globe
    line = np.abs(position[:, 2:] - 0.3) < 0.08
    lined = np.where(line, [8.0, 40, 6], two_colors(position))
    labels = segment(lined, adjacency)
    assert labels.max() == 2
    assert np.array_equal(labels == labels[line[:, 0]][0], line[:, 0])


def test_regions_grow_across_a_line_that_is_not_observed():
    row, col = np.mgrid[:40, :41]
    position = np.stack([col, row, 0 * row], -1).reshape(-1, 3).astype(np.float32)
    diffuse = np.where((col == 20).ravel()[:, None], np.nan, 20.0) * np.ones(3)
    normal = np.broadcast_to(np.float32([0, 0, 1]), position.shape)
    labels = segment_surface(position, normal, diffuse, join=False)
    assert np.array_equal(labels, np.where(col.ravel() == 20, -1, 0))


def test_thinned_surface_takes_the_labels_of_the_nearest():
    position = sphere(30000)
    diffuse = two_colors(position)
    diffuse[::7] = np.nan
    labels = segment_surface(position, position, diffuse, most=6000)
    seen = np.isfinite(diffuse[:, 0])
    assert np.array_equal(labels >= 0, seen)
    wrong = labels[seen] != (position[seen, 2] > 0.3)
    assert wrong.mean() < 0.01
    assert np.abs(position[seen, 2][wrong] - 0.3).max() < 0.05


@pytest.mark.parametrize(
    "options",
    [{"threshold": 0.0}, {"threshold": np.nan}, {"lightness_weight": 1.5}, {"minimum_share": 1.0}],
)
def test_impossible_options_are_named(globe, options):
    with pytest.raises(SvbrdfError, match=next(iter(options))):
        segment(two_colors(globe[0]), globe[1], **options)


def test_color_space_is_cie_lab_at_weight_one():
    srgb = np.random.default_rng(11).random((200, 3))
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert color_space(linear * 100, 1.0) == pytest.approx(rgb2lab(srgb), abs=2e-3)


@given(st.floats(0.1, 1), st.tuples(*[st.floats(20, 100)] * 3))
def test_color_space_at_weight_zero_forgets_shading(factor, color):
    color = np.array([color])
    assert color_space(color * factor, 0.0) == pytest.approx(color_space(color, 0.0), abs=1e-3)


def test_color_space_of_extreme_colors_is_finite_or_unobserved():
    extreme = np.array([[0, 0, 0], [-1, 0, 0], [1e6, 0, 0], [np.inf, 1, 1], [np.nan, 1, 1]])
    space = color_space(extreme)
    assert np.isfinite(space[:3]).all()
    assert np.isnan(space[3:]).all()
    assert np.array_equal(space[0], np.zeros(3))


def test_image_of_ids_is_read_at_texel_centres():
    image = np.array([[7, 7], [255, 3]], np.uint8)
    row, col = np.divmod(np.arange(16), 4)
    labels, table = from_image([image], np.zeros(16, int), row, col, [(4, 4)])
    assert np.array_equal(labels.reshape(4, 4)[::2, ::2], [[1, 1], [-1, 0]])
    assert np.array_equal(table, [3, 7])


@pytest.mark.parametrize("size", [1, 3, 8, 24, 40])
def test_image_of_any_size_at_its_own_centres(size):
    image = np.arange(size * size, dtype=np.uint16).reshape(size, size)
    row, col = np.divmod(np.arange(64), 8)
    labels, table = from_image([image], np.zeros(64, int), row, col, [(8, 8)])
    expected = image[((row + 0.5) * size / 8).astype(int), ((col + 0.5) * size / 8).astype(int)]
    assert np.array_equal(table[labels], expected)


def test_image_of_sixteen_bits_keeps_id_255():
    image = np.array([[255, 65535]], np.uint16)
    labels, table = from_image([image], np.zeros(2, int), np.zeros(2, int), np.arange(2), [(1, 2)])
    assert np.array_equal(labels, [0, -1])
    assert np.array_equal(table, [255])


def test_colors_and_alpha_over_two_textures():
    red, blue, clear = [200, 0, 0, 255], [0, 0, 200, 255], [9, 9, 9, 0]
    images = [np.array([[red, clear]], np.uint8), np.array([[blue, red]], np.uint8)]
    texture, col = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    labels, table = from_image(images, texture, np.zeros(4, int), col, [(1, 2), (1, 2)])
    assert np.array_equal(labels, [1, -1, 0, 1])
    assert np.array_equal(table, [[0, 0, 200], [200, 0, 0]])


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([], "one per texture"),
        ([np.zeros((2, 2))], "8-bit"),
        ([np.zeros((2, 2, 2), np.uint8)], "8-bit"),
        ([np.zeros((0, 2), np.uint8)], "8-bit"),
        ([np.arange(300 * 3, dtype=np.uint16).reshape(20, 15, 3)], "soft edges"),
    ],
)
def test_unusable_images_are_refused(images, message):
    row, col = np.divmod(np.arange(300), 15)
    with pytest.raises(SvbrdfError, match=message):
        from_image(images, np.zeros(300, int), row, col, [(20, 15)])


def test_images_must_be_alike():
    images = [np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.uint16)]
    zero = np.zeros(1, int)
    with pytest.raises(SvbrdfError, match="differ"):
        from_image(images, zero, zero, zero, [(2, 2), (2, 2)])


def test_palette_is_distinct_and_grows_without_changing():
    lab = rgb2lab(palette(64))
    apart = np.linalg.norm(lab[:, None] - lab, axis=2) + 1e3 * np.eye(64)
    assert apart.min() > 10
    assert np.array_equal(palette(64)[:5], palette(5))
    assert palette(0).shape == (0, 3)
    assert palette(1500).dtype == np.uint8


@pytest.mark.skipif(
    "MESHLAB_SVBRDF_SCENES" not in os.environ, reason="needs the scenes: MESHLAB_SVBRDF_SCENES"
)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_bust_keeps_its_materials_apart(noise):
    """The true shaded colour of the bust, in its chart: neighbours are pixels, charts are apart."""
    import cv2
    import OpenEXR

    truth = Path(os.environ["MESHLAB_SVBRDF_SCENES"]) / "bust_floods" / "ground_truth"
    with OpenEXR.File(str(truth / "diffuse_shaded.exr")) as file:
        shaded = file.channels()["RGB"].pixels * 100
    ids = cv2.imread(str(truth / "material_id.png"), cv2.IMREAD_UNCHANGED)[1::2, 1::2]
    mask = cv2.imread(str(truth / "texel_mask.png"), cv2.IMREAD_UNCHANGED)[1::2, 1::2] > 0
    row, col = np.nonzero(mask & (shaded.sum(2) > 0))
    position = np.stack([col, row, np.zeros_like(row)], 1).astype(np.float32)
    normal = np.broadcast_to(np.float32([0, 0, 1]), position.shape)
    rng = np.random.default_rng(12)
    diffuse = shaded[row, col] * rng.normal(1, noise, (len(row), 3))
    labels = segment(
        diffuse + rng.normal(0, 10 * noise, diffuse.shape), neighbours(position, normal)
    )
    assert labels.min() == 0
    assert labels.max() < 12
    assert agreement(labels, ids[row, col]) > 0.97
