"""The stability part: a seeded bit of every sweep, and that it sees what breaks."""

import itertools

import numpy as np
import pytest

from benchmarks.documents import STABILITY
from benchmarks.ledger import ROOT, Ledger
from benchmarks.stability import interruption, part, precision
from benchmarks.stability.checks import Check, run_cases
from benchmarks.stability.damage import damaged
from benchmarks.stability.files import Format
from benchmarks.stability.guards import GUARDS, without
from benchmarks.stability.handmade import try_handmade
from benchmarks.stability.hostile import try_format, try_formats
from meshlab_svbrdf.errors import SvbrdfError


def test_single_precision_holds_its_bounds(tmp_path):
    bad = [check for check in run_cases("single", precision.cases(tmp_path)) if not check.ok]
    assert bad == []


def test_damaged_files_of_every_format_are_read_or_refused(tmp_path):
    rows = try_formats(tmp_path / "files", 6, seed=1)
    assert {row["format"]: row["how"] for row in rows if row["broke"]} == {}
    assert sum(row["refused"] for row in rows) > 0.4 * sum(row["tried"] for row in rows)


def test_files_made_to_do_harm_are_told_and_do_none(tmp_path):
    assert [(name, broke) for name, _, broke in try_handmade(tmp_path) if broke] == []


def test_damage_is_seeded_and_does_damage():
    data = b'{"numbers": [1, 2.5, -3e4], "name": "stone"}' * 3
    first, again, other = (
        list(itertools.islice(damaged(data, seed, True), 50)) for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other
    assert sum(copy != data for copy in first) > 45


def _breaks(path):
    text = path.read_bytes()
    if b"kill" in text:
        import os

        os._exit(9)
    if b"change" in text:
        path.with_name("other.txt").write_text("changed")
        raise SvbrdfError(f"{path}: no")
    if b"silent" in text:
        raise SvbrdfError("no")
    if b"memory" in text:
        np.ones(1 << 32)
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("text", "how"),
    [("kill", "ended with 9"), ("change", "changed files"), ("silent", "does not name"),
     ("memory", "MemoryError"), ("else", "ZeroDivisionError at test_stability.py")],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_what_breaks_is_seen(tmp_path, monkeypatch, text, how):
    (tmp_path / "files").mkdir()
    path = tmp_path / "files" / "a.txt"
    path.write_text(text)
    monkeypatch.setattr("benchmarks.stability.hostile.damaged", lambda data, *_: [data] * 2)
    row = try_format(Format("text", path, True, _breaks), tmp_path / "files", 2, 0)
    assert row["broke"] == 2
    assert any(how in said for said in row["how"])


def test_checks_take_bounds_messages_and_nothing_else():
    def fail(error):
        raise error

    cases = [
        ("in", "m", 1.0, lambda: 0.5), ("out", "m", 1.0, lambda: 1.5),
        ("nan", "m", 1.0, lambda: float("nan")), ("told", "m", 1.0, lambda: fail(SvbrdfError("x"))),
        ("broke", "m", 1.0, lambda: fail(KeyError("x"))),
        ("warned", "m", 1.0, lambda: float(np.divide(1.0, np.zeros(1))[0])),
    ]  # fmt: skip
    assert [check.ok for check in run_cases("s", iter(cases))] == [
        True, False, False, True, False, False,
    ]  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_killed_runs_and_full_disks_go_on_to_the_same_result(tmp_path, monkeypatch):
    short = interruption.CHAIN[:4]
    monkeypatch.setattr(interruption, "CHAIN", short)
    monkeypatch.setattr(interruption, "STAGES", (*short, interruption.SAVING))
    row = interruption.kill_runs(tmp_path / "a", 6, seed=3)
    assert (row["kills"], row["broke"]) == (6, [])
    row = interruption.fill_disks(tmp_path / "b", 3, seed=1)
    assert row["broke"] == []
    assert row["told"] > 0


def test_what_is_not_whole_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(interruption, "CHAIN", interruption.CHAIN[:1])
    project = interruption.make_totem(tmp_path / "film", interruption.FILM).path
    output = tmp_path / "out"
    interruption._run(project, output)
    before, result = interruption._state(output), interruption._result(output / project.name)
    assert interruption._problems(output, before) == []
    file = output / "totem.svbrdf" / "arrays" / "texels_face.npy"
    whole = file.read_bytes()
    file.write_bytes(whole[:-1] + b"\1")
    assert interruption._problems(output, before) == ["texels: arrays/texels_face.npy changed"]
    (difference,) = interruption._differences(result, interruption._result(output / project.name))
    assert "texels_face.npy differs" in difference
    file.write_bytes(whole[:-9])
    assert any("is cut off or damaged" in p for p in interruption._problems(output, before))


def test_every_guard_is_in_the_source_once_and_its_test_exists():
    for guard in GUARDS:
        source = (ROOT / guard.file).read_text(encoding="utf-8")
        assert without(guard, source) != source
        file, _, name = guard.test.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="0 times"):
        without(GUARDS[0], "")


def test_rows_become_tables_and_every_table_has_its_place(tmp_path):
    rows = [
        {"name": "sums", "checks": [vars(Check("s", "case", "m", 0.5, 1.0)),
                                    vars(Check("s", "told", "m", said="no /a/b.ply"))]},
        {"name": "damaged", "formats": [{"format": ".ply", "tried": 9, "read": 4, "refused": 5,
                                         "broke": 0, "how": {}}]},
        {"name": "made", "cases": [{"case": "bomb", "said": "Error: no"}]},
        {"name": "guards", "guards": [{"guard": "w", "test": "t.py::test", "broke": ""}]},
        {"name": "killed", "stages": {"a": 3}, "kills": 3, "finished": 1, "broke": []},
        {"name": "disk", "told": 2, "tried": 3, "enough": 1, "broke": []},
    ]  # fmt: skip
    text = "\n".join(table.markdown() for table in part.tables(rows))
    assert "sums: 2 of 2 within their bounds" in text
    assert "“no b.ply”" in text
    page = STABILITY.read_text(encoding="utf-8")
    for task in part.tasks():
        assert f"<!-- benchmark: {task.scene}, {task.name} -->" in page
    assert len(part.tasks(["files"])) == 2
    failed = Ledger(tmp_path, say=lambda line: None)
    failed.finish()
    assert part._row({"a": 1}, ["x"])["error"] == "1 broke: x"
