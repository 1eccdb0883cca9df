"""Many projects with the same chain, each in a process of its own, so that one that fails, or is
killed for want of memory, takes none of the others with it.

read_list    projects, one a line          run_batch    run them, one after the other
"""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .document.atomic import replacing
from .errors import DocumentError, SvbrdfError

DONE, FAILED, LEFT = "done", "failed", "interrupted"
TABLE, RECORD = "batch.csv", "batch.json"
RUN = (sys.executable, "-m", "meshlab_svbrdf.cli", "run")
ERROR, USAGE, INTERRUPTED = 1, 2, 130
"""Exit codes of `run`; after any other but 0 another attempt may help."""


@dataclass(frozen=True)
class Entry:
    """A project, and the folder of its result within the batch's."""

    project: Path
    name: str


@dataclass(frozen=True)
class Result:
    """state : DONE, FAILED or LEFT; attempts, seconds : of this run
    outcomes : of the filters, a line each, as far as they came; error : of the last attempt
    """

    name: str
    project: str
    state: str
    attempts: int
    seconds: float
    outcomes: dict[str, str]
    error: str = ""


def read_list(path: Path) -> list[Entry]:
    """The projects of a list: a path a line, from the list's folder on; # begins a comment.

    A result is called as its project, or, where two projects are called alike, with their folders
    before that.

    Raises
    ------
    DocumentError : the list cannot be read, names nothing, something twice, or what is not there.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: expected a text file, a project a line ({error})") from None
    projects: dict[Path, int] = {}
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        project = (path.parent / text).absolute()
        if not project.is_file():
            raise DocumentError(f"{path}, line {number}: {project} does not exist")
        if project in projects:
            raise DocumentError(
                f"{path}, line {number}: {project} is in line {projects[project]} already"
            )
        projects[project] = number
    if not projects:
        raise DocumentError(f"{path}: names no project; expected one a line")
    return [Entry(project, name) for project, name in _names(list(projects)).items()]


def _names(projects: Sequence[Path]) -> dict[Path, str]:
    """Of each project a name that no other has, regardless of case."""
    names = {project: project.stem for project in projects}
    for depth in range(max(len(project.parts) for project in projects) - 1):
        counts: dict[str, int] = {}
        for name in names.values():
            counts[name.lower()] = counts.get(name.lower(), 0) + 1
        for project, name in names.items():
            if counts[name.lower()] > 1 and depth < len(project.parts) - 2:
                names[project] = f"{project.parts[-2 - depth]}_{name}"
    if len({name.lower() for name in names.values()}) < len(names):
        raise DocumentError("two projects of one folder have the same name: rename one")
    return names


def run_batch(
    entries: Sequence[Entry],
    folder: Path,
    options: Sequence[str],
    *,
    retries: int = 1,
    say: Callable[[Result], None] = lambda result: None,
) -> list[Result]:
    """Run each project as `meshlab-svbrdf run` does; results lie in `folder`/NAME.

    What an earlier batch finished is not done again, since `run` does not. After each project the
    table (batch.csv) and the record (batch.json) are written anew, whole.

    Parameters
    ----------
    options : of `run`, for every project
    retries : further attempts at a project that was killed; an error of its input stays one
    """
    folder.mkdir(parents=True, exist_ok=True)
    results: list[Result] = []
    for result in _each(entries, folder, options, retries):
        results.append(result)
        _write(folder, options, results)
        say(result)
        if result.state == LEFT:
            break
    return results


def _each(
    entries: Sequence[Entry], folder: Path, options: Sequence[str], retries: int
) -> Iterator[Result]:
    for entry in entries:
        start, attempts, code = time.monotonic(), 0, -1
        while code not in (0, ERROR, INTERRUPTED) and attempts <= retries:
            attempts += 1
            code, outcomes, error = _run(entry, folder, options)
            if code == USAGE:
                raise SvbrdfError(
                    f"`meshlab-svbrdf run` does not take {' '.join(options)}: {error}"
                )
        state = {0: DONE, INTERRUPTED: LEFT}.get(code, FAILED)
        took = time.monotonic() - start
        yield Result(entry.name, str(entry.project), state, attempts, took, outcomes, error)


def _run(entry: Entry, folder: Path, options: Sequence[str]) -> tuple[int, dict[str, str], str]:
    """Exit code, outcomes and error of `run` in a process of its own."""
    command = [*RUN, str(entry.project), "-o", str(folder / entry.name), "--json", *options]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
    ) as child:
        try:
            told, error = child.communicate()
        except KeyboardInterrupt:  # which the child has heard as well
            told, error = child.communicate()
            return INTERRUPTED, _outcomes(told), ""
    if child.returncode < 0:
        error = f"killed by signal {-child.returncode}; out of memory? {error}"
    return child.returncode, _outcomes(told), _one_line(error) if child.returncode else ""


def _outcomes(told: str) -> dict[str, str]:
    try:
        return {stage["name"]: stage["message"] for stage in json.loads(told)["stages"]}
    except (ValueError, KeyError, TypeError):  # killed before it could tell
        return {}


def _one_line(text: str) -> str:
    """The last error of what was said, else its last line."""
    lines = [line.strip(" │") for line in text.splitlines() if line.strip(" │─╭╮╰╯")]
    found = [line for line in lines if line.startswith("Error: ")] or lines
    return found[-1].removeprefix("Error: ") if found else ""


def _write(folder: Path, options: Sequence[str], results: Sequence[Result]) -> None:
    told: dict[str, Any] = {"options": list(options), "projects": [asdict(r) for r in results]}
    with replacing(folder / RECORD) as temporary:
        temporary.write_text(json.dumps(told, indent=1), encoding="utf-8")
    text = io.StringIO()
    filters = list(dict.fromkeys(name for r in results for name in r.outcomes))
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["name", "project", "state", "attempts", "seconds", "error", *filters])
    for r in results:
        row = [r.name, r.project, r.state, r.attempts, f"{r.seconds:.1f}", r.error]
        table.writerow([*row, *(r.outcomes.get(name, "") for name in filters)])
    with replacing(folder / TABLE) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
