"""How accurate both estimators are on scenes rendered by Mitsuba 3, which know the truth.

    pip install 'meshlab-svbrdf[benchmark]'
    python -m benchmarks.accuracy [--scene NAME …] [--only joint] [--cache FOLDER] [--json FILE]

Renders what is missing in the cache (1-2 minutes a scene), runs the chain with the true
segmentation unless told otherwise, renders views that the frames do not have, and prints one table.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from meshlab_svbrdf.document.mesh_files import read_mesh

from .scenes.catalogue import SCENES
from .scenes.ceiling import render_truth
from .scenes.make import cache_folder, ensure_scene
from .scenes.score import Scores, score, unseen_views

ESTIMATORS = ("joint", "paper")
COLUMNS = (  # of the table: heading, figure, format
    ("light °", "light_deg", "{:.2f}"),
    ("missed", "lights_missed", "{}"),
    ("false", "lights_false", "{}"),
    ("ln gain", "ln_gain_max", "{:.3f}"),
    ("ΔE mean", "dE_mean", "{:.2f}"),
    ("median", "dE_median", "{:.2f}"),
    ("95 %", "dE_p95", "{:.2f}"),
    ("ln ρs", "ln_rho_s_worst", "{:+.2f}"),
    ("ln α", "ln_alpha_worst", "{:+.2f}"),
    ("Rand", "adjusted_rand", "{:.2f}"),
    ("dB", "psnr", "{:.1f}"),
    ("highlights", "psnr_highlights", "{:.1f}"),
    ("inner", "psnr_inner", "{:.1f}"),
    ("SSIM", "ssim", "{:.3f}"),
    ("s", "seconds", "{:.0f}"),
)


def run(project: Path, estimator: str, out: Path, texture: int, segmentation: str) -> Scores:
    """Run the chain on a scene as a user would, render its held-out views, and score both."""
    truth = project.parent / "ground_truth"
    options = ["--estimator", estimator, "--texture-size", str(texture)]
    if segmentation == "true":
        options += ["--materials", str(truth / "material_id.png")]
    started = time.perf_counter()
    _shell("run", str(project), "-o", str(out), *options)
    seconds = time.perf_counter() - started
    result, rendered = out / project.name, out / "views"
    cameras = truth / "views" / "project.mlp"
    _shell("render", str(result), "--cameras", str(cameras), "-o", str(rendered))
    center = read_mesh(project.parent / "mesh.ply").mesh.center
    return score(result.with_suffix(".svbrdf"), truth, rendered, center) | {"seconds": seconds}


def ceiling(project: Path) -> Scores:
    """Figures of the held-out views rendered from the truth."""
    truth = project.parent / "ground_truth"
    with tempfile.TemporaryDirectory() as temporary:
        rendered = Path(temporary) / "views"
        render_truth(truth, rendered)
        return unseen_views(rendered, truth)


def _shell(*arguments: str) -> None:
    command = [sys.executable, "-m", "meshlab_svbrdf.cli", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def table(results: dict[str, dict[str, Scores]]) -> Table:
    shown = Table(title="worst ln ρs and ln α of all materials; dB over the held-out views")
    shown.add_column("scene")
    shown.add_column("estimator")
    for heading, *_ in COLUMNS:
        shown.add_column(heading, justify="right")
    for name, estimators in results.items():
        for estimator, figures in estimators.items():
            cells = [
                "–" if figures.get(key) is None else form.format(figures[key])
                for _, key, form in COLUMNS
            ]
            shown.add_row(name, estimator, *cells)
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", action="append", choices=list(SCENES), metavar="NAME")
    parser.add_argument("--only", choices=ESTIMATORS)
    parser.add_argument("--segmentation", choices=("true", "automatic"), default="true")
    parser.add_argument("--texture-size", type=int, default=512)
    parser.add_argument("--cache", type=Path, default=cache_folder())
    parser.add_argument("--out", type=Path, help="keep the results in this folder")
    parser.add_argument("--json", type=Path, help="write all figures")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Scores]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        for name in arguments.scene or SCENES:
            project = ensure_scene(SCENES[name], arguments.cache)
            phong = all(m.rho_s is not None for m in SCENES[name].materials)
            results[name] = {"truth": ceiling(project)} if phong else {}
            for estimator in [arguments.only] if arguments.only else ESTIMATORS:
                out = (arguments.out or Path(temporary)) / f"{name}.{estimator}"
                results[name][estimator] = run(
                    project, estimator, out, arguments.texture_size, arguments.segmentation
                )
                print(f"{name} {estimator}: done", file=sys.stderr, flush=True)
                if arguments.json:
                    arguments.json.write_text(json.dumps(results, indent=1))
    Console(width=None if sys.stdout.isatty() else 200).print(table(results))


if __name__ == "__main__":
    main()
