"""From samples to D: what must not change a result does not, what must scale it does just so.

A ball under two lamps, filmed in 8 bits; hypothesis turns, scales, shuffles and masks it.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from analytic import ball, film, lamp, observations_of, orbit, rotation
from hypothesis import given, settings
from hypothesis import strategies as st

from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.reflectance.diffuse import diffuse_color
from meshlab_svbrdf.reflectance.environment import environment_map
from meshlab_svbrdf.reflectance.specular import texel_specular
from meshlab_svbrdf.reflectance.threshold import luminance_threshold
from meshlab_svbrdf.samples import store

T, F = 120, 40
SEEDS = st.integers(0, 2**32 - 1)
LAMPS = [lamp([0.3, 0.5, 0.8], spread=0.15), lamp([-0.8, 0.3, 0.3], spread=0.15)]
few = settings(max_examples=3)


class Filmed(NamedTuple):
    """codes (T, F, 3), quality (T, F): what the cameras see of the texels"""

    codes: np.ndarray
    quality: np.ndarray
    texels: Texels
    cameras: list


class Result(NamedTuple):
    threshold: np.ndarray
    radiance: np.ndarray
    diffuse: np.ndarray
    rho_s: np.ndarray
    alpha: np.ndarray


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Filmed:
    texels, cameras = ball(T), orbit(F, turns=3, climb=100)
    rng = np.random.default_rng(0)
    made = film(
        tmp_path_factory.mktemp("scene"), texels, cameras, LAMPS, np.zeros(T, int), [30.0], [25.0],
        rng.uniform(4, 20, (T, 3)),
    )  # fmt: skip
    codes, quality = np.zeros((T, F, 3), np.uint8), np.zeros((T, F), np.uint8)
    for block in made.observations.store.blocks():
        texel = block.first + np.repeat(np.arange(block.stop - block.first), np.diff(block.offsets))
        codes[texel, block.frame], quality[texel, block.frame] = (
            block.value[:, :3],
            block.value[:, 3],
        )
    return Filmed(codes, quality, texels, cameras)


@pytest.fixture(scope="module")
def solve(tmp_path_factory):
    """All stages that need no fit, on a film."""

    def solve(filmed: Filmed, lights=LAMPS, order=None, **kw) -> Result:
        observations = observations_of(
            tmp_path_factory.mktemp("store"), filmed.codes, filmed.quality, filmed.texels,
            filmed.cameras, order=order, **kw,
        )  # fmt: skip
        statistics = luminance_threshold(observations)
        environment = environment_map(observations, statistics, height=32)
        diffuse = diffuse_color(observations, statistics, environment.probability)
        peaks = texel_specular(observations, diffuse @ [0.2126, 0.7152, 0.0722], lights)
        return Result(statistics.threshold, environment.radiance, diffuse, peaks.rho_s, peaks.alpha)

    return solve


@pytest.fixture(scope="module")
def plain(scene, solve) -> Result:
    return solve(scene)


def same(found: Result, expected: Result, rtol=0.0, atol=0.0):
    for name, a, b in zip(Result._fields, found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=atol, err_msg=name)


def shuffled(texels: Texels, order) -> Texels:
    names = ("position", "normal", "face", "barycentric", "texture", "row", "col")
    return replace(texels, **{name: getattr(texels, name)[order] for name in names})


def test_the_scene_tells_something(plain):
    assert np.isfinite(plain.diffuse).all(1).mean() > 0.9
    assert np.isfinite(plain.alpha).mean() > 0.1


@few
@given(SEEDS)
def test_numbering_of_texels_does_not_matter(scene, solve, plain, seed):
    order = np.random.default_rng(seed).permutation(T)
    found = solve(
        Filmed(
            scene.codes[order], scene.quality[order], shuffled(scene.texels, order), scene.cameras
        )
    )
    np.testing.assert_array_equal(found.threshold, plain.threshold[order])
    np.testing.assert_allclose(found.radiance, plain.radiance, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(found.diffuse, plain.diffuse[order], rtol=1e-6)
    np.testing.assert_allclose(found.alpha, plain.alpha[order], rtol=1e-5)


@few
@given(SEEDS)
def test_order_of_frames_does_not_matter_where_it_is_kept_apart(scene, solve, plain, seed):
    """Peaks are runs in time: but these, nothing asks for the order that frames are stored in."""
    order = np.random.default_rng(seed).permutation(F)
    cameras = [scene.cameras[k] for k in order]
    found = solve(Filmed(scene.codes[:, order], scene.quality[:, order], scene.texels, cameras))
    np.testing.assert_allclose(found.threshold, plain.threshold, rtol=1e-6)
    np.testing.assert_allclose(found.radiance, plain.radiance, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.diffuse, plain.diffuse, rtol=1e-5)


@few
@given(SEEDS, st.floats(-4, 4))
def test_turning_moving_and_scaling_the_world_changes_no_texel(scene, solve, plain, seed, power):
    rng = np.random.default_rng(seed)
    turn, scale, shift = rotation(rng), 10.0**power, 10.0**power * rng.normal(size=3)
    texels = replace(
        scene.texels, position=(scale * scene.texels.position @ turn.T).astype(np.float32),
        normal=(scene.texels.normal @ turn.T).astype(np.float32), center=shift, radius=scale,
    )  # fmt: skip
    cameras = [
        replace(c, R=c.R @ turn.T, t=scale * c.t - c.R @ turn.T @ shift) for c in scene.cameras
    ]
    lights = [lamp(turn @ light.direction, spread=0.15) for light in LAMPS]
    found = solve(scene._replace(texels=texels, cameras=cameras), lights)
    np.testing.assert_array_equal(found.threshold, plain.threshold)
    # The map has other pixels in other directions, so D is near, not equal
    assert np.nanmedian(np.abs(found.diffuse / plain.diffuse - 1)) < 0.01
    both = np.isfinite(found.alpha) & np.isfinite(plain.alpha)
    assert both.sum() > 0.8 * np.isfinite(plain.alpha).sum()
    assert np.median(np.abs(np.log(found.alpha / plain.alpha)[both])) < 0.05


@few
@given(st.sampled_from([0.25, 0.5, 2.0, 4.0]))
def test_exposure_scales_all_luminance_and_nothing_else(scene, solve, plain, times):
    """Frames of that exposure, taken as they are: powers of two are exact in single precision."""
    found = solve(scene, gains=np.full(F, 1 / times))
    np.testing.assert_allclose(found.threshold, times * plain.threshold, rtol=1e-6)
    np.testing.assert_allclose(found.radiance, times * plain.radiance, rtol=1e-6)
    np.testing.assert_allclose(found.diffuse, times * plain.diffuse, rtol=1e-3)


@few
@given(SEEDS, st.integers(1, 30))
def test_frames_that_a_mask_covers_change_nothing(scene, solve, plain, seed, count):
    rng = np.random.default_rng(seed)
    codes = np.concatenate(
        [scene.codes, rng.integers(0, 256, (T, count, 3)).astype(np.uint8)], axis=1
    )
    quality = np.concatenate([scene.quality, np.zeros((T, count), np.uint8)], axis=1)
    cameras = [*scene.cameras, *orbit(count, distance=3.0)]
    same(solve(Filmed(codes, quality, scene.texels, cameras)), plain)


@few
@given(st.integers(1, 7))
def test_threads_change_nothing(scene, solve, plain, count):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "thread_count", lambda: count)
        same(solve(scene), plain)
