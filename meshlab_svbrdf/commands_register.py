"""What `meshlab-svbrdf register` does: one of three filters, and perhaps the chain after it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from . import registry
from .commands import _friendly, _name_value, _open, _planned, _run, errors
from .document.document import MESHES, Document
from .errors import SvbrdfError
from .kernels import compiling
from .presets import PRESETS, chain
from .script import Step, check_script

TRACK = "generate_svbrdf_registered_rasters"
CAMERAS = "generate_svbrdf_rasters_from_cameras"
REFINE = "apply_svbrdf_raster_refinement"


def register(
    project: Path, output: Path, options: dict[str, Any], *, settings: list[str] | None,
    run: bool, preset: str | None, layer: str, force: bool, as_json: bool,
) -> None:  # fmt: skip
    """Give frames their cameras, and write them as rasters."""
    with _friendly():
        given = dict(map(_name_value, settings or ()))
        step = registration_step(options, {n: v for n, v in given.items() if "." not in n})
        check_script([step])
        chained = {name: value for name, value in given.items() if "." in name}
        if (chained or preset) and not run:
            raise SvbrdfError(f"{next(iter(chained), '--preset')} is for the chain: add --run")
        steps = chain("joint", preset or "standard", chained) if run else []
        check_script(steps)
        if project.suffix.lower() in MESHES:
            document = Document.of_mesh(project, output)
        else:
            document = _open(project, output, layer)
        if document.path == project.absolute():
            raise SvbrdfError(
                f"the result would replace {project} itself: give another folder or name with -o"
            )
        if preset is not None and not as_json:
            typer.echo(f"preset {preset}: {PRESETS[preset]}")

        def later() -> list[Step]:
            return _planned(document, steps, chained, as_json) if run else []

        with compiling(errors.print):
            _run(document, [step], force, as_json, later)


def registration_step(options: dict[str, Any], settings: dict[str, str]) -> Step:
    """The filter that the options ask for, with its parameters.

    Raises SvbrdfError where an option does not belong to that filter.
    """
    footage = options["video"] or options["images"] is not None
    name = CAMERAS if options["cameras"] is not None else TRACK if footage else REFINE
    known = {parameter.name for parameter in registry.get(name).parameters}
    parameters: dict[str, str] = {}
    for option, value in _plain(options).items():
        if option not in known:
            raise SvbrdfError(f"{option} does not go with {_why(name)}")
        parameters[option] = value
    return Step(name, parameters | settings, "the command line")


def _plain(options: dict[str, Any]) -> dict[str, str]:
    """The options that were given, as text."""
    found: dict[str, str] = {}
    for name, value in options.items():
        if value in (None, "", [], False, 0) or (name, value) in (("step", 1), ("align", "auto")):
            continue
        if name == "range":
            first, colon, last = value.partition(":")
            if not colon or not (first + last).isdigit():
                raise SvbrdfError(f"--range is {value!r}, expected FIRST:LAST, such as 100:400")
            found |= {"first": first or "0", "last": last or "-1"}
        elif isinstance(value, list):
            texts = [str(v.absolute()) if isinstance(v, Path) else v for v in value]
            found[name] = "; ".join(texts)
        else:
            found[name] = str(value.absolute() if isinstance(value, Path) else value)
    return found


def _why(name: str) -> str:
    return {
        TRACK: "frames that are registered from a start",
        CAMERAS: "--cameras",
        REFINE: "the project's own rasters: give --video or --images for new frames",
    }[name]
