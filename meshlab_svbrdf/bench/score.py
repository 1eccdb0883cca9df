"""How near a run on the workload comes to its truth: the diffuse colour, and highlights unseen."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ..document.document import Document
from ..document.images import read_image
from ..document.project import read_project
from .workload import Workload

BRIGHTEST = 0.1  # of the object's pixels: where highlights are


def score(workload: Workload, result: Path) -> dict[str, float | None]:
    """dE : mean CIEDE2000 over the observed texels; highlights : root mean square, in codes of
    sRGB, over the brightest tenth of the object in views that no frame has.

    result : the project that a run wrote
    """
    document = Document.open(result)
    return {"dE": diffuse_error(workload, document), "highlights": _highlights(workload, document)}


def diffuse_error(workload: Workload, document: Document) -> float | None:
    """Mean CIEDE2000 between a result's D and the true one, over the texels that have one; None
    where there is none."""
    texels = document.texels()
    true, _ = workload.scene.truth(texels)
    got = document.map("diffuse")[0][texels.row, texels.col]
    known = np.isfinite(got).all(-1)
    if not known.any():
        return None
    return float(_delta_E(got[known], true[known]).mean())


def _highlights(workload: Workload, document: Document) -> float:
    squares = []
    views = read_project(workload.views())
    with tempfile.TemporaryDirectory(prefix="svbrdf-views-") as folder:
        document.apply("generate_svbrdf_rendering", cameras=views.path, folder=folder)
        for index, raster in enumerate(views.rasters):
            expected = read_image(raster.path).astype(np.float64)
            got = read_image(Path(folder) / f"view_{index:02d}.png")[..., :3].astype(np.float64)
            on = workload.scene.covers(raster.camera)
            bright = expected.mean(-1)
            bright[~on] = -1
            high = bright >= np.quantile(bright[on], 1 - BRIGHTEST)
            squares.append(((got - expected) ** 2)[high].mean())
    return float(np.sqrt(np.mean(squares)))


def _delta_E(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    import colour  # takes a second

    def lab(linear: np.ndarray) -> np.ndarray:
        return colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(linear, 0, 1), "sRGB"))

    return colour.delta_E(lab(one), lab(other))
