"""How a project's frames stand for light: 8-bit sRGB, or more."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.coding import Coding
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.samples.level import FLAT, brightest_diffuse, plateau, white_of
from meshlab_svbrdf.samples.store import SampleStore
from meshlab_svbrdf.samples.transfer import AUTO, ESTIMATE, SRGB

from ._brackets import Shots, measure_response
from ._samples import Deep


def how_frames_are_coded(
    mesh: Mesh, rasters: list[RasterEntry], brackets: dict[str, Shots], parameters: Namespace
) -> tuple[Deep | None, str]:
    """How frames are read, None where all are 8-bit sRGB, and what the outcome says of it, or "".

    rasters : all, those that are merged too
    """
    said = []
    views = [shots for shots in brackets.values() if len(shots) > 1]
    response = None
    if parameters.transfer == ESTIMATE:
        found = measure_response(mesh, views)
        response = found.light
        said.append(
            f"the camera's response is measured: exposures agree within {found.disagreement:.1%}"
        )
    transfer = AUTO if response is not None else parameters.transfer
    coding = Coding(transfer, parameters.clip, None, response)
    if response is None:
        if not views and are_plain(rasters, coding):
            return None, ""
        with Frames(rasters) as frames:
            names = Counter(coding.name(frames.told(raster)[0]) for raster in rasters)
        said.append(f"transfer: {', '.join(name for name, _ in names.most_common())}")
    if views:
        count = sum(len(shots) for shots in views)
        said.append(f"{count} exposures are merged to {len(views)} views")
    return Deep(coding, brackets), "; ".join([*said, "samples of 16 bits"])


def are_plain(rasters: list[RasterEntry], coding: Coding) -> bool:
    """Whether all frames are 8-bit sRGB, of which nothing more is known."""
    with Frames(rasters) as frames:
        told = [frames.told(raster) for raster in rasters]
    return not coding.clip and all(coding.name(name) == SRGB and not deep for name, deep in told)


def with_white(
    deep: Deep | None, store: SampleStore, exposure: np.ndarray, white: float
) -> tuple[Deep | None, float, list[str]]:
    """The same with the light that results call 1, as asked for or else by the samples; that light;
    and what is to be said of the frames' levels."""
    white = white or (1.0 if deep is None else _white(store, exposure))
    said = [f"results call a light of {white:g} 1 (white)"] if white != 1 else []
    if deep is None:
        return None, white, said
    share, top = plateau(store)
    if share > FLAT:
        said.append(
            f"{share:.1%} of the samples are as bright as the brightest, {top:g}, and not marked "
            f"as clipped: if the frames end there, say clip={top:g}"
        )
    return replace(deep, coding=replace(deep.coding, white=white)), white, said


def _white(store: SampleStore, exposure: np.ndarray) -> float:
    level = brightest_diffuse(store, exposure)
    if level == 0:
        raise SvbrdfError("the frames show the object black: look at them, and at transfer=")
    return white_of(level)
