"""What the shell's commands do."""

from __future__ import annotations

import errno
import json
import logging
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import typer
from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from . import registry
from .document.document import Document, Outcome
from .document.frames import Frames
from .document.freshness import in_words
from .document.record import BusyError
from .document.video_file import video_problem
from .errors import SvbrdfError
from .exits import BUSY, ERROR, INTERRUPTED
from .filter import describe, to_json
from .kernel_list import listed
from .kernels import compiling
from .plan import make_plan
from .presets import PRESETS, chain
from .progress import Show
from .script import Step, check_script, run_script
from .spread import Spread

errors = Console(stderr=True)
TEXTURE_SIZE = "compute_svbrdf_texels.texture_size"
MATERIALS = "compute_svbrdf_materials.image"
CURRENT = "up to date"
NO_MEMORY = (
    "there is not enough memory: use a smaller texture (--texture-size), fewer frames "
    "(--set compute_svbrdf_samples.frames=120) or --preset draft, or end other programs; "
    "finished stages are kept"
)


def run(
    project: Path, output: Path, *, script: Path | None, estimator: str | None, preset: str | None,
    texture_size: int | None, materials: Path | None, hold_out: bool, settings: list[str] | None,
    layer: str, scheduler: str | None, force: bool, as_json: bool,
) -> None:  # fmt: skip
    """Run the whole chain on PROJECT and write a project that MeshLab opens."""
    with _friendly():
        given = dict(map(_name_value, settings or ()))
        if texture_size is not None:
            given.setdefault(TEXTURE_SIZE, str(texture_size))
        if materials is not None:
            given.setdefault(MATERIALS, str(materials.absolute()))
        steps = chain(estimator or "joint", preset or "standard", given, script=script)
        check_script(steps)
        document = _open(project, output, layer)
        if document.path == project.absolute() and not document.results.record["products"]:
            raise SvbrdfError(
                f"the result would replace {project} itself: give another folder or name with -o"
            )
        if not document.project.rasters:
            raise SvbrdfError(
                f"{project}: has no rasters; add them with `meshlab-svbrdf register`, or in MeshLab"
            )
        document.hold_out(hold_out)
        if preset is not None and not as_json:
            typer.echo(f"preset {preset}: {PRESETS[preset]}")
        with compiling(errors.print):
            if script is None:
                steps = _planned(document, steps, given, as_json)
            with workers(scheduler, document.folder.parent) as document.spread:
                _run(document, steps, force, as_json)


