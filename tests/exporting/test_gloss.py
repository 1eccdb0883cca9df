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


def energy(kind, facing, shape, view=0.0):
    """(1/π) ∫ highlight dω over the hemisphere: the share of light sent back along a direction.

    By reciprocity of the microfacets, and of the lobe at view = 0.
    """
    turn = (np.arange(64) + 0.5) * 2 * np.pi / 64
    ring = (np.arange(3000) + 0.5) / 3000
    theta = (np.pi / 2) * ring**2  # fine about the normal
    weight = np.sin(theta) * np.pi * ring / 3000 * (2 * np.pi / 64)
    v = np.array([np.sin(view), 0, np.cos(view)])
    total = 0.0
    for t, w in zip(theta, weight, strict=True):
        for a in turn if view else turn[:1]:
            light = np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
            lv = float(light @ v)
            total += (
                w * highlight_of(kind, facing, 0.0, shape, light[2], v[2], lv) * (1 if view else 64)
            )
    return total / np.pi


@given(st.floats(1e-3, 50), st.floats(0.1, 3000))
def test_there_and_back(rho_s, alpha):
    ggx = ggx_of_phong(rho_s, alpha)
    np.testing.assert_allclose(phong_of_ggx(ggx.facing, ggx.roughness), (rho_s, alpha), rtol=1e-9)


def test_rougher_than_any_lobe_is_none():
    assert np.isnan(phong_of_ggx(0.1, 0.9)).all()


@pytest.mark.parametrize("alpha", [3.0, 12.0, 86.0, 900.0])
def test_the_lobes_energy_is_what_is_said(alpha):
    assert energy(PHONG, 0.4, alpha) == pytest.approx(2 * 0.4 / (alpha + 1), rel=1e-4)


@pytest.mark.parametrize(("alpha", "hidden"), [(12.0, 0.04), (86.0, 0.007), (900.0, 0.001)])
def test_ggx_has_the_lobes_top_and_energy(alpha, hidden):
    """Up to what the microfacets hide, which is less the smoother they are."""
    rho_s = 0.4
    ggx = ggx_of_phong(rho_s, alpha)
    top, _ = facets(GGX, float(ggx.roughness), 1.0, 1.0, 1.0)
    assert np.pi * ggx.facing * top == pytest.approx(rho_s, rel=1e-12)
    kept = energy(GGX, np.pi * float(ggx.facing), float(ggx.roughness)) / (2 * rho_s / (alpha + 1))
    assert 1 - hidden < kept < 1
    blunt = energy(BECKMANN, np.pi * float(ggx.facing), float(ggx.roughness))
    assert blunt / (2 * rho_s / (alpha + 1)) == pytest.approx(1, abs=hidden)


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
