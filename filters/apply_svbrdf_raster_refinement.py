"""The project's own rasters, refined against the mesh; those not aligned yet are registered."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames, FramesInOrder
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.registered import FrameReport, clip_json
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.refine import refine_cameras
from meshlab_svbrdf.registration.results import Options, Registration
from meshlab_svbrdf.registration.track import register_frames

from ._registration import REPORT, stage, verdict

FILTER = Filter(
    name="apply_svbrdf_raster_refinement",
    title="SVBRDF: refine the rasters' cameras",
    needs=("mesh", "rasters"),
    writes=("refinement",),
    parameters=(
        Parameter(
            "refine_focal", "bool", False,
            help="Let the last adjustment of all cameras find the focal length too.",
        ),
        Parameter(
            "order", "enum", "auto", choices=("auto", "video", "stills"),
            help="video: neighbouring rasters show nearly the same. stills: photographs from "
            "anywhere. auto: rasters with an exposure in their EXIF are stills.",
        ),
        *REPORT,
    ),
    help="Refines the cameras of all rasters against the mesh. Rasters that are not aligned yet "
    "(MeshLab sets them at the world's origin) are registered from the aligned ones of their "
    "sequence. Rasters that cannot be relied on are named, and taken out of the project.",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    mesh = document.mesh()
    rasters = document.project.rasters
    sequences: dict[str, list[RasterEntry]] = {}
    for raster in rasters:
        sequences.setdefault(raster.sequence, []).append(raster)
    entries: list[dict] = []
    with Frames(rasters) as pixels:
        for nth, own in enumerate(sequences.values()):
            part = progress.part(0.9 * nth / len(sequences), 0.9 * (nth + 1) / len(sequences))
            frames = FramesInOrder(pixels, own)
            known = {k: r.camera for k, r in enumerate(own) if np.any(r.camera.center)}
            if not known:
                raise SvbrdfError(
                    f"no raster of sequence {own[0].sequence!r} is aligned: align one in MeshLab"
                )
            video = parameters.order == "video"
            if parameters.order == "auto":
                video = pixels.exposure(own[0]) is None
            options = Options(
                ordered=video, free_focal=parameters.refine_focal,
                cut=min(parameters.threshold, Options.cut),
            )  # fmt: skip
            core = refine_cameras if len(known) == len(own) else register_frames
            result = core(mesh.vertices, mesh.faces, frames, known, options, part)
            entries.append(clip_json(None, _reports(own, result, parameters)))
        readers = [FramesInOrder(pixels, own) for own in sequences.values()]
        return stage(
            document, entries, lambda c, k: readers[c][k], mesh, {}, progress.part(0.9, 1)
        )  # fmt: skip


def _reports(
    rasters: list[RasterEntry], result: Registration, parameters: Namespace
) -> list[FrameReport]:
    found = []
    for k, (raster, frame) in enumerate(zip(rasters, result.frames, strict=True)):
        used, reason = verdict(frame, parameters.threshold, parameters.bridged)
        found.append(
            FrameReport(
                raster.label, raster.path, k, float("nan"), used, frame.status, reason,
                frame.residual, frame.inliers, frame.confidence, frame.blur, frame.camera,
            )
        )  # fmt: skip
    return found
