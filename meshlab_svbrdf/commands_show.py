"""What `meshlab-svbrdf render | compare | report` do: filters that show a result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .commands import _friendly, _stages
from .document.document import Document
from .errors import SvbrdfError

RENDERING = "generate_svbrdf_rendering"
RELIGHTING = "generate_svbrdf_relighting"
ALBEDO = "compute_svbrdf_albedo"
COMPARISON = "generate_svbrdf_comparison"
REPORT = "generate_svbrdf_report"
PREVIEW = {"size": 0.25, "supersampling": 1}


def render(
    project: Path, output: Path, views: dict[str, Any], light: dict[str, Any], *, preview: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Render the object as it was lit, or under other light, from cameras or along a path."""
    with _friendly():
        views, light = _given(views), _given(light)
        place = "video" if output.suffix.lower() == ".mp4" else "folder"
        parameters = views | {place: str(output.absolute())} | (PREVIEW if preview else {})
        relit = bool(light.keys() & {"lights", "environment", "recovered"})
        if light and not relit:
            raise SvbrdfError(
                "--turn and --exposure are of other light: give --environment or --lights"
            )
        document = _finished(project, "render")
        with _stages(as_json) as (say, show):
            if not relit:
                say(document.apply(RENDERING, False, show("render"), **parameters))
                return
            _divide_light(
                document, say, show, {k: v for k, v in views.items() if k == "lamp_radius"}
            )
            say(document.apply(RELIGHTING, False, show("render"), **parameters, **light))


def compare(project: Path, output: Path, frames: list[str], as_json: bool) -> None:
    """Show frames beside what the result makes of them."""
    with _friendly():
        document = _finished(project, "compare")
        given = {"frames": "; ".join(frames), "folder": str(output.absolute())}
        with _stages(as_json) as (say, show):
            say(document.apply(COMPARISON, False, show("compare"), **given))


def report(project: Path, output: Path, as_json: bool) -> None:
    """Write a page on the result; what was not made is said there."""
    with _friendly():
        document = Document.open(project)
        with _stages(as_json) as (say, show):
            say(document.apply(REPORT, False, show("report"), file=str(output.absolute())))


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """The options that were given, paths whole."""
    return {
        name: str(value.absolute()) if isinstance(value, Path) else value
        for name, value in options.items()
        if value is not None
    }


def _divide_light(document: Document, say: Any, show: Any, given: dict[str, Any]) -> None:
    """Find the albedo, where it is not there already."""
    if not document.has("albedo") or document.stale("albedo"):
        say(document.apply(ALBEDO, False, show("albedo"), **given))


def _finished(project: Path, verb: str) -> Document:
    document = Document.open(project)
    if not document.has("material_specular"):
        raise SvbrdfError(
            f"{project} has no results to {verb}: make them with "
            f"`meshlab-svbrdf run {project} -o out` and {verb} out/{project.name}"
        )
    return document
