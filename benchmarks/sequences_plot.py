"""The picture of number and size of frames against error. Needs matplotlib (extra [docs])."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .sequences import worst
from .tables import Row

PANELS = (  # title, figure of a row, whether its axis is logarithmic
    ("share of the surface with a colour", "coverage", False),
    ("diffuse colour: mean ΔE2000", "dE_mean", False),
    ("worst light: degrees", "light_deg_max", True),
    ("worst |ln ρs| (full), |ln α| (dashed)", "gloss", True),
    ("unseen views: dB", "psnr", False),
)
COLORS, MARKERS = ("#1f3a93", "#c0453b", "#2e8b57", "#d2691e"), ("o", "D", "^", "s")
LEAST = 1e-3  # of what is drawn on a logarithmic axis
NEAR = 1.3  # ratio of two numbers of frames whose labels would touch


def sequences_plot(rows: Sequence[Row], path: Path) -> None:
    """A row of panels a scene, the number of frames to the right, a line for each width and
    number of samples that a texel needs."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rows = [row for row in rows if "error" not in row]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure, grid = pyplot.subplots(
        len(scenes), len(PANELS), figsize=(15, 3 * len(scenes)), layout="constrained", squeeze=False
    )
    for scene, axes in zip(scenes, grid, strict=True):
        own = [row for row in rows if row["scene"] == scene]
        for axis, (title, key, logarithmic) in zip(axes, PANELS, strict=True):
            _panel(axis, own, key, logarithmic)
            axis.set_title(title, fontsize=9)
            axis.set_xscale("log", base=2)
            counts = sorted({row["frames"] for row in own})
            axis.set_xticks(counts, _apart(counts), fontsize=7)
            axis.minorticks_off()
            axis.grid(alpha=0.25)
        axes[0].set_ylabel(scene, fontsize=10)
        axes[0].legend(fontsize=7, title="pixels wide, samples a texel", title_fontsize=7)
    for axis in grid[-1]:
        axis.set_xlabel("frames", fontsize=8)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def _apart(counts: Sequence[int]) -> list[str]:
    """Ascending numbers as labels, but those that would touch the one before."""
    labels, last = [], 0.0
    for count in counts:
        labels.append(str(count) if count >= NEAR * last else "")
        last = count if labels[-1] else last
    return labels


def _panel(axis, rows: Sequence[Row], key: str, logarithmic: bool) -> None:
    kinds = sorted({(-row["width"], -row["least"]) for row in rows})
    for kind, color, marker in zip(kinds, COLORS, MARKERS, strict=False):
        own = [row for row in rows if (-row["width"], -row["least"]) == kind]
        own.sort(key=lambda row: row["frames"])
        for name, style in (("rho_s", "-"), ("alpha", "--")) if key == "gloss" else ((key, "-"),):
            values = [worst(row, name) if key == "gloss" else row.get(key) for row in own]
            shown = np.array([np.nan if value is None else float(value) for value in values])
            if logarithmic:
                shown = np.maximum(np.abs(shown), LEAST)
            frames = [row["frames"] for row in own]
            label = f"{-kind[0]}, {-kind[1]}" if style == "-" else None
            axis.plot(frames, shown, style, color=color, marker=marker, markersize=4, label=label)
    if logarithmic:
        axis.set_yscale("log")
