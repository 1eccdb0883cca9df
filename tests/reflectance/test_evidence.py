"""The evidence against numpy, and every reason for which a gloss is unobserved."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.reflectance.evidence import (
    Evidence,
    highlight_color,
    verdict,
    weigh_evidence,
)
from meshlab_svbrdf.reflectance.fit_samples import FitSamples

REC709 = np.array([0.2126, 0.7152, 0.0722])
GOLD = np.array([1.6, 0.9, 0.2]) / ([1.6, 0.9, 0.2] @ REC709)
EXTREMES = [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]


def case(tint=(1, 1, 1), noise=0.5, texels=60, per=30, rho=20.0, seed=0, material=None):
    """Texels with one lobe each, in colour; the residual is the noise."""
    rng = np.random.default_rng(seed)
    n = texels * per
    owner = np.repeat(np.arange(texels), per)
    specular = rho * np.exp(-(rng.normal(size=n) ** 2)) * (rng.random(n) < 0.5)
    error = noise * rng.normal(size=(n, 3))
    rgb = rng.uniform(5, 40, (texels, 3))[owner] + specular[:, None] * np.asarray(tint) + error
    y = rgb @ REC709
    weight = rng.uniform(0.2, 1, n) * (rng.random(n) < 0.9)
    material = np.zeros(texels, np.int32) if material is None else np.asarray(material, np.int32)
    samples = FitSamples(
        np.arange(texels), material, np.arange(texels + 1) * per, y.astype(np.float32),
        rgb.astype(np.float32), np.ones(n, np.float32), np.zeros(n, bool),
        np.zeros((n, 3), np.float32), np.zeros((n, 4), np.float32),
    )  # fmt: skip
    residual = error @ REC709
    return (
        samples,
        weight.astype(np.float32),
        specular.astype(np.float32),
        residual.astype(np.float32),
    )


def weigh(samples, weight, specular, residual, noise, pieces=1):
    edges = np.linspace(0, len(samples.texel), pieces + 1).astype(int)
    return weigh_evidence(
        samples, weight, specular, residual, np.atleast_1d(noise),
        lambda work: [work(a, b) for a, b in itertools.pairwise(edges)],
    )  # fmt: skip


def centred(values, weight, per=30):
    w = weight.reshape(-1, per).astype(float)
    v = values.reshape(-1, per)
    return v - (w * v).sum(1, keepdims=True) / w.sum(1, keepdims=True), w


def test_is_numpys_of_centred_samples():
    samples, weight, specular, residual = case(GOLD)
    (found,) = weigh(samples, weight, specular, residual, 2.0)
    s, w = centred(specular.astype(float), weight)
    y, _ = centred(samples.luminance.astype(float), weight)
    e = residual.reshape(s.shape).astype(float)
    q = (w * s * s).sum()
    assert found.z == pytest.approx(q / np.sqrt((w * w * s * s * e * e).sum()), rel=1e-5)
    shows = (np.where(w > 0, specular.reshape(s.shape), 0).max(1) > 6)[:, None]
    explained = 1 - (w * e * e * shows).sum() / (w * y * y * shows).sum()
    assert found.explained == pytest.approx(explained, rel=1e-5)
    for c in range(3):
        v, _ = centred(samples.rgb[:, c].astype(float), weight)
        assert found.color[c] == pytest.approx((w * s * v).sum() / q, rel=1e-5)
        error = np.sqrt((w * w * s * s * (v - found.color[c] * s) ** 2).sum()) / q
        assert found.color_error[c] == pytest.approx(error, rel=1e-4)


def test_pieces_do_not_matter_and_materials_are_apart():
    material = np.arange(60) % 2
    samples, weight, specular, residual = case(material=material)
    whole = weigh(samples, weight, specular, residual, [1.0, 1.0], pieces=1)
    parts = weigh(samples, weight, specular, residual, [1.0, 1.0], pieces=7)
    for a, b in zip(whole, parts, strict=True):
        assert a.z == pytest.approx(b.z, rel=1e-12)
        assert a.explained == pytest.approx(b.explained, rel=1e-12)
    assert whole[0].z != whole[1].z


def test_a_lobe_that_is_there_is_evident_and_the_more_so_the_less_noise():
    z, explained = zip(
        *((e.z, e.explained) for n in (3.0, 1.0, 0.3) for e in weigh(*case(noise=n), n)),
        strict=True,
    )
    assert (np.diff(z) > 0).all()
    assert (np.diff(explained) > 0).all()
    assert explained[-1] > 0.98


def test_a_lobe_that_explains_nothing_has_no_share():
    """The residual is as large as the samples vary."""
    samples, weight, specular, _ = case(noise=8.0, rho=0.5)
    y, _ = centred(samples.luminance.astype(float), weight)
    (found,) = weigh(samples, weight, specular, y.ravel().astype(np.float32), 0.1)
    assert abs(found.explained) < 0.01


@pytest.mark.parametrize("without", ["specular", "weight", "texels"])
def test_without_lobe_or_samples_there_is_no_evidence(without):
    samples, weight, specular, residual = case(texels=0 if without == "texels" else 60)
    specular = specular * (without != "specular")
    weight = weight * np.float32(without != "weight")
    (found,) = weigh(samples, weight, specular, residual, 1.0)
    assert found.z == 0
    assert np.isnan(found.explained)
    assert highlight_color(found) == (1, 1, 1)


def test_texels_that_should_not_show_the_lobe_do_not_count():
    samples, weight, specular, residual = case(rho=2.0)
    (found,) = weigh(samples, weight, specular, residual, 1e3)
    assert np.isnan(found.explained)
    assert found.z > 3
    assert "noise" in verdict(2.0, False, found, 0.1)


def test_exact_fit_is_infinitely_evident():
    samples, weight, specular, residual = case(noise=0.0)
    (found,) = weigh(samples, weight, specular, 0 * residual, 0.1)
    assert found.z == np.inf
    assert found.explained == 1


# The highlight's colour


def evidence(color=(1, 1, 1), error=(0.01,) * 3, z=10.0, explained=0.9):
    return Evidence(z, explained, np.array(color, float), np.array(error, float))


@pytest.mark.parametrize(
    ("color", "error", "white"),
    [
        (GOLD, (0.02,) * 3, False),
        (GOLD, (0.11, 0.01, 0.01), True),  # its error exceeds .1
        ((1.05, 0.99, 0.95), (0.001,) * 3, True),  # within .1 of white
        ((1.2, 1, 0.8), (0.09,) * 3, True),  # within 3 errors of white
        ((2.0, -0.1, 0.5), (0.01,) * 3, True),  # no colour
        ((1, 1, 1), (np.inf,) * 3, True),
        ((np.nan,) * 3, (0.01,) * 3, True),
        (GOLD, (np.nan,) * 3, True),
    ],
)
def test_highlights_are_white_unless_the_samples_clearly_say_otherwise(color, error, white):
    found = highlight_color(evidence(color, error))
    assert (found == (1, 1, 1)) == white
    assert np.dot(found, REC709) == pytest.approx(1)


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_gold_is_gold_of_luminance_one(scale):
    found = highlight_color(evidence(scale * GOLD))
    np.testing.assert_allclose(found, GOLD, rtol=1e-9)


def test_gold_is_found_in_samples():
    (found,) = weigh(*case(GOLD, texels=300), 0.5)
    np.testing.assert_allclose(highlight_color(found), GOLD, rtol=0.02)
    (found,) = weigh(*case(texels=300), 0.5)
    assert highlight_color(found) == (1, 1, 1)


@pytest.mark.parametrize("tint", [(1, 1, 1), GOLD])
def test_the_colours_error_is_that_of_the_noise_whatever_the_colour(tint):
    """Also where gold is far from white."""
    (found,) = weigh(*case(tint, noise=0.0), 0.5)
    assert (found.color_error < 1e-3).all()
    (found,) = weigh(*case(tint, texels=300), 0.5)
    (white,) = weigh(*case(texels=300), 0.5)
    np.testing.assert_allclose(found.color_error, white.color_error, rtol=0.05)


# The verdict

GOOD = {"rho_s": 10.0, "at_end": False, "z": 10.0, "explained": 0.8, "width": 0.5}


def judge(**kw):
    v = GOOD | kw
    return verdict(
        v["rho_s"], v["at_end"], evidence(z=v["z"], explained=v["explained"]), v["width"]
    )


def test_good_evidence_has_no_objection():
    assert judge() == ""


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        ({"rho_s": 0.0}, "no highlight"),
        ({"rho_s": -1.0}, "no highlight"),
        ({"at_end": True}, "end of the range"),
        ({"z": 3.0}, "times its error"),
        ({"width": 1.5}, "uncertain by a factor"),
        ({"explained": 0.3}, "explain 30%"),
        ({"explained": -2.0}, "explain 0%"),
    ],
)
def test_each_objection_has_its_reason(bad, word):
    assert word in judge(**bad)


@given(st.sampled_from(sorted(GOOD.keys() - {"at_end"})), st.sampled_from([np.nan]))
def test_what_is_not_a_number_is_never_observed(key, value):
    assert judge(**{key: value}) != ""


@given(*[st.sampled_from(EXTREMES)] * 4, st.booleans())
def test_extremes_raise_nothing(rho, z, explained, width, at_end):
    reason = judge(rho_s=rho, z=z, explained=explained, width=width, at_end=at_end)
    assert isinstance(reason, str)
    if not reason:
        assert rho > 0
        assert z > 3
        assert width < 1.5
        assert explained > 0.3
