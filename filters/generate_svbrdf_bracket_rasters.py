"""Exposures of one view made rasters of one camera, where one of them has a camera already."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.exposure import told_exposure
from meshlab_svbrdf.document.footage import open_images
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.registered import FORMAT, bracket_json
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress

from ._brackets import ALIKE

NAMED = 8  # views that the outcome names

FILTER = Filter(
    name="generate_svbrdf_bracket_rasters",
    title="SVBRDF: rasters of bracketed exposures",
    needs=("rasters",),
    writes=("brackets",),
    parameters=(
        Parameter(
            "images", "path", "",
            help="The folder of all exposures, in natural order (f2 before f10): one view's, then "
            "the next one's.",
        ),
        Parameter(
            "count", "int", 3, minimum=2, maximum=100, help="Exposures of a view.",
        ),
        Parameter(
            "exposures", "string", "",
            help='What they are, relative to each other, in their order: "1; 0.25; 0.0625". Empty: '
            "as the rasters have it, else the files' EXIF.",
        ),
    ),
    help="Every `count` images of a folder show one view. Where at least one of them is a raster "
    "of the project, all become rasters of that one's camera (the middle exposure's, if several "
    "are), with their exposures: compute_svbrdf_samples merges them. Views without a camera are "
    "named and left out.",
    reference="Debevec and Malik 1997",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    if parameters.images is None:
        raise SvbrdfError("give the exposures: images=FOLDER")
    clip = open_images(parameters.images)
    count = parameters.count
    if len(clip) % count:
        raise SvbrdfError(
            f"{clip.source}: holds {len(clip)} images, which are no views of {count} exposures "
            "each; give the number of exposures (count), or take away what is none"
        )
    given = _numbers(parameters.exposures, count)
    known = {raster.path: raster for raster in document.project.rasters}
    found: list[dict[str, Any]] = []
    without: list[str] = []
    for first in progress.over(range(0, len(clip), count), "exposures"):
        files = clip.files[first : first + count]
        rasters = [known.get(file) for file in files]
        if not any(rasters):
            without.append(files[0].name)
            continue
        exposures = given or _told(files, rasters)
        model = _model(rasters, exposures)
        if (model.camera.width, model.camera.height) != clip.size:
            raise SvbrdfError(
                f"raster {model.label!r} is of {model.camera.width}×{model.camera.height} pixels, "
                f"the images of {clip.source} have {clip.size[0]}×{clip.size[1]}"
            )
        found += [bracket_json(f, model, e) for f, e in zip(files, exposures, strict=True)]
    if not found:
        raise SvbrdfError(
            f"{clip.source}: none of its {len(clip)} images is a raster of the project, so no "
            "view has a camera: register one exposure of each view first"
        )
    document.set_rasters({"format": FORMAT, "clips": [], "brackets": found})
    said = f"{len(found) // count} views of {count} exposures"
    if without:
        named = ", ".join(without[:NAMED]) + (" …" if len(without) > NAMED else "")
        said += f"; left out, none of their exposures has a camera: {len(without)} views ({named})"
    return said


def _numbers(text: str, count: int) -> list[float]:
    """The exposures of every view as `exposures` gives them; none where it is empty."""
    words = text.replace(";", " ").replace(",", " ").split()
    if not words:
        return []
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    good = len(numbers) == count and np.isfinite(numbers).all() and min(numbers) > 0
    if not good or max(numbers) < ALIKE * min(numbers):
        raise SvbrdfError(
            f"parameter exposures is {text!r}, expected {count} numbers above 0 that differ: "
            '"1; 0.25; 0.0625"'
        )
    return numbers


def _told(files: list[Path], rasters: list[RasterEntry | None]) -> list[float]:
    """The exposures of one view as its rasters have them, else its files."""
    own = [None if raster is None else raster.exposure for raster in rasters]
    values = [told_exposure(file) for file in files] if None in own else own
    told = [value for value in values if value is not None]
    if len(told) < len(files):
        lacking = files[values.index(None)]
        raise SvbrdfError(
            f"{lacking}: tells no exposure (EXIF); give them, in the images' order: "
            'exposures="1; 0.25; 0.0625"'
        )
    if max(told) < ALIKE * min(told):
        raise SvbrdfError(
            f"{files[0]} to {files[-1].name}: have one exposure, and are no bracket; see to count "
            "and to the images' order"
        )
    return told


def _model(rasters: list[RasterEntry | None], exposures: list[float]) -> RasterEntry:
    """The raster whose camera counts: of those there are, the nearest to the middle exposure."""
    middle = np.sort(exposures)[(len(exposures) - 1) // 2]
    there = [(r, e) for r, e in zip(rasters, exposures, strict=True) if r is not None]
    return min(there, key=lambda shot: abs(np.log(shot[1] / middle)))[0]
