"""Frames chosen by geometry: even, the same whatever the world or the numbering."""

import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.samples.choose_frames import choose_frames, run_order, view_places

CENTER = np.array([3.0, -2.0, 5.0])


def looking(position, target=CENTER):
    z = (target - position) / np.linalg.norm(target - position)
    x = np.cross(z, [0.1, 0.9, 0.2])
    x /= np.linalg.norm(x)
    R = np.array([x, np.cross(z, x), z])
    return Camera(640, 480, 900.0, 900.0, 320.0, 240.0, R, -R @ position)


def orbit(count, height=0.5, distance=4.0):
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.full(count, height), np.sin(angle)])
    return [looking(CENTER + distance * p / np.linalg.norm(p)) for p in ring]


def scattered(count, seed):
    """Frames at random: no two choices tie."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(count, 3))
    places *= rng.uniform(2, 5, (count, 1)) / np.linalg.norm(places, axis=1, keepdims=True)
    return [looking(CENTER + p, CENTER + rng.normal(0, 0.1, 3)) for p in places]


def chosen(cameras, limit, center=CENTER):
    return choose_frames(cameras, center, 1.0, limit)


def gap(cameras, kept):
    """How far the farthest frame is from the chosen ones."""
    places = view_places(cameras, CENTER, 1.0)
    apart = np.linalg.norm(places[:, None] - places[None, kept], axis=2)
    return apart.min(axis=1).max()


@pytest.mark.parametrize("limit", [0, 30, 31, 1000])
def test_without_a_limit_all_are_used(limit):
    assert chosen(orbit(30), limit).tolist() == list(range(30))


@given(st.integers(1, 40), st.integers(0, 9))
def test_the_limit_is_kept_in_the_films_order(limit, seed):
    kept = chosen(scattered(40, seed), limit)
    assert len(kept) == limit
    assert (np.diff(kept) > 0).all()


@given(st.integers(2, 30), st.integers(0, 9))
def test_no_frame_is_farther_than_the_chosen_from_each_other(limit, seed):
    """Hence the gap is at most twice the least possible one: some two of limit + 1 such points
    share a chosen one in whatever choice."""
    cameras = scattered(31, seed)
    kept = chosen(cameras, limit)
    places = view_places(cameras, CENTER, 1.0)[kept]
    apart = np.linalg.norm(places[:, None] - places, axis=2)[~np.eye(limit, dtype=bool)]
    assert gap(cameras, kept) <= apart.min() + 1e-12


@pytest.mark.parametrize(("count", "limit"), [(360, 12), (360, 60), (1000, 90), (97, 31)])
def test_an_orbit_is_left_in_even_steps(count, limit):
    kept = chosen(orbit(count), limit)
    steps = np.diff([*kept, kept[0] + count])
    assert steps.max() <= 2 * np.ceil(count / limit)


def test_a_film_that_stands_still_half_the_time_is_not_dwelt_on():
    moving = orbit(100)
    kept = chosen([moving[0]] * 900 + moving[1:], 50)
    assert (kept >= 900).sum() >= 49


def test_every_orbit_gets_its_share():
    cameras = [camera for height in (-0.8, 0.0, 0.8) for camera in orbit(300, height)]
    share = np.bincount(chosen(cameras, 90) // 300, minlength=3)
    assert share.min() >= 20
    assert share.sum() == 90


def test_close_ups_from_the_same_side_count_as_views():
    kept = chosen(orbit(100) + orbit(10, distance=1.5), 30)
    assert (kept >= 100).sum() >= 3


@given(st.integers(0, 9), st.integers(1, 39))
def test_numbering_does_not_matter(seed, limit):
    cameras = scattered(40, seed)
    order = np.random.default_rng(seed).permutation(40)
    kept = chosen([cameras[k] for k in order], limit)
    assert sorted(order[kept]) == chosen(cameras, limit).tolist()


@given(st.integers(0, 9), st.floats(0.001, 1000))
def test_neither_does_the_world(seed, scale):
    """Turned, moved and in other units."""
    cameras, turn = scattered(40, seed), Rotation.random(random_state=seed).as_matrix()
    move = np.array([1e3, -2e3, 5e2]) * scale
    moved = []
    for camera in cameras:
        place = scale * turn @ camera.center + move
        R = camera.R @ turn.T
        moved.append(Camera(640, 480, 900.0, 900.0, 320.0, 240.0, R, -R @ place))
    kept = choose_frames(moved, scale * turn @ CENTER + move, scale, 12)
    assert kept.tolist() == chosen(cameras, 12).tolist()


@given(st.integers(0, 9), st.integers(1, 38))
def test_a_higher_limit_only_adds_frames(seed, limit):
    cameras = scattered(40, seed)
    assert set(chosen(cameras, limit)) <= set(chosen(cameras, limit + 1))


@given(st.integers(0, 9), st.integers(1, 39))
def test_the_same_views_appended_change_nothing(seed, limit):
    """As a film does that goes round once more. (They only shift where the middle is: not here.)"""
    cameras = scattered(40, seed)
    assert chosen(cameras + cameras, limit).tolist() == chosen(cameras, limit).tolist()


def test_frames_that_cannot_see_the_object_are_not_chosen():
    z = np.array([0.0, 0.0, 1.0])
    away = [looking(CENTER + d * z, CENTER + 2 * d * z) for d in (4.0, 8.0, 12.0)]
    assert chosen(away + orbit(20), 5).min() >= 3
    assert len(chosen(away + orbit(2), 4)) == 2
    assert len(chosen(away, 2)) == 0


def test_nothing_is_known_of_what_frames_show():
    """By construction: cameras go in, and nothing that could hold a pixel."""
    assert set(inspect.signature(choose_frames).parameters) == {
        "cameras", "center", "radius", "limit",
    }  # fmt: skip


def test_runs_of_peaks_end_where_much_was_left_out():
    assert run_order([]).tolist() == []
    assert run_order([7]).tolist() == [0]
    assert run_order([0, 4, 8, 13, 16]).tolist() == [0, 1, 2, 3, 4]
    assert run_order([0, 4, 8, 17, 21]).tolist() == [0, 1, 2, 4, 5]
    assert run_order([3, 4, 5, 6]).tolist() == [0, 1, 2, 3]
    assert run_order([3, 4, 6, 7, 11]).tolist() == [0, 1, 2, 3, 5]
