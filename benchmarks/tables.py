"""Tables for the terminal and for the documentation, from rows of figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table as RichTable

Row = dict[str, Any]


@dataclass(frozen=True)
class Column:
    """heading; key : of the figure, or a function of the row; form : how it is written"""

    heading: str
    key: str | Callable[[Row], Any]
    form: str = "{}"

    def cell(self, row: Row) -> str:
        value = self.key(row) if callable(self.key) else row.get(self.key)
        if value is None:
            return "–"
        if isinstance(value, str) and self.form != "{}":
            value = float(value)
        return self.form.format(value).replace("+inf", "∞").replace("inf", "∞")


@dataclass(frozen=True)
class Table:
    """title : one line above; cells : texts, row by row."""

    title: str
    headings: list[str]
    cells: list[list[str]]
    notes: tuple[str, ...] = ()

    def rich(self) -> RichTable:
        shown = RichTable(title=self.title, caption="\n".join(self.notes))
        for heading in self.headings:
            shown.add_column(heading)
        for cells in self.cells:
            shown.add_row(*cells)
        return shown

    def markdown(self) -> str:
        lines = [f"**{self.title}**", "", f"| {' | '.join(self.headings)} |"]
        lines.append("|---" * len(self.headings) + "|")
        lines += [f"| {' | '.join(c.replace('|', '∣') for c in cells)} |" for cells in self.cells]
        return "\n".join([*lines, *(f"\n{note}" for note in self.notes)])


def table(
    title: str, rows: Sequence[Row], columns: Sequence[Column], *notes: str, scene: bool = True
) -> Table:
    """A line per row; where it failed, why. scene : whether the scene has a column of its own"""
    headings = ["scene"] * scene + ["result", *(column.heading for column in columns)]
    cells = []
    for row in rows:
        if "error" in row:
            values = [f"failed: {row['error'][:60]}"] + [""] * (len(columns) - 1)
        else:
            values = [column.cell(row) for column in columns]
        cells.append([*([row["scene"]] if scene else []), row["name"], *values])
    return Table(title, headings, cells, tuple(note for note in notes if note))


def splice(path: Path, name: str, text: str) -> None:
    """Put `text` between `<!-- benchmark: NAME -->` and `<!-- end -->` of a page."""
    page = path.read_text(encoding="utf-8")
    part = re.compile(rf"(<!-- benchmark: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not part.search(page):
        raise SystemExit(f"{path}: has no part `<!-- benchmark: {name} -->`")
    made = part.sub(lambda match: f"{match[1]}{text.rstrip()}\n{match[2]}", page)
    path.write_text(made, encoding="utf-8")
