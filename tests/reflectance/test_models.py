"""Models are chosen on a film whose highlights are computed in numpy, by other formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, bumpy_ball, film, lamp, lobes, orbit, unit, view_vectors
from scipy.optimize import nnls

from meshlab_svbrdf.reflectance.gloss_fit import LEAST_F0, center, moved, strengths
from meshlab_svbrdf.reflectance.joint import Material
from meshlab_svbrdf.reflectance.lights import tangents
from meshlab_svbrdf.reflectance.microfacet import BECKMANN, GGX, PHONG
from meshlab_svbrdf.reflectance.model_fit import first_half
from meshlab_svbrdf.reflectance.models import choose_models, described

T, F = 2500, 160
LIGHTS = [
    lamp([0.3, 0.5, 0.8], 1.2, 0.2),
    lamp([-0.8, 0.3, 0.3], 1.0, 0.1),
    lamp([0.1, -0.6, -0.8], 1 / 1.2),
]
TURN, FOOTPRINT = np.full(T, 1.5), 0.005
STRENGTH, ROUGHNESS, F0 = 300.0, 0.25, 0.05
GOLD = np.array([1.2, 1.0, 0.41])


def rough(texels, cameras, lights, kind: int) -> np.ndarray:
    """k Σ g D G F/(4 n·v) in numpy, G after Heitz's Λ (GGX) or Walter's rational (Beckmann)."""
    v, n = view_vectors(texels, cameras), texels.normal[:, None].astype(float)
    nv = np.maximum((n * v).sum(-1), 1e-3)
    total = np.zeros(nv.shape)
    for light in lights:
        toward = light.direction - light.curvature / texels.radius * texels.position[:, None]
        length = np.linalg.norm(toward, axis=-1)
        l = toward / length[..., None]
        h = unit(l + v)
        nl, nh, lh = (n * l).sum(-1), (n * h).sum(-1), (l * h).sum(-1)
        tan2 = 1 / nh**2 - 1
        if kind == GGX:
            d = 1 / (np.pi * ROUGHNESS**2 * nh**4 * (1 + tan2 / ROUGHNESS**2) ** 2)
        else:
            d = np.exp(-tan2 / ROUGHNESS**2) / (np.pi * ROUGHNESS**2 * nh**4)
        g = 1.0
        for c in (np.maximum(nl, 1e-3), nv):
            tan = np.sqrt(1 / c**2 - 1)
            a = 1 / (ROUGHNESS * np.maximum(tan, 1e-9))
            if kind == GGX:
                g = g / (1 + (np.sqrt(1 + 1 / a**2) - 1) / 2)
            else:
                rational = (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2)
                g = g * np.where(a < 1.6, rational, 1)
        fresnel = F0 + (1 - F0) * (1 - lh) ** 5
        value = STRENGTH * light.gain / length**2 * d * g * fresnel / (4 * nv)
        total += np.where(nl > 0, value, 0)
    return total


def shoot(folder, kind: int, tint=(1.0, 1.0, 1.0), lights=LIGHTS):
    """A rough material, a Phong lobe and a matte one, at random over a dented ball."""
    texels, cameras = bumpy_ball(T), orbit(F, turns=4, climb=120)
    rng = np.random.default_rng(3)
    material = rng.integers(0, 3, T).astype(np.int32)
    shine = 30.0 * lobes(texels, cameras, lights, 60.0)
    if kind != PHONG:
        shine[material == 0] = rough(texels, cameras, lights, kind)[material == 0]
    shine[material == 2] = 0
    return film(
        folder, texels, cameras, lights, material, [0, 30, 0], [1, 60, 1],
        rng.uniform(4, 40, (T, 3)), tint=[tint, (1, 1, 1), (1, 1, 1)], highlights=shine, noise=1.3,
    )  # fmt: skip


def off(degrees: float):
    """The lights, each a little off its place."""
    return [moved(light, np.radians(degrees) * np.eye(4)[k % 2]) for k, light in enumerate(LIGHTS)]


def choose(scene, materials, lights):
    return choose_models(scene.observations, scene.material, materials, lights, TURN, FOOTPRINT)


SEEN = [Material(20.0, 15.0, True), Material(30.0, 60.0, True), Material(np.nan, np.nan, False)]


@pytest.mark.parametrize("kind", [GGX, BECKMANN])
def test_the_right_kind_wins_where_it_is_the_truth(tmp_path, kind):
    scene = shoot(tmp_path, kind)
    lights = off(0.5)
    found = choose(scene, SEEN, lights)
    rough_, lobe, matte = found.microfacets
    assert lobe is None
    assert matte is None
    assert rough_.kind == kind
    assert rough_.roughness == pytest.approx(ROUGHNESS, rel=0.02)
    assert rough_.strength == pytest.approx(STRENGTH, rel=0.05)
    assert rough_.f0 == pytest.approx(F0, rel=0.05)
    assert rough_.gain_db > 3
    assert rough_.color == (1, 1, 1)
    # The lights are pulled to their places, and Phong's material is judged under them
    for light, truth in zip(found.lights, LIGHTS, strict=True):
        assert angle(light.direction, truth.direction) < 0.05
        assert light.gain == pytest.approx(truth.gain, rel=0.02)
    assert found.materials[1].rho_s == pytest.approx(30, rel=0.02)
    assert found.materials[1].alpha == pytest.approx(60, rel=0.03)
    assert found.materials[2] is SEEN[2]
    assert len(found.notes) == 1
    gloss, tint = described(found.materials, found.microfacets)
    assert gloss.kind.tolist() == [kind, PHONG, PHONG]
    assert gloss.facing[0] == rough_.facing
    assert gloss.facing[2] == 0
    assert (tint == 1).all()


def long(half: float):
    """The lights, two of them as long lamps."""
    return [
        replace(light, bar=half * tangents(light.direction)[k]) if k < 2 else light
        for k, light in enumerate(LIGHTS)
    ]


@pytest.mark.parametrize("kind", [GGX, BECKMANN])
def test_lamps_that_a_wrong_lobe_made_long_are_compact_again(tmp_path, kind):
    found = choose(shoot(tmp_path, kind), SEEN, long(0.35))
    assert found.microfacets[0].kind == kind
    assert found.microfacets[0].roughness == pytest.approx(ROUGHNESS, rel=0.02)
    for light, truth in zip(found.lights, LIGHTS, strict=True):
        assert not light.bar.any()
        assert angle(light.direction, truth.direction) < 0.05


def test_lamps_that_are_long_stay_long_and_phong_phong(tmp_path):
    lights = long(0.35)
    points = [
        replace(light, direction=light.direction + x * light.bar, gain=light.gain / 15)
        for light in lights
        for x in np.linspace(-1, 1, 15)
    ]
    found = choose(shoot(tmp_path, PHONG, lights=points), [SEEN[1], *SEEN[1:]], lights)
    assert found.microfacets == [None] * 3
    assert found.lights is lights


def test_a_metal_has_its_colour_and_a_lobe_unseen_by_phong_is_found(tmp_path):
    """Phong's verdict "unobserved" does not bind: its lobe may be the wrong one."""
    scene = shoot(tmp_path, BECKMANN, GOLD / (GOLD @ [0.2126, 0.7152, 0.0722]))
    unseen = Material(np.nan, np.nan, False, "why")
    found = choose(scene, [unseen, *SEEN[1:]], LIGHTS)
    assert found.microfacets[0].kind == BECKMANN
    np.testing.assert_allclose(
        found.microfacets[0].color, GOLD / (GOLD @ [0.2126, 0.7152, 0.0722]), rtol=0.02
    )
    assert found.materials[0] is unseen


