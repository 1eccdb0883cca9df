"""The tables that the benchmark prints, from its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .analysis import KINDS, paper_row, total

Figures = dict[str, Any]
GPU = {"environment": 0.145, "diffuse": 0.143, "specular": 0.055}  # the paper's, s a frame
REGISTRATION = "2000 ms"  # the paper's: two seconds a frame
MIB, GIB = 1 << 20, 1 << 30
PAPER = "The paper's columns: time of all frames (of each)"


@dataclass(frozen=True)
class Sheet:
    """title : one line above; cells : texts, row by row; notes : lines below."""

    title: str
    headings: Sequence[str]
    cells: Sequence[Sequence[str]]
    notes: tuple[str, ...] = ()

    def rich(self):
        """For a terminal."""
        from rich.table import Table

        shown = Table(title=self.title, caption="\n".join(self.notes) or None)
        for index, heading in enumerate(self.headings):
            shown.add_column(heading, justify="right" if index else "left")
        for cells in self.cells:
            shown.add_row(*cells)
        return shown


def sheets(told: Figures) -> list[Sheet]:
    """All tables of a benchmark's figures, as `bench.measure` gives them."""
    runs = told.get("runs", [])
    made = [_stages(run) for run in runs]
    made += [_paper(runs)] if runs else []
    for key, make in (
        ("slope", _slope), ("second_core", _second_core), ("automatic", _automatic),
        ("scaling", _scaling), ("roofline", _roofline),
    ):  # fmt: skip
        if told.get(key):
            made.append(make(told[key]))
    return made


def _stages(run: Figures) -> Sheet:
    frames, samples, floor = run["frames"], run["samples"], run["decode"]
    rows = [*run["stages"], {"name": "whole"} | {k: total(run, k) for k in KINDS}]
    rows[-1]["peak"] = run["peak"]
    cells = [
        [
            row["name"], _s(row["seconds"]), _s(row["cpu_seconds"]),
            f"{1000 * row['seconds'] / frames:.1f}", f"{1000 * row['cpu_seconds'] / frames:.1f}",
            _rate(samples, row["seconds"]), f"{row['seconds'] / floor['seconds']:.2f}",
            f"{row['cpu_seconds'] / floor['cpu_seconds']:.2f}", f"{row['peak'] / MIB:.0f}",
        ]
        for row in [*rows, floor | {"name": "only decode these frames"}]
    ]  # fmt: skip
    per_sample = run["store_bytes"] / samples if samples else 0
    notes = [
        f"{samples:,} samples of {run['texels']:,} texels, {per_sample:.2f} bytes each on disk."
    ]
    if run["reduce"] > 1:
        notes.append(f"Frames were reduced to 1/{run['reduce']} of their width while decoding.")
    if run["compiled"]:
        notes.append(f"{run['compiled']} kernels were compiled meanwhile: measure again.")
    return Sheet(
        f"{frames} frames, preset {run['preset']} ({run['frames_used']} used), "
        f"{run['threads']} threads",
        ["stage", "s", "CPU s", "ms/frame", "CPU ms/frame", "M samples/s",
         "× decode", "CPU × decode", "peak MiB"],
        cells,
        tuple(notes),
    )  # fmt: skip


def _paper(runs: Sequence[Figures]) -> Sheet:
    rows = [paper_row(run) for run in runs]
    cells = [
        [
            f"{row['frames']:,}, {run['preset']}", f"{row['triangles']:,}",
            _registration(row["registration"]),
            *(f"{row[name]:.1f} s ({1000 * row[name] / row['frames']:.1f} ms)" for name in GPU),
            str(row["clusters"]),
        ]
        for run, row in zip(runs, rows, strict=True)
    ]  # fmt: skip
    paper = [f"{1000 * seconds:.0f} ms" for seconds in GPU.values()]
    return Sheet(
        PAPER,
        ["frames", "triangles", "registration", *GPU, "clusters"],
        [*cells, ["paper, GTX 580", "135–250k", REGISTRATION, *paper, "–"]],
        (
            "Registration: of some frames, from the first one's camera; decoding them included.",
            "Environment: all up to the map, projecting the frames included.",
        ),
    )


def _registration(told: Figures | None) -> str:
    if told is None:
        return "–"
    n = told["frames"]
    return (
        f"({1000 * told['seconds'] / n:.0f} ms; {told['registered']} of {n} "
        f"found, {told['error']:.1f} px off)"
    )


def _slope(found: Figures) -> Sheet:
    few, many = found["frames"]
    wall, cpu = found["seconds"], found["cpu_seconds"]

    def row(name: str, *numbers: float) -> list[str]:
        return [name, *(f"{1000 * x:.2f}" for x in numbers[:2]), *map(_s, numbers[2:])]

    cells = [
        row(name, each, cpu["stages"][name], wall["fixed_stages"][name], cpu["fixed_stages"][name])
        for name, each in wall["stages"].items()
    ]
    cells += [
        row("whole", wall["per_frame"], cpu["per_frame"], wall["fixed"], cpu["fixed"]),
        [*row("only decode", wall["decode"], cpu["decode"]), "", ""],
        ["whole / decode", *(_ratio(kind["ratio"]) for kind in (wall, cpu)), "", ""],
    ]
    return Sheet(
        f"What a further frame costs: slope from {few} to {many} frames",
        ["stage", "ms/frame", "CPU ms/frame", "fixed s", "fixed CPU s"],
        cells,
    )


