"""Rows of points: what a long lamp is, and how its length is found."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import bumpy_ball, film, lamp, orbit, unit

from meshlab_svbrdf.reflectance.joint import fit
from meshlab_svbrdf.reflectance.lights import Light, tangents
from meshlab_svbrdf.reflectance.long_lamps import as_seen, fit_lengths, long_axis
from meshlab_svbrdf.reflectance.phong import SPACING, lamps

T, F = 2500, 160
HALF = np.radians(14)


def tube(direction, turn: float, half: float = HALF, gain: float = 1.0, curvature: float = 0.0):
    """A long lamp, and the blob that it would show: a bar's variance with a lobe's around it."""
    direction = unit(np.array(direction, float))
    along = np.array([np.cos(turn), np.sin(turn)])
    covariance = half**2 / 3 * np.outer(along, along) + 0.05**2 * np.eye(2)
    return Light(direction, covariance, gain, curvature, bar=half * along @ tangents(direction))


def points_of(lights):
    """The long lamps as many compact ones, in numpy."""
    rows = []
    for light in lights:
        for x in np.linspace(-1, 1, 41)[1::2]:
            d = light.direction + x * light.bar
            r = np.linalg.norm(d)
            rows.append(lamp(d / r, light.gain / 20 / r**2, light.curvature / r))
    return rows


def test_points_share_the_gain_and_lie_close():
    light = tube([0.2, 0.3, 0.9], 0.7, gain=1.7)
    points = lamps([lamp([1, 0, 0]), light], 1.0)
    own = points.light == 1
    assert points.gain[own].sum() == pytest.approx(1.7)
    np.testing.assert_allclose(points.direction[own].mean(0), light.direction)
    steps = np.linalg.norm(np.diff(points.direction[own], axis=0), axis=1)
    assert (steps <= SPACING + 1e-12).all()
    assert (points.light == 0).sum() == 1


def test_the_axis_is_the_bar_of_the_blobs_variance():
    light = tube([0.2, 0.3, 0.9], 0.7)
    axis = long_axis(light)
    assert axis is not None
    assert abs(unit(axis) @ unit(light.bar)) == pytest.approx(1, abs=1e-6)
    assert np.linalg.norm(axis) == pytest.approx(np.sqrt(HALF**2 + 3 * 0.05**2), rel=1e-6)
    assert long_axis(replace(light, covariance=np.eye(2) * 0.01)) is None


def test_the_length_is_where_least_is_left():
    light = replace(tube([0.2, 0.3, 0.9], 0.7), bar=np.zeros(3))
    axis = long_axis(light)

    def unexplained(lights):
        length = float(lights[0].bar @ axis / (axis @ axis))
        return 10 + (length - 0.83) ** 2

    (found,) = fit_lengths([light], unexplained)
    np.testing.assert_allclose(found.bar, 0.83 * axis, rtol=1e-6)
    (same,) = fit_lengths([light], lambda lights: 10 + 1e-6 * float(lights[0].bar @ lights[0].bar))
    assert not same.bar.any()


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
