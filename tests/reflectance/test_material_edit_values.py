"""Edits as values: written, read, done again; marks as edits; parts split off by faces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph
from meshlab_svbrdf.reflectance.edit import carve
from meshlab_svbrdf.reflectance.marks import (
    edits_of_marks,
    marks_of_faces,
    paint_marks,
    selection_marks,
)
from meshlab_svbrdf.reflectance.material_edits import (
    Canvas,
    Carve,
    Merge,
    Split,
    faces_text,
    from_text,
    perform,
    read_faces,
    rounded,
    to_text,
)

ids = st.integers(0, 60000)
points = st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=2, max_size=5)
edits = st.one_of(
    st.lists(ids, min_size=2, max_size=5, unique=True).map(lambda k: Merge(tuple(sorted(k)))),
    st.builds(Split, ids, points.map(lambda p: rounded(np.array(p)))),
    st.builds(
        Carve, st.integers(-1, 9), st.sets(ids, min_size=1).map(lambda f: np.array(sorted(f)))
    ),
)


@given(st.lists(edits, max_size=4))
def test_reading_is_the_inverse_of_writing(done):
    read = from_text(to_text(done))
    assert [type(edit) for edit in read] == [type(edit) for edit in done]
    for mine, theirs in zip(done, read, strict=True):
        for name, value in vars(mine).items():
            np.testing.assert_array_equal(getattr(theirs, name), value)


@given(st.sets(ids))
def test_faces_are_written_as_runs(faces):
    np.testing.assert_array_equal(
        read_faces(faces_text(np.array(sorted(faces), int))), sorted(faces)
    )


def test_runs_are_short_and_edits_may_share_a_line():
    assert faces_text(np.array([7, 0, 1, 2, 4])) == "0-2 4 7"
    merge, split = from_text("merge 0 3 | split 4 faces 1-3")
    assert merge.ids == (0, 3)
    np.testing.assert_array_equal(split.faces, [1, 2, 3])


@pytest.mark.parametrize(
    "text",
    [
        "merge 1 two", "split 4", "split 4 along 0 0 0", "split x stroke 0 0 0; 1 1 1", "paint 3",
        "split 1 stroke 0 0; 1 1", "split 1 stroke 0 0 nan; 1 1 1", "split 1 faces 3-",
    ],
)  # fmt: skip
def test_what_is_no_edit_is_named(text):
    with pytest.raises(SvbrdfError, match=r"cannot read the edit|expected numbers and runs"):
        from_text(text)


def test_a_part_is_split_off():
    labels = np.array([0, 0, 1, 1, -1, 2], np.int32)
    chosen = np.array([1, 0, 1, 0, 1, 0], bool)
    np.testing.assert_array_equal(carve(labels, chosen), [3, 0, 3, 1, -1, 2])
    np.testing.assert_array_equal(carve(labels, chosen, 1), [0, 0, 3, 1, -1, 2])
    for some, cluster, says in (
        (chosen, 7, "no material 7"),
        (chosen, 2, "holds no texel of material 2"),
        (labels < 0, -1, "holds no texel of any material"),
        (labels == 2, -1, "all of material 2"),
    ):
        with pytest.raises(SvbrdfError, match=says):
            carve(labels, some, cluster)


def test_edits_are_performed_on_their_faces():
    place = np.random.default_rng(0).random((6, 3))
    canvas = Canvas(SurfaceGraph(place, place), np.zeros(3), np.array([0, 0, 1, 1, 2, 2]))
    labels = np.array([0, 0, 0, 1, 1, 1], np.int32)
    np.testing.assert_array_equal(perform(labels, Merge((0, 1)), canvas), np.zeros(6))
    part = Carve(0, np.array([1, 2]))
    np.testing.assert_array_equal(perform(labels, part, canvas), [0, 0, 2, 1, 1, 1])


# Marks

WHITE = np.array([255, 255, 255])


def test_paints_are_told_apart_and_soft_edges_go_to_the_nearest():
    red, blue, soft = [255, 0, 0], [0, 0, 255], [255, 90, 90]
    colors = np.array([[255] * 3] * 9 + [red] * 20 + [blue] * 10 + [soft], np.uint8)
    marks = paint_marks(colors, WHITE)
    np.testing.assert_array_equal(marks, [-1] * 9 + [1] * 20 + [0] * 10 + [1])
    with pytest.raises(SvbrdfError, match="nothing is painted"):
        paint_marks(colors[:9], WHITE)
    rainbow = np.random.default_rng(0).integers(0, 255, (500, 3)).astype(np.uint8)
    with pytest.raises(SvbrdfError, match="colours, expected at most 64"):
        paint_marks(rainbow, WHITE)


def test_a_face_has_the_mark_of_most_of_its_corners():
    marks = np.array([-1, 0, 1])
    faces = np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0], [0, 0, 1], [2, 1, 0]])
    np.testing.assert_array_equal(marks_of_faces(marks, faces), [0, 0, 0, -1, 1])


def test_marks_are_splits_or_merges():
    labels, face = np.array([0, 0, 1, 1, 2, -1]), np.arange(6)
    split = edits_of_marks(np.array([0, -1, 1, 1, -1, -1]), labels, face, merges=False)
    assert [edit.faces.tolist() for edit in split] == [[0], [2, 3]]
    merges = edits_of_marks(np.array([-1, 0, 0, 1, 1, 1]), labels, face, merges=True)
    assert [edit.ids for edit in merges] == [(0, 1), (0, 2)]  # 1 is 0 by then
    with pytest.raises(SvbrdfError, match="on material 0 alone"):
        edits_of_marks(selection_marks(labels == 0), labels, face, merges=True)
    with pytest.raises(SvbrdfError, match="nothing is marked"):
        edits_of_marks(selection_marks(labels == 9), labels, face, merges=False)
