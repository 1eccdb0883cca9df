"""Specular parameters of single texels: the exact inverse of the forward model, and every guard."""

import numpy as np
import pytest
from analytic import ball, film, free_texels, grey, lamp, look_at, observations_of, orbit, unit
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance.specular import (
    FARTHEST,
    GAP,
    mahalanobis2,
    shapes,
    solve_peak,
    texel_specular,
)
from meshlab_svbrdf.samples.luminance import REC709, decode

EXTREMES = [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-300, 1e300]


# Eq. 7


def excess(rho, alpha, d2, variance):
    return rho * (1 + d2 * variance) ** (-alpha / 2)


@given(
    st.floats(3.1, 999), st.floats(1.01, 1999), st.floats(0, 6), st.floats(0.01, 30),
    st.floats(1e-5, 0.3),
)  # fmt: skip
def test_inverts_the_forward_model(rho, alpha, d2_max, further, variance):
    """Whatever the guards let through is exact; what they stop fails one of them."""
    d2_min = d2_max + further
    high, low = (excess(rho, alpha, d2, variance) for d2 in (d2_max, d2_min))
    found = solve_peak(high, low, d2_max, d2_min, variance)
    if np.isnan(found[0]):
        ln_ratio = 0.5 * np.log((1 + d2_min * variance) / (1 + d2_max * variance))
        assert high <= 3 or low <= 0.5 or high / low <= 1.3 or ln_ratio <= 1.0001e-4
    else:
        assert found[0] == pytest.approx(rho, rel=1e-6)
        assert found[1] == pytest.approx(alpha, rel=1e-6)


GOOD = {"rho": 40.0, "alpha": 60.0, "d2_max": 0.2, "d2_min": 2.0, "variance": 0.01}


def solve(excess_max=None, excess_min=None, **kw):
    v = GOOD | kw
    high = excess(v["rho"], v["alpha"], v["d2_max"], v["variance"])
    low = excess(v["rho"], v["alpha"], v["d2_min"], v["variance"])
    return solve_peak(
        high if excess_max is None else excess_max, low if excess_min is None else excess_min,
        v["d2_max"], v["d2_min"], v["variance"],
    )  # fmt: skip


def test_the_good_peak_is_good():
    np.testing.assert_allclose(solve(), [40, 60], rtol=1e-12)


@pytest.mark.parametrize(
    "bad",
    [
        {"rho": 2.9},  # E_max ≤ 3
        {"excess_min": 0.5},  # E_min ≤ .5
        {"excess_min": 0.0},
        {"excess_min": -1.0},
        {"alpha": 20.0, "d2_min": 0.5},  # E_max / E_min ≤ 1.3
        {"alpha": 1999.0, "variance": 1e-5, "d2_min": 0.21},  # |ln cos ratio| ≤ 1e-4
        {"excess_min": 20.0, "d2_min": 0.2},  # the same direction
        {"excess_max": 6.0, "excess_min": 4.0, "d2_min": 1e4},  # α ≤ 1
        {"excess_max": 90.0, "excess_min": 1.0, "variance": 1e-3},  # α ≥ 2000
        {"d2_max": 3.0, "d2_min": 0.5},  # α < 0: brighter farther away
        {"rho": 1001.0},  # ρs ≥ 1000
    ],
)
def test_guards(bad):
    assert np.isnan(solve(**bad)).all()


def test_without_its_guards_the_shiny_end_would_explode():
    """ρs = E_max / cos_max^α: a peak far from the light with a steep slope."""
    found = solve_peak(50.0, 0.6, 6.2, 6.4, 0.3)
    assert np.isnan(found).all()
    alpha = np.log(50 / 0.6) / (0.5 * np.log((1 + 6.4 * 0.3) / (1 + 6.2 * 0.3)))
    assert 1 < alpha < 2000
    assert 50 * (1 + 6.2 * 0.3) ** (alpha / 2) > 1e40


@given(*[st.sampled_from(EXTREMES)] * 5)
def test_extremes_give_no_invented_number(high, low, d2_max, d2_min, variance):
    rho, alpha = solve_peak(high, low, d2_max, d2_min, variance)
    assert np.isnan(rho) == np.isnan(alpha)
    if not np.isnan(rho):
        assert 3 < high < np.inf
        assert 0 < rho < 1000
        assert 1 < alpha < 2000
        assert not np.isnan([low, d2_max, d2_min, variance]).any()


@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_distance_from_a_round_light_is_the_tangent_over_sigma(u, v):
    light = lamp([0.3, -0.5, 0.7], spread=0.05)
    table = shapes([light])
    d = unit(light.direction + u * table.frame[0, 0] + v * table.frame[0, 1])
    assert mahalanobis2(*d, 0, table) == pytest.approx(
        (u * u + v * v) / 0.05**2, rel=1e-6, abs=1e-12
    )


