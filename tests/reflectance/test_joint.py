"""The joint fit on a dented ball of known lights and materials, filmed in 8 bits with noise."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import (
    REC709,
    angle,
    ball,
    bumpy_ball,
    film,
    free_texels,
    lamp,
    observations_of,
    orbit,
    rotation,
    unit,
)

import meshlab_svbrdf.reflectance.joint as module
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.reflectance.diffuse import diffuse_color
from meshlab_svbrdf.reflectance.diffuse_refit import refitting
from meshlab_svbrdf.reflectance.environment import environment_map
from meshlab_svbrdf.reflectance.evidence import Evidence
from meshlab_svbrdf.reflectance.fit_state import _predict, _reweigh, huber_scale
from meshlab_svbrdf.reflectance.joint import _converged, _settle, fit
from meshlab_svbrdf.reflectance.lights import lights_by_peaks, tangents
from meshlab_svbrdf.reflectance.models import described
from meshlab_svbrdf.reflectance.threshold import luminance_threshold

T, F = 2500, 160
LIGHTS = [
    lamp([0.3, 0.5, 0.8], 1.2, 0.2),
    lamp([-0.8, 0.3, 0.3], 1.0, 0.1),
    lamp([0.1, -0.6, -0.8], 1 / 1.2),
]
NOISE = 1.3  # codes RMS, as on an ordinary camera
TURN, FOOTPRINT = np.full(T, 1.5), 0.005


@pytest.fixture(scope="module")
def shoot(tmp_path_factory):
    """Films the dented ball: materials at random over its texels, diffuse colours too."""

    def shoot(rho_s, alpha, lights=LIGHTS, noise=NOISE, seed=0, texels=None, cameras=None, **kw):
        texels = texels or bumpy_ball(T)
        rng = np.random.default_rng(seed)
        material = rng.integers(0, len(rho_s), len(texels)).astype(np.int32)
        diffuse = rng.uniform(4, 40, (len(texels), 3))
        return film(
            tmp_path_factory.mktemp("film"), texels, cameras or orbit(F, turns=4, climb=120),
            lights, material, rho_s, alpha, diffuse, noise=noise, seed=seed, **kw,
        )  # fmt: skip

    return shoot


@pytest.fixture(scope="module")
def scene(shoot):
    """Two glossy materials and a matte one."""
    return shoot([45.0, 30.0, 0.0], [40.0, 150.0, 10.0])


def guess(lights=LIGHTS, degrees=1.0):
    """What the environment map gives: a degree off, of equal gain, far."""
    out = []
    for k, light in enumerate(lights):
        phi = 2.4 * k
        step = np.radians(degrees) * np.array([np.cos(phi), np.sin(phi)])
        direction = unit(light.direction + step @ tangents(light.direction))
        out.append(replace(light, direction=direction, gain=1.0, curvature=0.0))
    return out


def run(scene, lights=None, **kw):
    return fit(
        scene.observations, scene.material, guess() if lights is None else lights, TURN, FOOTPRINT,
        **kw,
    )  # fmt: skip


def assert_materials(found, scene, tolerance):
    for m, rho, alpha in zip(found.materials, scene.rho_s, scene.alpha, strict=True):
        if rho > 0:
            assert m.observed, m.reason
            assert m.rho_s == pytest.approx(rho, rel=tolerance)
            assert m.alpha == pytest.approx(alpha, rel=tolerance)
        else:
            assert not m.observed
            assert np.isnan([m.rho_s, m.alpha]).all()
            assert m.reason


def assert_lights(found, truth, *, degrees=0.1, gain=0.03, curvature=0.01):
    assert len(found.lights) == len(truth)
    for light in truth:
        near = min(found.lights, key=lambda f: angle(f.direction, light.direction))
        assert angle(near.direction, light.direction) < degrees
        assert near.gain == pytest.approx(light.gain, rel=gain)
        assert near.curvature == pytest.approx(light.curvature, abs=curvature)


def test_recovers_materials_and_lights(scene):
    found = run(scene)
    assert_materials(found, scene, 0.02)
    assert_lights(found, LIGHTS)
    assert found.lights[2].curvature == 0  # far, and said to be
    assert found.lights[2].position(np.zeros(3), 1.0) is None
    assert found.notes == []
    counts = np.bincount(scene.material)
    for m, count in zip(found.materials, counts, strict=True):
        assert m.texels == count
        assert m.color == (1, 1, 1)


def test_without_noise_only_the_codes_and_the_grid_are_left(shoot):
    scene = shoot([45.0, 30.0], [40.0, 150.0], noise=0.0)
    found = run(scene)
    assert_materials(found, scene, 0.01)
    assert_lights(found, LIGHTS, degrees=0.05, gain=0.02, curvature=0.005)


def test_near_lamps_are_found_where_they_stand(shoot):
    """At 2.5 and 3.3 radii, from guesses that they are far."""
    lights = [replace(LIGHTS[0], curvature=0.4), replace(LIGHTS[1], curvature=0.3), LIGHTS[2]]
    scene = shoot([45.0, 30.0], [40.0, 150.0], lights)
    found = run(scene)
    assert_materials(found, scene, 0.05)
    assert_lights(found, lights, gain=0.05, curvature=0.02)


def test_clipped_peaks_are_extrapolated(shoot):
    """The top of the lobe is 120 and more where the frames end at 100."""
    scene = shoot([120.0, 45.0], [60.0, 40.0])
    assert (scene.observations.store.read(0, T).quality >= 128).mean() > 0.005
    assert_materials(run(scene), scene, 0.05)
    assert_materials(run(scene, censoring=False), scene, 0.05)


def test_ignoring_near_light_costs_what_it_should(shoot):
    """The option off is worse: what it is for."""
    scene = shoot([45.0, 30.0], [40.0, 150.0])
    far = run(scene, near=False)
    assert all(light.curvature == 0 for light in far.lights)
    error = [abs(np.log(m.rho_s / r)) for m, r in zip(far.materials, scene.rho_s, strict=True)]
    assert max(error) > 0.1


def test_a_light_that_is_none_is_dropped(shoot):
    scene = shoot([45.0, 30.0], [40.0, 150.0])
    found = run(scene, guess([*LIGHTS, lamp([0, -1, 0.3])]))
    assert_lights(found, LIGHTS)
    assert_materials(found, scene, 0.03)
    assert any("1 lights dropped" in note for note in found.notes)


def test_wide_faint_lobes_are_not_overlooked(shoot):
    """False negative: α = 12 with ρs of 3 of 100, two codes above the noise at its top."""
    scene = shoot([3.0], [12.0])
    found = run(scene)
    assert_materials(found, scene, 0.05)
    assert_lights(found, LIGHTS, degrees=0.5, curvature=0.03)


@pytest.mark.parametrize(
    ("seed", "noise"), [(0, NOISE), (1, NOISE), (2, NOISE), (3, 8.0), (4, 8.0)]
)
def test_noise_on_matte_surfaces_is_no_gloss(shoot, seed, noise):
    """False positive: D only. Every material says why, and no light is claimed."""
    scene = shoot([0.0, 0.0], [10.0, 10.0], noise=noise, seed=seed)
    found = run(scene)
    assert_materials(found, scene, 0)
    assert found.lights == []
    assert any("no gloss" in note for note in found.notes)


def test_gold_shines_golden(shoot):
    gold = np.array([1.6, 0.9, 0.2]) / ([1.6, 0.9, 0.2] @ REC709)
    scene = shoot([30.0, 30.0], [60.0, 60.0], tint=[gold, [1, 1, 1]])
    found = run(scene)
    np.testing.assert_allclose(found.materials[0].color, gold, rtol=0.03)
    assert found.materials[1].color == (1, 1, 1)


def test_no_lights_no_materials_and_why(scene):
    found = run(scene, [])
    assert found.lights == []
    assert [m.reason for m in found.materials] == ["no light was found"] * 3
    assert not any(m.observed for m in found.materials)
    nothing = fit(scene.observations, np.full(T, -1, np.int32), guess(), TURN, FOOTPRINT)
    assert nothing.materials == []
    assert nothing.notes == ["there is no material"]


def test_texels_of_no_material_and_materials_of_no_texel(scene):
    """Ids may have holes: a material without texels is unobserved, the others are as before."""
    material = np.where(scene.material == 1, 4, np.where(scene.material == 2, -1, 0)).astype(
        np.int32
    )
    found = fit(scene.observations, material, guess(), TURN, FOOTPRINT)
    assert [m.observed for m in found.materials] == [True, False, False, False, True]
    assert all(m.reason for m in found.materials[1:4])
    assert found.materials[4].alpha == pytest.approx(150, rel=0.03)
    assert [m.texels for m in found.materials[1:4]] == [0, 0, 0]


def turned(scene_of, matrix=None, scale=1.0, shift=(0, 0, 0)):
    """The dented ball and its cameras, moved in the world."""
    matrix = np.eye(3) if matrix is None else matrix
    texels, shift = bumpy_ball(T), np.asarray(shift, float)
    texels = free_texels(scale * texels.position @ matrix.T, texels.normal @ matrix.T, scale, shift)
    cameras = [
        Camera(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.R @ matrix.T,
               scale * c.t - c.R @ matrix.T @ shift)
        for c in orbit(F, turns=4, climb=120)
    ]  # fmt: skip
    lights = [replace(light, direction=matrix @ light.direction) for light in LIGHTS]
    return scene_of([45.0, 30.0, 0.0], [40.0, 150.0, 10.0], lights, texels=texels, cameras=cameras)


@pytest.mark.parametrize(
    "world",
    [
        {"matrix": rotation(np.random.default_rng(0))},
        {"scale": 1e-3},
        {"scale": 50.0, "shift": (4.5e5, 5.4e6, 120.0)},
    ],
    ids=["turned", "small", "at map coordinates"],
)
def test_moving_the_world_moves_only_the_lights(scene, shoot, world):
    """To a few thousandths: rounding decides single codes."""
    matrix = world.get("matrix", np.eye(3))
    start = [replace(light, direction=matrix @ light.direction) for light in guess()]
    a, b = run(scene), run(turned(shoot, **world), start)
    for m, n in zip(a.materials, b.materials, strict=True):
        assert m.observed == n.observed
        if m.observed:
            assert n.rho_s == pytest.approx(m.rho_s, rel=5e-3)
            assert n.alpha == pytest.approx(m.alpha, rel=5e-3)
    for m, n in zip(a.lights, b.lights, strict=True):
        assert angle(matrix @ m.direction, n.direction) < 0.02
        assert n.gain == pytest.approx(m.gain, rel=5e-3)
        assert n.curvature == pytest.approx(m.curvature, abs=2e-3)


def samples_of(scene):
    """Codes (T, F, 3) and quality (T, F) of a film."""
    codes, quality = np.zeros((T, F, 3), np.uint8), np.zeros((T, F), np.uint8)
    for block in scene.observations.store.blocks():
        texel = block.first + np.repeat(np.arange(block.stop - block.first), np.diff(block.offsets))
        codes[texel, block.frame], quality[texel, block.frame] = block.rgb, block.quality
    return codes, quality


def agree(found, expected, tolerance):
    """Materials and lights of two fits."""
    for m, n in zip(expected.materials, found.materials, strict=True):
        assert m.observed == n.observed
        if m.observed:
            assert n.rho_s == pytest.approx(m.rho_s, rel=tolerance)
            assert n.alpha == pytest.approx(m.alpha, rel=tolerance)
    for m, n in zip(expected.lights, found.lights, strict=True):
        np.testing.assert_allclose(n.direction, m.direction, atol=tolerance)
        assert n.gain == pytest.approx(m.gain, rel=tolerance)


def test_frames_that_a_mask_covers_change_nothing(scene, tmp_path):
    codes, quality = samples_of(scene)
    more = np.random.default_rng(5).integers(0, 256, (T, 9, 3)).astype(np.uint8)
    covered = observations_of(
        tmp_path, np.concatenate([codes, more], 1), np.pad(quality, ((0, 0), (0, 9))),
        scene.observations.texels, [*scene.cameras, *orbit(9)],
    )  # fmt: skip
    agree(run(replace(scene, observations=covered)), run(scene), 0)


def test_numbering_of_frames_does_not_matter(scene, tmp_path):
    """To the rounding of sums: they are taken in the frames' order."""
    codes, quality = samples_of(scene)
    order = np.random.default_rng(6).permutation(F)
    cameras = [scene.cameras[k] for k in order]
    mixed = observations_of(
        tmp_path, codes[:, order], quality[:, order], scene.observations.texels, cameras
    )
    agree(run(replace(scene, observations=mixed)), run(scene), 1e-3)


