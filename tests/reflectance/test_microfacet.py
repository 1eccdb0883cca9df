"""Microfacets against what the integrals of a mirror's highlight must be."""

from __future__ import annotations

import numpy as np
import pytest

from meshlab_svbrdf.reflectance.microfacet import (
    BECKMANN,
    GGX,
    PHONG,
    Gloss,
    Microfacets,
    columns,
    facets,
    phong_gloss,
    specular,
)

UP = np.array([0, 0, 1], np.float32)


def hemisphere(count: int) -> tuple[np.ndarray, float]:
    """Directions of equal solid angle above the horizon, and that angle."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    s = np.sqrt(1 - z * z)
    return np.stack([s * np.cos(turn), s * np.sin(turn), z], 1), 2 * np.pi / count


def towards(degrees: float) -> np.ndarray:
    return np.array([np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))])


@pytest.mark.parametrize("kind", [GGX, BECKMANN])
@pytest.mark.parametrize("degrees", [0, 30, 60])
@pytest.mark.parametrize("roughness", [0.05, 0.1])
def test_a_smooth_mirror_reflects_all_light(kind, degrees, roughness):
    """∫ D G/(4 n·v) dω = 1 but for what microfacets hide: light that comes from everywhere."""
    way, angle = hemisphere(200_000)
    v = towards(degrees)
    total = sum(facets(kind, roughness, l[2], v[2], l @ v)[0] for l in way) * angle
    assert 0.95 < total < 1.005


@pytest.mark.parametrize("kind", [GGX, BECKMANN])
def test_it_is_reciprocal_but_for_the_cosine(kind):
    l, v = towards(70), towards(20)
    there, back = (facets(kind, 0.3, a[2], b[2], l @ v) for a, b in ((l, v), (v, l)))
    assert there[0] * v[2] == pytest.approx(back[0] * l[2], rel=1e-12)
    assert there[1] == back[1]


def test_light_along_the_surface_is_mirrored_whole():
    """Schlick's (1 − l·h)⁵ is 0 where light returns, and near 1 where it grazes."""
    assert facets(GGX, 0.3, 0.5, 0.5, 1.0)[1] == 0
    assert facets(GGX, 0.3, 0.01, 0.01, 2e-4 - 1)[1] > 0.9


def test_beyond_the_lobe_beckmann_is_exactly_dark():
    assert facets(BECKMANN, 0.05, 0.5, 0.5, -0.5)[0] > 1
    assert facets(BECKMANN, 0.05, 0.9, 0.9, 0.9) == (0.0, 0.0)


@pytest.mark.parametrize("kind", [GGX, BECKMANN, PHONG])
def test_nothing_shines_below_the_horizon_or_without_light(kind):
    shape = 30.0 if kind == PHONG else 0.3
    rays = np.array([[0, 0.8, 0.6]], np.float32)
    below = np.array([[0, 0.8, -0.6]], np.float32)
    assert columns(kind, shape, 0.0, UP, 0.0, 0.8, 0.6, rays, np.ones(1, np.float32))[0] > 0
    assert columns(kind, shape, 0.0, UP, 0.0, 0.8, 0.6, rays, np.zeros(1, np.float32)) == (0, 0)
    if kind != PHONG:
        assert columns(kind, shape, 0.0, UP, 0.0, 0.8, 0.6, below, np.ones(1, np.float32)) == (0, 0)
        assert columns(kind, shape, 0.0, UP, 0.0, 0.8, -0.6, rays, np.ones(1, np.float32)) == (0, 0)


@pytest.mark.parametrize("kind", [BECKMANN, PHONG])
def test_a_blur_is_a_wider_lobe(kind):
    """The mean over mirror directions of variance b per axis, about a light overhead."""
    shape, b = (100.0, 0.004) if kind == PHONG else (0.08, 0.004)
    rays, gains = UP[None], np.ones(1, np.float32)
    rng = np.random.default_rng(5)
    tilt = rng.normal(0, np.sqrt(b), (200_000, 2))
    mean = np.mean(
        [
            columns(kind, shape, 0.0, UP, x, y, np.sqrt(1 - x * x - y * y), rays, gains)[0]
            for x, y in tilt
        ]
    )
    assert columns(kind, shape, b, UP, 0.0, 0.0, 1.0, rays, gains)[0] == pytest.approx(
        mean, rel=0.02
    )


def test_specular_is_linear_in_strength_and_f0():
    rays = np.array([[0.8, 0, 0.6], [-0.9, 0, np.sqrt(0.19)]], np.float32)
    gains = np.array([1, 2], np.float32)
    gloss = Gloss(np.array([GGX]), np.array([3.0]), np.array([40.0]), np.array([0.3]))
    where = (0.0, UP, 0.7, 0.0, np.sqrt(0.51), rays, gains)
    a, b = columns(GGX, 0.3, *where)
    assert specular(gloss, 0, *where) == pytest.approx(3 * a + 40 * b)
    found = Microfacets(GGX, 3.0, 40.0, 0.3, (1, 1, 1), 2.0, 0.3)
    assert found.strength * found.f0 == 3
    assert found.strength == 43


def test_no_lobe_is_no_gloss():
    gloss = phong_gloss(np.array([np.nan, 20.0]), np.array([np.nan, 30.0]))
    assert gloss.facing.tolist() == [0, 20]
    assert gloss.shape.tolist() == [1, 30]
    assert not gloss.grazing.any()
