"""Lights in maps that are known: discs on the pole and on the seam, none, one, twenty."""

import numpy as np
import pytest
from analytic import angle, unit
from hypothesis import given, settings
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance.directions import directions, solid_angles
from meshlab_svbrdf.reflectance.environment import EnvironmentMap
from meshlab_svbrdf.reflectance.lights import (
    Light,
    blob_light,
    lights_by_median_cut,
    lights_by_peaks,
    median_cut,
    tangents,
)

H = 64
D = directions(H)
UNIT = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3).map(unit)
POLES_AND_SEAM = [(0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0.6, -0.8), (0, 0.999, -0.04)]


def world(radiance):
    radiance = np.asarray(radiance, float)
    top = radiance.max()
    return EnvironmentMap(radiance, radiance / top if top > 0 else radiance, np.ones_like(radiance))


def gauss(direction, sigma=4.0, height=50.0):
    return height * np.exp(-0.5 * (angle(D, unit(direction)) / sigma) ** 2)


@given(UNIT)
def test_tangents_are_a_right_handed_frame(d):
    a, b = tangents(d)
    np.testing.assert_allclose(np.array([a, b, d]) @ np.array([a, b, d]).T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(np.cross(a, b), d, atol=1e-9)


@pytest.mark.parametrize("z", [1.0, -1.0])
def test_tangents_at_the_poles_of_their_formula(z):
    np.testing.assert_allclose(np.cross(*tangents(np.array([0, 0, z]))), [0, 0, z])
    np.testing.assert_allclose(np.cross(*tangents(np.array([1, 0, np.copysign(0, z)]))), [1, 0, 0])


@pytest.mark.parametrize("direction", POLES_AND_SEAM)
def test_centroid_of_a_symmetric_blob_is_its_centre(direction):
    (light,) = lights_by_peaks(world(gauss(direction)))
    assert angle(light.direction, unit(direction)) < 0.25


@settings(max_examples=30)
@given(UNIT)
def test_centroid_anywhere_is_within_a_quarter_of_a_pixel(direction):
    (light,) = lights_by_peaks(world(gauss(direction)))
    assert angle(light.direction, direction) < 0.25 * 180 / H


def test_centroid_at_the_pole_is_exact():
    """By symmetry, whatever the map's resolution."""
    (light,) = lights_by_peaks(world(gauss((0, 1, 0))))
    np.testing.assert_allclose(light.direction, [0, 1, 0], atol=1e-12)


def test_centroid_on_the_seam_is_exact_across_it():
    (light,) = lights_by_peaks(world(gauss((0, 0.3, -1))))
    assert abs(light.direction[0]) < 1e-12


@pytest.mark.parametrize("shift", [1, 17, 64, 127])
def test_turning_the_map_turns_the_light(shift):
    radiance = gauss((0.3, 0.5, -0.2))
    (a,) = lights_by_peaks(world(radiance))
    (b,) = lights_by_peaks(world(np.roll(radiance, shift, 1)))
    phi = np.pi * shift / H
    turn = np.array([[np.cos(phi), 0, -np.sin(phi)], [0, 1, 0], [np.sin(phi), 0, np.cos(phi)]])
    np.testing.assert_allclose(b.direction, turn @ a.direction, atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(b.covariance), np.linalg.eigvalsh(a.covariance), rtol=1e-9
    )
    assert b.energy == pytest.approx(a.energy)


def test_upside_down():
    radiance = gauss((0.3, 0.5, -0.2))
    (a,) = lights_by_peaks(world(radiance))
    (b,) = lights_by_peaks(world(radiance[::-1]))
    np.testing.assert_allclose(b.direction, a.direction * [1, -1, 1], atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_brightness_only_scales_energy(scale):
    radiance = gauss((0.3, 0.5, -0.2)) + gauss((0, -1, 0.3), height=30)
    for a, b in zip(
        lights_by_peaks(world(radiance)), lights_by_peaks(world(scale * radiance)), strict=True
    ):
        np.testing.assert_allclose(b.direction, a.direction, atol=1e-12)
        np.testing.assert_allclose(b.covariance, a.covariance, atol=1e-12)
        assert b.energy == pytest.approx(scale * a.energy)


def test_covariance_of_an_even_disc_is_a_quarter_of_its_radius_squared():
    for direction in POLES_AND_SEAM:
        radius = 12.0
        (light,) = lights_by_peaks(world(10.0 * (angle(D, unit(direction)) < radius)))
        expected = np.radians(radius) ** 2 / 4
        np.testing.assert_allclose(np.linalg.eigvalsh(light.covariance), expected, rtol=0.12)


def test_covariance_of_a_bar_shows_its_axis():
    d = unit([0.1, 0.2, 0.9])
    frame = tangents(d)
    flat = np.einsum("hwc,tc->hwt", D, frame)
    bar = (np.abs(flat[..., 0]) < 0.3) & (np.abs(flat[..., 1]) < 0.05) & (D @ d > 0)
    (light,) = lights_by_peaks(world(10.0 * bar))
    values, vectors = np.linalg.eigh(light.covariance)
    assert abs(vectors[:, 1] @ (tangents(light.direction) @ frame[0])) > 0.99
    assert values[1] > 8 * values[0]


def test_blob_of_one_pixel_is_not_singular():
    radiance = np.zeros((H, 2 * H))
    radiance[20, 5] = 9.0
    (light,) = lights_by_peaks(world(radiance))
    np.testing.assert_allclose(light.direction, D[20, 5], atol=1e-12)
    np.testing.assert_allclose(light.covariance, np.eye(2) * (np.pi / H) ** 2 / 12, atol=1e-12)


def test_blob_projects_only_what_is_before_it():
    """A stray direction behind the centroid would be projected to infinity."""
    rays = unit([[0, 0, 1], [0.02, 0, 1], [0, 0.02, 1], [1, 0, -0.5]])
    light = blob_light(rays, np.array([10, 10, 10, 0.1]), 0.01)
    assert np.linalg.eigvalsh(light.covariance).max() < 0.01


@pytest.mark.parametrize("find", [lights_by_peaks, lights_by_median_cut])
def test_no_light(find):
    dark = np.zeros((H, 2 * H))
    assert find(world(dark)) == []
    assert find(EnvironmentMap(dark + 1, dark, dark)) == []


def test_what_no_sample_mirrors_is_no_light():
    """Radiance where the weight is 0 does not count, nor do its zeros in the percentile."""
    radiance = gauss((0.3, 0.5, -0.2))
    seen = radiance > 1.0
    whole = lights_by_peaks(EnvironmentMap(radiance, radiance, seen.astype(float)))
    assert len(whole) == 1
    assert lights_by_peaks(EnvironmentMap(radiance, radiance, np.zeros_like(radiance))) == []
    # A pixel as bright as the lamp that no sample reached
    unreached = radiance + 40.0 * (np.arange(H)[:, None] == 50) * (np.arange(2 * H)[None] == 20)
    assert (
        len(
            lights_by_peaks(
                EnvironmentMap(unreached, radiance, seen.astype(float)), minimum_energy=0
            )
        )
        == 1
    )


def test_one_noisy_pixel_sets_no_scale():
    """The level is a share of the 99.95th percentile: a wide light outlives a brighter pixel."""
    radiance = gauss((0.3, 0.5, -0.2), sigma=6, height=20)
    radiance[5, 100] = 1e4
    lights = lights_by_peaks(world(radiance), minimum_energy=0)
    assert len(lights) == 2


def test_twenty_lights_are_found_and_ranked():
    k = np.arange(20)
    y = 1 - 2 * (k + 0.5) / 20
    phi = np.pi * (1 + 5**0.5) * k
    s = np.sqrt(1 - y**2)
    where = np.column_stack([s * np.sin(phi), y, s * np.cos(phi)])
    heights = 40 + k
    lights = lights_by_peaks(
        world(sum(gauss(d, 3, h) for d, h in zip(where, heights, strict=True)))
    )
    assert len(lights) == 20
    energies = [light.energy for light in lights]
    assert energies == sorted(energies, reverse=True)
    for light in lights:
        assert angle(light.direction, where).min() < 1


def test_lights_below_a_share_of_the_strongest_are_dropped():
    radiance = gauss((0, 1, 0), 10) + gauss((1, 0, 0), 2)
    assert len(lights_by_peaks(world(radiance), minimum_energy=0.05)) == 1
    assert len(lights_by_peaks(world(radiance), minimum_energy=0.01)) == 2


def test_level_parts_what_touches_below_it():
    radiance = gauss((0.12, 0, 1)) + gauss((-0.12, 0, 1))
    assert len(lights_by_peaks(world(radiance), level=0.3)) == 1
    assert len(lights_by_peaks(world(radiance), level=0.8)) == 2


@pytest.mark.parametrize(
    ("pixels", "count"),
    [
        ([(30, 0), (31, 127)], 1),  # touching diagonally across the seam
        ([(31, 0), (30, 127)], 1),
        ([(30, 0), (30, 127)], 1),
        ([(30, 0), (32, 127)], 2),
        ([(30, 5), (31, 6)], 1),
        ([(30, 5), (30, 7)], 2),
        ([(0, 10), (0, 70)], 1),  # touching at the pole
        ([(63, 10), (63, 70)], 1),
        ([(1, 10), (1, 70)], 2),
    ],
)
def test_pixels_join_over_seam_and_poles(pixels, count):
    radiance = np.zeros((H, 2 * H))
    for row, col in pixels:
        radiance[row, col] = 1.0
    assert len(lights_by_peaks(world(radiance), minimum_energy=0)) == count


def test_light_from_everywhere_has_no_made_up_direction():
    """An even sky has no centroid: the directions cancel, and what is left is rounding."""
    assert lights_by_peaks(world(np.full((H, 2 * H), 7.0))) == []


@settings(max_examples=15)
@given(st.integers(0, 99), st.sampled_from([1, 2, 16, 64, 500]))
def test_median_cut_is_a_partition(seed, count):
    rng = np.random.default_rng(seed)
    energy = rng.random((16, 32)) ** 8
    energy[rng.random(energy.shape) < 0.5] = 0
    regions = median_cut(energy, count)
    covered = np.zeros(energy.shape, int)
    for top, bottom, left, right in regions:
        assert bottom > top
        assert right > left
        covered[top:bottom, left:right] += 1
    np.testing.assert_array_equal(covered, 1)
    assert len(regions) >= min(count, 256)


@pytest.mark.parametrize("count", [4, 16, 64])
def test_median_cut_halves_energy_to_within_a_line_of_pixels(count):
    """Of an even sky, every region gets a like share."""
    energy = np.repeat(solid_angles(256)[:, :1], 512, 1)
    shares = [energy[t:b, l:r].sum() for t, b, l, r in median_cut(energy, count)]
    assert len(shares) == count
    np.testing.assert_allclose(shares, 4 * np.pi / count, rtol=0.1)


def test_median_cut_stops_at_pixels():
    assert len(median_cut(np.ones((2, 4)), 100)) == 8


def test_median_cut_lights_find_two_discs():
    """The letter: on a black ground its lights are the discs."""
    where = unit([[0.3, 0.5, 0.8], [-0.6, -0.2, -0.7]])
    radiance = sum(10.0 * (angle(D, d) < 6) for d in where)
    lights = lights_by_median_cut(world(radiance), 1024)
    assert len(lights) == 2
    for light in lights:
        assert angle(light.direction, where).min() < 1


def test_position_is_at_the_distance_in_radii():
    light = Light(unit([0, 3, 4]), np.eye(2), curvature=0.25)
    np.testing.assert_allclose(light.position(np.array([1, 2, 3.0]), 2.0), [1, 2 + 4.8, 3 + 6.4])
    assert Light(unit([0, 3, 4]), np.eye(2)).position(np.zeros(3), 2.0) is None
