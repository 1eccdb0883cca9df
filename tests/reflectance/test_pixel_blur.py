"""What a pixel averages over blurs a lobe as much as the formula says."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import (
    ball,
    bumpy_ball,
    film,
    free_texels,
    grey,
    lamp,
    lobes,
    observations_of,
    orbit,
    unit,
)

from meshlab_svbrdf.geometry.surface_shape import surface_shape
from meshlab_svbrdf.reflectance.diffuse_refit import refitting
from meshlab_svbrdf.reflectance.fit_samples import collect
from meshlab_svbrdf.reflectance.footprint import SPREAD
from meshlab_svbrdf.reflectance.joint import fit
from meshlab_svbrdf.reflectance.lobes import add_blurred
from meshlab_svbrdf.reflectance.microfacet import phong_gloss
from meshlab_svbrdf.reflectance.phong import lamps, light_texels
from meshlab_svbrdf.samples.luminance import decode

LIGHTS = [lamp([0.3, 0.5, 0.8]), lamp([-0.8, 0.3, 0.3]), lamp([0.1, -0.6, -0.8])]
RADIUS, FX = 0.5, 220.0


def small_ball(count):
    unit_ball = ball(count)
    return free_texels(RADIUS * unit_ball.position, unit_ball.normal)


def seen_at(texels, camera, shift):
    """The texels of the small ball that `shift` (2,) pixels beside the given ones show; and NaN."""
    eye = camera.center
    point = texels.position.astype(float)
    depth = (point - eye) @ camera.R[2]
    ray = unit(point + (depth[:, None] / FX) * (shift @ camera.R[:2]) - eye)
    along = ray @ eye
    root = along**2 - (eye @ eye - RADIUS**2)
    hit = eye + (-along - np.sqrt(np.where(root > 0, root, np.nan)))[:, None] * ray
    return free_texels(hit, hit / RADIUS)


def offsets():
    """Where a sample's light comes from: a box and a tent's variance, on a grid of points."""
    box = (np.arange(5) + 0.5) / 5 - 0.5
    side = np.array([-1, 1]) * np.sqrt(1 / 6)
    axis = np.add.outer(box, side).ravel()
    return np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)


def blurred(texels, cameras, alpha):
    """φ averaged over what each sample's pixels cover, (T, F)."""
    out = np.zeros((len(texels), len(cameras)))
    for f, camera in enumerate(cameras):
        shifted = [seen_at(texels, camera, s) for s in offsets()]
        out[:, f] = np.mean([lobes(x, [camera], LIGHTS, alpha)[:, 0] for x in shifted], 0)
    return out


def test_spread_is_that_of_box_and_bilinear_weights():
    box, a = np.linspace(-0.5, 0.5, 100001), np.linspace(0, 1, 100001)
    assert np.mean(box**2) + np.mean(a * (1 - a)) == pytest.approx(SPREAD, rel=1e-4)
    assert offsets()[:, 0].var() == pytest.approx(SPREAD, rel=0.02)


def test_is_the_variance_of_the_mirror_directions_within_a_pixel(tmp_path):
    texels, cameras = small_ball(400), orbit(8, fx=FX)
    facing = np.full((400, 8), 127, np.uint8)
    o = observations_of(tmp_path, np.zeros((400, 8, 3)), facing, texels, cameras)
    n = texels.normal.astype(float)
    exact = ((np.eye(3) - n[:, :, None] * n[:, None, :]) / RADIUS).astype(np.float32)
    blur = collect(replace(o, shape=exact), np.arange(400), np.zeros(400)).blur.reshape(400, 8, 4)
    for f, camera in enumerate(cameras):
        mirrors = []
        for shift in offsets():
            at = seen_at(texels, camera, 0.1 * shift)
            v = unit(camera.center - at.position.astype(float))
            m = at.normal.astype(float)
            mirrors.append(2 * np.sum(m * v, -1, keepdims=True) * m - v)
        away = (np.array(mirrors) - np.mean(mirrors, 0)).transpose(1, 2, 0)
        covariance = away @ away.transpose(0, 2, 1) / len(mirrors) / 0.1**2
        v = unit(camera.center - texels.position.astype(float))
        # Away from the middle of the image a pixel subtends a little less
        sure = (np.sum(n * v, -1) > 0.4) & np.isfinite(covariance[:, 0, 0])
        least, most = np.linalg.eigvalsh(covariance[sure])[:, 1:].T
        axis, across = blur[sure, f, :3].astype(float), blur[sure, f, 3]
        along = np.sum(axis**2, -1)
        np.testing.assert_allclose(along, most, rtol=0.1)
        np.testing.assert_allclose(across, least, rtol=0.1)
        told = np.einsum("ta,tab,tb->t", axis, covariance[sure], axis) / along
        np.testing.assert_allclose(told, most, rtol=0.02)
        assert np.median(along / most) == pytest.approx(1, abs=0.05)
    assert not collect(o, np.arange(400), np.zeros(400)).blur.any()
    unknown = replace(o, shape=np.full((400, 3, 3), np.nan, np.float32))
    assert not collect(unknown, np.arange(400), np.zeros(400)).blur.any()


