"""Thousands of damaged files: each is read as it is, or refused by one error that names the file.

Anything else breaks: another exception (a traceback for the user), a crash, more than a gigabyte
of memory, more than ten seconds, an error that does not name the file, a refusal that changed one.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from meshlab_svbrdf.errors import SvbrdfError

from .damage import damaged
from .files import Format, formats

MEMORY = 1 << 30  # bytes that reading a small file may take
SECONDS = 10
OWN = (".lock", ".staging", ".commit", ".partial")  # of a run that goes on


def try_formats(folder: Path, count: int, seed: int = 0, only: str = "") -> list[dict[str, Any]]:
    """Damage each format's file `count` times; a row per format."""
    found = formats(folder)
    return [
        try_format(each, folder, count, seed + k) for k, each in enumerate(found)
        if only in each.name
    ]  # fmt: skip


def try_format(each: Format, folder: Path, count: int, seed: int) -> dict[str, Any]:
    """A row: how many were read and refused, and what broke, each kind once.

    Files are read in a process of its own, which a crash may take along: another goes on behind it.
    """
    good = each.path.read_bytes()
    kept = folder.parent / f"{folder.name}_kept"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(folder, kept, symlinks=True)
    counts: Counter[str] = Counter()
    broke: dict[str, str] = {}
    done = 0
    context = multiprocessing.get_context("fork")
    while done < count:
        receiver, sender = context.Pipe(duplex=False)
        job = (each, folder, kept, good, seed, done, count, sender)
        process = context.Process(target=_read_damaged, args=job)
        process.start()
        sender.close()
        while True:
            try:
                index, kind, said = receiver.recv()
            except EOFError:
                break
            done = index + 1
            counts[kind] += 1
            if kind == "broke":
                broke.setdefault(said, f"seed {seed}, file {index}")
        process.join()
        if done < count:
            counts["broke"] += 1
            broke.setdefault(f"the process ended with {process.exitcode}", f"seed {seed}, {done}")
            done += 1
    _put_back(folder, kept)
    shutil.rmtree(kept)
    return {
        "format": each.name, "tried": count, "read": counts["read"], "refused": counts["refused"],
        "broke": counts["broke"], "how": broke,
    }  # fmt: skip


def _read_damaged(each: Format, folder, kept, good, seed, first, count, sender) -> None:
    """In a process of its own: read the damaged files first..count, and tell of each."""
    signal.signal(signal.SIGALRM, _too_long)
    warnings.simplefilter("ignore")
    nowhere = os.open(os.devnull, os.O_WRONLY)  # decoders write of damage themselves
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    limit = _address_space() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for index, data in enumerate(islice(damaged(good, seed, each.text), count)):
        if index < first:
            continue
        each.path.write_bytes(data)
        before = snapshot(folder)
        try:
            with _alarm():
                each.read(each.path)
            outcome = "read", ""
        except SvbrdfError as error:
            outcome = "refused", ""
            if each.path.name not in str(error) and str(folder) not in str(error):
                outcome = "broke", f"does not name the file: {str(error)[:80]}"
            elif snapshot(folder) != before:
                outcome = "broke", "refused, but changed files"
        except BaseException as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            own = [f for f in traceback.extract_tb(error.__traceback__) if "svbrdf" in f.filename]
            place = own[-1] if own else place
            where = f"{Path(place.filename).name}:{place.lineno}"
            outcome = "broke", f"{type(error).__name__} at {where}: {str(error)[:80]}"
        if snapshot(folder) != before:
            _put_back(folder, kept)
        sender.send((index, *outcome))


def snapshot(folder: Path) -> list[tuple[Any, ...]]:
    """What tells whether any file changed."""
    return [
        (path.as_posix(), status.st_size, status.st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if not any(part in OWN for part in path.parts) and path.is_file()
        for status in [path.lstat()]
    ]


def _put_back(folder: Path, kept: Path) -> None:
    shutil.rmtree(folder)
    shutil.copytree(kept, folder, symlinks=True)


def _address_space() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()


def _too_long(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


@contextmanager
def _alarm() -> Iterator[None]:
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