def plan(
    project: Path, output: Path | None, estimator: str, preset: str, settings: list[str] | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Tell what `run` would choose for PROJECT, why, and what that would cost."""
    with _friendly():
        given = dict(map(_name_value, settings or ()))
        steps = chain(estimator, preset, given)
        check_script(steps)
        document = Document.open(project, output)
        if not document.rasters:
            raise SvbrdfError(
                f"{project}: has no rasters; add them with `meshlab-svbrdf register`, or in MeshLab"
            )
        made = make_plan(document, steps, given)
        typer.echo(json.dumps(made.to_json(), indent=1) if as_json else "\n".join(made.lines()))


def apply(
    project: Path, filter: str, parameters: list[str] | None, output: Path | None, layer: str,
    force: bool, as_json: bool,
) -> None:  # fmt: skip
    """Run one filter on PROJECT, in place unless an output is given."""
    with _friendly():
        step = Step(filter, dict(map(_name_value, parameters or ())), "the command line")
        registry.get(filter)
        check_script([step])
        with compiling(errors.print):
            _run(_open(project, output, layer), [step], force, as_json)


def compile_kernels() -> None:
    """Compile all kernels of a run that are not compiled yet."""
    with compiling(errors.print):
        for kernel, arguments in listed():
            kernel.compile(arguments)


def filters(name: str, as_json: bool) -> None:
    """List the filters, or describe one with its parameters."""
    with _friendly():
        found = [registry.get(name)] if name else list(registry.filters().values())
        if as_json:
            described = [to_json(filter) for filter in found]
            typer.echo(json.dumps(described[0] if name else described, indent=1))
        elif name:
            typer.echo(describe(found[0]), nl=False)
        else:
            width = max((len(filter.name) for filter in found), default=0)
            for filter in found:
                typer.echo(f"{filter.name:{width}}  {filter.title}")


def presets(as_json: bool) -> None:
    """List what `run --preset` offers, with the parameters that each one sets."""
    if as_json:
        typer.echo(json.dumps({name: asdict(preset) for name, preset in PRESETS.items()}, indent=1))
        return
    for name, preset in PRESETS.items():
        typer.echo(f"{name:9} {preset.about}: {preset}")


def info(project: Path, as_json: bool) -> None:
    """Tell what PROJECT holds: layers, frames, and which results are up to date."""
    with _friendly():
        document = Document.open(project)
        told = _tell(document)
        if as_json:
            typer.echo(json.dumps(told, indent=1))
            return
        for label, size in told["layers"].items():
            typer.echo(f"layer    {label}: {size}")
        typer.echo(f"rasters  {told['rasters']}, of these held out: {told['held_out']}")
        for video in told["videos"]:
            problem = f" ({video['problem']})" if video["problem"] else ""
            typer.echo(f"video    {video['file']}: {video['frames']} of the rasters{problem}")
        for folder, count in told["outside"].items():
            typer.echo(f"outside  {folder}: {count} files of the project, which are only read")
        for label in told["held_out_labels"]:
            typer.echo(f"held out {label}")
        typer.echo(f"results  {told['results']}{'' if told['products'] else ': none yet'}")
        for product, state in told["products"].items():
            typer.echo(f"result   {product}: {state['message']} ({state['state']})")
        for product, state in told["products"].items():
            if state["state"] != CURRENT:
                typer.echo(f"stale    {product}: run {state['filter']} again")
        gloss = told["products"].get("material_specular", {"state": CURRENT})["state"]
        if told["materials"] and gloss != CURRENT:
            typer.echo(f"the gloss below is {gloss}, and not of the object as it is now")
        for material in told["materials"]:
            typer.echo(_material_line(material))


def view(project: Path, port: int, browser: bool) -> None:
    """Serve PROJECT's materials as a page, until it is interrupted."""
    from .viewing.command import serve

    with _friendly():
        serve(project, port, browser, typer.echo)


def workers(scheduler: str | None, folder: Path) -> AbstractContextManager[Spread | None]:
    """The workers of a scheduler, which share this folder; None where none is given."""
    if scheduler is None:
        return nullcontext()
    from .cluster import connected

    return connected(scheduler, folder, lambda line: errors.print(line, soft_wrap=True))


def _open(project: Path, output: Path | None, layer: str) -> Document:
    document = Document.open(project, output)
    if layer != document.settings.get("object", ""):
        document.set(object=layer)
    document.object_layer()
    return document


def _planned(
    document: Document, steps: list[Step], given: dict[str, str], as_json: bool
) -> list[Step]:
    """The steps with what the plan chose, which is said."""
    made = make_plan(document, steps, given)
    if not document.has("samples"):
        made.check_space()
    for line in made.short() if not as_json else ():
        typer.echo(line)
    return made.steps


def _run(
    document: Document,
    steps: list[Step],
    force: bool,
    as_json: bool,
    later: Callable[[], list[Step]] = list,
) -> None:
    """Run the steps and save; what was finished is saved even if a later step fails.

    later : gives further steps when these are done: a plan needs the rasters that they place
    """
    with _stages(as_json, document) as (say, show):
        try:
            for outcome in run_script(document, steps, force=force, show=show):
                say(outcome)
            for outcome in run_script(document, later(), force=force, show=show):
                say(outcome)
        finally:
            interrupted = isinstance(sys.exception(), KeyboardInterrupt)
            if document.results.record["products"] and not interrupted:
                document.save()
    if not as_json:
        typer.echo(f"Open {document.path} in MeshLab.")


@contextmanager
def _stages(as_json: bool, document: Document | None = None) -> Iterator[tuple[Any, Any]]:
    """Say each stage's outcome on stdout, show its progress on stderr where that is a terminal."""
    outcomes: list[Outcome] = []
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    with Progress(
        *columns,
        TimeElapsedColumn(),
        console=errors,
        transient=True,
        disable=not errors.is_terminal,
    ) as bars:
        tasks: dict[str, Any] = {}

        def show(name: str) -> Show:
            for task in tasks.values():
                bars.update(task, visible=False)
            tasks[name] = bars.add_task(name, total=1.0)
            return lambda fraction, message: bars.update(
                tasks[name], completed=fraction, description=f"{name} {message}"
            )

        def say(outcome: Outcome) -> None:
            outcomes.append(outcome)
            if not as_json:
                first, *more = outcome.message.split("; ")
                typer.echo(f"{outcome.name:36} {outcome.seconds:7.1f} s  {first}")
                for line in more:
                    typer.echo(" " * 48 + line)

        try:
            yield say, show
        finally:
            if as_json:
                told = {"project": str(document.path)} if document else {}
                stages = [asdict(outcome) for outcome in outcomes]
                typer.echo(json.dumps(told | {"stages": stages}, indent=1))


@contextmanager
def _friendly() -> Iterator[None]:
    """Errors of the input, and lack of memory or of room on the disk, become one message and an
    exit code, as an interruption does."""
    log = logging.getLogger("meshlab_svbrdf")
    handler = RichHandler(console=errors, show_time=False, show_path=False, markup=False)
    log.addHandler(handler)
    try:
        yield
    except (SvbrdfError, OSError) as error:
        text = str(error)
        if isinstance(error, OSError) and error.filename:
            text = (
                f"{error.filename}: {error.strerror}; see to its permissions and the free space, "
                "or give another place with -o"
            )
        _say_error(f"{text}; {NO_MEMORY}" if _out_of_memory(error) else text)
        raise typer.Exit(BUSY if isinstance(error, BusyError) else ERROR) from None
    except (MemoryError, RuntimeError, cv2.error) as error:
        if not _out_of_memory(error):
            raise
        _say_error(NO_MEMORY)
        raise typer.Exit(ERROR) from None
    except KeyboardInterrupt:
        errors.print("Interrupted; finished stages are kept, the same command goes on from there.")
        raise typer.Exit(INTERRUPTED) from None
    finally:
        log.removeHandler(handler)


def _say_error(text: str) -> None:
    errors.print(f"Error: {text}", style="red", markup=False, highlight=False, soft_wrap=True)


def _out_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or the one it was made of, means that memory, or room for threads, has run
    out."""
    if error is None:
        return False
    if isinstance(error, cv2.error):
        return error.code == cv2.Error.StsNoMem
    return (
        isinstance(error, MemoryError)
        or getattr(error, "errno", None) == errno.ENOMEM
        or "can't start new thread" in str(error)
        or _out_of_memory(error.__context__)
    )


def _name_value(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise SvbrdfError(f"expected name=value, found {text!r}")
    return name, value


def _tell(document: Document) -> dict[str, Any]:
    record = document.results.record
    products = {}
    for name, product in record["products"].items():
        older = document.stale(name)
        products[name] = {
            "filter": product["filter"],
            "message": record["runs"].get(product["filter"], {}).get("message", ""),
            "state": f"older than the {in_words(older)}" if older else CURRENT,
        }
    has_materials = document.has("material_specular") and document.has_json("materials")
    layers = {}
    for layer in document.layers:
        mesh = layer.read().mesh
        layers[layer.label] = f"{len(mesh.vertices)} vertices, {len(mesh.faces)} faces"
    return {
        "project": str(document.path),
        "layers": layers,
        "rasters": len(document.project.rasters),
        "videos": _videos(document),
        "outside": _outside(document),
        "held_out": len(document.held_out),
        "held_out_labels": [raster.label for raster in document.held_out],
        "results": str(document.folder),
        "products": products,
        "materials": _named(document) if has_materials else [],
    }


def _outside(document: Document) -> dict[str, int]:
    """Folders that do not lie beside the project or below, and how many of its files they hold."""
    rasters = document.project.rasters
    frames = Frames(rasters)
    files = {frames.file(raster) for raster in rasters}
    files |= {path for each in rasters if (path := each.mask) is not None}
    files |= {path for layer in document.layers if (path := layer.path) is not None}
    here = document.path.parent.resolve()
    away = (path.parent for path in files if not path.resolve().is_relative_to(here))
    return {str(folder): count for folder, count in sorted(Counter(away).items())}


def _videos(document: Document) -> list[dict[str, Any]]:
    """The videos that rasters are frames of, and what is wrong with the files."""
    counts = Counter(frame.video for frame in Frames(document.project.rasters).videos.values())
    return [
        {"file": str(video), "frames": count, "problem": video_problem(video)}
        for video, count in counts.items()
    ]


def _named(document: Document) -> list[dict[str, Any]]:
    """The materials of materials.json, with their names where they were given."""
    from .filters._materials import read_names

    names = read_names(document)
    materials = document.json("materials")["materials"]
    return [m | ({"name": names[m["id"]]} if m["id"] in names else {}) for m in materials]


def _material_line(material: dict[str, Any]) -> str:
    """A row of the material table: its microfacets where they describe it better, else ρs and α, or
    why there are none."""
    name = f" ({material['name']})" if "name" in material else ""
    line = f"material {material['id']}{name}: {material['texels']:,} texels, "
    if model := material.get("reflectance"):
        return (
            f"{line}{model['model']} of roughness {model['roughness']:.3g}, F0 {model['f0']:.3g}, "
            f"strength {model['strength']:.4g}"
        )
    if not material["observed"]:
        return f"{line}unobserved: {material['reason']}"
    return f"{line}rho_s {material['rho_s']:.4g}, alpha {material['alpha']:.4g}"
