"""The picture of run time against error. Needs matplotlib (extra [docs])."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .tables import Row
from .timing import ENVIRONMENT, FRAMES, PAPER, PEER, PRESET, SHADOW, TEXELS, front

PANELS = (  # figure, sign (1: less is better), label
    ("dE_mean", 1, "diffuse colour: mean ΔE2000 (less is better)"),
    ("psnr_highlights", -1, "highlights of unseen views: dB (more is better)"),
)
STYLES = {
    PRESET: ("#1f3a93", "o", "presets"),
    FRAMES: ("#2e8b57", "^", "fewer frames"),
    TEXELS: ("#d2691e", "s", "texture size"),
    ENVIRONMENT: ("#8e44ad", "D", "environment size"),
    SHADOW: ("#7f8c8d", "v", "visibility"),
    PAPER: ("#c0392b", "X", "paper"),
    PEER: ("#000000", "P", "peers"),
}


def time_plot(rows: Sequence[Row], path: Path) -> None:
    """Two panels, time to the right; the front of what no faster run equals is a line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    figure, axes = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for axis, (key, sign, label) in zip(axes, PANELS, strict=True):
        shown = [row for row in rows if row.get(key) is not None and "seconds" in row]
        by_name = {row["name"]: row for row in shown}
        line = [(by_name[name]["seconds"], by_name[name][key]) for name in front(shown, key, sign)]
        axis.step(*zip(*line, strict=True), where="post", color="#1f3a93", alpha=0.35, linewidth=5)
        for group, (color, marker, words) in STYLES.items():
            own = [(row["seconds"], row[key]) for row in shown if row["group"] == group]
            if own:
                size = 80 if group == PRESET else 36
                axis.scatter(
                    *zip(*own, strict=True), s=size, c=color, marker=marker, label=words, zorder=3
                )
        slow = [(row["seconds"], row[key]) for row in shown if "over_time" in row]
        if slow:
            axis.plot(*zip(*slow, strict=True), color=STYLES[PEER][0], linewidth=1, alpha=0.5)
        named = sorted(
            (row for row in shown if row["group"] in (PRESET, PEER, PAPER)),
            key=lambda row: row["seconds"],
        )
        for k, row in enumerate(named):  # neighbours are named above and below
            axis.annotate(
                row["name"], (row["seconds"], row[key]), (6, -12 if k % 2 else 6), fontsize=9,
                textcoords="offset points", weight="bold" if row["group"] == PRESET else "normal",
            )  # fmt: skip
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("seconds")
        axis.set_title(label, fontsize=10)
        axis.grid(alpha=0.25, which="both")
        axis.margins(x=0.12, y=0.09)
    axes[0].legend(fontsize=8, loc="best")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
