"""The diffuse colour: every guard of its weight, and surfaces whose colour is known."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, ball, grey, lamp, lobes, mirror, observations_of, orbit, unit
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance import diffuse
from meshlab_svbrdf.reflectance.diffuse import (
    DARK,
    METHODS,
    cone_average,
    cone_directions,
    cone_weights,
    diffuse_color,
    specular_weight,
)
from meshlab_svbrdf.reflectance.diffuse_refit import refitting
from meshlab_svbrdf.reflectance.directions import directions, octahedral_cell
from meshlab_svbrdf.reflectance.microfacet import phong_gloss
from meshlab_svbrdf.reflectance.threshold import luminance_threshold
from meshlab_svbrdf.samples.luminance import REC709, decode, to_srgb8

T, F = 400, 60
LIGHT = unit([0.4, 0.3, 0.85])
EXTREMES = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-300, 1e300]


@pytest.fixture(autouse=True)
def _coarse_cones(monkeypatch):
    """Cones in cells of 1.4° instead of .35°: nothing here is finer."""
    monkeypatch.setattr(diffuse, "_CELLS", 128)


# Eq. 3 and 5


def weight(y, b, t, low):
    return float(specular_weight(y, np.log(b) if b > 0 else DARK + 0 * b, t, low))


def test_weight_is_the_equation():
    y, b, t, low = 30.0, 0.3, 25.0, 10.0
    w = (t - low) / (y - low)
    assert weight(y, b, t, low) == pytest.approx(b ** (w * w) / w)


def test_weight_of_the_darkest_sample_is_nothing():
    """Y = min would divide by 0."""
    assert weight(10.0, 1.0, 20.0, 10.0) == 0
    assert weight(9.0, 1.0, 20.0, 10.0) == 0


def test_weight_of_a_constant_texel_is_b():
    """t − min < 1e-6: w = 1."""
    assert weight(10.5, 0.3, 10.0, 10.0) == pytest.approx(0.3)
    assert weight(10.5, 0.3, 10.0 + 9e-7, 10.0) == pytest.approx(0.3)


def test_w_is_clamped():
    """Just above the minimum w would be 1e6 and b^(w²) 0 or 1; far above, s would exceed 1."""
    assert weight(10.0 + 1e-5, 0.9, 20.0, 10.0) == pytest.approx(0.9**16 / 4)
    assert weight(99.0, 1e-20, 10.001, 10.0) == pytest.approx(4 * 1e-20 ** (1 / 16), rel=1e-5)


@given(st.floats(1e-3, 1), st.floats(0, 100), st.floats(0, 100))
def test_what_counts_as_nothing_is_below_a_thousandth(b, y, t):
    low = 10.0
    w = np.clip((t - low) / (y - low), 0.25, 4) if y > low and t - low >= 1e-6 else 1.0
    exact = min(b ** (w * w) / w, 1) if y > low else 0
    assert weight(y, b, t, low) == pytest.approx(exact, rel=2e-4, abs=1 / 1024)


def test_weight_without_light_in_the_cone_is_nothing():
    """Σ gV = 0 makes b = 0."""
    assert weight(30.0, 0.0, 20.0, 10.0) == 0
    assert weight(30.0, -0.1, 20.0, 10.0) == 0


def test_weight_is_clamped_to_one():
    """b near 1 and Y far above t give s = 1/w = 4."""
    assert weight(99.0, 0.999, 11.0, 10.0) == 1


@given(*[st.sampled_from(EXTREMES)] * 4)
def test_weight_of_extremes_is_a_weight_or_nothing(y, b, t, low):
    s = weight(y, b, t, low)
    assert np.isnan(s) or 0 <= s <= 1
    if np.isnan([y, b, low]).any():
        assert s == 0


@given(st.floats(0, 100), st.floats(0, 1), st.floats(0, 100), st.floats(0, 100))
def test_weight_is_in_zero_to_one(y, b, t, low):
    assert 0 <= weight(y, b, t, low) <= 1


@given(st.floats(0.01, 1), st.floats(0.01, 0.99))
def test_weight_grows_with_luminance_and_light(b, share):
    y = np.linspace(11, 100, 40)
    s = [weight(v, b, 20.0, 10.0) for v in y]
    assert (np.diff(s) >= -1e-6).all()
    assert weight(30.0, b * share, 20.0, 10.0) <= weight(30.0, b, 20.0, 10.0)


# Eq. 4


@pytest.mark.parametrize("cone", [0.5, 5.0, 30.0])
def test_cone_directions_stratify_the_cone(cone):
    axes = unit(np.vstack([np.random.default_rng(0).normal(size=(50, 3)), np.eye(3), -np.eye(3)]))
    d = cone_directions(axes, cone)
    assert d.shape == (56, 16, 3)
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1)
    cos = np.einsum("ad,acd->ac", axes, d)
    assert (cos >= np.cos(np.radians(cone))).all()
    np.testing.assert_allclose(unit(d.mean(1)), axes, atol=1e-9)
    strata = (1 - cos) / (1 - np.cos(np.radians(cone)))
    np.testing.assert_allclose(np.sort(strata)[0], np.repeat([1, 3, 5, 7], 4) / 8, rtol=1e-6)


def test_cone_weights_are_the_formulas():
    axis = np.array([0, 0, 1.0])
    cos = cone_directions(axis, 5.0) @ axis
    theta = np.degrees(np.arccos(cos))
    np.testing.assert_allclose(cone_weights(5.0, "angle"), np.exp(-(theta**2) / 50), rtol=1e-6)
    sigma = np.cos(np.radians(5.0))
    np.testing.assert_allclose(
        cone_weights(5.0, "literal"), np.exp(-((cos - 1) ** 2) / (2 * sigma**2)), rtol=1e-9
    )


def test_cone_average_of_an_even_sky_is_the_sky():
    np.testing.assert_allclose(cone_average(np.full((16, 32), 0.7), 5.0), 0.7, rtol=1e-6)


def test_cone_average_is_one_within_a_patch_of_light_and_nothing_beyond():
    probability = (angle(directions(64), LIGHT) < 20).astype(float)
    average = cone_average(probability, 5.0)
    for d in unit(np.random.default_rng(0).normal(size=(300, 3))):
        value, away = average[octahedral_cell(*d, 128)], angle(d, LIGHT)
        if away < 20 - 5 - 3:
            assert value == 1
        elif away > 20 + 5 + 3:
            assert value == 0
        else:
            assert 0 <= value <= 1


# Eq. 5 and 6


@pytest.fixture(scope="module")
def sky():
    """Light from one patch only."""
    return (angle(directions(64), LIGHT) < 12).astype(float)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Lambertian texels of all brightnesses, with highlights where the mirror meets the light."""
    texels, cameras = ball(T), orbit(F, climb=100)
    rng = np.random.default_rng(0)
    ground = rng.integers(40, 180, (T, 1, 3))
    near = angle(mirror(texels, cameras), LIGHT) < 8
    codes = np.minimum(ground + np.where(near, 70, 0)[..., None], 253).astype(np.uint8)
    quality = np.full((T, F), 127)
    o = observations_of(tmp_path_factory.mktemp("store"), codes, quality, texels, cameras)
    return o, 100 * decode(ground[:, 0] / 255), near


