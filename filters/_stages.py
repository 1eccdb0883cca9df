"""What several filters read in the same way."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.geometry.surface_shape import steepest_turn, surface_shape
from meshlab_svbrdf.geometry.visibility import Rays
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.reflectance.threshold import LuminanceStatistics
from meshlab_svbrdf.samples.observations import Observations, observe

from ._samples import read_samples

UNOBSERVED_GREY = 118  # sRGB code of the texture where nothing was observed


class _Surface(NamedTuple):
    """What is held of the texels' surface: its shape, how fast its normals turn, its rays."""

    shape: np.ndarray
    turn: np.ndarray
    rays: Rays


def read_observations(document: Document, *, visibility: bool = True) -> Observations:
    """The samples with their frames' cameras and gains, and the visibility."""
    mesh, told = document.mesh(), document.json("frames")
    rasters = {raster.label: raster for raster in document.rasters}
    used = [rasters[frame["label"]] for frame in told["frames"] if "samples" in frame]
    coefficients = document.array("visibility") if visibility else np.zeros((0, 36), np.float32)
    return observe(
        document.texels(),
        read_samples(document, mesh, used),
        [raster.camera.reduced(told.get("reduce", 1)) for raster in used],
        mesh.faces,
        gains=document.array("samples_gain"),
        coefficients=coefficients if len(coefficients) else None,
        sequence=document.array("samples_sequence"),
        order=document.array("samples_order"),
    )


def read_curved_observations(
    document: Document,
    *,
    rays: bool = False,
    adjacency: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Observations, np.ndarray]:
    """The samples with the surface's shape, and how fast the normals turn (T,), radians per radius:
    what a joint fit takes.

    rays : also with the mesh to shoot shadow rays at; adjacency : of the texels, where it is known
    """
    observations = read_observations(document)
    texels, surface = observations.texels, document.held("texels")
    if surface is None:
        shape = surface_shape(texels.position, texels.normal, adjacency)
        turn = steepest_turn(shape)
        turn *= texels.radius
        surface = _Surface(shape, turn, Rays(document.mesh()))
        document.hold("texels", surface)
    held = surface.rays if rays else None
    return replace(observations, shape=surface.shape, rays=held), surface.turn


def read_statistics(document: Document) -> LuminanceStatistics:
    """What compute_svbrdf_luminance_threshold left."""
    return LuminanceStatistics(
        document.attribute("threshold"),
        document.attribute("mean"),
        document.attribute("minimum"),
        document.attribute("mean_color"),
        document.attribute("samples"),
    )


def read_lights_found(document: Document) -> list[Light]:
    """What compute_svbrdf_light_sources found, before any refinement."""
    return [
        Light(np.array(entry["direction"]), np.array(entry["covariance"]), energy=entry["energy"])
        for entry in document.json("lights_found")["lights"]
    ]


def counted(progress: Progress, message: str):
    """A core function's progress(done, total) on ours."""
    return lambda done, total: progress(done / max(total, 1), message)


def share(values: np.ndarray) -> str:
    """The share of True, in words: 98.3 %."""
    return f"{100 * float(np.mean(values)) if len(values) else 0.0:.1f} %"
