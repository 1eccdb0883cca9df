"""Samples of the frames: projected, taken from an earlier run, or held in memory."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

from meshlab_svbrdf import registry
from meshlab_svbrdf.document.atomic import named
from meshlab_svbrdf.document.coding import Coding
from meshlab_svbrdf.document.document import Document, raster_digest
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.record import digest
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.filter import Namespace
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.samples.radiance_code import clipped_code, encode_radiance
from meshlab_svbrdf.samples.store import SampleStore, write_store

from ._brackets import Shots, read_view
from ._frames import check_space, frame_sampler, read_reduced

SAMPLES = "compute_svbrdf_samples"
UNREADABLE = (OSError, ValueError, KeyError, TypeError)  # of a store that is cut off or damaged

log = logging.getLogger("meshlab_svbrdf")


@dataclass(frozen=True)
class Deep:
    """How frames of more than 8-bit sRGB are read.

    brackets : by label of the raster that stands for a view, all that are merged to it
    """

    coding: Coding
    brackets: dict[str, Shots]


def read_deep(document: Document) -> Deep | None:
    """What compute_svbrdf_samples wrote of it; None where all frames are 8-bit sRGB."""
    told = document.json("frames")
    coding = Coding.told(told)
    if coding is None:
        return None
    rasters = {raster.label: raster for raster in document.project.rasters}
    brackets = {
        frame["label"]: [(rasters[label], exposure) for label, exposure in frame["merged"]]
        for frame in told["frames"]
        if frame.get("merged")
    }
    return Deep(coding, brackets)


def shots_of(deep: Deep | None, raster: RasterEntry) -> Shots:
    """The rasters that make the view that a raster stands for."""
    own: Shots = [(raster, 1.0)]
    return own if deep is None else deep.brackets.get(raster.label, own)


def project_frames(
    document: Document, mesh: Mesh, texels: Texels, rasters: list[RasterEntry],
    parameters: Namespace, reduce: int, folder: Path | None, deep: Deep | None = None,
    progress=lambda done, total: None,
) -> SampleStore:  # fmt: skip
    """Project the frames to the texels, but for those that an earlier run has projected alike.

    folder : an empty one, staged; None: the samples stay in memory
    deep : how frames that are not all 8-bit sRGB are read; None: they are
    """
    cameras = [raster.camera.reduced(reduce) for raster in rasters]
    sampler = frame_sampler(mesh, texels, cameras, parameters, reduce)
    bits = 8 if deep is None else 16
    check_space(folder, sampler, cameras, parameters.memory << 20, bits)
    views = [shots_of(deep, raster) for raster in rasters]
    every = [raster for shots in views for raster, _ in shots]

    def sample(index: int):
        if deep is None:
            image, mask = read_reduced(frames, rasters[index], reduce)
            return sampler.sample(cameras[index], image, mask)
        light, mask = read_view(frames, views[index], reduce)
        codes, clipped = encode_radiance(light.radiance), clipped_code(light.clipped)
        return sampler.sample(cameras[index], codes, mask, clipped)

    basis = [document.key("texels"), *vars(sampler.quality).values(), sampler.reference_depth]
    if deep is not None:
        basis.append(replace(deep.coding, white=None).to_json())
    with Frames(every, deep and deep.coding) as frames, named(folder or Path()):

        def name(shots: Shots) -> str:
            seen = raster_digest([raster for raster, _ in shots], frames)
            exposures = [exposure for _, exposure in shots] if len(shots) > 1 else []
            return digest([*basis, reduce, seen, *exposures])

        return write_store(
            folder, len(texels), len(rasters), sample, names=[name(shots) for shots in views],
            earlier=_readable(document.earlier("samples")) if folder else (),
            memory=parameters.memory << 20, bits=bits, progress=progress,
        )  # fmt: skip


def read_samples(document: Document, mesh: Mesh, rasters: list[RasterEntry]) -> SampleStore:
    """The samples of compute_svbrdf_samples; those that were not kept are projected again."""
    held = document.held("samples")
    if held is not None:
        return held
    run = document.results.record["runs"].get(SAMPLES, {}).get("parameters", {})
    if run.get("store", "disk") == "disk":
        folder = document.result_folder("samples")
        try:
            return SampleStore.open(folder)
        except UNREADABLE as error:
            raise DocumentError(
                f"{folder}: the samples are damaged ({error}): run {SAMPLES} again with --force"
            ) from None
    log.warning("the samples were not kept (store=memory): the frames are projected again")
    store = project_frames(
        document, mesh, document.texels(), rasters, registry.get(SAMPLES).check(run),
        document.json("frames")["reduce"], None, read_deep(document),
    )  # fmt: skip
    document.hold("samples", store)
    return store


def _readable(folders: list[Path]) -> list[SampleStore]:
    """The stores in these folders, but for those that cannot be read."""
    found = []
    for folder in folders:
        try:
            found.append(SampleStore.open(folder))
        except UNREADABLE:
            continue
    return found
