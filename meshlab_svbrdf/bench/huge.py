"""How memory, time and disk grow towards a huge object: lines through runs on two smaller ones."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .machine import measure
from .workload import Options, make_workload

Figures = dict[str, Any]
TEXELS = 16384**2
TRIANGLES = 10_000_000
SIZE = "compute_svbrdf_texels.texture_size"
RAYS = "compute_svbrdf_visibility.directions"
SURFACES = 100_000, 400_000  # triangles
FACES_SIZE = 256  # of the texture where triangles are counted
RETURNED = {"MALLOC_MMAP_THRESHOLD_": "1000000"}
"""Arrays that a stage lets go of do not count in the next one's peak (glibc)."""
IN_FILES = {"MESHLAB_SVBRDF_LARGE": "1000000"}
"""Of small runs: what lies in files for a huge object does so for them, too (`blocks.room`)."""
DIRECTIONS = 64  # rays a vertex: their time is a line, their memory the same


def huge(
    frames: int, texture_size: int, options: Options, folder: Path | None,
    estimator: str = "joint", preset: str = "full", say: Callable[[str], None] = lambda line: None,
) -> Figures:  # fmt: skip
    """Runs at the texture size and at half of it, surfaces of so many triangles, and what follows
    for `TEXELS` and `TRIANGLES`.

    Kernels are loaded in both runs of a line alike: its slope does not hold that.

    texels : `growth` per stage of the whole chain, and the two runs
    triangles : of the stages that need the mesh alone
    """
    say(f"making {frames} frames, or what is lacking of them")
    workload = make_workload(folder, frames, options)
    place = Path(tempfile.mkdtemp(prefix="huge-", dir=workload.folder))
    try:
        runs = []
        for size in (texture_size // 2, texture_size):
            say(f"{frames} frames, {size}×{size}")
            runs.append(_run(workload.first(frames), place, size, estimator, preset, IN_FILES))
        surfaces = []
        for count in SURFACES:
            say(f"a surface of {count:,} triangles")
            surfaces.append(measure(
                "surface", None, RETURNED | IN_FILES, folder=str(place), triangles=count,
                size=FACES_SIZE, directions=DIRECTIONS,
            ))  # fmt: skip
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return {
        "runs": runs,
        "texels": growth(runs[0], runs[1], "texels", TEXELS),
        "triangles": growth(surfaces[0], surfaces[1], "triangles", TRIANGLES),
    }


def shown(
    frames: int, texture_size: int, options: Options, folder: Path | None,
    estimator: str = "joint", preset: str = "full", say: Callable[[str], None] = lambda line: None,
) -> Figures:  # fmt: skip
    """One run on an object with six textures of that size, UDIM tiles; the child's figures."""
    say(f"making {frames} frames, or what is lacking of them")
    workload = make_workload(folder, frames, options)
    place = Path(tempfile.mkdtemp(prefix="huge-", dir=workload.folder))
    try:
        say(f"{frames} frames, six tiles of {texture_size}×{texture_size}")
        project = workload.first(frames, tiles=True)
        return _run(project, place, texture_size, estimator, preset, {})
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _run(
    project: Path, place: Path, size: int, estimator: str, preset: str, where: dict[str, str]
) -> Figures:
    """The chain's figures; its results are measured, and taken away. where : of `IN_FILES`"""
    told = measure(
        "chain", None, RETURNED | where, project=str(project), output=str(place / "run"),
        estimator=estimator, preset=preset, settings={SIZE: str(size), RAYS: str(DIRECTIONS)},
        warm=False,
    )  # fmt: skip
    shutil.rmtree(place / "run")
    return told


def growth(small: Figures, large: Figures, size: str, aim: float) -> Figures:
    """Straight lines through two runs, at `aim`; size : what grew, "texels" or "triangles".

    stages : peak, own (bytes: of all, of what is no file's), cpu (seconds) at the larger run;
        by_peak, by_own, by_cpu, what one more takes; aim_peak, aim_own, aim_cpu at the aim; disk,
        by_disk, aim_disk of the folder of results
    """
    more = large[size] - small[size]
    rest = aim - large[size]

    def line(few: float, many: float) -> tuple[float, float, float]:
        each = (many - few) / more
        return many, each, many + each * rest

    stages = []
    for few, many in zip(small["stages"], large["stages"], strict=True):
        peak, by_peak, aim_peak = line(few["peak"], many["peak"])
        own, by_own, aim_own = line(few["own"], many["own"])
        cpu, by_cpu, aim_cpu = line(few["cpu_seconds"], many["cpu_seconds"])
        stages.append({
            "name": many["name"], "peak": peak, "by_peak": by_peak, "aim_peak": aim_peak,
            "own": own, "by_own": by_own, "aim_own": aim_own,
            "cpu": cpu, "by_cpu": by_cpu, "aim_cpu": aim_cpu,
        })  # fmt: skip
    disk, by_disk, aim_disk = line(small["disk"], large["disk"])
    return {
        "size": size, "sizes": [small[size], large[size]], "aim": aim, "stages": stages,
        "disk": disk, "by_disk": by_disk, "aim_disk": aim_disk,
    }  # fmt: skip
