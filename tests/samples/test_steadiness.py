"""Whether the light stayed: a ball in two lamps' light, one of which changes halfway or not."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import ball, grey, lamp, lobes, observations_of, orbit, view_vectors

from meshlab_svbrdf.samples.steadiness import light_steadiness

T, F = 1200, 48
TEXELS, CAMERAS = ball(T), orbit(F, turns=2, climb=80)
LAMPS = [lamp([0.3, 0.5, 0.8]), lamp([-0.8, 0.3, 0.3], 0.7)]


def shade(lamps, metal):
    """Lambert and gloss under lamps and ambient light, (T, F); a share of it is rough metal."""
    facing = sum(g.gain * np.maximum(TEXELS.normal @ g.direction, 0) for g in lamps)
    rng = np.random.default_rng(1)
    albedo = rng.uniform(15, 40, T)
    paint = (albedo * (0.15 + facing))[:, None] + 20 * lobes(TEXELS, CAMERAS, lamps, 40.0)
    shine = 2 + 70 * lobes(TEXELS, CAMERAS, lamps, 12.0)
    return np.where((rng.random(T) < metal)[:, None], shine, paint)


def filmed(folder, early, late, gain=None, metal=0.0):
    y = np.where(np.arange(F) < F / 2, shade(early, metal), shade(late, metal))
    y = y * (np.ones(F) if gain is None else gain)
    noise = np.random.default_rng(2).normal(0, 1, (T, F, 1))
    codes = np.clip(grey(y) + noise, 0, 255).astype(np.uint8)
    facing = np.sum(view_vectors(TEXELS, CAMERAS) * TEXELS.normal[:, None], -1)
    quality = np.where(facing > 0.1, np.rint(127 * facing.clip(0, 1)), 0).astype(np.uint8)
    quality |= np.where((codes.max(-1) >= 254) & (quality > 0), 128, 0).astype(np.uint8)
    return observations_of(folder, codes, quality, TEXELS, CAMERAS)


def test_steady_light_is_steady(tmp_path):
    found = light_steadiness(filmed(tmp_path, LAMPS, LAMPS), np.ones(F))
    assert found.sides < 0.01
    assert found.turns < 0.03


def test_the_gloss_of_a_half_is_no_light(tmp_path):
    """Seen from higher up in the second half, metal is brighter above: on all of one side."""
    steady = light_steadiness(filmed(tmp_path / "a", LAMPS, LAMPS, metal=2 / 3), np.ones(F))
    assert steady.sides < 0.01
    weaker = [replace(LAMPS[0], gain=0.7), LAMPS[1]]
    changed = light_steadiness(filmed(tmp_path / "b", LAMPS, weaker, metal=2 / 3), np.ones(F))
    assert changed.sides > 0.2


@pytest.mark.parametrize(
    ("late", "least"),
    [
        ([LAMPS[0]], 1.0),
        ([replace(LAMPS[0], gain=0.7), LAMPS[1]], 0.25),
        ([LAMPS[0], replace(LAMPS[1], gain=0.49)], 0.2),
        ([lamp([0.8, 0.5, 0.3]), LAMPS[1]], 1.0),
    ],
    ids=["off", "weaker", "the other weaker", "moved"],
)
def test_a_lamp_that_changes_halfway_shows(tmp_path, late, least):
    found = light_steadiness(filmed(tmp_path, LAMPS, late), np.ones(F))
    assert found.sides > least
    assert found.turns < 0.03


def test_exposure_is_no_light(tmp_path):
    gain = np.where(np.arange(F) < F / 2, 1.0, 0.7)
    found = light_steadiness(filmed(tmp_path, LAMPS, LAMPS, gain), gain)
    assert found.sides < 0.01


def test_few_texels_tell_nothing(tmp_path):
    codes, quality = np.full((50, F, 3), 90, np.uint8), np.full((50, F), 127, np.uint8)
    assert light_steadiness(observations_of(tmp_path, codes, quality, ball(50), CAMERAS),
                            np.ones(F)) is None  # fmt: skip