@pytest.mark.parametrize("method", METHODS)
def test_few_highlights_leave_the_lambertian_colour(film, sky, method):
    o, truth, near = film
    found = diffuse_color(o, luminance_threshold(o), sky, method=method)
    assert (near.mean(1) < 0.3).all()
    assert (near.any(1)).sum() > 20
    np.testing.assert_allclose(found, truth, rtol=1e-4)


def test_the_letters_weights_bias_upward(film, sky):
    o, truth, near = film
    s = luminance_threshold(o)
    letter = diffuse_color(o, s, sky, weights="s")
    assert (letter >= diffuse_color(o, s, sky) * (1 - 1e-5)).all()
    assert letter[near.any(1)].mean() > 1.02 * truth[near.any(1)].mean()


def test_cone_visibility_where_all_is_visible_changes_nothing(film, sky):
    o, truth, _ = film
    everywhere = np.zeros((1, 36), np.float32)
    everywhere[0, 0] = np.sqrt(4 * np.pi)
    seen = replace(o, view=o.view._replace(coefficients=everywhere))
    s = luminance_threshold(o)
    for per_direction in (False, True):
        found = diffuse_color(seen, s, sky, cone_visibility=per_direction)
        np.testing.assert_allclose(found, truth, rtol=1e-4)


@pytest.mark.parametrize("per_direction", [False, True])
def test_where_nothing_is_visible_no_sample_is_specular(film, sky, per_direction):
    """b = 0 for all: the bound is the plain threshold."""
    o, _, _ = film
    hidden = o.view._replace(coefficients=np.zeros((1, 36), np.float32))
    s = luminance_threshold(o)
    found = diffuse_color(
        replace(o, view=hidden), s, sky,
        cone_visibility=per_direction,
    )  # fmt: skip
    dark = diffuse_color(o, s, np.zeros_like(sky))
    np.testing.assert_allclose(found, dark, rtol=1e-6)


