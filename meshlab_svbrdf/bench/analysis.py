"""From figures of runs to what they mean: slopes, exponents, shares of the machine's rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Figures = dict[str, Any]
TEXELS, VISIBILITY, SAMPLES = (
    "compute_svbrdf_texels", "compute_svbrdf_visibility", "compute_svbrdf_samples",
)  # fmt: skip
KINDS = ("seconds", "cpu_seconds")
STORED = 5  # bytes of a sample that a pass over the store reads at least


def total(run: Figures, kind: str = "seconds") -> float:
    """Of all stages of a run; kind : one of KINDS."""
    return sum(stage[kind] for stage in run["stages"])


def by_stage(run: Figures, kind: str) -> dict[str, float]:
    return {stage["name"]: stage[kind] for stage in run["stages"]}


def slope(short: Figures, long: Figures) -> Figures:
    """What a further frame costs, from runs on fewer and on more frames, and what is fixed.

    Per kind of seconds: stages by name and their sum, each per frame; decode per frame; the ratio
    of the two; fixed : what would remain without frames.
    """
    more = long["frames"] - short["frames"]
    found: Figures = {"frames": [short["frames"], long["frames"]]}
    for kind in KINDS:
        few, many = by_stage(short, kind), by_stage(long, kind)
        stages = {name: (many[name] - few[name]) / more for name in few if name in many}
        per_frame = (total(long, kind) - total(short, kind)) / more
        decode = (long["decode"][kind] - short["decode"][kind]) / more
        found[kind] = {
            "stages": stages,
            "fixed_stages": {n: few[n] - short["frames"] * each for n, each in stages.items()},
            "per_frame": per_frame,
            "fixed": total(short, kind) - short["frames"] * per_frame,
            "decode": decode,
            "ratio": per_frame / decode if decode > 0 else None,
        }
    return found


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float | None:
    """The least squares slope of ln cost over ln size; None where that cannot be told."""
    x, y = np.asarray(sizes, float), np.asarray(costs, float)
    if len(set(sizes)) < 2 or (y <= 0).any():
        return None
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def exponents(runs: Sequence[Figures], size: str, kind: str = "cpu_seconds") -> Figures:
    """Fitted exponents of each stage and of their sum. size : "frames" or "texels"."""
    sizes = [run[size] for run in runs]
    names = [stage["name"] for stage in runs[0]["stages"]]
    stages = {name: exponent(sizes, [by_stage(run, kind)[name] for run in runs]) for name in names}
    whole = exponent(sizes, [total(run, kind) for run in runs])
    return {"size": size, "sizes": sizes, "stages": stages, "whole": whole}


def roofline(run: Figures, machine: Mapping[str, float], pixels: int) -> list[Figures]:
    """What each stage moves at least and how long, per sample, against the machine's rates.

    The stage that projects reads every pixel after decoding and every texel's place and normal, and
    writes the sample; the others read the store once. Operations are not counted but bounded: what
    the machine could have done in the stage's CPU time.

    pixels : of a frame, before it is reduced
    """
    found = []
    count = run["samples"]
    for stage in run["stages"]:
        if stage["name"] in (TEXELS, VISIBILITY) or not count:
            continue
        moved = float(STORED)
        if stage["name"] == SAMPLES:
            read = 3 * pixels / run["reduce"] ** 2 + 24 * run["texels"]
            moved += run["frames_used"] * read / count
        cpu = stage["cpu_seconds"] / count
        found.append(
            {
                "name": stage["name"],
                "bytes": moved,
                "nanoseconds": 1e9 * cpu,
                "bandwidth_share": moved * count / stage["seconds"] / machine["copy_bytes"],
                "operations": cpu * machine["operations"] / machine["cores"],
            }
        )
    return found


def paper_row(run: Figures) -> Figures:
    """The columns of the paper's table: seconds of all before the diffuse colour, of the diffuse
    colour, and of all after it (the project's writing left out)."""
    stages = [s for s in run["stages"] if s["name"] != "save"]
    at = [s["name"] for s in stages].index("compute_svbrdf_diffuse_color")
    parts = {
        "environment": stages[:at],
        "diffuse": stages[at : at + 1],
        "specular": stages[at + 1 :],
    }
    return {
        "frames": run["frames"],
        "triangles": run["triangles"],
        "registration": run.get("registration"),
        **{name: sum(s["seconds"] for s in part) for name, part in parts.items()},
        "clusters": run["clusters"],
    }
