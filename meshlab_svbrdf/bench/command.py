"""`meshlab-svbrdf bench`: how long a run takes on frames made for that."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from .sheets import Sheet


class Format(StrEnum):
    jpeg = "jpeg"
    png = "png"
    h264 = "h264"


def bench(
    frames: Annotated[
        int, typer.Option(help="Full-HD frames; the paper's objects have some 3,382.", min=2)
    ] = 300,
    format: Annotated[Format, typer.Option(help="How the frames are stored.")] = Format.jpeg,
    texture_size: Annotated[int, typer.Option(help="Side of the atlas.", min=16, max=16384)] = 1024,
    preset: Annotated[str, typer.Option(help="Of the run; full uses every frame.")] = "full",
    estimator: Annotated[str, typer.Option(help="joint or paper.")] = "joint",
    threads: Annotated[
        list[int] | None,
        typer.Option(help="Cores to run on; given twice, both are run and compared.", min=1),
    ] = None,
    slope: Annotated[
        tuple[int, int] | None,
        typer.Option(help="Two numbers of frames: what a further frame costs, and what is fixed. "
                     "Without it 300 and all, from 1,200 frames on."),
    ] = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Compare the automatic choice of frames with all frames.")
    ] = False,
    scaling: Annotated[
        bool, typer.Option("--scaling", help="Fit how the time grows with frames and texels.")
    ] = False,
    huge: Annotated[
        bool,
        typer.Option("--huge", help="Only tell how memory, time and disk grow to 16384² texels and "
                     "10 million triangles, from this size and half of it."),
    ] = False,
    tiles: Annotated[
        bool,
        typer.Option("--tiles", help="Only run once on an object with six textures of that size, "
                     "UDIM tiles, and tell time and memory."),
    ] = False,
    cold: Annotated[
        bool, typer.Option(help="Also time a first run, which compiles the kernels.")
    ] = True,
    folder: Annotated[
        Path | None, typer.Option(help="Keeps the frames, 240 KB each; default: the user's cache.")
    ] = None,
    only_make: Annotated[
        bool, typer.Option("--only-make", help="Make the frames, print their project, and stop.")
    ] = False,
    triangles: Annotated[int, typer.Option(help="Of the object, about.", min=12)] = 200_000,
    width: Annotated[int, typer.Option(help="Of a frame.", min=32)] = 1920,
    height: Annotated[int, typer.Option(help="Of a frame.", min=32)] = 1080,
    step: Annotated[float, typer.Option(help="Degrees between frames.", min=0.01)] = 1.0,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
) -> None:  # fmt: skip
    """Measure time, memory and disk of every stage on a made object, beside only decoding.

    Frames of a bumpy object are rendered once and kept. Every run is a process and a folder of its
    own; kernels are warm. Close other programs first: wall-clock times are of the whole machine.
    """
    # What follows loads the whole suite
    from rich.console import Console

    from ..errors import SvbrdfError
    from .huge import huge as grow
    from .huge import shown
    from .measure import Wanted, benchmark
    from .sheets import huge_sheets, sheets, shown_sheet
    from .workload import Options, make_workload

    options = Options(triangles, width, height, format.value, step=step)
    say = Console(stderr=True, highlight=False)
    try:
        if only_make:
            typer.echo(str(make_workload(folder, frames, options).project))
            return
        if tiles:
            told = shown(frames, texture_size, options, folder, estimator, preset, say.print)
            _print(told, [shown_sheet(told)], json)
            return
        if huge:
            told = grow(frames, texture_size, options, folder, estimator, preset, say.print)
            _print(told, huge_sheets(told), json)
            return
        wanted = Wanted(
            frames, texture_size, estimator, preset, tuple(threads or ()), slope, auto, scaling,
            cold,
        )  # fmt: skip
        told = benchmark(wanted, options, folder, say.print)
    except SvbrdfError as error:
        say.print(f"Error: {error}", style="red", markup=False)
        raise typer.Exit(1) from None
    _print(told, sheets(told), json)
    names = {"first": "a first run on next to nothing", "second": "the same again"}
    for name, figures in told["kernels"].items():
        typer.echo(
            f"{names.get(name, name)}: {figures['seconds']:.1f} s, "
            f"{figures['cpu_seconds']:.1f} CPU s"
        )


def _print(told: dict[str, Any], tables: list[Sheet], json: Path | None) -> None:
    from json import dumps

    from rich.console import Console

    if json is not None:
        json.write_text(dumps(told, indent=1) + "\n", encoding="utf-8")
    shown = Console(width=None if Console().is_terminal else 160)
    for table in tables:
        shown.print(table.rich())