def noisy(tmp_path, quality=None):
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 254, (T, F, 3)).astype(np.uint8)
    q = rng.integers(13, 128, (T, F)) if quality is None else quality
    return observations_of(tmp_path, codes, q, ball(T), orbit(F)), 100 * decode(codes / 255), q


def masked_mean(colors, keep, q):
    return np.array([(q[t, k] @ colors[t, k]) / q[t, k].sum() for t, k in enumerate(keep)])


@pytest.mark.parametrize("b", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("weights", ["1-s", "s"])
def test_statistical_is_the_papers_equations(tmp_path, b, weights):
    """An even sky makes b constant, and numpy can follow."""
    o, colors, q = noisy(tmp_path)
    s = luminance_threshold(o)
    y = colors @ REC709
    t, low = s.threshold[:, None].astype(float), s.minimum[:, None].astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.clip((t - low) / (y - low), 0.25, 4)
        weight = np.where((y <= low * (1 + 1e-6)) | (b == 0), 0, np.minimum(b ** (w * w) / w, 1))
    weight = weight if weights == "s" else 1 - weight
    total = weight.sum(1, keepdims=True)
    if weights == "s" and b == 0:
        bound = t
    else:
        mu = (weight * y).sum(1, keepdims=True) / total
        bound = mu + (weight * np.abs(y - mu)).sum(1, keepdims=True) / total
    found = diffuse_color(o, s, np.full((16, 32), b), weights=weights)
    np.testing.assert_allclose(found, masked_mean(colors, y <= bound + 1e-4, q), rtol=1e-4)


def test_trimmed_and_quantile_are_numpys(tmp_path):
    o, colors, q = noisy(tmp_path)
    y, s, dark = colors @ REC709, luminance_threshold(o), np.zeros((16, 32))
    median = np.median(y, 1, keepdims=True)
    bound = median + 1.5 * np.median(np.abs(y - median), 1, keepdims=True)
    for method, keep in {
        "trimmed": y <= bound + 1e-4,
        "quantile": y <= np.quantile(y, 0.25, axis=1, keepdims=True) + 1e-4,
    }.items():
        found = diffuse_color(o, s, dark, method=method)
        np.testing.assert_allclose(found, masked_mean(colors, keep, q), rtol=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [0, 1, 128, 255])
def test_constant_texels_stay(tmp_path, method, value):
    """All samples equal: Y = min = t, every guard at once."""
    o = observations_of(
        tmp_path, np.full((4, F, 3), value), np.full((4, F), 127), ball(4), orbit(F)
    )
    found = diffuse_color(o, luminance_threshold(o), np.ones((16, 32)), method=method)
    np.testing.assert_allclose(found, 100 * decode(value / 255), rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_texels_seen_too_rarely_have_no_colour(tmp_path, method):
    quality = np.full((3, F), 127)
    quality[0, 7:], quality[1] = 0, 0
    o = observations_of(tmp_path, np.full((3, F, 3), 90), quality, ball(3), orbit(F))
    found = diffuse_color(o, luminance_threshold(o), np.ones((16, 32)), method=method)
    np.testing.assert_array_equal(np.isfinite(found).all(1), [False, False, True])
    assert np.isnan(found[:2]).all()


@pytest.mark.parametrize("method", METHODS)
def test_colour_lies_among_the_samples(tmp_path, method):
    o, colors, _ = noisy(tmp_path)
    found = diffuse_color(o, luminance_threshold(o), np.full((16, 32), 0.5), method=method)
    assert (found >= colors.min(1) - 1e-3).all()
    assert (found <= colors.max(1) + 1e-3).all()


# Method 9


def glossy(tmp_path, rho=80.0, alpha=30.0):
    texels, cameras, lights = ball(T), orbit(F, climb=100), [lamp(LIGHT)]
    d = np.random.default_rng(2).uniform(5, 50, T)
    y = d[:, None] + rho * lobes(texels, cameras, lights, alpha)
    codes = grey(y)
    quality = np.where(codes.max(-1) >= 254, 255, 127)
    return observations_of(tmp_path, codes, quality, texels, cameras), d, lights, y


def test_refit_takes_the_lobes_off_exactly(tmp_path):
    """With the true lobes what is left of each sample is the diffuse colour, but for rounding."""
    o, d, lights, y = glossy(tmp_path)
    start = np.repeat((d * 1.3)[:, None], 3, 1).astype(np.float32)
    found = o.store.rows(
        refitting(
            o, start, np.zeros(T, np.int32), phong_gloss([80.0], [30.0]), np.ones((1, 3)), lights
        )
    )[0]
    assert (y > 100).any()
    np.testing.assert_allclose(found, np.repeat(d[:, None], 3, 1), rtol=0.01, atol=0.1)


@pytest.mark.parametrize("material", [-1, 0])
def test_refit_leaves_what_it_does_not_know(tmp_path, material):
    """Texels of no material, of an unobserved one, and without a diffuse colour."""
    o, d, lights, _ = glossy(tmp_path)
    start = np.repeat((d * 1.3)[:, None], 3, 1).astype(np.float32)
    start[:3] = np.nan
    rho = [np.nan] if material == 0 else [40.0]
    found = o.store.rows(
        refitting(
            o, start, np.full(T, material, np.int32), phong_gloss(rho, rho), np.ones((1, 3)), lights
        )
    )[0]
    np.testing.assert_array_equal(found, start)


def test_refit_without_lights_is_a_robust_mean(tmp_path):
    o, d, _, _ = glossy(tmp_path, rho=0.0)
    start = np.repeat(d[:, None], 3, 1).astype(np.float32)
    found = o.store.rows(
        refitting(o, start, np.zeros(T, np.int32), phong_gloss([80.0], [30.0]), np.ones((1, 3)), [])
    )[0]
    np.testing.assert_allclose(found, start, rtol=0.01, atol=0.05)


def test_refit_takes_clipped_samples_for_lower_bounds(tmp_path):
    """Where faint gloss clips red, those samples would make it darker."""
    texels, cameras, lights = ball(T), orbit(F, climb=100), [lamp(LIGHT)]
    red = np.array([95.0, 5, 5])
    codes = to_srgb8((red + 15 * lobes(texels, cameras, lights, 2.0)[..., None]) / 100)
    clipped = codes.max(-1) >= 254
    quality = np.where(clipped, 255, 127)
    o = observations_of(tmp_path, codes, quality, texels, cameras)
    start, material = np.tile(red, (T, 1)).astype(np.float32), np.zeros(T, np.int32)
    gloss = phong_gloss([15.0], [2.0])
    (found,) = o.store.rows(refitting(o, start, material, gloss, np.ones((1, 3)), lights))
    known = clipped.any(1) & ~clipped.all(1)
    assert known.sum() > 10
    np.testing.assert_allclose(found[known, 0], start[known, 0], rtol=0.004)
