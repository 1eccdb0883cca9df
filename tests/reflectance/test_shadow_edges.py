"""Shadows of a square that hangs above a plane: their edges are known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from analytic import free_texels, lamp, look_at, observations_of, plane

from meshlab_svbrdf.geometry.visibility import POINT_OFFSET, Rays
from meshlab_svbrdf.reflectance.fit_samples import collect
from meshlab_svbrdf.reflectance.fit_state import FitState
from meshlab_svbrdf.reflectance.phong import cast_shadows
from meshlab_svbrdf.reflectance.shadow_edges import LEAST, MARGIN, kept, shadow_edges

T = 1500


@pytest.fixture(scope="module")
def floor(tmp_path_factory):
    """Texels at random on z = 0 under a square of half side .5 at z = 1."""
    place = np.random.default_rng(0).uniform(-1, 1, (T, 3)) * [1, 1, 0]
    texels = free_texels(place, np.tile([0.0, 0, 1], (T, 1)))
    cameras = [look_at([x, 0.3, 2.5]) for x in (-1.0, 0, 1)]
    o = observations_of(
        tmp_path_factory.mktemp("floor"), np.full((T, 3, 3), 90), np.full((T, 3), 127), texels,
        cameras,
    )  # fmt: skip
    return replace(o, rays=Rays(plane(0.5, z=1.0)))


def shaded(x, y):
    return (np.abs(x) < 0.5) & (np.abs(y) < 0.5)


@pytest.mark.parametrize("bar", [0.0, 0.2])
@pytest.mark.parametrize("breadth", [0.0, 0.1])
def test_edges_lie_where_the_rim_of_the_lamp_says_otherwise(floor, bar, breadth):
    light = replace(lamp([0.0, 0, 1]), bar=np.array([bar, 0, 0]), breadth=breadth if bar else 0.0)
    everywhere = np.arange(T)
    lit = cast_shadows(floor, everywhere, [light])
    x, y, _ = floor.texels.position.T.astype(float)
    np.testing.assert_array_equal(lit[:, 0] == 1, ~shaded(x, y))
    # A lamp's point away by s to the side throws its shadow to the other side
    height = 1 - POINT_OFFSET * floor.rays.radius
    steps = height * (np.array([bar, light.breadth]) + np.tan(MARGIN))
    expected = np.zeros(T, bool)
    for sign in (1, -1):
        expected |= shaded(x + sign * steps[0], y) != shaded(x, y)
        expected |= shaded(x, y + sign * steps[1]) != shaded(x, y)
    found = shadow_edges(floor, everywhere, [light], lit)
    np.testing.assert_array_equal(found, expected)
    assert 0.02 < found.mean() < 0.5


def test_some_texels_are_asked_alone(floor):
    light, some = [lamp([0.1, 0.2, 1])], np.arange(3, T, 7)
    whole = shadow_edges(floor, np.arange(T), light, cast_shadows(floor, np.arange(T), light))
    part = shadow_edges(floor, some, light, cast_shadows(floor, some, light))
    np.testing.assert_array_equal(part, whole[some])


def test_a_material_with_edges_everywhere_keeps_its_texels():
    material = np.array([0] * 40 + [1] * 10, np.int32)
    edge = np.ones(50, bool)
    edge[: int(40 * LEAST) + 1] = False
    keep = kept(edge, material)
    np.testing.assert_array_equal(keep[:40], ~edge[:40])
    assert keep[40:].all()


def test_texels_at_edges_have_no_weight(floor):
    light, everywhere = [lamp([0.0, 0, 1])], np.arange(T)
    taken = collect(floor, everywhere, np.zeros(T, np.int32))
    with ThreadPoolExecutor(2) as pool:
        state = FitState(floor, taken, 1, pool)
        state.light(light)
        assert (state.weight > 0).all()  # until it is taken anew: trials of lights share it
        state.predict(np.array([0.0]), np.array([1.0]))
        state.reweigh(True)
    edge = shadow_edges(floor, everywhere, light, cast_shadows(floor, everywhere, light))
    np.testing.assert_array_equal(state.weight > 0, np.repeat(~edge, np.diff(taken.offsets)))
