"""The folder NAME.svbrdf: results are staged, committed whole, and recorded in its svbrdf.json.

A filter writes into `.staging/`. Committing it is one rename, to `.commit/`: from there on the new
state is certain, and whoever opens the folder next finishes the moves if this process cannot. So a
killed run leaves either all of a filter's results or none.

svbrdf.json:
  products   per product: the filter that made it, its key, the keys of what went in, files, layers;
             where it was edited, that is the edit, and `maker` is the key it was made with
  runs       per filter: parameters, key, version, outcome, seconds, date of its last run
  settings   what the user chose: object layer, held-out rasters, attribute shown as Quality
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..errors import DocumentError, SvbrdfError
from .atomic import named, remove_leftovers
from .record_check import check_record, finite, leads_out

FORMAT = 1
RESUMED = "samples/store.json"
"""A staged file whose folder a run that is interrupted leaves to the next one."""
RECORD = "svbrdf.json"
LOCK, HOLDER = ".lock", ".holder"
"""The lock, and beside it, while it is held, who holds it: a lock's own file is emptied by whoever
tries to take it."""


def empty_record() -> dict[str, Any]:
    return {"format": FORMAT, "settings": {}, "products": {}, "runs": {}}


def digest(value: Any) -> str:
    """SHA-256 of a JSON value, the same whatever the order of its keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file whole or not at all."""
    temporary = path.with_name(f".{path.name}.part")
    text = json.dumps(value, indent=1, allow_nan=False) + "\n"
    with named(path):
        temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


class ResultFolder:
    """NAME.svbrdf, its record, and the staging of one filter at a time.

    Entries are paths relative to the folder with forward slashes; a trailing slash marks a folder
    that is replaced as a whole ("samples/").
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.record = empty_record()
        self._lock: FileLock | None = None
        self.refresh()

    @property
    def _staging(self) -> Path:
        return self.path / ".staging"

    @property
    def _committed(self) -> Path:
        return self.path / ".commit"

    @property
    def _partial(self) -> Path:
        return self.path / ".partial"

    # Reading

    def earlier(self, entry: str) -> list[Path]:
        """Where an interrupted run and the last one left `entry`."""
        return [p for base in (self._partial, self.path) if (p := base / entry).exists()]

    def find(self, entry: str) -> Path | None:
        """Where `entry` is: staged by the filter that runs now, or else as committed."""
        for base in (self._staging, self.path):
            if self._lock is not None or base is self.path:
                path = base / entry
                if path.exists():
                    return path
        return None

    def files(self, record: dict[str, Any] | None = None) -> set[str]:
        """The entries that a record's products own."""
        products = (self.record if record is None else record)["products"].values()
        return {entry for product in products for entry in product["files"]}

    def refresh(self) -> None:
        """Finish or drop what a dead process left, unless a living one holds the folder."""
        if not self.path.is_dir():
            self.record = empty_record()
            return
        try:
            with self.locked():
                return
        except (BusyError, OSError):  # in use, or on a medium that cannot be written: read only
            self._read()

    def _read(self) -> None:
        path = self.path / RECORD
        self.record = self._parsed(path) if path.exists() else empty_record()

    def _parsed(self, path: Path) -> dict[str, Any]:
        """A record, whoever wrote it: no entry leads out of the folder."""
        try:
            text = path.read_text(encoding="utf-8")
            record = json.loads(text, parse_float=finite, parse_constant=finite)
            known = record["format"]
            if known == FORMAT:
                check_record(record)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise DocumentError(
                f"{path} is not a record of results ({error}): "
                f"restore it, or move {self.path.name} away to start anew"
            ) from None
        if known != FORMAT:
            raise DocumentError(
                f"{path} has format {known!r}, this version reads {FORMAT}: "
                f"move {self.path.name} away to start anew, or use the version that wrote it"
            )
        return record

    # Writing

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder for this process (again, inside); its death lets go.

        Raises BusyError where another process holds it.
        """
        if self._lock is not None:
            yield
            return
        self.path.mkdir(parents=True, exist_ok=True)
        if link := leads_out(self.path):
            raise DocumentError(
                f"{link} is a link to {link.resolve()}, outside of the results, which a run would "
                f"write to: put the files themselves in its place, or move {self.path.name} away"
            )
        lock = FileLock(self.path / LOCK, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            raise BusyError(self._busy()) from None
        try:
            self._lock = lock
            self._sign()
            self._recover()
            self._read()
            yield
        finally:
            self._lock = None
            (self.path / HOLDER).unlink(missing_ok=True)
            lock.release()

    def _sign(self) -> None:
        """Tell others who holds the folder."""
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        told = {"host": socket.gethostname(), "pid": os.getpid(), "since": since}
        with suppress(OSError):  # a full disk is told where a result does not fit
            write_json(self.path / HOLDER, told)

    def _busy(self) -> str:
        """Who holds the folder, and what to do."""
        told = f"{self.path} is being worked on by another run"
        advice = "wait for its end, or give this one an output of its own"
        try:
            holder = json.loads((self.path / HOLDER).read_text(encoding="utf-8"))
            host, pid, since = holder["host"], holder["pid"], holder["since"]
        except (OSError, ValueError, KeyError, TypeError):  # it has only begun, or is at its end
            return f"{told}: {advice}"
        if host == socket.gethostname():
            return f"{told} (process {pid} of this machine, since {since}): {advice}"
        return (
            f"{told} (process {pid} of the machine {host}, since {since}): {advice}; if that "
            "machine is gone, its file server lets go of it within minutes, or remove "
            f"{self.path / LOCK}"
        )

    def _recover(self) -> None:
        if self._committed.is_dir():
            self._finish()
        self.discard()
        for folder in (self.path, *(path for path in self.path.glob("*/") if path.is_dir())):
            remove_leftovers(folder)

    def stage(self, entry: str) -> Path:
        """Where to write `entry` for now; parent folders exist."""
        path = self._staging / entry
        (path if entry.endswith("/") or not entry else path.parent).mkdir(
            parents=True, exist_ok=True
        )
        return path

    def discard(self) -> None:
        """Forget everything staged, but for what the next run may go on from."""
        kept = Path(RESUMED).parent
        if (self._staging / RESUMED).exists():
            _move(self._staging / kept, self._partial / kept)
        shutil.rmtree(self._staging, ignore_errors=True)

    def commit(self, record: dict[str, Any]) -> None:
        """Make the staged entries and `record` the folder's state; drop files no product owns."""
        write_json(self.stage(RECORD), record)
        os.rename(self._staging, self._committed)
        self._finish()
        self.record = record

    def _finish(self) -> None:
        """Move what was committed into place; may be repeated after an interruption anywhere."""
        new_path = self._committed / RECORD
        if new_path.exists():
            new = self._parsed(new_path)
            self._read()
            if (self._committed / RESUMED).exists():
                shutil.rmtree(self._partial, ignore_errors=True)
            for entry in sorted(self.files(new)):
                _move(self._committed / entry, self.path / entry)
            for entry in self.files() - self.files(new):
                _remove(self.path / entry)
            os.replace(new_path, self.path / RECORD)
        shutil.rmtree(self._committed)


