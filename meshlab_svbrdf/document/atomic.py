"""Write files whole or not at all: temporary names in the same folder, then renames."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import DocumentError

_TEMPORARY = re.compile(r"\..*\.[0-9a-f]{8}(\.[^.]*)?\Z")


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path with the same suffix; rename it to `path` when the block succeeds.

    A block that raises leaves the old file (or none) and no temporary one.
    The folder must exist, and the disk have room: `DocumentError` otherwise.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise DocumentError(f"{path}: the folder does not exist; create it first")
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        with named(path):
            yield temporary
            _sync(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    if os.name == "posix":
        _sync(path.parent)


@contextmanager
def filling(folder: str | Path) -> Iterator[Path]:
    """Give an empty folder; its files go into `folder`, made if need be, when the block succeeds.

    Files of the same names there are replaced, others stay. A block that raises changes nothing.
    """
    folder = Path(folder)
    made = next((p for p in (*reversed(folder.parents), folder) if not p.exists()), None)
    folder.mkdir(parents=True, exist_ok=True)
    temporary = folder / f".part.{secrets.token_hex(4)}"
    try:
        temporary.mkdir()
        yield temporary
        for path in temporary.iterdir():
            _sync(path)
        for path in sorted(temporary.iterdir()):
            os.replace(path, folder / path.name)
        made = None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if made is not None:
            shutil.rmtree(made, ignore_errors=True)


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Name the file that the block writes where the disk is full: such errors do not tell it."""
    try:
        yield
    except OSError as error:
        if error.filename is not None:
            raise
        raise DocumentError(
            f"{path}: cannot be written whole ({error.strerror or error}): make room on the disk, "
            "or give another place with -o"
        ) from None


def remove_leftovers(folder: Path, stem: str = "") -> None:
    """Remove temporary files in a folder (of files of that `stem` alone) whose writer was killed.

    For the process alone that holds what is written there: a living writer's would go too.
    """
    for path in folder.glob(f".{stem}*") if folder.is_dir() else ():
        named = not stem or path.name.startswith(f".{stem}.")
        if named and _TEMPORARY.match(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
