"""The performance part: what it declares, its peers' work in small, its tables."""

from __future__ import annotations

import pytest

from benchmarks import documents, performance
from benchmarks.peers import meshlab, open3d, speed
from benchmarks.tables import splice
from meshlab_svbrdf.bench.body import body
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.geometry.visibility import vertex_visibility

TINY = Options(triangles=500, width=160, height=90, step=15.0, truth=64)
COST = {"seconds": 2.0, "cpu_seconds": 3.0, "peak": 1 << 20}


def test_what_is_lacking_is_said_and_left_out(tmp_path, monkeypatch):
    monkeypatch.setitem(performance.LACKING, "MeshLab", lambda: "needs a display")
    monkeypatch.setitem(performance.LACKING, "Open3D", lambda: "")
    tasks, notes = performance.tasks(12, 64, tmp_path, TINY)
    assert notes == ["MeshLab: left out, needs a display"]
    named = [(task.scene, task.name) for task in tasks]
    assert named == [
        ("workload", "12 frames"), ("growth", "12 frames"), ("projection", "ours"),
        ("projection", "Open3D"), ("visibility", "embreex"),
    ]  # fmt: skip


@pytest.mark.parametrize("name", performance.PROJECTIONS)
def test_every_projection_is_timed(tmp_path, name):
    reason = performance.LACKING[name]() if name in performance.LACKING else ""
    if reason:
        pytest.skip(reason)
    workload = make_workload(tmp_path, 4, TINY)
    cost = performance.PROJECTIONS[name](workload, 64, tmp_path / "out")
    assert cost["seconds"] > 0
    assert cost["cpu_seconds"] > 0


def test_our_visibility_is_no_worse_than_plain_rays():
    mesh = body(1500)
    ours, plain = vertex_visibility(mesh, 512), speed.plain_visibility(mesh, 512)
    assert speed.wrong(mesh, ours) < 1.05 * speed.wrong(mesh, plain) < 0.02
    assert speed.wrong(mesh, -ours) > 0.9


def test_what_the_second_core_gains_and_the_exponents_are_shown():
    growth = {
        "scene": "growth", "second_core": {"threads": [1, 2], "gains": {"whole": 1.75}},
        "scaling": [{"size": "frames", "sizes": [1, 2, 4], "whole": 0.9, "stages": {"a": 1.1}}],
    }  # fmt: skip
    second, exponents = performance.tables([growth])
    assert second.cells == [["whole", "1.75"]]
    assert exponents.cells == [["a", "1.10"], ["whole", "0.90"]]


def test_tables_compare_with_ours():
    rows = [
        {"scene": "projection", "name": "ours", "frames": 10, "texture": 64} | COST,
        {"scene": "projection", "name": "Open3D", "frames": 10, "texture": 64, "seconds": 40.0,
         "cpu_seconds": 30.0},
        {"scene": "projection", "name": "MeshLab", "error": "why"},
        {"scene": "visibility", "name": "embreex", "vertices": 100, "ours": COST | {"wrong": 0.001},
         "embreex": COST | {"wrong": 0.002}},
    ]  # fmt: skip
    projected, seen = performance.tables(rows)
    assert projected.cells == [
        ["ours", "200", "300", "1.0", "1.0"], ["Open3D", "4000", "3000", "20.0", "10.0"],
    ]  # fmt: skip
    assert [row[-1] for row in seen.cells] == ["0.10 %", "0.20 %"]
    assert performance.paper_table(rows) is None


def test_the_documentation_has_a_place_for_it(tmp_path):
    for path in (documents.SPEED, documents.README):
        copy = tmp_path / path.name
        copy.write_bytes(path.read_bytes())
        splice(copy, performance.PART, "table")
        assert "table\n<!-- end -->" in copy.read_text()


def test_peers_say_what_they_lack(monkeypatch):
    monkeypatch.setattr(meshlab, "find_spec", lambda name: None)
    monkeypatch.setattr("sys.platform", "linux")
    assert "Qt" in meshlab.why_not()
    monkeypatch.setitem(__import__("sys").modules, "open3d", None)
    assert "Open3D" in open3d.why_not()
