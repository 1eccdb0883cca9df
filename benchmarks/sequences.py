"""Few sharp photographs or many small frames: error against number of frames and their size.

From each scene so many frames are taken, spread evenly over the views, and reduced to a half or a
quarter of their width. Nothing else differs, but for the rows with few frames whose texels may have
fewer samples than usual.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.planning.resolution import resolution
from meshlab_svbrdf.presets import FRAMES
from meshlab_svbrdf.reflectance.threshold import MINIMUM_SAMPLES

from .cases import Case
from .full_hd import NAME, FullHD
from .ledger import Row, Task
from .solve import Setup, judge, solve
from .tables import Column, Table, table

PART = "sequences"
REDUCE = "compute_svbrdf_samples.reduce"
RUNS = (
    (6, 1), (12, 1), (24, 1), (48, 1), (96, 1), (192, 1), (48, 2), (192, 2), (192, 4), (0, 1)
)  # fmt: skip
"""Frames (0: all) and by how much they are reduced: four times as many at half the width are as
many pixels."""
THRESHOLD = "compute_svbrdf_luminance_threshold"
LEAST = f"{THRESHOLD}.minimum_samples"
FEW, SAMPLES = (12, 16, 20, 24), 4
"""Frames, of full width, with which a texel may have so few samples."""


def worst(row: Row, name: str) -> float | None:
    """The largest error of ln ρs ("rho_s") or ln α ("alpha") of the materials that were found."""
    errors = [float(m[f"ln_{name}"]) for m in row["materials"] if name in m and f"ln_{name}" in m]
    return max(errors, key=abs, default=None)


def _glossy(row: Row) -> str:
    """How many of the materials that have a gloss were observed on half of their texels."""
    true = [m for m in row["materials"] if "ln_rho_s" in m]
    return f"{sum('rho_s' in m for m in true)} of {len(true)}"


COLUMNS = (
    Column("wide", "width"),
    Column("apart °", "step", "{:.1f}"),
    Column("Mpixels", "megapixels", "{:.1f}"),
    Column("samples", "samples", "{:.0f}"),
    Column("coverage", "coverage", "{:.3f}"),
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("lights", lambda row: f"{row['lights'] - row['lights_false']} + {row['lights_false']}"),
    Column("worst °", "light_deg_max", "{:.2f}"),
    Column("gloss", _glossy),
    Column("ln ρs", lambda row: worst(row, "rho_s"), "{:+.3f}"),
    Column("ln α", lambda row: worst(row, "alpha"), "{:+.3f}"),
    Column("dB", "psnr", "{:.1f}"),
    Column("highlights", "psnr_highlights", "{:.1f}"),
    Column("CPU s", "cpu_seconds", "{:.0f}"),
)
NOTES = (
    "Apart: neighbouring frames, median. Samples: of a texel, median. Lights: right + wrong ones. "
    "Gloss: materials whose ρs and α were found, of those that have any; errors are of these.",
)


def cases(found: Sequence[Case], cache: Path) -> list[Case]:
    """The scenes: a film of 640×480, and full-HD frames of another object."""
    return [*found, FullHD(NAME, cache)]


def tasks(cases: Sequence[Case], texture: int) -> list[Task]:
    """A row for every number of frames and width."""
    runs = {
        f"{count} frames, {SAMPLES} samples a texel": {FRAMES: count, REDUCE: 1, LEAST: SAMPLES}
        for count in FEW
    }
    for count, reduce in RUNS:
        runs[f"{count or 'all'} frames, 1/{reduce}"] = {FRAMES: count, REDUCE: reduce}
    found = []
    for name, settings in runs.items():
        given = {key: str(value) for key, value in settings.items()}
        setup = Setup(preset="full", texture=texture, settings=given)
        for case in cases:
            found.append(Task(PART, case.name, name, repr(setup), partial(_measure, case, setup)))
    return found


def _measure(case: Case, setup: Setup, folder: Path) -> Row:
    solved = solve(case, setup, folder)
    return judge(case, solved, folder) | _facts(solved.document)


def _facts(document: Document) -> Row:
    """What was used, and what of it was found."""
    frames = document.json("frames")
    used = {frame["label"] for frame in frames["frames"] if "gain" in frame}
    cameras = [r.camera for r in document.rasters if r.label in used]
    texture, reduce = max(document.texels().sizes[0]), frames["reduce"]
    described = document.json("materials")["materials"]
    seen = document.attribute("samples")
    pixels = sum(c.width * c.height for c in cameras) / reduce**2
    return {
        "frames": len(cameras), "reduce": reduce, "width": cameras[0].width // reduce,
        "megapixels": pixels / 1e6, "step": frames["median_step_degrees"],
        "pixels_per_texel": resolution(document.mesh(), cameras).pixels_per_texel(texture) / reduce,
        "least": document.results.record["runs"][THRESHOLD]["parameters"]["minimum_samples"],
        "samples": float(np.median(seen[seen > 0])) if seen.any() else 0.0,
        "lights": len(document.json("lights")["lights"]),
        "glossy": sum(m["observed"] or "reflectance" in m for m in described),
        "reasons": [m["reason"] for m in described if not m["observed"]],
        "messages": {name: run["message"] for name, run in document.results.record["runs"].items()},
    }  # fmt: skip


def tables(rows: Sequence[Row]) -> list[Table]:
    """One table a scene."""
    made = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == scene]
        own.sort(key=lambda row: (row.get("reduce", 9), row.get("frames", 0), -row.get("least", 0)))
        lines = [row | {"name": _name(row)} for row in own]
        made.append(table(scene, lines, COLUMNS, *NOTES, scene=False))
    return made


def _name(row: Row) -> str:
    if "error" in row or row["least"] == MINIMUM_SAMPLES:
        return f"{row['frames']} frames" if "frames" in row else row["name"]
    return f"{row['frames']}, texels of {row['least']} samples too"
