"""Edits of materials: what merges comes apart again; a stroke cuts what it crosses, only that."""

import numpy as np
import pytest

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.reflectance.edit import merge, pick, split

SIDE = 40


def sphere(count):
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    phi = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], 1).astype(np.float32)


@pytest.fixture(scope="module")
def globe():
    position = sphere(8000)
    return position, position, neighbours(position, position)


@pytest.fixture(scope="module")
def sheet():
    """Both sides of a square sheet thinner than a texel."""
    y, x = np.mgrid[:SIDE, :SIDE]
    upper = np.stack([x.ravel(), y.ravel(), np.zeros(SIDE * SIDE)], 1)
    position = np.concatenate([upper, upper - [0, 0, 0.2]]).astype(np.float32)
    normal = np.repeat(np.float32([[0, 0, 1], [0, 0, -1]]), SIDE * SIDE, axis=0)
    return position, normal, neighbours(position, normal)


def circle(height, points, start=0.0, turn=2 * np.pi):
    phi = start + np.linspace(0, turn, points)
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), np.full(points, height)], 1)


@pytest.mark.parametrize("points", [5, 13, 200])
def test_loop_cuts_a_sphere_where_it_runs(globe, points):
    position = globe[0]
    labels = split(np.zeros(8000, np.int32), 0, circle(0.0, points), *globe)
    assert set(np.unique(labels)) == {0, 1}
    upper = labels[position[:, 2].argmax()]
    wrong = (labels == upper) != (position[:, 2] > 0)
    assert np.abs(position[wrong, 2]).max(initial=0) < 0.1


def test_stroke_across_the_sheet_leaves_the_other_side_alone(sheet):
    position, normal, adjacency = sheet
    stroke = np.array([[19.6, -0.4, 0], [19.6, 39.4, 0]])
    labels = split(np.where(normal[:, 2] > 0, 0, 5), 0, stroke, position, normal, adjacency)
    assert (labels[normal[:, 2] < 0] == 5).all()
    upper = labels[: SIDE * SIDE].reshape(SIDE, SIDE)
    assert len(np.unique(upper[:, :18])) == len(np.unique(upper[:, 22:])) == 1
    assert set(np.unique(upper)) == {0, 6}


def test_straight_stroke_of_two_points_stays_straight(sheet):
    position, normal, adjacency = sheet
    stroke = np.array([[5.0, 0, 0], [30, 39, 0]])
    labels = split(np.zeros(len(position), int), 0, stroke, position, normal, adjacency)
    front = normal[:, 2] > 0
    side = (position[:, 0] - 5) * 39 - position[:, 1] * 25 > 0
    off = np.abs((position[:, 0] - 5) * 39 - position[:, 1] * 25) / np.hypot(39, 25)
    clear = front & (off > 3)
    assert set(labels[clear & side]) != set(labels[clear & ~side])
    assert len(set(labels[clear & side])) == len(set(labels[clear & ~side])) == 1


def test_only_the_piece_under_the_stroke_is_cut(sheet):
    position, normal, adjacency = sheet
    column = position[:, 0]
    labels = np.where((column < 12) | (column > 27), 4, 9)
    stroke = np.array([[-0.3, 20, 0], [14, 20, 0]])
    result = split(labels, 4, stroke, position, normal, adjacency)
    changed = result != labels
    assert changed.any()
    assert column[changed].max() < 12
    assert (normal[changed, 2] > 0).all()
    assert set(result[changed]) == {10}


def test_one_stroke_over_two_pieces_cuts_both(sheet):
    position, normal, adjacency = sheet
    column = position[:, 0]
    labels = np.where((column < 12) | (column > 27), 4, 9)
    stroke = np.array([[0, 16.0, 0], [39, 16.0, 0]])
    result = split(labels, 4, stroke, position, normal, adjacency)
    assert set(np.unique(result)) == {4, 9, 10, 11}
    for new in (10, 11):
        rows = position[result == new, 1]
        assert rows.max() < 19


def test_merge_undoes_a_split(globe):
    position = globe[0]
    labels = np.where(position[:, 0] > 0.8, 2, 0).astype(np.int32)
    cut = split(labels, 0, circle(0.2, 9), *globe)
    assert np.array_equal(merge(cut, set(np.unique(cut)) - {2}), labels)


def test_split_keeps_texels_and_input(globe):
    labels = np.zeros(8000, np.int32)
    labels[::50] = -1
    before = labels.copy()
    result = split(labels, 0, circle(0.3, 20), *globe)
    assert np.array_equal(labels, before)
    assert np.array_equal(result == -1, labels == -1)


