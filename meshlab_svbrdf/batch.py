"""Many projects with the same chain, each in a process of its own, so that one that fails, or is
killed for want of memory, takes none of the others with it.

run_batch    run them, one after the other, and keep the table, the record and the page
"""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from .batch_list import DONE, FAILED, LEFT, Entry, Result
from .batch_page import look_at, summary
from .document.atomic import replacing
from .document.document import place
from .errors import SvbrdfError
from .exits import BUSY, ERROR, INTERRUPTED, USAGE
from .spread import Spread

TABLE, RECORD, PAGE = "batch.csv", "batch.json", "batch.html"
RUN = (sys.executable, "-m", "meshlab_svbrdf.batch_child", "run")
REPORT = (*RUN[:-1], "report")
PAUSE = 3.0
"""Seconds before another attempt where another run has the project: that of a dead worker ends."""
WRITTEN_EVERY = 10.0
"""Seconds between two writings of table and record: of many projects they are large."""


def run_batch(
    entries: Sequence[Entry],
    folder: Path,
    options: Sequence[str],
    *,
    retries: int = 1,
    reports: bool = False,
    spread: Spread | None = None,
    say: Callable[[Result], None] = lambda result: None,
) -> list[Result]:
    """Run each project as `meshlab-svbrdf run` does; results lie in `folder`/NAME.

    What an earlier batch finished is not done again, since `run` does not. At the end, and of the
    first two every ten seconds, table (batch.csv), record (batch.json) and page (batch.html) are
    written anew, whole.

    Parameters
    ----------
    options : of `run`, for every project
    retries : further attempts at a project that was killed, or that another run had; an error of
        its input stays one
    reports : write each project's own report too, folder/NAME/NAME.html
    spread : workers, each of which runs a project at a time; None: one after the other, here
    """
    folder.mkdir(parents=True, exist_ok=True)
    results: list[Result] = []
    written = time.monotonic()
    try:
        run = partial(run_project, folder, options, retries, reports)
        for result in spread(run, entries) if spread else map(run, entries):
            results.append(result)
            say(result)
            if time.monotonic() - written > WRITTEN_EVERY:
                _write(folder, options, results)
                written = time.monotonic()
            if result.state == LEFT:
                break
    finally:
        if results:
            _write(folder, options, results)
            text = summary(folder, [entry.name for entry in entries], options, results)
            with replacing(folder / PAGE) as temporary:
                temporary.write_text(text, encoding="utf-8")
    return results


def run_project(
    folder: Path, options: Sequence[str], retries: int, reports: bool, entry: Entry
) -> Result:
    """Run one project, again where it was killed, and look at what it made."""
    start, attempts, code = time.monotonic(), 0, -1
    while code not in (0, ERROR, INTERRUPTED) and attempts <= retries:
        if code == BUSY:
            time.sleep(PAUSE)
        attempts += 1
        code, outcomes, error = _run(entry, folder, options)
        if code == USAGE:
            raise SvbrdfError(f"`meshlab-svbrdf run` does not take {' '.join(options)}: {error}")
    state = {0: DONE, INTERRUPTED: LEFT}.get(code, FAILED)
    project = place(entry.project, folder / entry.name)
    figures, remarks, picture = look_at(project)
    if reports and state == DONE:
        remarks += _report(project, folder / entry.name / f"{entry.name}.html")
    took = time.monotonic() - start
    return Result(
        entry.name, str(entry.project), state, attempts, took, outcomes, error, figures, remarks,
        picture,
    )  # fmt: skip


def _run(entry: Entry, folder: Path, options: Sequence[str]) -> tuple[int, dict[str, str], str]:
    """Exit code, outcomes and error of `run` in a process of its own."""
    command = [*RUN, str(entry.project), "-o", str(folder / entry.name), "--json", *options]
    code, told, error = _child(command)
    return code, _outcomes(told, _record(place(entry.project, folder / entry.name))), error


def _record(project: Path) -> Path:
    return project.with_suffix(".svbrdf") / "svbrdf.json"


def _report(project: Path, page: Path) -> list[str]:
    """Write a project's own report, unless it is newer than the result; why there is none."""
    if page.exists() and page.stat().st_mtime > _record(project).stat().st_mtime:
        return []
    code, _, error = _child([*REPORT, str(project), "-o", str(page)])
    return [f"No report of its own: {error}."] if code else []


def _child(command: Sequence[str]) -> tuple[int, str, str]:
    """Exit code of a process that ends with this one, what it told, and its error in one line."""
    read, held = os.pipe()
    try:
        with subprocess.Popen(
            command, stdin=read, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            encoding="utf-8",
        ) as child:  # fmt: skip
            os.close(read)
            try:
                told, error = child.communicate()
            except KeyboardInterrupt:  # which the child has heard as well
                told, _ = child.communicate()
                return INTERRUPTED, told, ""
    finally:
        os.close(held)
    said = _one_line(error) if child.returncode else ""
    if child.returncode < 0:
        said = f"killed by signal {-child.returncode}; out of memory? {said}".rstrip()
    return child.returncode, told, said


def _outcomes(told: str, record: Path) -> dict[str, str]:
    """What each filter said; one that had nothing to do, when it ran."""
    try:
        stages = json.loads(told)["stages"]
        found = {stage["name"]: stage["message"] for stage in stages}
        earlier = [stage["name"] for stage in stages if stage.get("skipped")]
        runs = json.loads(record.read_text(encoding="utf-8"))["runs"] if earlier else {}
        return found | {name: runs[name]["message"] for name in earlier if name in runs}
    except (ValueError, KeyError, TypeError):  # killed before it could tell
        return {}


def _one_line(text: str) -> str:
    """What was said from its last error on, else its last line."""
    lines = [line for line in (line.strip(" │─╭╮╰╯") for line in text.splitlines()) if line]
    errors = [k for k, line in enumerate(lines) if line == "Error" or line.startswith("Error: ")]
    told = " ".join(lines[errors[-1] :] if errors else lines[-1:])
    return told.removeprefix("Error").removeprefix(":").lstrip()


def _write(folder: Path, options: Sequence[str], results: Sequence[Result]) -> None:
    told: dict[str, Any] = {"options": list(options), "projects": [_told(r) for r in results]}
    with replacing(folder / RECORD) as temporary:
        temporary.write_text(json.dumps(told, indent=1), encoding="utf-8")
    text = io.StringIO()
    figures = list(dict.fromkeys(name for r in results for name in r.figures))
    filters = list(dict.fromkeys(name for r in results for name in r.outcomes))
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["name", "project", "state", "attempts", "seconds", "error", *figures, *filters])
    for r in results:
        row = [r.name, r.project, r.state, r.attempts, f"{r.seconds:.1f}", r.error]
        row += [r.figures.get(name, "") for name in figures]
        table.writerow([*row, *(r.outcomes.get(name, "") for name in filters)])
    with replacing(folder / TABLE) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _told(result: Result) -> dict[str, Any]:
    """A result for programs, without its picture."""
    return {k: v for k, v in asdict(result).items() if k != "picture"}
