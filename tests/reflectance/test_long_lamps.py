"""Rows and grids of points: what long and wide lamps are, and how their sizes are found."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, bumpy_ball, film, lamp, orbit, unit

from meshlab_svbrdf.reflectance.joint import fit
from meshlab_svbrdf.reflectance.lights import Light, tangents
from meshlab_svbrdf.reflectance.long_lamps import as_seen, blob_axes, fit_lengths
from meshlab_svbrdf.reflectance.missed_lights import complete_lights
from meshlab_svbrdf.reflectance.phong import COARSER, SPACING, lamps

T, F = 2500, 160
HALF = np.radians(14)


def tube(direction, turn: float, half: float = HALF, gain: float = 1.0, curvature: float = 0.0):
    """A long lamp, and the blob that it would show: a bar's variance with a lobe's around it."""
    direction = unit(np.array(direction, float))
    along = np.array([np.cos(turn), np.sin(turn)])
    covariance = half**2 / 3 * np.outer(along, along) + 0.05**2 * np.eye(2)
    return Light(direction, covariance, gain, curvature, bar=half * along @ tangents(direction))


def points_of(lights):
    """The long and wide lamps as many compact ones, in numpy: each sends light by its cosine."""
    rows = []
    for light in lights:
        across = unit(np.cross(light.direction, light.bar)) * light.breadth
        places = np.linspace(-1, 1, 41)[1::2]
        sides = places if light.breadth else [0.0]
        points = [light.direction + x * light.bar + y * across for x in places for y in sides]
        r = np.linalg.norm(points, axis=1)
        share = light.gain / np.sum(r**-4.0)
        rows += [
            lamp(d / n, share / n**3, light.curvature / n) for d, n in zip(points, r, strict=True)
        ]
    return rows


def window(direction, turn: float, half=(0.35, 0.2), gain=1.0, curvature=0.0):
    """A wide lamp, and a blob that is too small, as a threshold makes it."""
    light = tube(direction, turn, half[0], gain, curvature)
    return replace(light, breadth=half[1], covariance=0.12**2 * np.eye(2))


def facing(points, owner: int) -> float:
    """What a surface at the centre that faces a lamp receives from its points."""
    own = points.light == owner
    return float(np.sum(points.gain[own] / np.linalg.norm(points.direction[own], axis=1) ** 3))


def test_points_share_the_gain_and_lie_close():
    light = tube([0.2, 0.3, 0.9], 0.7, gain=1.7)
    points = lamps([lamp([1, 0, 0]), light], 1.0)
    own = points.light == 1
    assert facing(points, 0) == pytest.approx(1)
    assert facing(points, 1) == pytest.approx(1.7)
    np.testing.assert_allclose(points.direction[own].mean(0), light.direction)
    steps = np.linalg.norm(np.diff(points.direction[own], axis=0), axis=1)
    assert (steps <= SPACING + 1e-12).all()
    assert (points.light == 0).sum() == 1


def test_a_wide_lamps_points_lie_on_its_plate():
    light = window([0.2, 0.3, 0.9], 0.7, gain=1.7)
    points = lamps([light], 1.0)
    assert facing(points, 0) == pytest.approx(1.7)
    away = points.direction - light.direction
    np.testing.assert_allclose(away @ light.direction, 0, atol=1e-12)
    np.testing.assert_allclose(away @ unit(light.bar), points.along * 0.35, atol=1e-12)
    np.testing.assert_allclose(away @ light.side, points.across * 0.2, atol=1e-12)
    apart = np.linalg.norm(away[:, None] - away[None], axis=-1) + 9 * np.eye(len(away))
    assert apart.min(0).max() <= COARSER * SPACING + 1e-12
    assert light.side @ light.bar == pytest.approx(0, abs=1e-12)


def test_the_axes_are_the_bars_of_the_blobs_variance():
    light = tube([0.2, 0.3, 0.9], 0.7)
    major, minor = blob_axes(light)
    assert abs(unit(major) @ unit(light.bar)) == pytest.approx(1, abs=1e-6)
    assert np.linalg.norm(major) == pytest.approx(np.sqrt(HALF**2 + 3 * 0.05**2), rel=1e-6)
    assert np.linalg.norm(minor) == pytest.approx(np.sqrt(3) * 0.05, rel=1e-6)
    assert abs(minor @ major) < 1e-12


def test_the_length_is_where_least_is_left():
    light = replace(tube([0.2, 0.3, 0.9], 0.7), bar=np.zeros(3))
    axis = blob_axes(light)[0]

    def unexplained(lights):
        length = float(lights[0].bar @ axis / (axis @ axis))
        return 10 + (length - 0.83) ** 2 + lights[0].breadth

    (found,) = fit_lengths([light], unexplained)
    np.testing.assert_allclose(found.bar, 0.83 * axis, rtol=1e-6)
    (same,) = fit_lengths([light], lambda lights: 10 + 1e-6 * float(lights[0].bar @ lights[0].bar))
    assert not same.bar.any()


def test_a_plate_is_where_least_is_left():
    """The blob is round: both sides grow together; a size that a light has stays if it serves."""
    light = replace(window([0.2, 0.3, 0.9], 0.7), bar=np.zeros(3), breadth=0.0)
    half = np.sqrt(3) * 0.12

    def unexplained(lights):
        return 10 + 20 * (np.linalg.norm(lights[0].bar) - 0.3) ** 2

    (found,) = fit_lengths([light], unexplained)
    assert found.breadth == pytest.approx(0.3, rel=1e-6)
    assert np.linalg.norm(found.bar) == pytest.approx(0.3, rel=1e-6)
    assert fit_lengths([found], unexplained) == [found]
    (gone,) = fit_lengths([found], lambda lights: 10 + np.linalg.norm(lights[0].bar) / half)
    assert gone.breadth == 0
    assert not gone.bar.any()


def test_a_round_highlight_that_a_plate_hardly_explains_better_is_a_compact_lamps():
    light = lamp([0.2, 0.3, 0.9], spread=0.1)
    (found,) = fit_lengths([light], lambda lights: 10 - 0.1 * lights[0].breadth)
    assert found is not None
    assert found.breadth == 0


def test_as_seen_is_the_lobe_itself_under_compact_lamps():
    assert as_seen(40.0, 90.0, [lamp([0, 0, 1]), lamp([0, 1, 0])]) == (40.0, 90.0)
    rho_s, alpha = as_seen(40.0, 90.0, [tube([0, 0, 1], 0.0)])
    assert alpha == pytest.approx(1 / (1 / 90 + HALF**2 / 6))
    assert rho_s / alpha == pytest.approx(40 / 90)


def test_joint_fit_finds_tubes(tmp_path):
    """Three tubes that were taken for compact lamps: their bars within a degree and a half."""
    truth = [
        tube([0.3, 0.5, 0.8], 0.4),
        tube([-0.8, 0.3, 0.3], 1.3),
        tube([0.1, -0.6, -0.8], 2.2),
    ]
    texels = bumpy_ball(T)
    scene = film(
        tmp_path, texels, orbit(F, turns=4, climb=120), points_of(truth),
        np.zeros(T, np.int32), [40.0], [150.0], np.full((T, 3), 12.0), noise=1.0, seed=3,
    )  # fmt: skip
    start = [replace(light, bar=np.zeros(3)) for light in truth]
    args = (scene.observations, scene.material, start, np.full(T, 1.5), 0.005)
    found, round_lamps = fit(*args), fit(*args, long=False)
    for light, true in zip(found.lights, truth, strict=True):
        error = min(np.linalg.norm(light.bar - true.bar), np.linalg.norm(light.bar + true.bar))
        assert np.degrees(error) < 1.5
    (material,) = found.materials
    assert abs(np.log(material.alpha / 150)) < 0.1
    assert abs(np.log(material.rho_s / 40)) < 0.1
    assert round_lamps.materials[0].alpha < 0.6 * 150


def test_joint_fit_finds_a_window(tmp_path):
    """A window and a lamp that were taken for two lamps: its sides within a degree."""
    truth = [window([0.3, 0.5, 0.8], 0.4, curvature=0.15), lamp([-0.8, 0.3, 0.3], 1.1, 0.1, 0.05)]
    texels = bumpy_ball(T)
    rng = np.random.default_rng(2)
    scene = film(
        tmp_path, texels, orbit(F, turns=4, climb=120), points_of(truth[:1]) + truth[1:],
        rng.integers(0, 2, T), [60.0, 30.0], [150.0, 20.0], np.full((T, 3), 8.0), noise=1.0,
    )  # fmt: skip
    start = [replace(g, bar=np.zeros(3), breadth=0.0, gain=1.0, curvature=0.0) for g in truth]
    args = (scene.observations, scene.material)
    lights, *_ = complete_lights(*args, start, np.full(T, 1.5), 0.005, samples=1_000_000)
    found = fit(*args, lights, np.full(T, 1.5), 0.005, samples=1_000_000)
    wide = found.lights[0]
    assert len(found.lights) == 2
    assert angle(wide.direction, truth[0].direction) < 0.3
    assert np.degrees(abs(np.linalg.norm(wide.bar) - 0.35)) < 1
    assert np.degrees(abs(wide.breadth - 0.2)) < 1
    assert wide.gain / found.lights[1].gain == pytest.approx(1 / 1.1, rel=0.03)
    assert found.lights[1].breadth == 0
    for material, alpha in zip(found.materials, (150, 20), strict=True):
        assert abs(np.log(material.alpha / alpha)) < 0.05
