"""One page of HTML with all that is known of a result, to file with the object."""

from __future__ import annotations

import time

from meshlab_svbrdf.document.atomic import replacing
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reporting.html import note, page, tag

from ._report_figures import coverage, lights, materials, residuals
from ._report_pictures import comparison, maps, object_views
from ._report_run import facts, runs, versions, warnings
from ._report_run import parameters as run_parameters

FILTER = Filter(
    name="generate_svbrdf_report",
    title="SVBRDF: report",
    needs=("mesh",),
    parameters=(
        Parameter("file", "path", "", help="The page to write, .html."),
        Parameter(
            "title", "string", "", help="Above all; empty: the project's name.",
        ),
    ),
    help="Writes one HTML file that opens offline and prints: pictures, lights, maps with "
    "histograms, materials, coverage, frames beside renderings, residuals, times, parameters and "
    "versions. Stages that have not run are named.",
)  # fmt: skip

SECTIONS = (
    object_views, warnings, lights, materials, maps, coverage, comparison, residuals, runs,
    run_parameters, versions,
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    file = parameters.file
    if file is None or file.suffix.lower() not in (".html", ".htm"):
        raise SvbrdfError("file: say where the page goes, a name that ends with .html")
    title = parameters.title or document.name
    said = f"How it reflects light, from {document.path.name}; {time.strftime('%-d %B %Y, %H:%M')}"
    parts = [tag("h1", title), note(said), facts(document)]
    for make in progress.over(SECTIONS, "sections"):
        parts.append(make(document))
    text = page(title, parts)
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return f"{file}, {len(text.encode()) / 1e6:.1f} MB"
