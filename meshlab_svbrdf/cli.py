"""The shell: `meshlab-svbrdf register | run | batch | plan | apply | info | render | export` …

What the commands are called and take. `commands*.py` do it, and are imported when one is run, so
that `--help` comes at once.
"""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .bench.command import bench
from .threads import quieten_blas

app = typer.Typer(
    help="How an object reflects light, recovered from an ordinary video of it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Estimator(StrEnum):
    joint = "joint"
    paper = "paper"


class CameraPath(StrEnum):
    smooth = "smooth"
    turntable = "turntable"


class PresetName(StrEnum):
    draft = "draft"
    standard = "standard"
    full = "full"


class Unobserved(StrEnum):
    grey = "grey"
    nearest = "nearest"


Project = Annotated[
    Path, typer.Argument(help="A MeshLab project, .mlp or .mlb.", show_default=False)
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="The project to write, or a folder for it."),
]
Layer = Annotated[str, typer.Option(help="The mesh layer to work on, where there are several.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for other programs.")]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS|local",
        help="A Dask scheduler whose workers share the disk; local: a process for each core here.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Run filters whose result is there already.")]


@app.command()
def run(
    project: Project,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The project to write, or a folder for it.")
    ],
    script: Annotated[
        Path | None, typer.Option(help="A chain of filters (.mlx) in place of the default one.")
    ] = None,
    estimator: Annotated[
        Estimator | None, typer.Option(help="joint: more accurate, the default. paper: as printed.")
    ] = None,
    preset: Annotated[
        PresetName | None,
        typer.Option(help="How much time it may take; see `meshlab-svbrdf presets`."),
    ] = None,
    texture_size: Annotated[
        int | None, typer.Option(help="Width and height of the maps in pixels.", min=16, max=16384)
    ] = None,
    materials: Annotated[
        Path | None, typer.Option(help="An image of material ids over the object's texture.")
    ] = None,
    hold_out: Annotated[
        bool, typer.Option("--hold-out", help="Keep every 8th frame for judging the result.")
    ] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="FILTER.NAME=VALUE",
            help="A parameter of one of the filters, as often as needed.",
        ),
    ] = None,
    layer: Layer = "",
    scheduler: Scheduler = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the whole chain on PROJECT and write a project that MeshLab opens.

    Filters whose inputs and parameters did not change do not run again: after an interruption the
    same command goes on where it was.
    """
    if script is not None and (estimator is not None or preset is not None):
        what = "estimator it runs" if estimator is not None else "parameters it takes"
        raise typer.BadParameter(f"a script says itself which {what}", param_hint="--script")
    from . import commands

    commands.run(
        project, output, script=script, estimator=estimator, preset=preset,
        texture_size=texture_size, materials=materials, hold_out=hold_out, settings=settings,
        layer=layer, scheduler=scheduler, force=force, as_json=as_json,
    )  # fmt: skip


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def batch(
    context: typer.Context,
    projects: Annotated[
        Path,
        typer.Argument(metavar="LIST", help="A text file: a project a line.", show_default=False),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The folder for the results, one each.")
    ],
    retries: Annotated[
        int, typer.Option(help="Further attempts at a project whose run was killed.", min=0)
    ] = 1,
    reports: Annotated[
        bool, typer.Option("--reports", help="Write the report of each project too.")
    ] = False,
    scheduler: Scheduler = None,
) -> None:
    """Run the chain on every project of LIST; all other options are those of `run`.

    A project that fails is named, and the others go on. The same command goes on where it was.
    """
    from . import commands_batch

    commands_batch.batch(projects, output, context.args, retries, reports, scheduler)


@app.command()
def register(
    project: Annotated[
        Path,
        typer.Argument(help="A MeshLab project, or a mesh (.ply, .obj).", show_default=False),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The project to write, or a folder for it.")
    ],
    video: Annotated[
        list[Path] | None, typer.Option(help="A video of the object, as often as needed.")
    ] = None,
    images: Annotated[
        Path | None, typer.Option(help="A folder of images in place of a video.")
    ] = None,
    start: Annotated[
        list[str] | None,
        typer.Option(metavar="RASTER", help="A raster that was aligned in MeshLab, by its label."),
    ] = None,
    points: Annotated[
        list[Path] | None,
        typer.Option(
            help="Points picked on the mesh and in a frame: CSV, JSON, or MeshLab's list."
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="A rough camera of a frame; it is refined.")
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(help="Cameras of all frames from COLMAP, Bundler, Metashape: refine only."),
    ] = None,
    align: Annotated[
        str, typer.Option(help="For --cameras: auto, none, pairs, rasters or points.")
    ] = "auto",
    pairs: Annotated[
        Path | None, typer.Option(help="For --cameras: points in both worlds.")
    ] = None,
    step: Annotated[int, typer.Option(help="Use every n-th frame.", min=1)] = 1,
    range_: Annotated[
        str, typer.Option("--range", metavar="FIRST:LAST", help="Frames, counted from 0.")
    ] = "",
    sharpest: Annotated[
        bool, typer.Option("--sharpest", help="Of every STEP frames use the sharpest.")
    ] = False,
    focal: Annotated[
        float | None, typer.Option(help="Focal length in pixels; else EXIF's, else estimated.")
    ] = None,
    focal_mm: Annotated[
        float | None, typer.Option(help="Focal length in mm, with --sensor-width.")
    ] = None,
    sensor_width: Annotated[
        float | None, typer.Option(help="The sensor's longer side in mm; 36: film.")
    ] = None,
    distortion: Annotated[
        str, typer.Option(metavar="'K1 K2 P1 P2 K3'", help="Of the lens (OpenCV), or auto.")
    ] = "",
    threshold: Annotated[
        float | None, typer.Option(help="Confidence below which frames are left out.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="[FILTER.]NAME=VALUE",
            help="Another parameter of the registration, or with --run of a filter of the chain.",
        ),
    ] = None,
    run_: Annotated[
        bool, typer.Option("--run", help="Go on with the whole chain, as `run` does.")
    ] = False,
    preset: Annotated[PresetName | None, typer.Option(help="For --run.")] = None,
    layer: Layer = "",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Give the frames of a video (or images) their cameras, and write them as rasters.

    It starts from one frame whose camera is known: an aligned raster, picked points, or a rough
    camera. Without --video and --images the project's own rasters are refined.
    """
    from . import commands_register

    commands_register.register(
        project, output,
        {
            "video": video, "images": images, "start": start, "points": points, "camera": camera,
            "cameras": cameras, "align": align, "pairs": pairs, "step": step, "range": range_,
            "sharpest": sharpest, "focal": focal, "focal_mm": focal_mm,
            "sensor_width": sensor_width, "distortion": distortion, "threshold": threshold,
        },
        settings=settings, run=run_, preset=preset, layer=layer, force=force, as_json=as_json,
    )  # fmt: skip


