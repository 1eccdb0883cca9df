"""The result folder: whatever interrupts it, its state is the old one or the new one, whole."""

import json
import os
import subprocess
import sys

import pytest

from meshlab_svbrdf.document import record
from meshlab_svbrdf.document.record import BusyError, ResultFolder, digest, empty_record
from meshlab_svbrdf.errors import DocumentError

ENTRIES = ["maps/a.txt", "b.json", "samples/"]


def product(files: list[str]) -> dict:
    return {"filter": "f", "key": "k", "inputs": {}, "files": files, "layers": {}}


def stage(folder: ResultFolder, text: str, entries: list[str] = ENTRIES) -> dict:
    for entry in entries:
        path = folder.stage(entry)
        (path / "chunk" if entry.endswith("/") else path).write_text(text)
    return empty_record() | {"products": {"p": product(entries)}, "settings": {"text": text}}


def state(folder) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (".lock", record.RECORD)
    }


def committed(path, text: str, entries: list[str] = ENTRIES) -> ResultFolder:
    folder = ResultFolder(path)
    with folder.locked():
        folder.commit(stage(folder, text, entries))
    return folder


def whole(text: str) -> dict[str, str]:
    return {"maps/a.txt": text, "b.json": text, "samples/chunk": text}


def test_what_is_staged_is_seen_inside_and_nowhere_else_until_committed(tmp_path):
    folder = committed(tmp_path / "r.svbrdf", "old")
    with folder.locked():
        staged = stage(folder, "new")
        assert folder.find("b.json").read_text() == "new"
        assert state(folder.path / "maps") == {"a.txt": "old"}
        folder.commit(staged)
    assert state(folder.path) == whole("new")
    assert ResultFolder(folder.path).record["settings"] == {"text": "new"}


def test_discarded_staging_leaves_no_trace(tmp_path):
    folder = committed(tmp_path / "r.svbrdf", "old")
    with folder.locked():
        stage(folder, "new")
        folder.discard()
    assert state(folder.path) == whole("old")


def test_files_no_product_owns_any_more_go_and_the_users_own_stay(tmp_path):
    folder = committed(tmp_path / "r.svbrdf", "old")
    (folder.path / "maps" / "mine.txt").write_text("mine")
    with folder.locked():
        folder.commit(stage(folder, "new", ["b.json"]))
    assert state(folder.path) == {"b.json": "new", "maps/mine.txt": "mine"}


class Killed(BaseException):
    pass


@pytest.mark.parametrize("call", ["write_json", "rename", "_move", "replace", "rmtree"])
@pytest.mark.parametrize("at", range(5))
def test_killed_anywhere_in_a_commit_the_next_one_to_open_finds_old_or_new(
    tmp_path, monkeypatch, call, at
):
    folder = committed(tmp_path / "r.svbrdf", "old")
    owner = {"write_json": record, "_move": record, "rmtree": record.shutil}.get(call, os)
    original, count = getattr(owner, call), 0

    def killed_at(*arguments, **options):
        nonlocal count
        count += 1
        if count > at:
            raise Killed
        return original(*arguments, **options)

    with folder.locked():
        new = stage(folder, "new", [*ENTRIES[1:], "maps/c.txt"])
        monkeypatch.setattr(owner, call, killed_at)
        survived = True
        try:
            folder.commit(new)
        except Killed:
            survived = False
        finally:
            monkeypatch.undo()
            # A dead process does not clean up: only its lock goes
            monkeypatch.setattr(folder, "discard", lambda: None)
    again = ResultFolder(folder.path)
    text = again.record["settings"]["text"]
    assert text == "new" or not survived
    expected = whole("old")
    if text == "new":
        expected = {"b.json": "new", "samples/chunk": "new", "maps/c.txt": "new"}
    assert state(folder.path) == expected


HOLD = """
import sys, time
from pathlib import Path
from meshlab_svbrdf.document.record import ResultFolder
folder = ResultFolder(Path(sys.argv[1]))
with folder.locked():
    folder.stage("b.json").write_text("half")
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_run_is_told_and_a_dead_one_lets_go(tmp_path):
    path = committed(tmp_path / "r.svbrdf", "old").path
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline().strip() == b"held"
        second = ResultFolder(path)
        assert second.record["settings"] == {"text": "old"}
        assert second.find("b.json").read_text() == "old"
        own = rf"another run \(process {process.pid} of this machine, since 2.*wait for its end"
        with pytest.raises(BusyError, match=own), second.locked():
            pass
        told = json.loads((path / ".holder").read_text()) | {"host": "elsewhere"}
        (path / ".holder").write_text(json.dumps(told))
        with pytest.raises(BusyError, match=r"machine elsewhere.*or remove "), second.locked():
            pass
    finally:
        process.kill()
        process.communicate()
    assert ResultFolder(path).record["settings"] == {"text": "old"}
    assert state(path) == whole("old")


def test_the_lock_is_reentrant(tmp_path):
    folder = ResultFolder(tmp_path / "r.svbrdf")
    with folder.locked():
        with folder.locked():
            folder.stage("b.json").write_text("x")
        assert folder.find("b.json")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"products": {}}', '{"format": 99}'])
def test_a_record_that_is_none_is_named_with_what_to_do(tmp_path, text):
    path = committed(tmp_path / "r.svbrdf", "old").path
    (path / record.RECORD).write_text(text)
    with pytest.raises(DocumentError, match=r"svbrdf\.json.*move r\.svbrdf away"):
        ResultFolder(path)


def test_opening_makes_no_folder(tmp_path):
    assert ResultFolder(tmp_path / "r.svbrdf").record == empty_record()
    assert not list(tmp_path.iterdir())


def test_digests_know_order_in_lists_and_not_in_objects():
    assert digest({"a": 1, "b": [1, 2]}) == digest({"b": [1, 2], "a": 1})
    assert digest([1, 2]) != digest([2, 1])
    assert digest(1) != digest("1")


@pytest.mark.parametrize("link", [False, True])
def test_replacing_results_keeps_the_users_files_and_never_touches_the_source(tmp_path, link):
    source = committed(tmp_path / "a.svbrdf", "a").path
    target = committed(tmp_path / "b.svbrdf", "b", ["b.json", "maps/only_b.txt"]).path
    (target / "notes").mkdir()
    (target / "notes" / "mine.txt").write_text("mine")
    record.replace_folder(source, target, link=link)
    assert state(target) == whole("a") | {"notes/mine.txt": "mine"}
    committed(target, "later")
    assert state(source) == whole("a")
    assert json.loads((source / record.RECORD).read_text())["settings"] == {"text": "a"}
    assert {p.name for p in tmp_path.iterdir()} == {"a.svbrdf", "b.svbrdf"}
