"""Frames projected to texels: planes whose image, occlusion and quality are known functions."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from analytic import look_at, plane, sphere, view_vectors

from meshlab_svbrdf.document.images import reduced
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.samples.capture import FrameSampler, Quality, _mark_jumps, reference_depth
from meshlab_svbrdf.samples.luminance import decode, encode, to_srgb8

CAMERA = look_at([0.8, 0.5, 3], [0.1, 0, 0], width=200, height=160, fx=230.0, fy=210.0, cx=107.0)
WHITE = np.full((160, 200, 3), 128, np.uint8)


@pytest.fixture(scope="module")
def wall():
    """A wall larger than the image."""
    mesh = plane(6.0)
    return mesh, rasterise_texels(mesh, ((160, 160),))


def pixels(texels, camera=CAMERA):
    return camera.project(texels.position + texels.center).T


def linear_image(camera=CAMERA):
    """Linear light that rises linearly over the image, another slope in every channel."""
    col, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return field(col, row)


def field(x, y):
    return np.stack([0.02 + 0.002 * x + 0.001 * y, 0.5 - 0.001 * x, 0.9 - 0.003 * y], -1)


def columns(sampled):
    return sampled.texel, sampled.rgb, sampled.quality


def test_samples_are_the_images_colour_there(wall):
    mesh, texels = wall
    image = to_srgb8(linear_image())
    texel, rgb, _ = columns(FrameSampler(mesh, texels, 3.0).sample(CAMERA, image))
    x, y, _ = pixels(texels)
    expected = 255 * encode(field(x, y))[texel]
    assert len(texel) > 1000
    assert np.abs(rgb - expected).max() <= 1.2


def test_interpolation_is_in_linear_light(wall):
    """Between black and white columns the mean is 188, not 128."""
    mesh, texels = wall
    image = np.zeros_like(WHITE)
    image[:, ::2] = 253
    texel, rgb, _ = columns(FrameSampler(mesh, texels, 3.0).sample(CAMERA, image))
    x = pixels(texels)[0][texel]
    share = 1 - np.abs((x % 2) - 1)
    weight = 1 - share
    expected = 255 * encode(decode(253 / 255) * weight)
    assert np.abs(rgb[:, 0] - expected).max() <= 1.2 + 0.5


def test_texels_are_those_inside_the_image_in_ascending_order(wall):
    mesh, texels = wall
    quality = Quality(cut=0.0)
    texel, rgb, weight = columns(FrameSampler(mesh, texels, 3.0, quality).sample(CAMERA, WHITE))
    x, y, _ = pixels(texels)
    expected = np.flatnonzero((x >= 0) & (x < 199) & (y >= 0) & (y < 159))
    np.testing.assert_array_equal(texel, expected)
    assert (texel.dtype, rgb.dtype, weight.dtype) == (np.int32, np.uint8, np.uint8)


def formula(texels, camera, reference, scale):
    x, y, z = pixels(texels, camera)
    edge = np.minimum(np.minimum(x, camera.width - 1 - x), np.minimum(y, camera.height - 1 - y))
    cos = np.sum(view_vectors(texels, [camera])[:, 0] * texels.normal, -1)
    return (
        np.clip((edge + 0.5) / (5 * scale), 0, 1) * np.minimum(reference / z, 1) ** 2 * cos.clip(0)
    )


@pytest.mark.parametrize("reference", [2.0, 3.0, 10.0])
def test_quality_on_a_wall_is_the_formula(wall, reference):
    mesh, texels = wall
    sampler = FrameSampler(mesh, texels, reference)
    texel, _, weight = columns(sampler.sample(CAMERA, WHITE))
    expected = formula(texels, CAMERA, reference, 200 / 640)
    assert np.abs(weight / 127 - expected[texel]).max() < 0.5 / 127 + 1e-3
    assert expected[texel].min() > 0.1 - 1e-3
    lost = np.setdiff1d(np.arange(len(texels)), texel)
    x, y, _ = pixels(texels)
    inside = (x[lost] >= 0) & (x[lost] < 199) & (y[lost] >= 0) & (y[lost] < 159)
    assert expected[lost][inside].max(initial=0) < 0.1 + 1e-3


def test_what_faces_away_is_not_seen(wall):
    mesh, texels = wall
    behind = look_at([0.3, 0.1, -3])
    assert len(FrameSampler(mesh, texels, 3.0).sample(behind, WHITE[:120, :160])[0]) == 0


def test_what_is_behind_the_camera_is_not_seen(wall):
    mesh, texels = wall
    away = look_at([0, 0, 3], [0, 0.1, 6])
    assert len(FrameSampler(mesh, texels, 3.0).sample(away, WHITE[:120, :160])[0]) == 0


def test_a_screen_hides_its_shadow_and_nothing_else():
    wall, screen = plane(3.0), plane(0.4, 1.2)
    mesh = Mesh(
        np.vstack([wall.vertices, screen.vertices]), np.vstack([wall.faces, screen.faces + 4]),
        None, np.vstack([wall.uv, screen.uv + 5]),
    )  # fmt: skip
    texels = rasterise_texels(mesh, ((200, 200),))
    texel, _, _ = columns(FrameSampler(mesh, texels, 3.0).sample(CAMERA, WHITE))
    eye, position = CAMERA.center, texels.position + texels.center
    cut = eye + (position - eye) * ((eye[2] - 1.2) / (eye[2] - position[:, 2]))[:, None]
    # Count how far the ray passes the screen's border, in pixels; inside it is negative
    beyond = (np.abs(cut[:, :2]).max(1) - 0.4) * CAMERA.fx / (eye[2] - 1.2)
    seen = np.zeros(len(texels), bool)
    seen[texel] = True
    assert not seen[beyond < 0].any()
    margin = Quality().border * 200 / 640 + 3
    inside = formula(texels, CAMERA, 3.0, 200 / 640) > 0.11
    x, y, _ = pixels(texels)
    inside &= (x > 0) & (y > 0) & (x < 199) & (y < 159)
    assert (beyond < 0).sum() > 200
    assert seen[inside & (beyond > margin)].all()


def test_nothing_on_a_convex_object_is_occluded():
    mesh = sphere(48)
    texels = rasterise_texels(mesh, ((64, 128),))
    camera = look_at([0.4, 1, 3])
    texel, _, _ = columns(FrameSampler(mesh, texels, 4.0).sample(camera, WHITE[:120, :160]))
    cos = np.sum(view_vectors(texels, [camera])[:, 0] * texels.normal, -1)
    facing = np.flatnonzero(cos > 0.45)  # nearer to the rim quality falls by the border
    assert np.isin(facing, texel).all()
    assert cos[texel].min() > 0.1


def test_mask_removes_what_it_covers_and_weighs_its_edge(wall):
    mesh, texels = wall
    mask = np.zeros(WHITE.shape[:2], bool)
    mask[:, 80:] = True
    sampler = FrameSampler(mesh, texels, 10.0)
    plain = dict(
        zip(*(a.tolist() for a in columns(sampler.sample(CAMERA, WHITE))[::2]), strict=True)
    )
    texel, _, weight = columns(sampler.sample(CAMERA, WHITE, mask))
    x = pixels(texels)[0][texel]
    assert x.min() >= 79.5
    before = np.array([plain[t] for t in texel.tolist()])
    deep = x > 80 + 5 * 200 / 640 + 1
    np.testing.assert_array_equal(weight[deep], before[deep])
    rim = x < 80.5
    assert (weight[rim] < 0.75 * before[rim]).all()
    np.testing.assert_array_equal(
        sampler.sample(CAMERA, WHITE, np.ones_like(mask))[0], sorted(plain)
    )


@pytest.mark.parametrize("cut", [0.0, 0.1])
def test_what_the_mask_covers_is_never_seen(wall, cut):
    """Not even where samples of any quality are kept: there the mask is all that parts them."""
    mesh, texels = wall
    sampler = FrameSampler(mesh, texels, 3.0, Quality(cut=cut))
    assert len(sampler.sample(CAMERA, WHITE, np.zeros(WHITE.shape[:2], bool))[0]) == 0


def test_clipped_is_any_tap_of_any_channel(wall):
    mesh, texels = wall
    rng = np.random.default_rng(0)
    image = rng.integers(0, 254, WHITE.shape, np.uint8)
    hot = rng.random(WHITE.shape) < 0.03
    image[hot] = rng.choice(np.array([254, 255], np.uint8), hot.sum())
    texel, _, weight = columns(FrameSampler(mesh, texels, 3.0).sample(CAMERA, image))
    x, y, _ = pixels(texels)
    c, r = x[texel].astype(int), y[texel].astype(int)
    taps = np.max([image[r + i, c + j].max(-1) for i in (0, 1) for j in (0, 1)], 0)
    safe = (
        np.minimum(np.abs(x[texel] - np.rint(x[texel])), np.abs(y[texel] - np.rint(y[texel])))
        > 1e-3
    )
    np.testing.assert_array_equal((weight >= 128)[safe], (taps >= 254)[safe])
    assert 0.1 < (weight >= 128).mean() < 0.9


def test_white_and_black_stay(wall):
    mesh, texels = wall
    sampler = FrameSampler(mesh, texels, 3.0)
    for value in (0, 1, 128, 253, 255):
        _, rgb, weight = columns(sampler.sample(CAMERA, np.full_like(WHITE, value)))
        np.testing.assert_array_equal(rgb, value)
        assert ((weight >= 128) == (value >= 254)).all()


def test_depth_jump_lowers_quality_around_it_in_proportion_to_the_image():
    """The rim of a ball against nothing: quality there is distance to the rim over the border."""
    mesh = sphere(64)
    texels = rasterise_texels(mesh, ((96, 192),))
    camera = look_at([0, 0, 4], width=320, height=240, fx=350.0)
    sampler = FrameSampler(mesh, texels, 10.0, Quality(cut=0.01))
    texel, _, weight = columns(sampler.sample(camera, np.full((240, 320, 3), 90, np.uint8)))
    x, y, _ = pixels(texels, camera)
    rim = 350 / np.sqrt(15) - np.hypot(x - camera.cx, y - camera.cy)
    cos = np.sum(view_vectors(texels, [camera])[:, 0] * texels.normal, -1)
    expected = np.clip(rim[texel] / 2.5, 0, 1) * cos[texel]
    assert np.abs(weight / 127 - expected).max() < 0.35
    near = rim[texel] < 1.5
    assert np.mean(weight[near] / 127 / cos[texel][near]) < 0.7
    flat = rim[texel] > 5
    assert np.abs(weight / 127 - cos[texel])[flat].max() < 0.01


def test_silhouettes_are_the_same_on_all_four_sides():
    """The object's pixels beside the background go, and those on both sides of a step."""
    inverse_depth = np.zeros((8, 9), np.float32)
    inverse_depth[2:6, 2:7] = 1.0
    smooth = np.ones((8, 9), np.uint8)
    _mark_jumps(inverse_depth, 0.05, smooth)
    assert (smooth[3:5, 3:6] == 1).all()
    assert smooth.sum() == 6
    inverse_depth[:, 4] *= 0.5
    _mark_jumps(inverse_depth, 0.05, smooth)
    assert not smooth.any()


