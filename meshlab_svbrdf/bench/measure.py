"""The benchmark: which runs there are, and all figures of them in one record."""

from __future__ import annotations

import platform
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .analysis import KINDS, by_stage, exponents, roofline, slope, total
from .first_run import first_run
from .machine import machine, measure
from .score import score
from .workload import Options, Workload, make_workload

Figures = dict[str, Any]
AUTOMATIC = "standard"
FULL = "full"
SLOPE_FROM = 300  # frames; the default where there are four times as many
REGISTERED = 60  # frames that are registered, to know what a frame takes
SIZE = "compute_svbrdf_texels.texture_size"


@dataclass(frozen=True)
class Wanted:
    """What to measure.

    frames : of the workload; texture_size : of the atlas; preset : of the first run
    threads : cores of the first run, and of a second one; empty: all
    slope : two numbers of frames; None: 300 and all, from 1,200 frames on
    automatic : compare the automatic choice of frames with all of them
    scaling : fit exponents over several sizes
    cold : compile all kernels anew, once
    """

    frames: int = 300
    texture_size: int = 1024
    estimator: str = "joint"
    preset: str = FULL
    threads: Sequence[int] = ()
    slope: tuple[int, int] | None = None
    automatic: bool = False
    scaling: bool = False
    cold: bool = True
    settings: dict[str, str] = field(default_factory=dict)


def benchmark(
    wanted: Wanted,
    options: Options | None = None,
    folder: Path | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Figures:
    """Make the workload and measure; every run in a process and a folder of its own."""
    bench = _Bench(wanted, options or Options(), folder, say)
    try:
        return bench.all()
    finally:
        shutil.rmtree(bench.place, ignore_errors=True)


class _Bench:
    def __init__(
        self, wanted: Wanted, options: Options, folder: Path | None, say: Callable[[str], None]
    ) -> None:
        self.wanted, self.say = wanted, say
        self.options = options
        self.threads = next(iter(wanted.threads), None)
        counts = [wanted.frames, *(wanted.slope or ())]
        say(f"making {max(counts)} frames, or what is lacking of them")
        self.workload: Workload = make_workload(folder, max(counts), options, self._made)
        self.place = Path(tempfile.mkdtemp(prefix="runs-", dir=self.workload.folder))
        self.known: dict[tuple[Any, ...], Figures] = {}

    def _made(self, done: int, count: int) -> None:
        if done % 100 == 99:
            self.say(f"  {done + 1} of {count} frames made")

    def run(
        self, frames: int, preset: str = FULL, threads: int | None = None, size: int | None = None
    ) -> Figures:
        """A run, once for each configuration. threads : None: those of the first run."""
        threads, size = threads or self.threads, size or self.wanted.texture_size
        key = (frames, preset, threads, size)
        if key not in self.known:
            self.say(f"{frames} frames, preset {preset}, {size}×{size}, {threads or 'all'} threads")
            output = self.place / "run"
            self.known[key] = measure(
                "chain", threads, project=str(self.workload.first(frames)), output=str(output),
                estimator=self.wanted.estimator, preset=preset,
                settings={SIZE: str(size), **self.wanted.settings},
            )  # fmt: skip
            if self.wanted.automatic and key[0::3] == (
                self.wanted.frames,
                self.wanted.texture_size,
            ):
                self.known[key] |= score(self.workload, next(output.glob("*.mlp")))
            shutil.rmtree(output)
        return self.known[key]

    def all(self) -> Figures:
        wanted, options = self.wanted, self.options
        told: Figures = {"version": 1, "wanted": asdict(wanted), "machine": machine()}
        told["machine"] |= {"python": platform.python_version(), "processor": platform.machine()}
        told["kernels"] = self._kernels()
        run = self.run(wanted.frames, wanted.preset)
        told["workload"] = asdict(options) | {
            "frames": wanted.frames,
            **{name: run[name] for name in ("triangles", "vertices", "texels")},
            "bytes_per_frame": self.workload.bytes / self.workload.frames,
        }
        told["runs"] = [run]
        run["registration"] = self._registration()
        if wanted.threads[1:]:
            told["runs"].append(self.run(wanted.frames, wanted.preset, wanted.threads[1]))
            told["second_core"] = _gain(*told["runs"])
        ends = wanted.slope
        if ends is None and wanted.frames >= 4 * SLOPE_FROM:
            ends = (SLOPE_FROM, wanted.frames)
        if ends:
            told["slope"] = slope(*(self.run(n) for n in sorted(ends)))
        if wanted.automatic:
            told["automatic"] = self._automatic()
        if wanted.scaling:
            told["scaling"] = self._scaling()
        pixels = options.width * options.height
        told["roofline"] = {
            "machine": told["machine"],
            "stages": roofline(run, told["machine"], pixels),
            "megapixels": run["frames"] * pixels / run["decode"]["seconds"] / 1e6,
            "format": options.format,
        }
        return told

    def _kernels(self) -> Figures:
        """What a user's first run waits for kernels, where that was asked for."""
        if not self.wanted.cold:
            return {}
        self.say("a first run on next to nothing: all kernels are compiled")
        return first_run(self.wanted.estimator)

    def _registration(self) -> Figures:
        """What it takes to register some frames of the workload, from the first one's camera."""
        count = min(REGISTERED, self.wanted.frames)
        self.say(f"registering {count} frames")
        project = str(self.workload.first(self.wanted.frames))
        return measure("register", self.threads, project=project, count=count)

    def _automatic(self) -> Figures:
        """Time and error with the frames chosen automatically, and with all of them."""
        found = {}
        for preset in (FULL, AUTOMATIC):
            run = self.run(self.wanted.frames, preset)
            cost = {kind: total(run, kind) for kind in KINDS}
            floor = self.run(self.wanted.frames)["decode"]
            found[preset] = {
                "frames_used": run["frames_used"],
                **cost,
                "ratio": cost["seconds"] / floor["seconds"],
                "cpu_ratio": cost["cpu_seconds"] / floor["cpu_seconds"],
                "dE": run["dE"],
                "highlights": run["highlights"],
            }
        return found

    def _scaling(self) -> list[Figures]:
        """Exponents in frames (a quarter, half, all) and in texels (a quarter, half, all)."""
        n, size = self.wanted.frames, self.wanted.texture_size
        frames = [self.run(max(1, round(n * share))) for share in (0.25, 0.5, 1)]
        half = max(1, round(n / 2))
        texels = [self.run(half, size=round(size * share**0.5)) for share in (0.25, 0.5, 1)]
        return [exponents(frames, "frames"), exponents(texels, "texels")]


def _gain(one: Figures, other: Figures) -> Figures:
    """How many times faster the second run is, stage by stage, and in decoding."""
    few, many = by_stage(one, "seconds"), by_stage(other, "seconds")
    gains = {name: few[name] / many[name] for name in few if few[name] > 0.05}
    gains["whole"] = total(one) / total(other)
    gains["only decode"] = one["decode"]["seconds"] / other["decode"]["seconds"]
    return {"threads": [one["threads"], other["threads"]], "gains": gains}
