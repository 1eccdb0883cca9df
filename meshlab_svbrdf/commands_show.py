"""What `meshlab-svbrdf render | compare | report` do: filters that show a result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .commands import _friendly, _stages
from .document.document import Document
from .document.project import read_project
from .errors import SvbrdfError

RENDERING = "generate_svbrdf_rendering"
RELIGHTING = "generate_svbrdf_relighting"
ALBEDO = "compute_svbrdf_albedo"
COMPARISON = "generate_svbrdf_comparison"
REPORT = "generate_svbrdf_report"
PREVIEW = 0.25
"""Of the size of a camera's image, but"""
SMALLEST = 320
"""pixels on the longer side at least, where the camera has as many."""
FILMS = (".avi", ".gif", ".m4v", ".mkv", ".mov", ".mpeg", ".mpg", ".ogv", ".webm", ".wmv")


def render(
    project: Path, output: Path, views: dict[str, Any], light: dict[str, Any], *, preview: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Render the object as it was lit, or under other light, from cameras or along a path."""
    with _friendly():
        views, light = _given(views), _given(light)
        if output.suffix.lower() in FILMS:
            raise SvbrdfError(f"{output}: films are .mp4: give such a name, or a folder's")
        place = "video" if output.suffix.lower() == ".mp4" else "folder"
        _check_path(views)
        relit = bool(light.keys() & {"lights", "environment", "recovered"})
        if light and not relit:
            raise SvbrdfError(
                "--turn and --exposure are of other light: give --environment, --lights or "
                "--recovered"
            )
        document = _finished(project, "render")
        parameters = views | {place: str(output.absolute())}
        if preview:
            parameters |= _preview(document, views.get("cameras"))
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
    """Write a page on the result; which later stages were not made is said there."""
    with _friendly():
        document = _finished(project, "report", "texels")
        with _stages(as_json) as (say, show):
            say(document.apply(REPORT, False, show("report"), file=str(output.absolute())))


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """The options that were given, paths whole."""
    return {
        name: str(value.absolute()) if isinstance(value, Path) else value
        for name, value in options.items()
        if value is not None
    }


def _check_path(views: dict[str, Any]) -> None:
    """What is of a path needs one."""
    path = views.get("path")
    if path is None and "frames" in views:
        raise SvbrdfError("--frames is of a path: give --path")
    if path != "turntable" and (alone := [n for n in ("elevation", "distance") if n in views]):
        raise SvbrdfError(f"--{alone[0]} is of a turntable: give --path turntable")


def _preview(document: Document, cameras: str | None) -> dict[str, Any]:
    """How a preview is rendered, by the smallest of the cameras."""
    project = document.project if cameras is None else read_project(cameras)
    sides = (max(raster.camera.width, raster.camera.height) for raster in project.rasters)
    size = min(max(PREVIEW, SMALLEST / min(sides, default=SMALLEST)), 1.0)
    return {"size": size, "supersampling": 1}


def _divide_light(document: Document, say: Any, show: Any, given: dict[str, Any]) -> None:
    """Find the albedo, where it is not there already."""
    if not document.has("albedo") or document.stale("albedo"):
        say(document.apply(ALBEDO, False, show("albedo"), **given))


def _finished(project: Path, verb: str, product: str = "material_specular") -> Document:
    """The project; SvbrdfError where the product that the command cannot do without is missing."""
    document = Document.open(project)
    if not document.has(product):
        raise SvbrdfError(
            f"{project} has no results to {verb}: make them with "
            f"`meshlab-svbrdf run {project} -o out` and {verb} out/{project.name}"
        )
    return document