def test_map_coordinates_cost_nothing(wall):
    mesh, texels = wall
    origin = np.array([4.5e5, 5.4e6, 120.0])
    moved = replace(mesh, vertices=mesh.vertices + origin)
    image = to_srgb8(linear_image())
    a = columns(FrameSampler(mesh, texels, 3.0).sample(CAMERA, image))
    there = FrameSampler(moved, rasterise_texels(moved, texels.sizes), 3.0)
    b = columns(there.sample(CAMERA.about(-origin), image))
    both, i, j = np.intersect1d(a[0], b[0], return_indices=True)
    assert len(both) > 0.999 * len(a[0])
    assert np.abs(a[1][i].astype(int) - b[1][j]).max() <= 1
    assert np.abs(a[2][i].astype(int) - b[2][j]).max() <= 1


@pytest.mark.parametrize("wrong", [(120, 160, 3), (160, 200), (160, 200, 4), (200, 160, 3)])
def test_image_of_another_size_than_the_cameras_is_refused(wall, wrong):
    mesh, texels = wall
    with pytest.raises(ValueError, match="200"):
        FrameSampler(mesh, texels, 3.0).sample(CAMERA, np.zeros(wrong, np.uint8))


def test_mask_of_another_size_than_the_cameras_is_refused(wall):
    mesh, texels = wall
    with pytest.raises(ValueError, match="mask"):
        FrameSampler(mesh, texels, 3.0).sample(CAMERA, WHITE, np.ones((10, 10), bool))


