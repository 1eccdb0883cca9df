"""The page at the end of a batch: a row for each project.

look_at    what a project's result shows: figures, remarks, a small picture
summary    the page
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from .batch_list import DONE, LEFT, Result
from .document.document import Document
from .errors import SvbrdfError
from .reporting.html import Html, join, note, page, picture, section, table, tag

SMALL = 150
"""Pixels of a picture's longer side."""
WAITING = "not begun"


def look_at(project: Path) -> tuple[dict[str, str], list[str], Html]:
    """Figures and remarks, as of the report, and a picture; nothing of what is not there."""
    from .filters._report_pictures import portrait
    from .filters._report_run import figures, remarks

    if not project.exists():
        return {}, [], Html()
    try:
        document = Document.open(project)
        image = portrait(document, SMALL) if document.has("diffuse") else None
        shown = Html() if image is None else picture(image, project.stem)
        return dict(figures(document)) | _gloss(document), remarks(document), shown
    except (SvbrdfError, OSError) as error:
        return {}, [f"The result cannot be shown: {error}"], Html()


def _gloss(document: Document) -> dict[str, str]:
    """Of the materials whose gloss was observed."""
    if not document.has("material_specular"):
        return {}
    seen = [m for m in document.json("materials")["materials"] if m["observed"]]
    return {f"material {m['id']}": f"ρs {m['rho_s']:.3g}, α {m['alpha']:.3g}" for m in seen}


def summary(
    folder: Path, names: Sequence[str], options: Sequence[str], results: Sequence[Result]
) -> str:
    """The page as it lies in `folder`, the batch's; names : of all projects, begun or not."""
    by_name = {result.name: result for result in results}
    bad = [result for result in results if result.state != DONE]
    waiting = [name for name in names if name not in by_name]
    hours = sum(result.seconds for result in results) / 3600
    told = {
        "projects": f"{len(names):,}", DONE: f"{len(results) - len(bad):,}",
        "failed": f"{sum(r.state not in (DONE, LEFT) for r in results):,}",
        "interrupted or not begun": f"{len(waiting) + sum(r.state == LEFT for r in results):,}",
        "time of all": f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.1f} min",
    }  # fmt: skip
    date = time.strftime("%-d %B %Y, %H:%M")
    said = f"{folder.name}; options: {' '.join(options) or 'none'}; {date}"
    facts = tag(
        "dl", *(tag("div", tag("dt", k), tag("dd", v)) for k, v in told.items()), class_="facts"
    )
    rows = [_row(folder, by_name[name]) for name in names if name in by_name]
    rows += [("", tag("strong", name), WAITING, "", "") for name in waiting]
    headings = ("", "project", "state", "figures", "remarks")
    return page(
        "Many objects",
        [
            tag("h1", "Many objects"), note(said), facts, _failures(bad),
            section("Each of them", table(headings, rows, 3, 4)),
        ],
    )  # fmt: skip


def _failures(bad: Sequence[Result]) -> Html:
    """Links to the rows of those that are not done, with their errors."""
    if not bad:
        return Html()
    items = (
        tag("li", tag("a", r.name, href="#" + quote(r.name)), f": {r.error or r.state}")
        for r in bad
    )
    return section("Not done", tag("ul", *items))


def _row(folder: Path, result: Result) -> tuple[object, ...]:
    """Picture, name with its report, state and time, figures, remarks."""
    own = [tag("strong", result.name, id=quote(result.name))]
    if (folder / result.name / f"{result.name}.html").exists():
        link = quote(f"{result.name}/{result.name}.html")
        own += [tag("br"), tag("a", "report", href=link)]
    tried = f", {result.attempts} attempts" if result.attempts > 1 else ""
    state = tag("span", result.state, class_="dim" if result.state == DONE else "warn")
    figures = join(tag("div", f"{name}: {value}") for name, value in result.figures.items())
    said = [tag("p", result.error, class_="missing")] if result.error else []
    said += [tag("p", remark) for remark in result.remarks]
    return (
        tag("div", result.picture, class_="small"), join(own),
        join([state, tag("br"), f"{result.seconds:.0f} s{tried}"]), figures, join(said),
    )  # fmt: skip
