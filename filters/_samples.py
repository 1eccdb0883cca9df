"""Samples of the frames: projected, taken from an earlier run, or held in memory."""

from __future__ import annotations

import logging
from pathlib import Path

from meshlab_svbrdf import registry
from meshlab_svbrdf.document.atomic import named
from meshlab_svbrdf.document.document import Document, raster_digest
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.record import digest
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.filter import Namespace
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.samples.store import SampleStore, write_store

from ._frames import check_space, frame_sampler, read_reduced

SAMPLES = "compute_svbrdf_samples"

log = logging.getLogger("meshlab_svbrdf")


def project_frames(
    document: Document, mesh: Mesh, texels: Texels, rasters: list[RasterEntry],
    parameters: Namespace, reduce: int, folder: Path | None,
    progress=lambda done, total: None,
) -> SampleStore:  # fmt: skip
    """Project the frames to the texels, but for those that an earlier run has projected alike.

    folder : an empty one, staged; None: the samples stay in memory
    """
    cameras = [raster.camera.reduced(reduce) for raster in rasters]
    sampler = frame_sampler(mesh, texels, cameras, parameters, reduce)
    check_space(folder, sampler, cameras, parameters.memory << 20)

    def sample(index: int):
        image, mask = read_reduced(frames, rasters[index], reduce)
        return sampler.sample(cameras[index], image, mask)

    basis = [document.key("texels"), *vars(sampler.quality).values(), sampler.reference_depth]
    with Frames(rasters) as frames, named(folder or Path()):
        names = [digest([*basis, reduce, raster_digest([raster], frames)]) for raster in rasters]
        return write_store(
            folder, len(texels), len(rasters), sample, names=names,
            earlier=_readable(document.earlier("samples")) if folder else (),
            memory=parameters.memory << 20, progress=progress,
        )  # fmt: skip


def read_samples(document: Document, mesh: Mesh, rasters: list[RasterEntry]) -> SampleStore:
    """The samples of compute_svbrdf_samples; those that were not kept are projected again."""
    held = document.held("samples")
    if held is not None:
        return held
    run = document.results.record["runs"].get(SAMPLES, {}).get("parameters", {})
    if run.get("store", "disk") == "disk":
        return SampleStore.open(document.result_folder("samples"))
    log.warning("the samples were not kept (store=memory): the frames are projected again")
    store = project_frames(
        document, mesh, document.texels(), rasters, registry.get(SAMPLES).check(run),
        document.json("frames")["reduce"], None,
    )  # fmt: skip
    document.hold("samples", store)
    return store


def _readable(folders: list[Path]) -> list[SampleStore]:
    """The stores in these folders, but for those that cannot be read."""
    found = []
    for folder in folders:
        try:
            found.append(SampleStore.open(folder))
        except DocumentError:
            continue
    return found
