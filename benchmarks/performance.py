"""Run time on the performance workload, and others at the same work.

The workload is `meshlab-svbrdf bench`'s; others are left out where they are not installed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from meshlab_svbrdf.bench.analysis import KINDS
from meshlab_svbrdf.bench.measure import Wanted, benchmark
from meshlab_svbrdf.bench.sheets import PAPER, sheets
from meshlab_svbrdf.bench.workload import Options, make_workload

from .ledger import Row, Task
from .peers import meshlab, open3d, speed
from .tables import Table

PART, WORKLOAD, GROWTH, OURS = "performance", "workload", "growth", "ours"
GROWN = 300  # frames on which the second core's gain and the exponents are measured
PROJECTED = 120  # frames that all are given: MeshLab holds every one of them in memory
VERTICES = 100_000
PROJECTIONS: dict[str, Callable[..., Row]] = {
    OURS: speed.projected_by_us,
    "MeshLab": speed.projected_by_meshlab,
    "Open3D": speed.projected_by_open3d,
}
LACKING = {"MeshLab": meshlab.why_not, "Open3D": open3d.why_not}


def tasks(
    frames: int, texture: int, cache: Path | None, options: Options | None = None
) -> tuple[list[Task], list[str]]:
    """What is measured, and a line on each peer that cannot be.

    frames, texture : of the workload; cache : keeps its frames; None: the user's cache
    """
    options = options or Options()
    about = f"{options}, {texture} texels"
    found, notes = [], []
    make = partial(_workload, frames, texture, cache, options)
    found.append(Task(PART, WORKLOAD, f"{frames} frames", f"{about}, {frames}", make))
    grown = min(GROWN, frames)
    make = partial(_growth, grown, texture, cache, options)
    found.append(Task(PART, GROWTH, f"{grown} frames", f"{about}, {grown}", make))
    for name, project in PROJECTIONS.items():
        if name in LACKING and (reason := LACKING[name]()):
            notes.append(f"{name}: left out, {reason}")
            continue
        count = min(PROJECTED, frames)
        make = partial(_projection, project, count, texture, cache, options)
        found.append(Task(PART, "projection", name, f"{about}, {count}", make))
    vertices = min(VERTICES, options.triangles // 2)
    make = partial(_visibility, vertices)
    found.append(Task(PART, "visibility", "embreex", f"{vertices} vertices", make))
    return found, notes


def _workload(frames: int, texture: int, cache: Path | None, options: Options, folder: Path) -> Row:
    wanted = Wanted(frames, texture, automatic=True)
    return {"told": benchmark(wanted, options, cache, partial(print, file=sys.stderr))}


def _growth(frames: int, texture: int, cache: Path | None, options: Options, folder: Path) -> Row:
    """What the second core gains; on one of them, exponents in frames and texels."""
    wanted = Wanted(frames, texture, threads=(1, 2), scaling=True, cold=False)
    told = benchmark(wanted, options, cache, partial(print, file=sys.stderr))
    return {name: told[name] for name in ("second_core", "scaling")}


def _projection(
    project: Callable[..., Row], frames: int, texture: int, cache: Path | None, options: Options,
    folder: Path,
) -> Row:  # fmt: skip
    workload = make_workload(cache, frames, options)
    return project(workload, texture, folder) | {"frames": frames, "texture": texture}


def _visibility(vertices: int, folder: Path) -> Row:
    return speed.visibility(vertices)


def tables(rows: Sequence[Row]) -> list[Table]:
    """The workload's, then what the others took."""
    made = []
    good = [row for row in rows if "error" not in row]
    for row in good:
        if row["scene"] in (WORKLOAD, GROWTH):
            made += [Table(s.title, [*s.headings], [*map(list, s.cells)], s.notes)
                     for s in sheets(row.get("told", row))]  # fmt: skip
    if projected := [row for row in good if row["scene"] == "projection"]:
        made.append(_projected(projected))
    made += [_seen(row) for row in good if row["scene"] == "visibility"]
    return made


def paper_table(rows: Sequence[Row]) -> Table | None:
    """What the README shows: the paper's columns."""
    return next((table for table in tables(rows) if table.title == PAPER), None)


def _projected(rows: Sequence[Row]) -> Table:
    ours = next((row for row in rows if row["name"] == OURS), None)
    cells = []
    for row in rows:
        per_frame = [f"{1000 * row[kind] / row['frames']:.0f}" for kind in KINDS]
        times = [f"{row[kind] / ours[kind]:.1f}" if ours else "–" for kind in KINDS]
        cells.append([row["name"], *per_frame, *times])
    frames, texture = rows[0]["frames"], rows[0]["texture"]
    return Table(
        f"Frames to texels: {frames} full-HD frames, {texture}×{texture}",
        ["by", "ms/frame", "CPU ms/frame", "times ours", "CPU times ours"], cells,
    )  # fmt: skip


def _seen(row: Row) -> Table:
    ours = row[OURS]
    cells = [
        [name, f"{each['seconds']:.2f}", f"{each['cpu_seconds']:.2f}",
         *(f"{each[kind] / ours[kind]:.1f}" for kind in KINDS), f"{100 * each['wrong']:.2f} %"]
        for name in (OURS, "embreex") for each in [row[name]]
    ]  # fmt: skip
    note = (
        f"Wrong: of rays from {speed.TRIED_VERTICES:,} vertices in {speed.TRIED} other directions "
        "that they face."
    )
    title = f"Visibility of {row['vertices']:,} vertices, {speed.DIRECTIONS} directions"
    headings = ["by", "s", "CPU s", "times ours", "CPU times ours", "wrong"]
    return Table(title, headings, cells, (note,))