def test_distance_is_infinite_beside_and_behind_the_light():
    table = shapes([lamp([0, 0, 1])])
    assert mahalanobis2(0.0, 0.0, 1.0, 0, table) == 0
    for d in ([0, 0, -1.0], [1, 0, 0.0], unit([1, 0, 0.1])):
        assert mahalanobis2(*d, 0, table) == np.inf


def test_distance_follows_the_ellipse():
    long = lamp([0, 0, 1])
    table = shapes([type(long)(long.direction, np.diag([0.04, 0.01]))])
    a, b = table.frame[0]
    for step, expected in ((a, 0.2**2 / 0.04), (b, 0.2**2 / 0.01)):
        assert mahalanobis2(*unit(long.direction + 0.2 * step), 0, table) == pytest.approx(expected)
    assert table.least[0] == pytest.approx(0.01)
    assert table.most[0] == pytest.approx(0.04)


# Peaks in time: one texel at the origin that faces the light; a camera at angle θ mirrors at −θ

SPREAD, RHO, ALPHA, GROUND = 0.1, 50.0, 40.0, 10.0
LIGHT = [lamp([0, 0, 1], spread=SPREAD)]


def one_texel(folder, degrees, *, codes=None, quality=None, sequence=None, order=None, **kw):
    """A texel filmed from the angles `degrees` (NaN: not seen), its samples a Phong lobe."""
    degrees = np.asarray(degrees, float)
    theta = np.radians(np.nan_to_num(degrees))
    cameras = [look_at([3 * np.sin(a), 0, 3 * np.cos(a)]) for a in theta]
    if codes is None:
        codes = grey(GROUND + RHO * np.cos(theta) ** ALPHA)
    quality = np.full(len(theta), 127) if quality is None else np.asarray(quality)
    quality = np.where(np.isnan(degrees), 0, quality)
    texels = free_texels([[0, 0, 0]], [[0, 0, 1]])
    o = observations_of(
        folder, codes[None], quality[None], texels, cameras, sequence=sequence, order=order
    )
    ground = 100 * decode(grey(GROUND) / 255) @ REC709
    found = texel_specular(o, np.atleast_1d(ground), LIGHT, **kw)
    return found.rho_s[0], found.alpha[0], found.distance[0], found.light[0]


SWEEP = np.arange(-20, 21, 2.0)


def test_a_sweep_over_a_light_gives_its_lobe(tmp_path):
    rho, alpha, distance, light = one_texel(tmp_path, SWEEP)
    assert rho == pytest.approx(RHO, rel=0.01)
    assert alpha == pytest.approx(ALPHA, rel=0.03)
    assert distance < 0.01
    assert light == 0


def test_the_least_of_the_peak_is_another_sample_of_the_same_lobe(tmp_path):
    _, alpha, _, _ = one_texel(tmp_path, SWEEP, c_min="least")
    assert alpha == pytest.approx(ALPHA, rel=0.1)


def test_farthest_point_of_the_ellipse_makes_the_lobe_wider(tmp_path):
    """With a long light the two points differ: the farthest has the largest variance."""
    long = [type(LIGHT[0])(LIGHT[0].direction, np.diag([0.04, 0.01]))]
    texels = free_texels([[0, 0, 0]], [[0, 0, 1]])
    cameras = [look_at([3 * np.sin(a), 0, 3 * np.cos(a)]) for a in np.radians(SWEEP)]
    codes = grey(GROUND + RHO * np.cos(np.radians(SWEEP)) ** ALPHA)[None]
    o = observations_of(tmp_path, codes, np.full((1, len(SWEEP)), 127), texels, cameras)
    d = np.array([GROUND])
    near, far = (texel_specular(o, d, long, p=p).alpha[0] for p in ("nearest", "farthest"))
    assert near > 2 * far


PAIR = [0.0, 9.0]
NONE = (True, True, True)


def unknown(found):
    return tuple(np.isnan(found[:3])) == NONE and found[3] == -1


def test_two_consecutive_frames_are_a_peak(tmp_path):
    assert one_texel(tmp_path, PAIR)[1] == pytest.approx(ALPHA, rel=0.05)


def test_peak_ends_with_its_sequence(tmp_path):
    assert unknown(one_texel(tmp_path, PAIR, sequence=[0, 1], order=[0, 0]))
    assert unknown(one_texel(tmp_path / "b", PAIR, sequence=[0, 1], order=[0, 1]))


def test_peak_ends_at_a_frame_that_was_left_out(tmp_path):
    assert unknown(one_texel(tmp_path, PAIR, order=[0, 2]))
    assert not unknown(one_texel(tmp_path / "b", PAIR, order=[5, 6]))


@pytest.mark.parametrize("gap", [0, GAP, GAP + 1, 10])
def test_peak_ends_after_a_gap_of_two(tmp_path, gap):
    """Frames in which the texel is not seen; up to two are bridged."""
    found = one_texel(tmp_path, [0.0, *[np.nan] * gap, 9.0])
    assert unknown(found) == (gap > GAP)


def test_peak_ends_where_the_texel_is_dark(tmp_path):
    codes = grey(np.array([GROUND + RHO, GROUND - 2, GROUND + RHO / 2]))
    assert unknown(one_texel(tmp_path, [0.0, 4, 9], codes=codes))