def _second_core(found: Figures) -> Sheet:
    cells = [[name, f"{gain:.2f}"] for name, gain in found["gains"].items()]
    title = f"{found['threads'][1]} threads against {found['threads'][0]}: how many times faster"
    return Sheet(title, ["stage", "×"], cells)


def _automatic(found: Figures) -> Sheet:
    cells = [
        [
            name, str(row["frames_used"]), _s(row["seconds"]), _s(row["cpu_seconds"]),
            _ratio(row["ratio"]), _ratio(row["cpu_ratio"]), _ratio(row["dE"], 3),
            _ratio(row["highlights"]),
        ]
        for name, row in found.items()
    ]  # fmt: skip
    headings = ["preset", "frames used", "s", "CPU s", "/ decode all", "CPU / decode all", "ΔE",
                "highlights"]  # fmt: skip
    note = "Highlights: RMS error in sRGB codes, brightest tenth of the object in unseen views."
    return Sheet("Frames chosen automatically against all of them", headings, cells, (note,))


def _scaling(found: Sequence[Figures]) -> Sheet:
    names = [*found[0]["stages"], "whole"]
    cells = [
        [name, *(_ratio(({"whole": e["whole"]} | e["stages"])[name]) for e in found)]
        for name in names
    ]
    notes = tuple(f"{e['size']}: {', '.join(f'{n:,}' for n in e['sizes'])}" for e in found)
    headings = ["stage", *(f"in {e['size']}" for e in found)]
    return Sheet("CPU seconds grow with the size to the power of", headings, cells, notes)


def _roofline(found: Figures) -> Sheet:
    cells = [
        [
            row["name"], f"{row['bytes']:.1f}", f"{row['nanoseconds']:.1f}",
            f"{row['operations']:.0f}", f"{100 * row['bandwidth_share']:.1f} %",
        ]
        for row in found["stages"]
    ]  # fmt: skip
    machine = found["machine"]
    return Sheet(
        "Per sample, against what the machine can do",
        ["stage", "bytes at least", "CPU ns", "operations at most", "of the bandwidth"],
        cells,
        (
            f"Copying moves {machine['copy_bytes'] / 1e9:.1f} GB/s on {machine['cores']} cores; "
            f"{machine['operations'] / 1e9:.1f}·10⁹ multiplications and additions per second.",
            f"Decoding: {found['megapixels']:.0f} Mpixel/s of {found['format']}.",
        ),
    )


def huge_sheets(told: Figures) -> list[Sheet]:
    """The tables of `huge.huge`."""
    return [_growth(told[size]) for size in ("texels", "triangles")]


def shown_sheet(run: Figures) -> Sheet:
    """The table of `huge.shown`."""
    rows = [*run["stages"], {"name": "whole"} | {kind: total(run, kind) for kind in KINDS}]
    rows[-1] |= {kind: max(stage[kind] for stage in run["stages"]) for kind in ("peak", "own")}
    cells = [
        [
            row["name"], f"{row['peak'] / MIB:.0f}", f"{row['own'] / MIB:.0f}",
            _s(row["seconds"]), _s(row["cpu_seconds"]),
        ]
        for row in rows
    ]  # fmt: skip
    return Sheet(
        f"{run['triangles']:,} triangles, {run['texels']:,} texels in six UDIM tiles, "
        f"{run['frames']} frames, {run['samples']:,} samples",
        ["stage", "peak MiB", "no file's", "s", "CPU s"],
        cells,
        (
            "Pages of files count in the peak, but the system takes them back where memory is "
            "wanted.",
            f"Results on disk: {run['disk'] / MIB:.0f} MiB.",
        ),
    )


def _growth(found: Figures) -> Sheet:
    aim, (small, large) = found["aim"], found["sizes"]
    one = found["size"].removesuffix("s")
    cells = [
        [
            row["name"], f"{row['peak'] / MIB:.0f}", f"{row['own'] / MIB:.0f}",
            f"{row['by_own']:.0f}", f"{row['aim_own'] / GIB:.1f}", _s(row["cpu"]),
            _s(1e6 * row["by_cpu"]), f"{row['aim_cpu'] / 3600:.2f}",
        ]
        for row in found["stages"]
    ]  # fmt: skip
    cpu, aim_cpu = (sum(row[key] for row in found["stages"]) for key in ("cpu", "aim_cpu"))
    whole = ["whole", "", "", "", "", _s(cpu), "", f"{aim_cpu / 3600:.2f}"]
    return Sheet(
        f"{large:,} {found['size']}, and what lines through {small:,} and these say of {aim:.2g}",
        ["stage", "peak MiB", "no file's", f"bytes a further {one}", "GiB then", "CPU s",
         f"CPU s a further million {found['size']}", "CPU h then"],
        [*cells, whole],
        (
            "Loading the kernels counts in CPU s, not in what a further million takes.",
            "Pages of files count in the peak, but the system takes them back where memory is "
            "wanted: what a further one takes, and the GiB, are of the rest.",
            f"Results on disk: {found['disk'] / MIB:.0f} MiB, {found['by_disk']:.0f} bytes a "
            f"further {one}, {found['aim_disk'] / GIB:.0f} GiB then.",
        ),
    )  # fmt: skip


def _s(seconds: float) -> str:
    return f"{seconds:.2f}"


def _ratio(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _rate(samples: int, seconds: float) -> str:
    return f"{samples / seconds / 1e6:.1f}" if seconds > 0 else "–"
