"""What the stages read from a sample: colour, quality, mirror direction, visibility."""

import numpy as np
import pytest
from analytic import ball, free_texels, mirror, observations_of, orbit, store_of, unit
from numba import njit

from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.samples.luminance import REC709, decode
from meshlab_svbrdf.samples.observations import (
    color,
    fill_visibility,
    mirror_direction,
    observe,
    sample_luminance,
    sample_quality,
    visibility,
)

T, F = 20, 12


@njit
def _read(block, view, out):
    for i in range(block.stop - block.first):
        for j in range(block.offsets[i], block.offsets[i + 1]):
            out[j, 0], out[j, 1], out[j, 2] = color(block, view, j)
            out[j, 3] = sample_luminance(block, view, j)
            out[j, 4] = sample_quality(block, j)
            out[j, 5], out[j, 6], out[j, 7] = mirror_direction(
                view, block.first + i, block.frame[j]
            )


def read(observations):
    """Every sample as (T, F, 8): R, G, B, Y, quality, mirror direction."""
    block = observations.store.read(0, len(observations.texels))
    out = np.empty((len(block.frame), 8))
    _read(block, observations.view, out)
    return out.reshape(len(observations.texels), -1, 8)


@pytest.fixture(scope="module")
def codes():
    return np.random.default_rng(0).integers(0, 256, (T, F, 3), np.uint8)


@pytest.fixture(scope="module")
def quality():
    return np.random.default_rng(1).integers(1, 256, (T, F), np.uint8)


@pytest.mark.parametrize("shape", [None, (F,), (F, 3)])
def test_colour_is_linear_light_over_the_gain(tmp_path, codes, quality, shape):
    gains = None if shape is None else np.random.default_rng(2).uniform(0.5, 2, shape)
    seen = read(observations_of(tmp_path, codes, quality, ball(T), orbit(F), gains=gains))
    gain = np.ones((F, 3)) if gains is None else np.broadcast_to(gains.reshape(F, -1), (F, 3))
    expected = 100 * decode(codes / 255) / gain
    np.testing.assert_allclose(seen[..., :3], expected, rtol=1e-6)
    np.testing.assert_allclose(seen[..., 3], expected @ REC709, rtol=1e-6)


def test_quality_is_seven_bits_without_the_mark_of_clipping(tmp_path, codes, quality):
    seen = read(observations_of(tmp_path, codes, quality, ball(T), orbit(F)))
    np.testing.assert_allclose(seen[..., 4], (quality & 127) / 127, rtol=1e-7)


@pytest.mark.parametrize("center", [np.zeros(3), np.array([4.5e5, 5.4e6, 120.0])])
def test_mirror_directions(tmp_path, codes, quality, center):
    texels, cameras = ball(T), [c.about(-center) for c in orbit(F)]
    texels = free_texels(texels.position, texels.normal, center=center)
    seen = read(observations_of(tmp_path, codes, quality, texels, cameras))[..., 5:]
    np.testing.assert_allclose(seen, mirror(texels, cameras), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=-1), 1, atol=1e-6)


def test_mirroring_twice_is_the_view(tmp_path, codes, quality):
    texels, cameras = ball(T), orbit(F)
    r = read(observations_of(tmp_path, codes, quality, texels, cameras))[..., 5:]
    n = texels.normal[:, None]
    back = 2 * np.sum(n * r, -1, keepdims=True) * n - r
    eyes = np.array([c.center for c in cameras])
    np.testing.assert_allclose(back, unit(eyes[None] - texels.position[:, None]), atol=1e-6)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_gains_that_are_no_gains_are_refused(tmp_path, codes, quality, bad):
    store = store_of(tmp_path, codes, quality)
    gains = np.ones(F)
    gains[3] = bad
    with pytest.raises(ValueError, match="gains"):
        observe(ball(T), store, orbit(F), np.zeros((1, 3), int), gains=gains)


@pytest.mark.parametrize("cameras", [F - 1, F + 1])
def test_a_camera_for_every_frame_of_the_store(tmp_path, codes, quality, cameras):
    """A missing camera would be read beyond its array."""
    with pytest.raises(ValueError, match="cameras"):
        observe(ball(T), store_of(tmp_path, codes, quality), orbit(cameras), np.zeros((1, 3), int))


def test_texels_are_those_of_the_store(tmp_path, codes, quality):
    with pytest.raises(ValueError, match="texels"):
        observe(ball(T + 1), store_of(tmp_path, codes, quality), orbit(F), np.zeros((1, 3), int))


@njit
def _visibilities(view, rays, out):
    coefficients = np.empty(36, np.float32)
    for t in range(len(out)):
        has = fill_visibility(view, t, coefficients)
        for k in range(len(rays)):
            out[t, k] = visibility(has, coefficients, rays[k, 0], rays[k, 1], rays[k, 2])


def test_visibility_interpolates_the_vertices_and_is_remapped(tmp_path, codes, quality):
    rng = np.random.default_rng(3)
    coefficients = rng.normal(size=(3, 36)) * 0.4
    store = store_of(tmp_path, codes, quality)
    observations = observe(
        ball(T), store, orbit(F), np.array([[2, 0, 1]]), coefficients=coefficients
    )
    barycentric = rng.dirichlet(np.ones(3), T).astype(np.float32)
    view = observations.view._replace(barycentric=barycentric)
    rays = unit(rng.normal(size=(40, 3)))
    out = np.empty((T, 40))
    _visibilities(view, rays, out)
    value = (barycentric @ coefficients[[2, 0, 1]]) @ basis(rays).T
    np.testing.assert_allclose(out, np.clip((value - 0.25) * 2, 0, 1), atol=1e-5)


def test_without_coefficients_all_is_visible(tmp_path, codes, quality):
    observations = observations_of(tmp_path, codes, quality, ball(T), orbit(F))
    out = np.empty((T, 3))
    _visibilities(observations.view, np.eye(3), out)
    np.testing.assert_array_equal(out, 1)