def test_clipped_samples_are_dropped(tmp_path):
    """The marked top is not the top: the next one is; with both marked there is no peak."""
    codes = grey(GROUND + RHO * np.cos(np.radians(SWEEP)) ** ALPHA)
    top = len(SWEEP) // 2
    codes[top] = 250
    wrong = one_texel(tmp_path / "a", SWEEP, codes=codes)
    quality = np.full(len(SWEEP), 127)
    quality[top] |= 128
    right = one_texel(tmp_path / "b", SWEEP, codes=codes, quality=quality)
    assert wrong[0] > 1.3 * RHO
    assert right[0] == pytest.approx(RHO, rel=0.02)
    assert right[1] == pytest.approx(ALPHA, rel=0.05)
    assert right[2] == pytest.approx(np.tan(np.radians(2)) / SPREAD, rel=1e-3)
    assert unknown(one_texel(tmp_path / "c", PAIR, quality=[255, 255]))


def test_luminance_above_98_is_clipped(tmp_path):
    codes = grey(GROUND + RHO * np.cos(np.radians(SWEEP)) ** ALPHA)
    codes[len(SWEEP) // 2] = 253  # Y = 98.3, below the mark of 254
    assert one_texel(tmp_path, SWEEP, codes=codes)[0] == pytest.approx(RHO, rel=0.02)


def test_of_several_peaks_the_nearest_to_its_light_is_kept(tmp_path):
    """Two sweeps of one texel; the far one sees another lobe."""
    far = np.array([8.0, 10, 12, 14, 16])
    theta = np.radians(np.concatenate([far, SWEEP]))
    alpha = np.where(np.arange(len(theta)) < len(far), 15.0, ALPHA)
    codes = grey(GROUND + RHO * np.cos(theta) ** alpha)
    sequence = (np.arange(len(theta)) >= len(far)).astype(int)
    for order in (slice(None), slice(None, None, -1)):
        found = one_texel(
            tmp_path / str(order.step), np.degrees(theta)[order], codes=codes[order],
            sequence=sequence[order],
        )  # fmt: skip
        assert found[1] == pytest.approx(ALPHA, rel=0.03)
        assert found[2] < 0.01
    alone = one_texel(tmp_path / "far", far, codes=codes[: len(far)])
    assert alone[1] == pytest.approx(15, rel=0.1)


def test_peak_too_far_from_every_light_belongs_to_none(tmp_path):
    start = np.degrees(np.arctan(FARTHEST * SPREAD))
    codes = grey(np.array([60.0, 40, 30, 20]))
    step = np.array([0, 2, 4, 6])
    assert unknown(one_texel(tmp_path / "a", start + 0.5 + step, codes=codes))
    assert not unknown(one_texel(tmp_path / "b", start - 0.5 + step, codes=codes))


def test_peak_whose_lower_sample_is_nearer_to_the_light_is_discarded(tmp_path):
    """d_min < d_max: not this light's lobe."""
    codes = grey(np.array([60.0, 40, 30]))
    assert unknown(one_texel(tmp_path, [10.0, 6, 2], codes=codes))


@pytest.mark.parametrize("diffuse", [np.nan, 100.0])
def test_nothing_above_the_diffuse_colour_is_no_peak(tmp_path, diffuse):
    texels, cameras = ball(6), orbit(20)
    o = observations_of(tmp_path, np.full((6, 20, 3), 120), np.full((6, 20), 127), texels, cameras)
    found = texel_specular(o, np.full(6, diffuse), LIGHT)
    assert np.isnan(found.rho_s).all()
    assert (found.light == -1).all()


def test_no_lights_no_parameters(tmp_path):
    texels, cameras = ball(6), orbit(20)
    o = observations_of(tmp_path, np.full((6, 20, 3), 120), np.full((6, 20), 127), texels, cameras)
    found = texel_specular(o, np.zeros(6), [])
    assert np.isnan(found.rho_s).all()
    assert np.isnan(found.alpha).all()
    assert np.isnan(found.distance).all()
    assert (found.light == -1).all()


def test_a_filmed_ball_gives_its_lobe_at_most_texels_that_show_a_peak(tmp_path):
    texels, cameras = ball(400), orbit(240, turns=2, climb=80)
    lights = [lamp([0.3, 0.4, 0.8], spread=0.05), lamp([-0.8, 0.1, -0.3], spread=0.05)]
    scene = film(
        tmp_path, texels, cameras, lights, np.zeros(400, int), [40.0], [60.0],
        np.full((400, 3), 15.0),
    )  # fmt: skip
    found = texel_specular(scene.observations, np.full(400, 15.0), lights)
    known = np.isfinite(found.rho_s)
    assert known.sum() > 40
    assert abs(np.log(np.median(found.rho_s[known]) / 40)) < 0.02
    assert abs(np.log(np.median(found.alpha[known]) / 60)) < 0.03
    assert set(np.unique(found.light[known])) == {0, 1}
