"""How near other methods come to a scene's truth, on the frames and texels of one of our results.

    pip install 'meshlab-svbrdf[benchmark]'
    meshlab-svbrdf run PROJECT -o OUT --texture-size 1024
    python -m benchmarks.peers PROJECT OUT/NAME.svbrdf [--peer NAME …] [--json FILE]

The truth is read from `ground_truth/` beside the project.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from meshlab_svbrdf.errors import SvbrdfError

from ..scenes.score import Scores
from .scores import MINUTES, PEERS, peer_scores

COLUMNS = (  # heading, figure, format
    ("ΔE mean", "dE_mean", "{:.2f}"),
    ("median", "dE_median", "{:.2f}"),
    ("95 %", "dE_p95", "{:.2f}"),
    ("coverage", "coverage", "{:.3f}"),
    ("dB", "psnr", "{:.1f}"),
    ("worst", "psnr_worst", "{:.1f}"),
    ("highlights", "psnr_highlights", "{:.1f}"),
    ("s", "seconds", "{:.0f}"),
)


def over_time(results: dict[str, Scores]) -> Iterator[str]:
    """What an inverse rendering had reached after how long."""
    for name, figures in results.items():
        for at in figures.get("over_time", ()):
            yield (
                f"{name}, {at['seconds']:.0f} s, {at['steps']} steps: ΔE {at['dE_mean']:.2f}, "
                f"{at['psnr']:.1f} dB, highlights {at['psnr_highlights']:.1f} dB"
            )


def table(results: dict[str, Scores]) -> Table:
    """One row a peer."""
    shown = Table(title="diffuse colour against the truth; dB over the held-out views")
    shown.add_column("peer")
    for heading, *_ in COLUMNS:
        shown.add_column(heading, justify="right")
    for name, figures in results.items():
        cells = (
            "–" if figures.get(key) is None else form.format(figures[key])
            for _, key, form in COLUMNS
        )
        shown.add_row(name, *cells)
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("project", type=Path, help="the scene's project")
    parser.add_argument("result", type=Path, help="NAME.svbrdf of a run on it")
    parser.add_argument("--truth", type=Path, help="default: ground_truth beside the project")
    parser.add_argument("--peer", action="append", choices=list(PEERS), metavar="NAME")
    parser.add_argument(
        "--minutes",
        type=float,
        default=MINUTES,
        help=f"of the inverse rendering, scoring not counted ({MINUTES:g}; 10 tells more)",
    )
    parser.add_argument("--out", type=Path, help="keep maps and views in this folder")
    parser.add_argument("--json", type=Path, help="write all figures")
    arguments = parser.parse_args()
    truth = arguments.truth or arguments.project.parent / "ground_truth"
    results: dict[str, Scores] = {}
    with tempfile.TemporaryDirectory() as temporary:
        work = arguments.out or Path(temporary)
        try:
            size = int(np.load(arguments.result / "arrays" / "texels_sizes.npy")[0, 0])
            for name in arguments.peer or PEERS:
                results |= peer_scores(
                    arguments.project, arguments.result, truth, size, work, [name],
                    arguments.minutes,
                )  # fmt: skip
                print(f"{name}: done", file=sys.stderr, flush=True)
                if arguments.json:
                    arguments.json.write_text(json.dumps(results, indent=1))
        except SvbrdfError as error:
            raise SystemExit(str(error)) from error
    Console(width=None if sys.stdout.isatty() else 120).print(table(results))
    for line in over_time(results):
        print(line)


if __name__ == "__main__":
    main()
