"""Clusters by gloss on filmed balls: parted where it is of two kinds, joined where it is one."""

import numpy as np
import pytest
from analytic import angle, bumpy_ball, film, lamp, orbit, rotation
from scipy.spatial import cKDTree

from benchmarks.scenes.score import adjusted_rand
from meshlab_svbrdf.reflectance.gloss_areas import _nearest, by_gloss, by_size, patches

CAMERAS = orbit(60, turns=2.0, climb=100.0, distance=5.0)
TEXELS = bumpy_ball(5000)
PLACE = TEXELS.position.astype(float)
TURN = np.full(len(TEXELS), 1.5)
LAMPS = [
    lamp([0.4, 0.7, 0.6], 1.1, 0.1), lamp([-0.8, 0.3, 0.5], 0.9, 0.1), lamp([0.1, 0.5, -0.9], 1.0)
]  # fmt: skip
SHADE = 0.15 + sum(np.maximum(TEXELS.normal @ light.direction, 0) for light in LAMPS)
GLAZE, SATIN, DULL, MATT = (35.0, 60.0), (20.0, 20.0), (12.0, 8.0), (0.0, 1.0)


def areas(*directions):
    """The texels nearest to each direction, (T,) int."""
    return np.argmax(PLACE @ np.array(directions, float).T, axis=1)


def filmed(folder, material, glosses, seed=0, noise=1.3):
    rho_s, alpha = np.array(glosses).T
    stain = 1 + 0.3 * np.sin(5 * PLACE[:, 0]) * np.sin(4 * PLACE[:, 1])
    diffuse = (12 * SHADE * stain)[:, None] * np.array([1.1, 0.9, 0.7])
    return film(
        folder, TEXELS, CAMERAS, LAMPS, material, rho_s, alpha, diffuse, noise=noise, seed=seed
    )


def guessed(seed=3):
    """The lamps half a degree off, as an environment map shows them."""
    rng = np.random.default_rng(seed)
    found = []
    for light in LAMPS:
        off = light.direction + 0.009 * rotation(rng)[0]
        found.append(lamp(off))
        assert angle(found[-1].direction, light.direction) < 0.6
    return found


def found(scene, labels, lights=None, colors=None, reach=20.0):
    """By gloss, where colours are as far apart as can be, or as given."""
    apart = 1e3 * np.column_stack([labels, labels, labels]).astype(float)
    return by_gloss(
        scene.observations, labels, apart if colors is None else colors,
        guessed() if lights is None else lights, TURN, reach,
    )  # fmt: skip


FOUR = areas([1, 0, 0], [-1, 0.2, 0], [0, 1, 0.5], [0, -0.5, -1])
HALVES = areas([1, 0.3, 0], [-1, -0.3, 0])


@pytest.mark.parametrize(
    "pair", [(GLAZE, DULL), (GLAZE, MATT), (SATIN, MATT)], ids=["dull", "matt", "satin"]
)
def test_one_colour_of_two_glosses_comes_apart(tmp_path, pair):
    scene = filmed(tmp_path, HALVES, pair)
    labels = found(scene, np.zeros(len(HALVES), np.int32))
    assert labels.max() == 1
    lit = PLACE[:, 1] > -0.3  # below no lamp is mirrored, and nothing can tell
    assert adjusted_rand(HALVES[lit], labels[lit]) > 0.85


@pytest.mark.parametrize("gloss", [GLAZE, DULL, MATT])
def test_one_gloss_is_left_whole(tmp_path, gloss):
    scene = filmed(tmp_path, 0 * FOUR, [gloss])
    labels = found(scene, np.zeros(len(FOUR), np.int32))
    assert labels.max() == 0


def test_colours_of_one_gloss_are_joined_and_others_are_not(tmp_path):
    """Four colours; two share the glaze."""
    scene = filmed(tmp_path, FOUR, [GLAZE, SATIN, GLAZE, DULL])
    labels = found(scene, FOUR.astype(np.int32))
    assert adjusted_rand(np.where(FOUR == 2, 0, FOUR), labels) == 1


def test_where_nothing_shines_colour_stands(tmp_path):
    scene = filmed(tmp_path, FOUR, [MATT] * 4)
    labels = found(scene, FOUR.astype(np.int32))
    np.testing.assert_array_equal(labels, FOUR)
    none = found(scene, FOUR.astype(np.int32), [], TURN)
    np.testing.assert_array_equal(none, FOUR)


def test_matt_colours_stay_apart_beside_glossy_ones_that_join(tmp_path):
    scene = filmed(tmp_path, FOUR, [GLAZE, MATT, GLAZE, MATT])
    given = FOUR.astype(np.int32)
    given[::9] = -1
    labels = found(scene, given)
    assert np.array_equal(labels < 0, given < 0)
    assert adjusted_rand(np.where(given == 2, 0, given), labels) == 1


def test_the_silent_follow_the_nearest_colour_that_is_not_contradicted(tmp_path):
    """Below, no lamp is mirrored: it goes with the nearer colour; matt in the light does not."""
    below = PLACE[:, 1] < -0.92
    kinds = np.where(below, 2, np.where(PLACE[:, 0] > 0, 0, 1)).astype(np.int32)
    scene = filmed(tmp_path, np.where(below, 1, kinds), [GLAZE, (15.0, 60.0)])
    colors = np.array([[0.0, 0, 0], [40, 0, 0], [28, 0, 0]])[kinds]
    labels = found(scene, kinds, colors=colors)
    assert adjusted_rand(np.where(below, 1, kinds), labels) == 1
    assert found(scene, kinds, colors=3 * colors).max() == 2

    matt = filmed(tmp_path / "matt", np.where(kinds == 2, 1, kinds), [GLAZE, MATT])
    lit = np.where(kinds == 2, 1, kinds).astype(np.int32)
    assert found(matt, lit, colors=0 * colors).max() == 1


def test_patches_are_parts_of_clusters():
    labels = np.where(np.arange(len(PLACE)) % 7 == 0, -1, FOUR).astype(np.int32)
    patch, of = patches(labels, PLACE)
    assert np.array_equal(patch < 0, labels < 0)
    assert np.array_equal(of[patch[labels >= 0]], labels[labels >= 0])
    spread = [np.ptp(PLACE[patch == p], axis=0).max() for p in range(len(of))]
    assert max(spread) <= 2 * np.linalg.norm(PLACE, axis=1).max() / 12 + 1e-6


@pytest.mark.parametrize(("points", "places"), [(5, 0), (1, 3), (3, 4), (9, 0)])
def test_nearest_points_also_where_nobody_asks_or_few_are_there(points, places):
    rng = np.random.default_rng(0)
    tree = cKDTree(rng.normal(size=(points, 3)))
    assert _nearest(tree, rng.normal(size=(places, 3)), 4).shape == (places, min(4, points))


def test_numbers_go_by_size():
    np.testing.assert_array_equal(by_size(np.array([3, 3, -1, 0, 5, 5, 5])), [1, 1, -1, 2, 0, 0, 0])