def test_the_fit_sees_through_the_blur(tmp_path):
    """A lobe so sharp that pixels take a fifth off its height; the fit that is told finds it."""
    texels, cameras = small_ball(1500), orbit(120, turns=4, climb=120, fx=FX)
    rho, alpha = 40.0, 150.0
    scene = film(tmp_path / "a", texels, cameras, LIGHTS, np.zeros(1500, int), [0.0], [1.0],
                 np.full((1500, 3), 10.0))  # fmt: skip
    phi = np.nan_to_num(blurred(texels, cameras, alpha))
    quality = scene.observations.store.read(0, 1500)
    seen = np.zeros(phi.shape, np.uint8)
    owner = np.repeat(np.arange(1500), np.diff(quality.offsets))
    seen[owner, quality.frame] = quality.quality
    o = observations_of(tmp_path / "b", grey(10.0 + rho * phi), seen, texels, cameras)
    o = replace(o, shape=surface_shape(texels.position, texels.normal))
    material, turn = np.zeros(1500, np.int32), np.full(1500, 1.0)
    told = fit(o, material, LIGHTS, turn, 0.02).materials[0]
    untold = fit(replace(o, shape=None), material, LIGHTS, turn, 0.02).materials[0]
    assert untold.rho_s < 0.9 * rho
    assert untold.alpha < 0.9 * alpha
    assert told.rho_s == pytest.approx(rho, rel=0.03)
    assert told.alpha == pytest.approx(alpha, rel=0.03)

    # Nor is what pixels show beside the lobe left in the diffuse colour
    matt = 100 * decode(grey(np.array(10.0))[0] / 255)  # what the code of 10 stands for
    gloss, start = phong_gloss([rho], [alpha]), np.full((1500, 3), 10.0)
    errors = []
    for shape in (o.shape, None):
        seen_as = replace(o, shape=shape)
        work = refitting(seen_as, start, material, gloss, np.ones((1, 3)), LIGHTS)
        errors.append(o.store.rows(work)[0][:, 1] - matt)
    assert abs(errors[0].mean()) < 0.1 * abs(errors[1].mean())
    assert errors[0].std() < 0.5 * errors[1].std()


@pytest.mark.parametrize("times", [1.0, 2.5])
def test_the_fit_finds_how_far_a_film_is_blurred(tmp_path, times):
    """Where a surface has flatter and steeper places, and a lens may add to the pixels' blur."""
    texels, cameras = bumpy_ball(1500, 0.1), orbit(120, turns=4, climb=120, fx=100.0)
    everywhere, material = np.arange(1500), np.zeros(1500, np.int32)
    scene = film(tmp_path / "a", texels, cameras, LIGHTS, material, [0.0], [1.0],
                 np.full((1500, 3), 10.0))  # fmt: skip
    shape = surface_shape(texels.position, texels.normal)
    o = replace(scene.observations, shape=shape)
    samples = collect(o, everywhere, material).blurred(times)
    rays, gains = light_texels(o.view, everywhere, lamps(LIGHTS, 1.0))
    block = o.store.read(0, 1500)
    owner = np.repeat(everywhere, np.diff(block.offsets))
    phi, seen = np.zeros((1500, 120)), np.zeros((1500, 120), np.uint8)
    seen[owner, block.frame] = block.quality
    scratch, lobe = np.empty((13, 120), np.float32), np.zeros(len(owner), np.float32)
    for t in everywhere:
        first, stop = block.offsets[t], block.offsets[t + 1]
        add_blurred(samples.mirror, samples.blur, first, stop - first, rays[t], gains[t], 100.0,
                    scratch, lobe[first:stop])  # fmt: skip
    phi[owner, block.frame] = lobe
    o = observations_of(tmp_path / "b", grey(10.0 + 50.0 * phi), seen, texels, cameras)
    found = fit(replace(o, shape=shape), material, LIGHTS, np.full(1500, 1.0), 0.02, lens=True)
    assert found.materials[0].rho_s == pytest.approx(50, rel=0.02)
    assert found.materials[0].alpha == pytest.approx(100, rel=0.02)
    told = [float(note.split()[3]) for note in found.notes]
    assert told == ([] if times == 1 else [pytest.approx(times, rel=0.1)])
