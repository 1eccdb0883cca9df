"""What a batch takes and gives: the projects of a list, and what became of each.

Entry, read_list    projects, one a line          Result    what became of one
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .errors import DocumentError
from .reporting.html import Html

DONE, FAILED, LEFT = "done", "failed", "interrupted"


@dataclass(frozen=True)
class Entry:
    """A project, and the folder of its result within the batch's."""

    project: Path
    name: str


@dataclass(frozen=True)
class Result:
    """state : DONE, FAILED or LEFT; attempts, seconds : of this run
    outcomes : of the filters, a line each, as far as they came; error : of the last attempt
    figures, remarks, picture : what the result shows (batch_page.py), as far as there is one
    """

    name: str
    project: str
    state: str
    attempts: int
    seconds: float
    outcomes: dict[str, str]
    error: str = ""
    figures: dict[str, str] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    picture: Html = field(default=Html(), repr=False)


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
