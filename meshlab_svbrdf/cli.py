"""The shell: `meshlab-svbrdf run | plan | apply | filters | presets | info | render | bench`.

What the commands are called and take. `commands.py` does it, and is imported when one is run, so
that `--help` comes at once.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .bench.command import bench

app = typer.Typer(
    help="How an object reflects light, recovered from an ordinary video of it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Estimator(StrEnum):
    joint = "joint"
    paper = "paper"


class PresetName(StrEnum):
    draft = "draft"
    standard = "standard"
    full = "full"


Project = Annotated[
    Path, typer.Argument(help="A MeshLab project, .mlp or .mlb.", show_default=False)
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="The project to write, or a folder for it."),
]
Layer = Annotated[str, typer.Option(help="The mesh layer to work on, where there are several.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for other programs.")]
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
        layer=layer, force=force, as_json=as_json,
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
    cameras: Annotated[Path, typer.Option(help="A project whose rasters are the views to render.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for the images.")],
    lights: Annotated[
        Path | None, typer.Option(help="Other lights, a JSON file in the form of lights.json.")
    ] = None,
    environment: Annotated[
        Path | None, typer.Option(help="Other surroundings, an HDR map, latitude-longitude EXR.")
    ] = None,
    turn: Annotated[float, typer.Option(help="Degrees by which the surroundings turn.")] = 0.0,
    exposure: Annotated[float, typer.Option(help="Stops, of other light.")] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Render the object as it was lit or under other light, from another project's cameras."""
    from . import commands

    commands.render(project, cameras, output, lights, environment, turn, exposure, as_json)


app.command()(bench)


def main() -> None:
    app()


if __name__ == "__main__":
    main()
