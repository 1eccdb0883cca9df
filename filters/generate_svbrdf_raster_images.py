"""Images of a video's frames, for MeshLab to show."""

from __future__ import annotations

import difflib
from collections import Counter
from pathlib import Path

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress

FILTER = Filter(
    name="generate_svbrdf_raster_images",
    title="SVBRDF: images of video frames",
    needs=("rasters",),
    writes=("raster_images",),
    parameters=(
        Parameter(
            "labels", "string", "",
            help='The rasters to extract, "walk_000012.jpg; walk_000120.jpg"; empty: all that are '
            "frames of videos.",
        ),
        Parameter(
            "step", "int", 1, minimum=1, maximum=100000,
            help="Of these, every n-th of each video.",
        ),
    ),
    help="Extracts frames of videos as the JPEGs that the rasters name, for MeshLab to show. "
    "The other filters read the video itself and need none. Images that an earlier run extracted, "
    "and that are not asked for again, are removed.",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    rasters = _wanted(document.project.rasters, parameters.labels)

    # Take every n-th of each video
    videos = Frames(rasters).videos
    seen: Counter[Path] = Counter()
    chosen = []
    for raster in rasters:
        video = videos[raster.path].video
        if seen[video] % parameters.step == 0:
            chosen.append(raster)
        seen[video] += 1

    with Frames(chosen) as frames:
        for raster in progress.over(chosen, "images"):
            document.set_frame_image(raster.path.name, frames.read(raster))
    return f"{len(chosen)} images, from {len(seen)} video{'s' if len(seen) > 1 else ''}"


def _wanted(rasters: list[RasterEntry], labels: str) -> list[RasterEntry]:
    """The rasters of those labels, or all, that are frames of videos."""
    videos = Frames(rasters).videos
    of_videos = {raster.label: raster for raster in rasters if raster.path in videos}
    if not of_videos:
        raise SvbrdfError("no raster is a frame of a video: their images are there already")
    wanted = [label.strip() for label in labels.split(";") if label.strip()]
    for label in wanted:
        if label not in of_videos:
            close = difflib.get_close_matches(label, of_videos, 1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise SvbrdfError(f"no frame of a video is labelled {label!r}{hint}")
    return [of_videos[label] for label in wanted] if wanted else list(of_videos.values())
