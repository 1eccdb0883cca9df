"""Frames beside what the result makes of them, as the paper's figures show it."""

from __future__ import annotations

import csv
import json
import re

import cv2
import numpy as np

from meshlab_svbrdf.document.atomic import replacing
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.products import plain
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.rendering.sheet import Panel, sheet

from ._comparison import FEW, Compared, chosen_frames, compare_frames
from ._views import BACKGROUND, REFLECTANCE, SUPERSAMPLING

SHEET_WIDTH = 480
"""Pixels of a panel on the sheet of all frames, at most."""

FILTER = Filter(
    name="generate_svbrdf_comparison",
    title="SVBRDF: compare with frames",
    needs=("mesh", "texels", "samples", "materials", "material_specular"),
    parameters=(
        Parameter(
            "frames", "rasters", "",
            help="Labels of rasters. Empty: the held-out frames; where there are none, a few of "
            "those that the result was made from, evenly spaced.",
        ),
        Parameter(
            "most", "int", 12, minimum=1, maximum=10000,
            help="Of the held-out frames, evenly spaced.",
        ),
        Parameter(
            "folder", "path", "",
            help="Where pictures and tables go: one picture per frame, comparison.png with the "
            "first ones, comparison.json and comparison.csv.",
        ),
        Parameter(
            "gain", "enum", "auto", choices=("auto", "fit", "none"),
            help='Fit a gain per channel to each frame, or not; "auto" does where the exposure '
            "of the frames differs.",
        ),
        SUPERSAMPLING,
        REFLECTANCE,
        BACKGROUND,
    ),
    help="Clusters, diffuse and specular part (normalised), rendering, the frame without what is "
    "around, and the error, side by side; PSNR and SSIM in sRGB over the object's pixels.",
    reference="Palma et al. 2012, figures of §8",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    folder = parameters.folder
    if folder is None:
        raise SvbrdfError("folder is empty: say where the pictures go")
    rasters, how = chosen_frames(document, parameters.frames, parameters.most)
    names = _file_names([raster.label for raster in rasters])
    folder.mkdir(parents=True, exist_ok=True)
    found = compare_frames(
        document, rasters, supersampling=parameters.supersampling, grey=parameters.background,
        gain=parameters.gain, phong=parameters.reflectance == "phong",
    )  # fmt: skip
    rows: list[Compared] = []
    shown: list[list[Panel]] = []
    for name, compared in progress.over(zip(names, found, strict=True), "frames", len(names)):
        write_png(folder / name, sheet([compared.panels]))
        rows.append(compared)
        if len(shown) < FEW:
            shown.append([small(panel) for panel in compared.panels])
    write_png(folder / "comparison.png", sheet(shown))
    return f"{_tables(document, rows, how, parameters)}; {how}"


def _tables(document: Document, rows: list[Compared], how: str, parameters: Namespace) -> str:
    """comparison.json and comparison.csv; the means, in words."""
    mean = {
        "psnr": float(np.mean([row.psnr for row in rows])),
        "ssim": float(np.mean([row.ssim for row in rows])),
    }
    told = {
        "format": 1,
        "project": document.path.name,
        "chosen": how,
        "frames": [row.row() for row in rows],
        "mean": mean | {"psnr": mean["psnr"] if np.isfinite(mean["psnr"]) else str(mean["psnr"])},
    }
    with replacing(parameters.folder / "comparison.json") as temporary:
        temporary.write_text(json.dumps(plain(told), indent=1), encoding="utf-8")
    with (
        replacing(parameters.folder / "comparison.csv") as temporary,
        open(temporary, "w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file)
        table.writerow(
            ("label", "held_out", "psnr", "ssim", "gain_r", "gain_g", "gain_b", "pixels")
        )
        for row in rows:
            table.writerow(
                (row.label, int(row.held_out), row.psnr, row.ssim, *row.gain.tolist(), row.pixels)
            )
    count = f"{len(rows)} frames" if len(rows) > 1 else "1 frame"
    return f"{count}: {mean['psnr']:.1f} dB, SSIM {mean['ssim']:.3f}"


def small(panel: Panel, width: int = SHEET_WIDTH) -> Panel:
    """The panel in at most so many columns."""
    scale = min(width / panel.image.shape[1], 1)
    size = (width, max(round(panel.image.shape[0] * scale), 1))
    if scale == 1:
        return panel
    return panel._replace(image=cv2.resize(panel.image, size, interpolation=cv2.INTER_AREA))


def _file_names(labels: list[str]) -> list[str]:
    """A PNG's name for each label, none twice."""
    names: list[str] = []
    for label in labels:
        stem = re.sub(r"[^\w.=+-]+", "_", re.sub(r"\.\w+$", "", label)) or "frame"
        name, k = f"{stem}.png", 1
        while name in (*names, "comparison.png"):
            k += 1
            name = f"{stem}_{k}.png"
        names.append(name)
    return names
