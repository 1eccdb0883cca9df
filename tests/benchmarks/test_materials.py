"""A minute by hand, the index that judges it, and what the page's part prints."""

import numpy as np
import pytest
from analytic import ball
from totems import WALK, copied

from benchmarks import page
from benchmarks.hands import OPERATIONS, a_minute
from benchmarks.scenes.score import adjusted_rand
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph

TEXELS = ball(4000)
SURFACE = SurfaceGraph(TEXELS.position, TEXELS.normal)
HEIGHT = TEXELS.position[:, 1]
TRUTH = np.digitize(HEIGHT, [-0.4, 0.5])


def test_the_index_is_one_for_the_same_partition_and_about_zero_by_chance():
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 4, (2, 20000))
    assert adjusted_rand(a, rng.permutation(4)[a]) == 1
    assert abs(adjusted_rand(a, b)) < 0.001
    c = np.array([0, 0, 1, 1, -1, 5])
    # By hand: of four judged, pairs {01}, {23} against {0}, {1, 2, 3}
    assert adjusted_rand(c[:4], np.array([0, 1, 1, 1])) == pytest.approx(0.0)
    assert adjusted_rand(np.append(c[:4], -1), np.array([1, 1, 0, 0, 0])) == 1


def test_a_user_merges_what_is_one_and_cuts_what_is_two():
    broken = np.where((TRUTH == 0) & (TEXELS.position[:, 0] > 0), 3, TRUTH)
    broken = np.where(TRUTH == 2, 1, broken).astype(np.int32)
    edited, done = a_minute(SURFACE, broken, TRUTH, 1.0)
    assert [words.split()[0] for words in done[:2]] in (["merge", "split"], ["split", "merge"])
    assert len(done) <= OPERATIONS
    assert adjusted_rand(TRUTH, broken) < 0.8
    assert adjusted_rand(TRUTH, edited) > 0.9


def test_a_user_leaves_alone_what_is_right():
    edited, done = a_minute(SURFACE, TRUTH.astype(np.int32), TRUTH, 1.0)
    assert done == []
    np.testing.assert_array_equal(edited, TRUTH)


def test_the_page_is_timed_and_its_table_says_what_is_allowed(
    tmp_path_factory, tmp_path, monkeypatch
):
    monkeypatch.setattr(page, "TIMES", 4)
    project = copied(tmp_path_factory, WALK, tmp_path / "result").save()
    (table,) = page.tables([page.measure(project, browser=False)])
    rows = {cells[0]: cells[1:] for cells in table.cells}
    assert rows["pick"][-1] == "150"
    assert rows["merge"][0] == str(page.TIMES // 2 + 1)
    assert not [name for name in rows if "refused" in name and not name.startswith("split")]
    assert {"save", "undo", "redo", "preview of a threshold", "find anew"} <= rows.keys()
