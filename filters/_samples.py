"""Samples of the frames: projected, taken from an earlier run, or held in memory."""

from __future__ import annotations

import logging
import secrets
import shutil
from dataclasses import dataclass
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
from meshlab_svbrdf.samples.capture import FrameSampler
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.store import SampleStore, runs_known, write_store
from meshlab_svbrdf.spread import Spread

from ._frames import check_space, frame_sampler, read_reduced

SAMPLES = "compute_svbrdf_samples"
PARTS = "part-*"
"""Stores of some frames within one that is being made, each by a worker."""
TASKS = 12
"""Into which the frames are parted for workers, but"""
LEAST, MOST = 16, 64
"""frames of each, lest offsets take more room than samples, or a worker's death cost much."""
UNREADABLE = (OSError, ValueError, KeyError, TypeError)  # of a store that is cut off or damaged

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
        return _sample(sampler, frames, rasters[index], reduce)

    memory = parameters.memory << 20
    basis = [document.key("texels"), *vars(sampler.quality).values(), sampler.reference_depth]
    with Frames(rasters) as frames, named(folder or Path()):
        names = [digest([*basis, reduce, raster_digest([raster], frames)]) for raster in rasters]
        earlier = _readable(document.earlier("samples")) if folder else []
        if folder is not None and document.spread is not None:
            work = Projecting(sampler, rasters, reduce, names, memory, folder)
            earlier += _elsewhere(document.spread, work, earlier, progress)
        store = write_store(
            folder, len(texels), len(rasters), sample, names=names, earlier=earlier,
            memory=memory, progress=progress,
        )  # fmt: skip
        for part in folder.glob(PARTS) if folder else ():
            shutil.rmtree(part)
        return store


@dataclass(frozen=True)
class Projecting:
    """Projects the frames first..stop on a worker: a store of these alone, PARTS in `folder`."""

    sampler: FrameSampler
    rasters: list[RasterEntry]
    reduce: int
    names: list[str]
    memory: int
    folder: Path

    def __call__(self, run: tuple[int, int]) -> Path:
        first, stop = run
        part = self.folder / PARTS.replace("*", secrets.token_hex(8))
        with named(part), Frames(self.rasters[first:stop]) as frames:
            part.mkdir()

            def sample(index: int):
                return _sample(self.sampler, frames, self.rasters[first + index], self.reduce)

            write_store(
                part, len(self.sampler.texels), stop - first, sample,
                names=self.names[first:stop], memory=self.memory,
            )  # fmt: skip
        return part


def _elsewhere(
    spread: Spread, work: Projecting, earlier: list[SampleStore], progress
) -> list[SampleStore]:  # fmt: skip
    """Stores, made by workers, of the frames that no earlier store has."""
    lacking = [
        (first, stop)
        for first, stop, found in runs_known(work.names, len(work.sampler.texels), earlier)
        if found is None
    ]
    size = min(max(sum(stop - first for first, stop in lacking) // TASKS, LEAST), MOST)
    runs = [
        (at, min(at + size, stop)) for first, stop in lacking for at in range(first, stop, size)
    ]
    made = []
    for (_, stop), part in zip(runs, spread(work, runs), strict=True):
        made.append(SampleStore.open(part))
        progress(stop, len(work.rasters))
    return made


def _sample(
    sampler: FrameSampler, frames: Frames, raster: RasterEntry, reduce: int
) -> SampledFrame:  # fmt: skip
    image, mask = read_reduced(frames, raster, reduce)
    return sampler.sample(raster.camera.reduced(reduce), image, mask)


def read_samples(document: Document, mesh: Mesh, rasters: list[RasterEntry]) -> SampleStore:
    """The samples of compute_svbrdf_samples; those that were not kept are projected again."""
    held = document.held("samples")
    if held is not None:
        return held
    run = document.results.record["runs"].get(SAMPLES, {}).get("parameters", {})
    if run.get("store", "disk") == "disk":
        folder = document.result_folder("samples")
        try:
            store = SampleStore.open(folder)
            store.spread = document.spread
            return store
        except UNREADABLE as error:
            raise DocumentError(
                f"{folder}: the samples are damaged ({error}): run {SAMPLES} again with --force"
            ) from None
    log.warning("the samples were not kept (store=memory): the frames are projected again")
    store = project_frames(
        document, mesh, document.texels(), rasters, registry.get(SAMPLES).check(run),
        document.json("frames")["reduce"], None,
    )  # fmt: skip
    document.hold("samples", store)
    return store


def _readable(folders: list[Path]) -> list[SampleStore]:
    """The stores in these folders, and parts of some, but for those that cannot be read."""
    found = []
    for folder in [each for own in folders for each in (own, *sorted(own.glob(PARTS)))]:
        try:
            found.append(SampleStore.open(folder))
        except UNREADABLE:
            continue
    return found