@app.command()
def plan(
    project: Project,
    output: Output = None,
    estimator: Annotated[Estimator, typer.Option(help="joint or paper.")] = Estimator.joint,
    preset: Annotated[PresetName, typer.Option(help="As of `run`.")] = PresetName.standard,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="FILTER.NAME=VALUE", help="As of `run`: it stays."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Tell what `run` would choose for PROJECT, why, and what that would cost; nothing is written.

    Every choice is a parameter: `run … --set FILTER.NAME=VALUE` overrides it.
    """
    from . import commands

    commands.plan(project, output, estimator, preset, settings, as_json)


@app.command()
def apply(
    project: Project,
    filter: Annotated[
        str, typer.Argument(help="See `meshlab-svbrdf filters`.", show_default=False)
    ],
    parameters: Annotated[
        list[str] | None, typer.Argument(metavar="[name=value]...", show_default=False)
    ] = None,
    output: Output = None,
    layer: Layer = "",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run one filter on PROJECT, in place unless an output is given."""
    from . import commands

    commands.apply(project, filter, parameters, output, layer, force, as_json)


@app.command()
def filters(
    name: Annotated[str, typer.Argument(help="One filter, in full.", show_default=False)] = "",
    as_json: AsJson = False,
) -> None:
    """List the filters, or describe one with its parameters."""
    from . import commands

    commands.filters(name, as_json)


@app.command()
def presets(as_json: AsJson = False) -> None:
    """List what `run --preset` offers, with the parameters that each one sets."""
    from . import commands

    commands.presets(as_json)


@app.command()
def info(project: Project, as_json: AsJson = False) -> None:
    """Tell what PROJECT holds: layers, frames, and which results are up to date."""
    from . import commands

    commands.info(project, as_json)


@app.command()
def render(
    project: Project,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="A folder for the images, or a film, FILE.mp4.")
    ],
    cameras: Annotated[
        Path | None,
        typer.Option(help="A project whose rasters are the views; without it PROJECT's own."),
    ] = None,
    path: Annotated[
        CameraPath | None,
        typer.Option(help="smooth: a film over the cameras. turntable: around the object."),
    ] = None,
    frames: Annotated[int | None, typer.Option(help="Of a path.", min=2)] = None,
    elevation: Annotated[
        float | None, typer.Option(help="Degrees, of a turntable's camera above the horizon.")
    ] = None,
    distance: Annotated[
        str, typer.Option(help="Of a turntable's camera; without it the object just fits.")
    ] = "",
    lights: Annotated[
        Path | None, typer.Option(help="Other lights, a JSON file in the form of lights.json.")
    ] = None,
    environment: Annotated[
        Path | None, typer.Option(help="Other surroundings, an HDR map, latitude-longitude EXR.")
    ] = None,
    recovered: Annotated[
        bool, typer.Option("--recovered", help="The recovered environment map as the light.")
    ] = False,
    turn: Annotated[
        float | None, typer.Option(help="Degrees by which the surroundings turn.")
    ] = None,
    exposure: Annotated[float | None, typer.Option(help="Stops, of other light.")] = None,
    lamp_radius: Annotated[
        float | None, typer.Option(help="Degrees, of the lamps: soft shadows.")
    ] = None,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview", help="A quarter of the size (320 pixels or more), one ray a pixel."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Render the object as it was lit or under other light: views, or a film along a path."""
    from . import commands_show

    commands_show.render(
        project, output,
        {
            "cameras": cameras, "path": path, "frames": frames, "elevation": elevation,
            "distance": distance or None, "lamp_radius": lamp_radius,
        },
        {
            "lights": lights, "environment": environment, "recovered": recovered or None,
            "turn": turn, "exposure": exposure,
        },
        preview=preview, as_json=as_json,
    )  # fmt: skip


