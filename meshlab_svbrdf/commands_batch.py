"""What `meshlab-svbrdf batch` does."""

from __future__ import annotations

from pathlib import Path

import typer

from .batch import PAGE, TABLE, run_batch
from .batch_list import DONE, LEFT, Result, read_list
from .commands import _friendly, workers
from .exits import ERROR, INTERRUPTED

SHOWN = ("frames", "observed", "lights", "materials")
"""Figures of a project that its line tells; the page has all of them."""


def batch(
    projects: Path,
    output: Path,
    options: list[str],
    retries: int,
    reports: bool,
    scheduler: str | None,
) -> None:
    """Run the chain on every project of a list."""
    with _friendly():
        entries = read_list(projects)
        width = max(len(entry.name) for entry in entries)

        def say(result: Result) -> None:
            shown = (f"{name} {result.figures[name]}" for name in SHOWN if name in result.figures)
            told = result.error or "; ".join(shown)
            typer.echo(f"{result.name:{width}}  {result.state:8} {result.seconds:7.1f} s  {told}")

        with workers(scheduler, output) as spread:
            results = run_batch(
                entries, output.absolute(), options, retries=retries, reports=reports,
                spread=spread, say=say,
            )  # fmt: skip
        bad = [result.name for result in results if result.state != DONE]
        typer.echo(
            f"{len(results) - len(bad)} of {len(entries)} projects done"
            + (f"; not: {', '.join(bad)}" if bad else "")
            + f". {output / PAGE} shows them, {output / TABLE} tells what each stage said."
        )
    if results[-1].state == LEFT:
        raise typer.Exit(INTERRUPTED)
    if bad:
        raise typer.Exit(ERROR)
