"""Groups of texels: passing them over must never lose a texel that is seen."""

import numpy as np
import pytest
from analytic import plane, sphere
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from meshlab_svbrdf.geometry.texel_groups import GROUP, faces_away, group_texels
from meshlab_svbrdf.geometry.texels import rasterise_texels

BALL = rasterise_texels(sphere(24), ((64, 128),))
GROUPS = group_texels(BALL)


@njit
def away(groups, eye, cut):
    out = np.empty(len(groups.radius), np.bool_)
    for g in range(len(out)):
        out[g] = faces_away(groups, g, eye, cut)
    return out


def cosines(texels, eye):
    view = eye - texels.position
    return np.einsum("td,td->t", view, texels.normal) / np.linalg.norm(view, axis=1)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-8, 8)] * 3), st.sampled_from([1e-3, 0.1, 0.5]))
def test_no_texel_that_is_seen_is_in_a_group_passed_over(eye, cut):
    eye = np.array(eye, np.float32)
    passed = np.repeat(away(GROUPS, eye, np.float32(cut)), GROUP)[: len(BALL)]
    assert not (cosines(BALL, eye) >= cut)[passed].any()


def test_most_of_what_faces_away_is_passed_over():
    eye = np.array([0, 0, 5], np.float32)
    passed = np.repeat(away(GROUPS, eye, np.float32(0.1)), GROUP)[: len(BALL)]
    assert passed.sum() > 0.6 * (cosines(BALL, eye) < 0.1).sum()


@pytest.mark.parametrize("count", [0, 1, GROUP, GROUP + 1])
def test_groups_bound_their_texels(count):
    wall = rasterise_texels(plane(1.0), ((16, 16),))
    some = type(wall)(
        wall.position[:count], wall.normal[:count], wall.face[:count], wall.barycentric[:count],
        wall.texture[:count], wall.row[:count], wall.col[:count], wall.center, wall.radius,
        wall.sizes,
    )  # fmt: skip
    groups = group_texels(some)
    assert len(groups.radius) == -(-count // GROUP)
    for g in range(len(groups.radius)):
        own = some.position[g * GROUP : (g + 1) * GROUP]
        away = np.linalg.norm(own - groups.center[g], axis=1)
        assert away.max() == pytest.approx(groups.radius[g])
        assert groups.spread[g] == pytest.approx(0, abs=1e-3)


def test_normals_that_cancel_pass_nothing_over():
    """A group that faces everywhere has no axis."""
    both = type(BALL)(
        np.zeros((2, 3), np.float32), np.array([[0, 0, 1], [0, 0, -1]], np.float32),
        BALL.face[:2], BALL.barycentric[:2], BALL.texture[:2], BALL.row[:2], BALL.col[:2],
        BALL.center, BALL.radius, BALL.sizes,
    )  # fmt: skip
    assert not away(group_texels(both), np.array([0, 0, 3], np.float32), np.float32(0.1)).any()
