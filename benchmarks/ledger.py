"""What was measured, kept in files, so that an interrupted benchmark goes on where it was.

A row is one result on one scene: OUT/PART/SCENE.NAME.json. It is measured again when the code has
changed since (not the documentation), when it had failed, or when that is asked for.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
CODE = ("meshlab_svbrdf", "filters", "benchmarks/scenes", "benchmarks/peers")
GUESS = 40.0  # seconds, where a row was never measured

Row = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """A row to measure: `make(folder)` gives its figures; the folder goes afterwards.

    about : of the configuration, in words; it is measured again where they change
    """

    part: str
    scene: str
    name: str
    about: str
    make: Callable[[Path], Row]


def code_digest() -> str:
    """Of all code that the figures depend on."""
    found = hashlib.sha256()
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".mlx"):
                found.update(f"{path.relative_to(ROOT)}\n".encode())
                found.update(path.read_bytes())
    return found.hexdigest()[:16]


class Ledger:
    """Rows in a folder.

    work : a folder for results that rows go on from, until `finish`
    old : "again" measures rows of older code again, "keep" takes them, "force" measures all
    say : gets a line for each row
    """

    def __init__(self, folder: Path, old: str = "again", say: Callable[[str], None] = print):
        self.folder, self.old, self.say = folder, old, say
        self.code = code_digest()
        self.begun = time.time()
        folder.mkdir(parents=True, exist_ok=True)
        self.work = Path(tempfile.mkdtemp(prefix="work-", dir=folder))

    def rows(self, tasks: Iterable[Task]) -> list[Row]:
        """The rows of all tasks, in their order; a task that fails becomes a row with its error."""
        tasks = list(tasks)
        todo = self.todo(tasks)
        self.say(
            f"{len(tasks)} rows, {len(todo)} to measure: "
            f"about {sum(map(self._guess, todo)) / 60:.0f} min"
        )
        found = []
        for task in tasks:
            row = self._kept(task)
            found.append(self._measure(task) if row is None else row)
        return found

    def todo(self, tasks: Iterable[Task]) -> list[Task]:
        """Those that are not measured yet."""
        return [task for task in tasks if self._kept(task) is None]

    def finish(self) -> None:
        """Remove the results that rows went on from."""
        shutil.rmtree(self.work, ignore_errors=True)

    def _path(self, task: Task) -> Path:
        name = re.sub(r"[^\w.=+-]+", "_", f"{task.scene}.{task.name}")
        return self.folder / task.part / f"{name}.json"

    def _read(self, task: Task) -> Row | None:
        path = self._path(task)
        return json.loads(path.read_text()) if path.is_file() else None

    def _kept(self, task: Task) -> Row | None:
        row = self._read(task)
        if row is None or "error" in row or row["about"] != task.about:
            return None
        if self.old == "force":
            return row if row["date"] >= self.begun else None
        return row if row["code"] == self.code or self.old == "keep" else None

    def _guess(self, task: Task) -> float:
        row = self._read(task)
        return row["took"] if row else GUESS

    def _measure(self, task: Task) -> Row:
        row: Row = {
            "part": task.part, "scene": task.scene, "name": task.name, "about": task.about,
            "code": self.code,
        }  # fmt: skip
        started = time.perf_counter()
        folder = self.work / task.part / self._path(task).stem
        try:
            row |= task.make(folder)
        except Exception as error:
            traceback.print_exc()
            row["error"] = f"{type(error).__name__}: {error}".splitlines()[0]
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        row |= {"took": time.perf_counter() - started, "date": time.time()}
        path = self._path(task)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(_plain(row), indent=1))
        said = row.get("error", "done")
        self.say(f"{task.part}: {task.scene}, {task.name}: {said} ({row['took']:.0f} s)")
        return json.loads(path.read_text())


def _plain(value: Any) -> Any:
    """Infinity as a text that float() reads, paths and numpy numbers as plain ones."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value.item() if hasattr(value, "item") else value
