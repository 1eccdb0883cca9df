"""Phong's lobe as GGX: exact inverses, the same top, the same energy."""

import numpy as np
import pytest
from analytic import unit
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.exporting.gloss import HALF_VECTOR, ggx_of, ggx_of_phong, phong_of_ggx
from meshlab_svbrdf.reflectance.microfacet import BECKMANN, GGX, PHONG, facets
from meshlab_svbrdf.rendering.highlight import highlight_of
from meshlab_svbrdf.rendering.surface import Appearance


def energy(kind, facing, shape):
    """(1/π) ∫ highlight dω over the hemisphere, seen from above: the share of light sent back."""
    ring = (np.arange(3000) + 0.5) / 3000
    theta = np.pi / 2 * ring**2  # fine about the normal
    weight = 2 * np.sin(theta) * np.pi * ring / 3000
    shown = [
        highlight_of(kind, facing, 0.0, shape, np.cos(t), 1.0, np.cos(t)) for t in theta
    ]  # cosines of light, view, and between the two
    return float(weight @ np.array(shown))


@given(st.floats(1e-3, 50), st.floats(0.1, 3000))
def test_there_and_back(rho_s, alpha):
    ggx = ggx_of_phong(rho_s, alpha)
    np.testing.assert_allclose(phong_of_ggx(ggx.facing, ggx.roughness), (rho_s, alpha), rtol=1e-9)


def test_rougher_than_any_lobe_is_none():
    assert np.isnan(phong_of_ggx(0.1, 0.9)).all()


@pytest.mark.parametrize("alpha", [3.0, 12.0, 86.0, 900.0])
def test_the_lobes_energy_is_what_is_said(alpha):
    assert energy(PHONG, 0.4, alpha) == pytest.approx(2 * 0.4 / (alpha + 1), rel=1e-4)


@pytest.mark.parametrize("alpha", [12.0, 86.0, 900.0])
def test_ggx_has_the_lobes_top_and_energy(alpha):
    """Up to what the microfacets hide, some a² of it, which Beckmann's do not yet at the top."""
    rho_s = 0.4
    ggx = ggx_of_phong(rho_s, alpha)
    facing, a = np.pi * float(ggx.facing), float(ggx.roughness)
    top, _ = facets(GGX, a, 1.0, 1.0, 1.0)
    assert facing * top == pytest.approx(rho_s, rel=1e-12)
    whole = 2 * rho_s / (alpha + 1)
    assert a**2 < 1 - energy(GGX, facing, a) / whole < 1.35 * a**2
    assert energy(BECKMANN, facing, a) == pytest.approx(whole, rel=1e-6)


def test_half_vectors_want_four_times_the_exponent():
    """(l·r)^α and (n·h)^4α agree about the mirror direction."""
    alpha, angles = 50.0, np.radians(np.linspace(0, 8, 9))
    v = unit([0.3, 0.1, 1])
    mirror = v * [-1, -1, 1]
    for a in angles:
        light = unit(mirror + np.tan(a) * unit(np.cross(mirror, [0, 1, 0])))
        half = unit(light + v)
        ours, theirs = (light @ mirror) ** alpha, half[2] ** (HALF_VECTOR * alpha)
        assert theirs == pytest.approx(ours, abs=0.01)


def test_microfacets_keep_their_own():
    def row(*values):
        return np.array([values])

    look = Appearance(
        np.ones((1, 4, 3)), row(0.4, 0.1, 0.2, np.nan), row(50, 0.2, 0.3, np.nan),
        np.ones((1, 4, 3)), kind=row(PHONG, GGX, BECKMANN, PHONG), grazing=row(0, 0.5, 0, 0),
    )  # fmt: skip
    facing, grazing, roughness = ggx_of(look)
    np.testing.assert_allclose(facing, row(0.8 / 51, 0.1 / np.pi, 0.2 / np.pi, 0))
    np.testing.assert_allclose(grazing, row(0.8 / 51, 0.6 / np.pi, 0.2 / np.pi, 0))
    np.testing.assert_allclose(roughness, row(np.sqrt(1 / 102), 0.2, 0.3, np.nan))