def test_twice_the_light_is_twice_the_gloss(scene, tmp_path):
    codes, quality = samples_of(scene)
    twice = observations_of(
        tmp_path, codes, quality, scene.observations.texels, scene.cameras, gains=np.full(F, 0.5)
    )
    found, expected = run(replace(scene, observations=twice)), run(scene)
    double = [replace(m, rho_s=2 * m.rho_s) for m in expected.materials]
    agree(found, replace(expected, materials=double), 0.02)


def test_order_of_lights_does_not_matter(scene):
    a, b = run(scene), run(scene, guess()[::-1])
    for m, n in zip(a.lights, b.lights[::-1], strict=True):
        np.testing.assert_allclose(n.direction, m.direction, atol=1e-6)
        assert n.gain == pytest.approx(m.gain, rel=1e-5)
    assert [m.alpha for m in b.materials[:2]] == pytest.approx([m.alpha for m in a.materials[:2]])


def test_threads_change_nothing(scene, monkeypatch):
    a = run(scene)
    monkeypatch.setattr(module, "thread_count", lambda: 1)
    b = run(scene)
    assert [m.alpha for m in a.materials[:2]] == [m.alpha for m in b.materials[:2]]
    for m, n in zip(a.lights, b.lights, strict=True):
        np.testing.assert_array_equal(m.direction, n.direction)