def test_phong_stays_where_it_is_the_truth(tmp_path):
    """Nothing is touched then: neither the materials nor the lights."""
    scene = shoot(tmp_path, PHONG)
    materials, lights = [SEEN[1], *SEEN[1:]], off(0.02)
    found = choose(scene, materials, lights)
    assert found.microfacets == [None] * 3
    assert found.materials is materials
    assert found.lights is lights
    assert found.notes == []


def test_without_lights_there_is_nothing_to_choose(tmp_path):
    scene = shoot(tmp_path, PHONG)
    assert choose(scene, SEEN, []).microfacets == [None] * 3


def test_half_a_film():
    assert first_half(np.array([0, 3, 5])).tolist() == [True, True, False, True, False]


@pytest.mark.parametrize("seed", range(20))
def test_strengths_are_the_least_squares_with_b_positive_and_f0_of_a_surface(seed):
    """k₁ (1, 0) + k₂ (F₀, 1 − F₀) with k ≥ 0 are all that may be."""
    rng = np.random.default_rng(seed)
    columns, y = rng.normal(size=(30, 2)), rng.normal(size=30)
    edges = np.array([[1, LEAST_F0], [0, 1 - LEAST_F0]])
    (pp, pq), (_, qq) = columns.T @ columns
    (py, qy), yy = columns.T @ y, y @ y
    a, b, rest = strengths(np.array([pp, pq, qq, py, qy, yy]))
    expected, norm = nnls(columns @ edges, y)
    np.testing.assert_allclose([a, b], edges @ expected, atol=1e-12)
    assert rest == pytest.approx(norm**2)


def test_strengths_of_nothing_are_none():
    assert strengths(np.zeros(6)) == (0, 0, 0)
    assert strengths(np.array([1.0, 1.0, 1.0, 2.0, 2.0, 5.0]))[2] == pytest.approx(
        1
    )  # same columns


def test_a_texel_without_weight_is_centred_on_nothing():
    values, weight = np.array([1.0, 3.0, 5.0]), np.array([1.0, 1.0, 0.0])
    assert center(values, weight, np.array([0, 2, 3])).tolist() == [-1, 1, 5]


def test_a_light_that_is_moved_stays_a_light():
    light = replace(LIGHTS[0], bar=0.1 * tangents(LIGHTS[0].direction)[0])
    far = moved(light, np.array([0.03, -0.02, 0.1, -1.0]))
    assert np.linalg.norm(far.direction) == pytest.approx(1)
    assert far.bar @ far.direction == pytest.approx(0)
    assert far.gain == pytest.approx(light.gain * np.exp(0.1))
    assert far.curvature == 0
    assert angle(far.direction, light.direction) == pytest.approx(np.degrees(0.036), rel=0.01)
