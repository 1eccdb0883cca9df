"""Samples of the frames: projected, taken from an earlier run, or held in memory."""

from __future__ import annotations

import logging
import secrets
import shutil
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
from meshlab_svbrdf.samples.capture import FrameSampler
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.radiance_code import clipped_code, encode_radiance
from meshlab_svbrdf.samples.store import SampleStore, runs_known, write_store
from meshlab_svbrdf.spread import Spread

from ._brackets import Shots, read_view
from ._frames import check_space, frame_sampler, read_reduced

SAMPLES = "compute_svbrdf_samples"
PARTS = "part-*"
"""Stores of some frames within one that is being made, each by a worker."""
TASKS = 12
"""Into which the frames are parted for workers, but"""
LEAST, MOST = 16, 64
"""frames of each, lest offsets take more room than samples, or a worker's death cost much."""

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


def bits_of(deep: Deep | None) -> int:
    """Of the samples' values."""
    return 8 if deep is None else 16


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
    bits = bits_of(deep)
    check_space(folder, sampler, cameras, parameters.memory << 20, bits)
    views = [shots_of(deep, raster) for raster in rasters]
    every = [raster for shots in views for raster, _ in shots]

    def sample(index: int):
        return _sample(sampler, frames, rasters[index], views[index], reduce, deep)

    memory = parameters.memory << 20
    basis = [document.key("texels"), *vars(sampler.quality).values(), sampler.reference_depth]
    if deep is not None:
        basis.append(replace(deep.coding, white=None).to_json())
    with Frames(every, deep.coding if deep else None) as frames, named(folder or Path()):

        def name(shots: Shots) -> str:
            seen = raster_digest([raster for raster, _ in shots], frames)
            exposures = [exposure for _, exposure in shots] if len(shots) > 1 else []
            return digest([*basis, reduce, seen, *exposures])

        names = [name(shots) for shots in views]
        earlier = _readable(document.earlier("samples")) if folder else []
        if folder is not None and document.spread is not None:
            work = Projecting(sampler, rasters, views, reduce, deep, names, memory, folder)
            earlier += _elsewhere(document.spread, work, earlier, progress)
        store = write_store(
            folder, len(texels), len(rasters), sample, names=names, earlier=earlier,
            memory=memory, bits=bits, progress=progress,
        )  # fmt: skip
        for part in folder.glob(PARTS) if folder else ():
            shutil.rmtree(part)
        return store


@dataclass(frozen=True)
class Projecting:
    """Projects the frames first..stop on a worker: a store of these alone, PARTS in `folder`."""

    sampler: FrameSampler
    rasters: list[RasterEntry]
    views: list[Shots]
    reduce: int
    deep: Deep | None
    names: list[str]
    memory: int
    folder: Path

    def __call__(self, run: tuple[int, int]) -> Path:
        first, stop = run
        part = self.folder / PARTS.replace("*", secrets.token_hex(8))
        every = [raster for shots in self.views[first:stop] for raster, _ in shots]
        with named(part), Frames(every, self.deep.coding if self.deep else None) as frames:
            part.mkdir()

            def sample(index: int):
                own = first + index
                return _sample(
                    self.sampler, frames, self.rasters[own], self.views[own], self.reduce, self.deep
                )

            write_store(
                part, len(self.sampler.texels), stop - first, sample,
                names=self.names[first:stop], memory=self.memory, bits=bits_of(self.deep),
            )  # fmt: skip
        return part


def _elsewhere(
    spread: Spread, work: Projecting, earlier: list[SampleStore], progress
) -> list[SampleStore]:  # fmt: skip
    """Stores, made by workers, of the frames that no earlier store has.

    Where it is interrupted, `folder` is kept for the next run as one that holds a store.
    """
    SampleStore(len(work.sampler.texels), [], names=[], seen=[], quality=[]).describe(work.folder)
    lacking = [
        (first, stop)
        for first, stop, found in runs_known(
            work.names, len(work.sampler.texels), bits_of(work.deep), earlier
        )
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
    sampler: FrameSampler, frames: Frames, raster: RasterEntry, shots: Shots, reduce: int,
    deep: Deep | None,
) -> SampledFrame:  # fmt: skip
    camera = raster.camera.reduced(reduce)
    if deep is None:
        image, mask = read_reduced(frames, raster, reduce)
        return sampler.sample(camera, image, mask)
    light, mask = read_view(frames, shots, reduce)
    codes, clipped = encode_radiance(light.radiance), clipped_code(light.clipped)
    return sampler.sample(camera, codes, mask, clipped)


def read_samples(document: Document, mesh: Mesh, rasters: list[RasterEntry]) -> SampleStore:
    """The samples of compute_svbrdf_samples; those that were not kept are projected again."""
    held = document.held("samples")
    if held is not None:
        return held
    run = document.results.record["runs"].get(SAMPLES, {}).get("parameters", {})
    if run.get("store", "disk") == "disk":
        store = SampleStore.open(document.result_folder("samples"))
        store.spread = document.spread
        return store
    log.warning("the samples were not kept (store=memory): the frames are projected again")
    store = project_frames(
        document, mesh, document.texels(), rasters, registry.get(SAMPLES).check(run),
        document.json("frames")["reduce"], None, read_deep(document),
    )  # fmt: skip
    document.hold("samples", store)
    return store


def _readable(folders: list[Path]) -> list[SampleStore]:
    """The stores in these folders, and parts of some, but for those that cannot be read."""
    found = []
    for folder in [each for own in folders for each in (own, *sorted(own.glob(PARTS)))]:
        try:
            found.append(SampleStore.open(folder))
        except DocumentError:
            continue
    return found