def test_permuted_texels_are_cut_alike(globe):
    position = globe[0]
    order = np.random.default_rng(1).permutation(8000)
    moved = position[order]
    labels = split(np.zeros(8000, int), 0, circle(0.3, 9), *globe)
    other = split(np.zeros(8000, int), 0, circle(0.3, 9), moved, moved, neighbours(moved, moved))
    assert np.array_equal(other, labels[order])


def test_map_coordinates_need_only_be_consistent(globe):
    position, normal, adjacency = globe
    far = position * 1000.0 + np.array([4e5, 5e6, 100])
    labels = split(np.zeros(8000, int), 0, circle(0.3, 9), position, normal, adjacency)
    stroke = circle(0.3, 9) * 1000 + np.array([4e5, 5e6, 100])
    assert np.array_equal(split(np.zeros(8000, int), 0, stroke, far, normal, adjacency), labels)


def test_stroke_that_ends_inside_says_how_far_it_got(sheet):
    position, normal, adjacency = sheet
    labels = np.where(position[:, 0] < 30, 0, 1)
    stroke = np.array([[38.0, 20, 0], [12, 20, 0]])
    with pytest.raises(SvbrdfError, match=r"does not divide material 0.* 0 and 18 away"):
        split(labels, 0, stroke, position, normal, adjacency)


def test_open_loop_on_one_material_is_asked_to_close(globe):
    with pytest.raises(SvbrdfError, match="close it to a loop"):
        split(np.zeros(8000, int), 0, circle(0.0, 20, turn=5.5), *globe)


def test_stroke_beside_the_material(globe):
    labels = np.where(globe[0][:, 2] > 0.5, 3, 0)
    with pytest.raises(SvbrdfError, match="does not touch material 3"):
        split(labels, 3, circle(-0.5, 20), *globe)


def test_stroke_that_covers_the_material_divides_nothing(globe):
    labels = np.where(globe[0][:, 2] > 0.999, 3, 0)
    with pytest.raises(SvbrdfError, match="does not divide material 3"):
        split(labels, 3, np.array([[-0.04, 0, 1], [0.04, 0, 1]]), *globe)


def test_stroke_between_parts_that_do_not_touch(sheet):
    position, normal, adjacency = sheet
    stroke = np.array([[20.0, 20, 0.05], [20, 25, -0.25]])  # from one side to the other
    with pytest.raises(SvbrdfError, match="closer together"):
        split(np.zeros(len(position), int), 0, stroke, position, normal, adjacency)


@pytest.mark.parametrize(
    ("stroke", "message"),
    [
        (np.zeros((1, 3)), "two or more points"),
        (np.zeros((4, 2)), "two or more points"),
        (np.array([[1.0, 0, 0], [3, 0, 0]]), "point 1 .* off the object"),
        (np.array([[1.0, 0, 0], [np.nan, 0, 1]]), "finite"),
    ],
)
def test_impossible_strokes(globe, stroke, message):
    with pytest.raises(SvbrdfError, match=message):
        split(np.zeros(8000, int), 0, stroke, *globe)


def test_merge_keeps_the_smallest_id_and_all_others():
    labels = np.array([0, 1, 2, 3, 2, -1], np.int32)
    assert np.array_equal(merge(labels, [3, 1]), [0, 1, 2, 1, 2, -1])
    assert np.array_equal(merge(labels, [1, 3]), merge(labels, [3, 1, 3]))


@pytest.mark.parametrize(("ids", "message"), [([0, 7], "no material 7"), ([1], "two"), ([], "two")])
def test_merge_of_unknown_or_too_few(ids, message):
    with pytest.raises(SvbrdfError, match=message):
        merge(np.array([0, 1, 2]), ids)


@pytest.mark.parametrize("cluster", [-1, 1])
def test_split_of_an_unknown_material(globe, cluster):
    with pytest.raises(SvbrdfError, match=f"no material {cluster}; there are: 0"):
        split(np.zeros(8000, int), cluster, circle(0, 5), *globe)


def test_pick_is_the_nearest_texel(globe):
    position = globe[0]
    for texel in (0, 4321, 7999):
        assert pick(position, position[[texel]] * 1.001) == texel
    with pytest.raises(SvbrdfError, match=r"point 1 .* off the object"):
        pick(position, [position[0], [2.0, 0, 0]])
    with pytest.raises(SvbrdfError, match="no texels"):
        pick(position[:0], [[0.0, 0, 0]])
    assert pick(position[:1], position[:1]) == 0