def test_reference_depth_is_the_tenth_percentile_of_what_is_in_the_image():
    mesh = sphere()
    cameras = [look_at([0, 0, d]) for d in (3.0, 4.0, 5.0)] + [look_at([0, 0, 3], [0, 0, 9])]
    depth = np.concatenate([c.project(mesh.vertices)[:, 2] for c in cameras[:3]])
    assert reference_depth(mesh.vertices, cameras) == pytest.approx(np.quantile(depth, 0.1))
    assert reference_depth(mesh.vertices, []) == 1.0
    assert reference_depth(mesh.vertices, cameras[3:]) == 1.0


def test_distance_transform_finds_no_edge_in_a_full_image():
    """What the kernel relies on: OpenCV returns something huge, not 0, without any edge."""
    assert cv2.distanceTransform(np.ones((20, 30), np.uint8), cv2.DIST_L2, 3).min() > 1e3


@pytest.mark.parametrize("times", [2, 4])
def test_a_reduced_frame_shows_the_same(wall, times):
    """Colour and place: linear light that rises linearly keeps its value in means of pixels."""
    mesh, texels = wall
    camera = look_at([0.8, 0.5, 3], [0.1, 0, 0], width=201, height=163, fx=230.0, cx=107.0)
    image = reduced(to_srgb8(linear_image(camera)), times)
    small = camera.reduced(times)
    assert image.shape[:2] == (small.height, small.width)
    texel, rgb, _ = columns(FrameSampler(mesh, texels, 3.0).sample(small, image))
    x, y, _ = pixels(texels, camera)
    inside = (x < 201 - times) & (y < 163 - times)
    expected = 255 * encode(field(x, y))
    kept = inside[texel]
    assert kept.sum() > 1000
    assert np.abs(rgb - expected[texel])[kept].max() <= 2.2
