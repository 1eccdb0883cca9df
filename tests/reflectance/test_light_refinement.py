"""Gauss-Newton on the lights: its Jacobian by finite differences, and lights that are known."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, ball, lamp, lobes, mirror, observations_of, orbit, unit

from meshlab_svbrdf.reflectance.fit_samples import collect
from meshlab_svbrdf.reflectance.light_refinement import PARAMETERS, refine_lights
from meshlab_svbrdf.reflectance.lights import Light, tangents
from meshlab_svbrdf.reflectance.phong import lamps, light_texels

T, F = 500, 60
RHO, ALPHA = np.array([30.0]), np.array([40.0])
LIGHTS = [
    lamp([0.2, 0.5, 0.8], 2.0, 0.2),
    lamp([-1, 0.1, 0.3], 0.8, 0.35),
    lamp([0, -0.7, -0.7], 1 / 1.6, 0.1),
]


def compact(lights):
    """Each point of a long lamp as a compact lamp of its own."""
    points = lamps(lights, 1.0)
    length = np.linalg.norm(points.direction, axis=1)
    return [
        Light(d / r, np.eye(2), gain=g / r**2, curvature=kappa / r)
        for d, r, g, kappa in zip(
            points.direction, length, points.gain, points.curvature, strict=True
        )
    ]


class Bench:
    """Samples of a ball; predictions by numpy, steps by the kernel."""

    def __init__(self, folder):
        self.texels, self.cameras = ball(T), orbit(F, turns=3, climb=150)
        self.view = observations_of(
            folder, np.zeros((T, F, 3)), np.full((T, F), 127), self.texels, self.cameras
        )
        self.samples = collect(self.view, np.arange(T), np.zeros(T, np.int32))
        assert mirror(self.texels, self.cameras).shape == (T, F, 3)

    def predict(self, lights):
        return RHO[0] * lobes(self.texels, self.cameras, compact(lights), ALPHA[0]).ravel()

    def step(self, lights, residual, *, weight=None, rho=RHO, near=True, pieces=1, **kw):
        bulbs = lamps(lights, self.texels.radius)
        rays, gains = light_texels(self.view.view, np.arange(T), bulbs)
        weight = np.ones(T * F, np.float32) if weight is None else weight.astype(np.float32)
        edges = np.linspace(0, T, pieces + 1).astype(int)
        return refine_lights(
            lights, self.samples, weight, np.asarray(residual, np.float32), self.view.view.position,
            rays, gains, bulbs, rho, ALPHA,
            lambda work: [work(a, b) for a, b in itertools.pairwise(edges)],
            near=near, **kw,
        )  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(tmp_path_factory.mktemp("store"))


def moved(lights, k, parameter, by):
    """The lights with one parameter of one light changed."""
    light = lights[k]
    if parameter < 2:
        direction = unit(light.direction + by * tangents(light.direction)[parameter])
        bar = light.bar - (light.bar @ direction) * direction
        light = replace(light, direction=direction, bar=bar)
    elif parameter == 2:
        light = replace(light, gain=light.gain * np.exp(by))
    elif parameter == 3:
        light = replace(light, curvature=light.curvature + by)
    elif parameter == 6:
        light = replace(light, breadth=light.breadth + by)
    else:
        light = replace(light, bar=light.bar + by * tangents(light.direction)[parameter - 4])
    return [*lights[:k], light, *lights[k + 1 :]]


def differences(found, lights):
    """What a step did, (K, 7): angles, ln gain, κ, bar and breadth."""
    return np.array([
        [
            *(tangents(b.direction) @ a.direction), np.log(a.gain / b.gain),
            a.curvature - b.curvature, *(tangents(b.direction) @ (a.bar - b.bar)),
            a.breadth - b.breadth,
        ]
        for a, b in zip(found, lights, strict=True)
    ])  # fmt: skip


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("parameter", range(PARAMETERS))
def test_jacobian_is_the_finite_difference(bench, k, parameter):
    """To Gauss-Newton the central difference of the prediction is one step along its parameter."""
    h, bar = 1e-5, np.array([0.12, 0.05])  # so small that no texel crosses the horizon
    lights = [replace(light, bar=bar @ tangents(light.direction), breadth=0.08) for light in LIGHTS]
    ahead, back = moved(lights, k, parameter, h), moved(lights, k, parameter, -h)
    found, _ = bench.step(lights, (bench.predict(ahead) - bench.predict(back)) / 2, damping=0.0)
    expected = np.zeros((3, PARAMETERS))
    expected[k, parameter] = h
    expected[:, 2] -= expected[:, 2].mean()  # gains of geometric mean 1
    np.testing.assert_allclose(differences(found, lights), expected, atol=0.01 * h)


def test_a_row_stays_a_row(bench):
    lights = [replace(light, bar=0.1 * tangents(light.direction)[0]) for light in LIGHTS]
    wider = [replace(light, breadth=0.1) for light in lights]
    found, _ = bench.step(lights, bench.predict(wider) - bench.predict(lights))
    assert not any(light.breadth for light in found)


def test_the_bar_of_a_compact_lamp_stays_zero(bench):
    found, _ = bench.step(LIGHTS, bench.predict(moved(LIGHTS, 0, 0, 0.01)) - bench.predict(LIGHTS))
    assert not any(light.bar.any() for light in found)


def perturbed(curvature=None):
    """Every light off by about a degree, its gain by a tenth, its distance unknown or given."""
    rng = np.random.default_rng(0)
    out = []
    for light in LIGHTS:
        away = rng.normal(size=2)
        step = 0.018 * away / np.linalg.norm(away) @ tangents(light.direction)
        gain = light.gain * np.exp(0.1 * rng.normal())
        kappa = 0.0 if curvature is None else light.curvature + curvature
        out.append(Light(unit(light.direction + step), light.covariance, gain, kappa))
    return out


def test_each_step_brings_the_prediction_nearer(bench):
    truth, lights = bench.predict(LIGHTS), perturbed(0.03)
    errors = []
    for _ in range(5):
        residual = truth - bench.predict(lights)
        errors.append(np.sqrt(np.mean(residual**2)))
        lights, _ = bench.step(lights, residual)
    assert (np.diff(errors[:4]) < 0).all()
    assert errors[1] < 0.3 * errors[0]
    assert errors[-1] < 1e-3 * errors[0]


def test_recovers_directions_gains_and_distances(bench):
    truth, lights = bench.predict(LIGHTS), perturbed()
    for _ in range(12):
        lights, error = bench.step(lights, truth - bench.predict(lights))
    for found, light in zip(lights, LIGHTS, strict=True):
        assert angle(found.direction, light.direction) < 0.01
        assert found.curvature == pytest.approx(light.curvature, rel=0.01)
    ratio = np.array([f.gain / x.gain for f, x in zip(lights, LIGHTS, strict=True)])
    np.testing.assert_allclose(ratio / ratio.mean(), 1, rtol=0.01)
    assert (error < 1e-3).all()


def test_standard_error_of_the_distance_is_its_scatter(bench):
    """Of 30 runs with noise, κ scatters by about what each run says."""
    rng = np.random.default_rng(1)
    steps = [bench.step(LIGHTS, 2.0 * rng.normal(size=T * F), damping=0.0) for _ in range(30)]
    scatter = np.std([differences(s, LIGHTS)[:, 3] for s, _ in steps], axis=0)
    said = np.mean([error for _, error in steps], axis=0)
    np.testing.assert_allclose(scatter, said, rtol=0.4)


def test_diffuse_terms_do_not_matter(bench):
    """What is added to all samples of a texel is eliminated."""
    lights = perturbed()
    residual = bench.predict(LIGHTS) - bench.predict(lights)
    shift = np.repeat(np.random.default_rng(2).integers(-20, 20, T), F)
    a, _ = bench.step(lights, residual)
    b, _ = bench.step(lights, residual + shift)
    np.testing.assert_allclose(differences(b, lights), differences(a, lights), atol=1e-4)


def test_samples_without_weight_do_not_matter(bench):
    lights = perturbed()
    residual = bench.predict(LIGHTS) - bench.predict(lights)
    out = np.random.default_rng(3).random(T * F) < 0.3
    a, ea = bench.step(lights, np.where(out, 0, residual), weight=~out)
    b, eb = bench.step(lights, np.where(out, 1e6, residual), weight=~out)
    np.testing.assert_array_equal(differences(a, lights), differences(b, lights))
    np.testing.assert_array_equal(ea, eb)


def test_pieces_do_not_matter(bench):
    lights = perturbed()
    residual = bench.predict(LIGHTS) - bench.predict(lights)
    a, b = bench.step(lights, residual)[0], bench.step(lights, residual, pieces=7)[0]
    np.testing.assert_allclose(differences(b, a), 0, atol=1e-10)


def test_no_residual_no_step(bench):
    found, _ = bench.step(LIGHTS, np.zeros(T * F))
    np.testing.assert_allclose(differences(found, LIGHTS), 0, atol=1e-12)


def test_gains_have_geometric_mean_one(bench):
    louder = [replace(light, gain=5 * light.gain) for light in LIGHTS]
    found, _ = bench.step(louder, np.zeros(T * F))
    assert np.prod([light.gain for light in found]) == pytest.approx(1)


def test_distance_stays_where_it_is_not_free(bench):
    lights = moved(LIGHTS, 0, 3, 0.1)
    found, error = bench.step(lights, bench.predict(LIGHTS) - bench.predict(lights), near=False)
    assert [a.curvature for a in found] == [b.curvature for b in lights]
    assert np.isinf(error).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_steps_and_distances_are_bounded(bench, sign):
    """A residual far beyond any model moves a light by no more than the step."""
    wild = sign * 1e4 * (bench.predict(moved(LIGHTS, 0, 0, 0.05)) - bench.predict(LIGHTS))
    found, _ = bench.step(LIGHTS, wild, step=0.03)
    for a, b in zip(found, LIGHTS, strict=True):
        assert angle(a.direction, b.direction) < np.degrees(0.0301)
        assert 0 <= a.curvature <= 0.5
        assert abs(a.curvature - b.curvature) <= 3 * 0.03 + 1e-12
        assert np.linalg.norm(a.direction) == pytest.approx(1)


def test_a_light_whose_highlights_no_sample_sees_stays(bench):
    """Its rows of the normal equations are 0: no division by them, and no motion."""
    away = np.ones(T * F)
    near = RHO[0] * lobes(bench.texels, bench.cameras, LIGHTS[:1], ALPHA[0]).ravel()
    away[near > 0] = 0
    lights = perturbed()
    found, error = bench.step(
        lights, bench.predict(LIGHTS) - bench.predict(lights), weight=away, damping=0.01
    )
    assert np.isfinite(differences(found, lights)).all()
    hidden, hidden_error = bench.step(lights, np.ones(T * F), weight=np.zeros(T * F))
    np.testing.assert_allclose(differences(hidden, lights)[:, [0, 1, 3]], 0, atol=1e-12)
    assert np.isinf(hidden_error).all()
    assert error.shape == (3,)


def test_materials_without_gloss_say_nothing(bench):
    found, error = bench.step(LIGHTS, np.ones(T * F), rho=np.zeros(1))
    np.testing.assert_allclose(differences(found, LIGHTS), 0, atol=1e-12)
    assert np.isinf(error).all()