def replace_folder(source: Path, target: Path, *, link: bool) -> None:
    """Put a copy of the results `source` in place of `target`; files that are not ours stay."""
    fresh, old = (target.with_name(f".{target.name}.{word}") for word in ("part", "old"))
    shutil.rmtree(fresh, ignore_errors=True)
    hidden = shutil.ignore_patterns(LOCK, HOLDER, ".staging", ".commit", ".partial")
    shutil.copytree(source, fresh, ignore=hidden, copy_function=_link if link else shutil.copy2)
    if not target.is_dir():
        os.rename(fresh, target)
        return
    there = ResultFolder(target)
    with there.locked():
        shown = set(there.record["settings"].get("shown", {}))
        ours = there.files() | shown | {RECORD, "exact.mlp", LOCK, HOLDER}
        os.rename(target, old)
        os.rename(fresh, target)
    for path in sorted(old.rglob("*")):
        entry = path.relative_to(old).as_posix()
        known = entry in ours or any(entry.startswith(o) for o in ours if o.endswith("/"))
        if path.is_file() and not known and not (target / entry).exists():
            _move(path, target / entry)
    shutil.rmtree(old)


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


class BusyError(SvbrdfError):
    """Another process works on this folder."""


def _move(source: Path, target: Path) -> None:
    if not source.exists():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        _remove(target)
    os.replace(source, target)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
