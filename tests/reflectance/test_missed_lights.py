"""Lights that no guess names, found in what the named ones leave unexplained."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, bumpy_ball, film, lamp, orbit, unit

from meshlab_svbrdf.reflectance.fit_samples import collect
from meshlab_svbrdf.reflectance.fit_state import FitState
from meshlab_svbrdf.reflectance.joint import fit
from meshlab_svbrdf.reflectance.light_evidence import hear
from meshlab_svbrdf.reflectance.missed_lights import Residue, brightest, complete_lights, search

T, F = 2500, 120
LIGHTS = [
    lamp([0.3, 0.5, 0.8], 1.2),
    lamp([-0.8, 0.3, 0.3], 0.9, 0.1),
    lamp([0.1, -0.6, -0.8], 0.5),
]
RHO, ALPHA = np.array([40.0, 20.0, 0.0]), np.array([120.0, 12.0, 10.0])
TURN, FOOTPRINT = np.full(T, 1.5), 0.005


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    rng = np.random.default_rng(0)
    material = rng.integers(0, 3, T).astype(np.int32)
    return film(
        tmp_path_factory.mktemp("film"), bumpy_ball(T), orbit(F, turns=4, climb=120), LIGHTS,
        material, RHO, ALPHA, rng.uniform(4, 40, (T, 3)), noise=1.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def state(scene):
    """Every fifth texel, lit by some lights whose lobes are known."""
    with ThreadPoolExecutor(2) as pool:

        def state(lights):
            chosen = np.arange(0, T, 5)
            taken = collect(scene.observations, chosen, scene.material[chosen])
            made = FitState(scene.observations, taken, 3, pool)
            made.light(lights)
            for _ in range(2):
                made.predict(RHO, ALPHA)
                made.reweigh(True)
            return made

        yield state


def test_every_light_but_one_leaves_that_one(scene, state):
    for k, missed in enumerate(LIGHTS):
        others = LIGHTS[:k] + LIGHTS[k + 1 :]
        found = brightest(search(state(others), scene.observations.view, RHO, ALPHA), others)
        assert found is not None
        assert angle(found.direction, missed.direction) < 8
        assert 0.3 * missed.gain < found.gain < 1.5 * missed.gain


def test_all_lights_leave_nothing(scene, state):
    assert brightest(search(state(LIGHTS), scene.observations.view, RHO, ALPHA), LIGHTS) is None


def test_a_lamp_explains_as_much_as_its_gain_says(tmp_path):
    """No noise, no other light, a lobe wide enough: N/Q is the gain, N²/Q all there is."""
    light = lamp([0.0, 0.6, 0.8], 0.7)
    scene = film(
        tmp_path, bumpy_ball(400), orbit(F, turns=4, climb=120), [light],
        np.zeros(400, np.int32), [40.0], [12.0], np.full((400, 3), 10.0),
    )  # fmt: skip
    everywhere = np.arange(400)
    taken = collect(scene.observations, everywhere, scene.material)
    with ThreadPoolExecutor(2) as pool:
        state = FitState(scene.observations, taken, 1, pool)
        state.light([lamp([0, 0, 1], 1e-9)])
        state.predict(np.array([40.0]), np.array([12.0]))
        residue = search(state, scene.observations.view, np.array([40.0]), np.array([12.0]))
    best = int(np.argmax(residue.share))
    assert angle(residue.direction[best], light.direction) < 4
    assert residue.gain[best] == pytest.approx(0.7, rel=0.02)
    assert 0.97 < residue.share[best] <= 1


def test_what_is_faint_uncertain_or_beside_a_light_is_no_candidate():
    known = [lamp([0, 0, 1], 1.0)]
    direction = unit(np.array([[0, 0.1, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]]))
    gain = np.array([1, 0.6, 0.04, 0.6, 0.6])
    share = np.array([0.9, 0.2, 0.9, 0.005, 0.9])
    z = np.array([50, 8.0, 50, 50, 4])
    found = brightest(Residue(direction, gain, share, z), known)
    assert found is not None
    np.testing.assert_array_equal(found.direction, [1, 0, 0])
    assert found.gain == 0.6


def test_witnesses_speak_for_lamps_and_against_ghosts(state):
    ghost = lamp([0.9, -0.3, 0.3], 0.5)
    noise = np.full(3, 0.3)
    lights = [*LIGHTS, ghost]
    said = hear(state(lights), 4, RHO, ALPHA, noise)
    assert (said.texels > 20).all()
    assert (said.share[:3] > 0.95).all()
    assert said.share[3] < 0.2
    assert (said.taken[:3] > 0.8).all()
    assert said.taken[3] < 0
    unseen = hear(state([*LIGHTS, lamp([0.9, -0.3, 0.3], 1e-6)]), 4, RHO, ALPHA, noise)
    assert unseen.texels[3] == unseen.share[3] == unseen.taken[3] == 0


def test_completes_the_lights(scene):
    lights, _, notes = complete_lights(
        scene.observations, scene.material, LIGHTS[:1], TURN, FOOTPRINT, samples=600_000
    )
    assert len(lights) == 3
    assert notes == ["2 lights added that the environment map does not show"]
    found = fit(scene.observations, scene.material, lights, TURN, FOOTPRINT)
    for light in LIGHTS:
        near = min(found.lights, key=lambda f: angle(f.direction, light.direction))
        assert angle(near.direction, light.direction) < 0.1
        assert near.gain / found.lights[0].gain == pytest.approx(light.gain / 1.2, rel=0.03)


def test_adds_none_where_none_is_missed(scene):
    given = [replace(light, curvature=0.0) for light in LIGHTS]
    lights, _, notes = complete_lights(
        scene.observations, scene.material, given, TURN, FOOTPRINT, samples=600_000
    )
    assert len(lights) == 3
    assert notes == []


def test_without_gloss_the_lights_stay_as_they_are(tmp_path):
    scene = film(
        tmp_path, bumpy_ball(400), orbit(40), [], np.zeros(400, np.int32), [0.0], [1.0],
        np.full((400, 3), 10.0), noise=1.0,
    )  # fmt: skip
    arguments = scene.observations, scene.material
    turn = np.full(400, 1.5)
    assert complete_lights(*arguments, LIGHTS, turn, FOOTPRINT) == (LIGHTS, None, [])
    assert complete_lights(*arguments, [], turn, FOOTPRINT) == ([], None, [])