@app.command()
def compare(
    project: Project,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for the pictures.")],
    frames: Annotated[
        list[str] | None,
        typer.Option(metavar="RASTER", help="A frame by its label, as often as needed."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show frames beside what PROJECT's result makes of them, with PSNR and SSIM.

    Without --frames these are the held-out ones, or a few of those that were used.
    """
    from . import commands_show

    commands_show.compare(project, output, frames or [], as_json)


@app.command()
def report(
    project: Project,
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write, .html.")],
    as_json: AsJson = False,
) -> None:
    """Write one page of HTML with all that is known of PROJECT's result, to file with the object.

    It needs nothing else: it opens offline, and prints.
    """
    from . import commands_show

    commands_show.report(project, output, as_json)


@app.command()
def export(
    project: Project,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for the files.")],
    formats: Annotated[
        str, typer.Option("--format", help="Of gltf, glb, obj, textures and lights.")
    ] = "glb,obj,textures,lights",
    shaded: Annotated[
        bool, typer.Option("--shaded", help="The colour as it was lit, shown without a light.")
    ] = False,
    lights: Annotated[
        Path | None, typer.Option(help="Other lamps, a JSON file in the form of lights.json.")
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Of colour and gloss; lamps are divided by it.")
    ] = 1.0,
    unobserved: Annotated[
        Unobserved, typer.Option(help="Colour of texels that were not observed.")
    ] = Unobserved.grey,
    jpeg: Annotated[bool, typer.Option("--jpeg", help="glTF's base colour as JPEG.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write the object for other programs: glTF, OBJ, textures, lamps."""
    from . import commands_export

    commands_export.export(
        project, output, formats=formats, shaded=shaded, lights=lights, scale=scale,
        unobserved=unobserved, jpeg=jpeg, as_json=as_json,
    )  # fmt: skip


@app.command()
def view(
    project: Project,
    port: Annotated[
        int, typer.Option(help="Of the page, on this machine alone; 0: a free one.", max=65535)
    ] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """Show PROJECT's object in a browser, to pick, merge, split and name its materials by hand.

    Saved edits go back into PROJECT: the next filter takes them.
    """
    from . import commands

    commands.view(project, port, browser)


@app.command()
def compile() -> None:
    """Compile all kernels of a run ahead: what its first time on a machine would take longer."""
    from . import commands

    commands.compile_kernels()


app.command()(bench)


LEAST_MEMORY = 3 << 29
"""Bytes of address space: NumPy, OpenCV and the compiler take 1 GB, and below it crash or do not
load."""


def main() -> None:
    quieten_blas()
    limit = _memory_limit()
    if limit is not None and limit < LEAST_MEMORY:
        typer.echo(
            f"Error: this shell gives programs {limit >> 20} MB of address space (ulimit -v); the "
            f"libraries alone take 1 GB: allow {LEAST_MEMORY >> 20} MB or more",
            err=True,
        )
        sys.exit(1)
    app()


def _memory_limit() -> int | None:
    """Bytes of address space that this process may have, or None where there is no limit."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


if __name__ == "__main__":
    main()
