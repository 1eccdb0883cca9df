"""Groups of texels: passing them over must never lose a texel that is seen."""

import numpy as np
import pytest
from analytic import plane, sphere
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from meshlab_svbrdf.geometry.groups import GROUP, faces_away, group
from meshlab_svbrdf.geometry.texels import rasterise_texels

BALL = rasterise_texels(sphere(24), ((64, 128),))
CUTS = (1e-3, 0.1, 0.5)
GROUPS = {cut: group(BALL.position, BALL.normal, cut) for cut in CUTS}


@njit
def away(groups, eye):
    out = np.empty(len(groups.radius), np.bool_)
    for g in range(len(out)):
        out[g] = faces_away(groups, g, eye)
    return out


def cosines(texels, eye):
    view = eye - texels.position
    return np.einsum("td,td->t", view, texels.normal) / np.linalg.norm(view, axis=1)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-8, 8)] * 3), st.sampled_from(CUTS))
def test_no_texel_that_is_seen_is_in_a_group_passed_over(eye, cut):
    eye = np.array(eye, np.float32)
    passed = np.repeat(away(GROUPS[cut], eye), GROUP)[: len(BALL)]
    assert not (cosines(BALL, eye) >= cut)[passed].any()


def test_most_of_what_faces_away_is_passed_over():
    eye = np.array([0, 0, 5], np.float32)
    passed = np.repeat(away(GROUPS[0.1], eye), GROUP)[: len(BALL)]
    assert passed.sum() > 0.6 * (cosines(BALL, eye) < 0.1).sum()


@pytest.mark.parametrize("count", [0, 1, GROUP, GROUP + 1])
def test_groups_bound_their_texels(count):
    wall = rasterise_texels(plane(1.0), ((16, 16),))
    position, normal = wall.position[:count], wall.normal[:count]
    groups = group(position, normal, 0.1)
    assert len(groups.radius) == -(-count // GROUP)
    for g in range(len(groups.radius)):
        own = position[g * GROUP : (g + 1) * GROUP]
        assert np.linalg.norm(own - groups.center[g], axis=1).max() == pytest.approx(
            groups.radius[g]
        )
        assert groups.cosine[g] == pytest.approx(0.1, abs=2e-3)


def test_normals_that_cancel_pass_nothing_over():
    """A group that faces everywhere has no axis."""
    both = np.array([[0, 0, 1], [0, 0, -1]], np.float32)
    assert not away(group(np.zeros((2, 3)), both, 0.1), np.array([0, 0, 3], np.float32)).any()


def test_points_without_a_normal_keep_no_group_from_being_passed_over():
    normal = np.array([[0, 0, 1], [0, 0, 0]], np.float32)
    assert away(group(np.zeros((2, 3)), normal, 0.1), np.array([0, 0, -3], np.float32)).all()