def test_evidence_is_of_texels_that_the_fit_has_not_used(scene, monkeypatch):
    """Whatever the strides of the two choices are; and there are some of every material."""
    used, collect = [], module.collect

    def record(observations, texel, material):
        used.append(texel)
        return collect(observations, texel, material)

    monkeypatch.setattr(module, "collect", record)
    for share in (0.4, 0.9, 9.0):
        used.clear()
        run(scene, samples=int(share * len(scene.observations.store)))
        _, fitted, _, judged = used  # at first, from round 2 on, for the lengths of lamps, and then
        assert not np.intersect1d(judged, fitted).size
        assert (np.bincount(scene.material[judged], minlength=3) > 20).all()


def test_fewer_samples_find_the_same(scene):
    found = run(scene, samples=len(scene.observations.store) // 8)
    assert_materials(found, scene, 0.05)


def test_starts_from_what_is_known(scene):
    """In fewer rounds, the matte material's too, it finds what it finds from nothing."""
    first = run(scene, samples=len(scene.observations.store) // 8)
    again = run(scene, first.lights, known=first.rounds[-1])
    assert len(again.rounds) < len(first.rounds)
    assert_materials(again, scene, 0.03)
    for found, light in zip(again.lights, run(scene).lights, strict=True):
        assert angle(found.direction, light.direction) < 0.02


def test_a_material_without_gloss_keeps_nobody_waiting():
    sure, unsure = (Evidence(z, 0.5, np.ones(3), np.ones(3)) for z in (1000.0, 2.0))
    before, after = ({"rho_s": [50.0, x], "alpha": [40.0, x]} for x in (5.0, 5.2))
    assert _converged(before, after, [sure, unsure])
    assert not _converged(before, after, [sure, sure])
    assert _converged(before, before, [sure, sure])


def test_curved_surfaces_are_named(scene):
    """Nothing is flat enough: the flattest twentieth is taken, and a note says so."""
    turn = 100 * (1 + np.random.default_rng(0).random(T))
    found = fit(scene.observations, scene.material, guess(), turn, FOOTPRINT)
    assert any("curved nearly everywhere" in note for note in found.notes)
    everything = fit(scene.observations, scene.material, guess(), turn, FOOTPRINT, curvature=0)
    assert everything.notes == []
    assert_materials(everything, scene, 0.03)


def test_notes_add_up(scene):
    turn = 100 * (1 + np.random.default_rng(0).random(T))
    found = fit(
        scene.observations, scene.material, guess([*LIGHTS, lamp([0, -1, 0.3])]), turn, FOOTPRINT
    )
    assert any("curved nearly everywhere" in note for note in found.notes)
    assert any("dropped" in note for note in found.notes)


def test_rounds_and_progress_are_counted(scene):
    calls = []
    found = run(scene, rounds=3, progress=lambda d, t: calls.append((d, t)))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert len(found.rounds) == 3
    assert len(found.rounds[0]["rho_s"]) == 3


# One round's predictions and weights


def test_prediction_parts_diffuse_from_lobe():
    """D is the weighted mean of y − S, and the residual what is left."""
    rng = np.random.default_rng(0)
    mirror = unit(np.array([0, 0, 1]) + 0.2 * rng.normal(size=(40, 3))).astype(np.float32)
    cos = mirror[:, 2].astype(float)
    rays, gains = np.array([[[0, 0, 1]]], np.float32), np.ones((1, 1), np.float32)
    y = (12 + 30 * cos**20).astype(np.float32)
    w = rng.uniform(0.1, 1, 40).astype(np.float32)
    specular, residual = np.zeros((2, 40), np.float32)
    blur = np.zeros((40, 4), np.float32)
    arguments = (0, 1, np.array([0, 40]), np.zeros(1, np.int32), y, mirror, blur, rays, gains)
    _predict(*arguments, np.array([30.0]), np.array([20.0]), w, specular, residual)
    np.testing.assert_allclose(specular, 30 * cos**20, rtol=1e-4)
    np.testing.assert_allclose(residual, 0, atol=1e-4)
    _predict(*arguments, np.array([0.0]), np.array([20.0]), w, specular, residual)
    assert not specular.any()
    np.testing.assert_allclose(residual, y - np.average(y, weights=w), atol=1e-4)
    _predict(*arguments, np.array([30.0]), np.array([20.0]), 0 * w, specular, residual)
    assert not residual.any()


@pytest.mark.parametrize("use_clipped", [False, True])
def test_a_clipped_sample_counts_only_where_it_was_predicted_too_dark(use_clipped):
    quality = np.array([1, 0.5, 1, 1, 1], np.float32)
    clipped = np.array([False, False, True, True, True])
    specular = np.array([0, 0, 80, 80, 80], np.float32)
    residual = np.array([0.1, -0.1, 5, -5, 0], np.float32)
    w = np.full(5, 9, np.float32)
    _reweigh(
        0, 1, np.array([0, 5]), np.zeros(1, np.int32), quality, clipped, specular, residual,
        np.array([0.3]), use_clipped, w,
    )  # fmt: skip
    np.testing.assert_allclose(w, [1, 0.5, 1 if use_clipped else 0, 0, 0])


def test_outliers_are_weighed_down_but_peaks_are_not():
    """Huber with h = h0 + .2 S."""
    residual = np.array([10, -10, 10, 0], np.float32)
    specular = np.array([0, 0, 60, 0], np.float32)
    w = np.zeros(4, np.float32)
    _reweigh(
        0, 1, np.array([0, 4]), np.zeros(1, np.int32), np.ones(4, np.float32), np.zeros(4, bool),
        specular, residual, np.array([1.0]), True, w,
    )  # fmt: skip
    np.testing.assert_allclose(w, [0.1, 0.1, 1, 1])


def test_scale_of_outliers_is_robust_and_has_a_floor(scene):
    """1.68 · median |e| of each material; .3 where it is less, or nothing is there."""
    texels = len(scene.observations.texels)
    samples = module.collect(scene.observations, np.arange(texels), scene.material)
    owner = np.repeat(scene.material, np.diff(samples.offsets))
    residual = np.where(owner == 0, 2.0, np.where(owner == 1, 0.01, np.nan))
    residual[np.flatnonzero(owner == 0)[::3]] = 1e6
    scale = huber_scale(samples, residual, (owner < 2).astype(float), 4)
    np.testing.assert_allclose(scale, [1.68 * 2, 0.3, 0.3, 0.3])


@pytest.mark.parametrize(
    ("curvature", "error", "far"),
    [(0.2, 0.01, False), (0.009, 1e-6, True), (0.2, 0.11, True), (0.2, np.inf, True), (0, 0, True)],
)
def test_a_light_is_far_where_its_distance_does_not_show(curvature, error, far):
    """κ below .01 of the radius, or below two standard errors."""
    lights, free = _settle([lamp([0, 0, 1], 1.0, curvature)], np.ones(1, bool), [error], [])
    assert lights[0].curvature == (0 if far else curvature)
    assert free.tolist() == [not far]


def test_lights_that_settle_at_next_to_nothing_are_dropped():
    lights = [lamp([0, 0, 1], 2.0, 0.2), lamp([1, 0, 0], 0.09, 0.2), lamp([0, 1, 0], 0.11, 0.2)]
    notes: list[str] = []
    kept, free = _settle(lights, np.array([True, True, False]), np.zeros(3), notes)
    gains = np.array([light.gain for light in kept])
    np.testing.assert_allclose(gains, np.array([2.0, 0.11]) / np.sqrt(2.0 * 0.11))
    assert free.tolist() == [True, False]
    assert notes == ["1 lights dropped: no highlight is theirs"]


# From the samples alone


def test_from_samples_to_lights_materials_and_diffuse_colour(shoot):
    """Every stage on what the one before found; nothing but the materials' map is given."""
    scene = shoot([45.0, 30.0], [40.0, 150.0])
    o = scene.observations
    statistics = luminance_threshold(o)
    environment = environment_map(o, statistics, height=64)
    lights = lights_by_peaks(environment)
    assert len(lights) == 3
    for light in LIGHTS:
        # A near lamp's blob is smeared by the parallax over the object
        assert min(angle(found.direction, light.direction) for found in lights) < 4
    diffuse = diffuse_color(o, statistics, environment.probability)
    found = run(scene, lights)
    assert_lights(found, LIGHTS)
    assert_materials(found, scene, 0.03)
    refit = o.store.rows(
        refitting(
            o,
            diffuse,
            scene.material,
            described(found.materials, [None] * 2)[0],
            np.ones((2, 3)),
            found.lights,
        )
    )[0]
    seen = statistics.observed
    before, after = (np.abs(d[seen] / scene.diffuse[seen] - 1) for d in (diffuse, refit))
    assert np.median(before) < 0.03
    assert np.median(after) < 0.01
    assert np.quantile(after, 0.95) < np.quantile(before, 0.95)


def test_a_smooth_ball_is_no_harder(shoot):
    scene = shoot([45.0], [40.0], texels=ball(T))
    found = run(scene)
    assert_materials(found, scene, 0.02)
    assert_lights(found, LIGHTS)
