"""Rasters that are frames of videos: added to a project, and kept when its results move.

add_video      rasters and their names in FOLDER/frames/videos.json
follow_folder  when results were copied elsewhere
bring_videos   when a project got results of its own
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..errors import DocumentError
from ..geometry.camera import Camera
from ..geometry.lens import Lens
from .layers import moved
from .project import Project, RasterEntry
from .project_entries import absolute, folder_name
from .video_file import frame_times
from .video_names import (
    FRAMES,
    VideoFrame,
    is_frames_folder,
    name_frame,
    read_videos,
    video_frames,
    write_videos,
)


def add_video(
    project: Project,
    folder: Path,
    path: Path,
    cameras: Mapping[int, Camera],
    exposure: float | None = None,
    lens: Lens | None = None,
) -> list[RasterEntry]:
    """Add frames of a video, in their order; all of them or none (`Document.add_video`).

    folder : of the results, NAME.svbrdf
    cameras : by the frame's index; of the undistorted frames, where there is a `lens`
    """
    video, frames = absolute(path), folder / FRAMES
    times = frame_times(video)
    wrong = [index for index in cameras if not 0 <= index < len(times)]
    if wrong or not cameras:
        raise DocumentError(
            f"{path}: has the frames 0 to {len(times) - 1}, "
            f"cameras were given for {wrong[:5] or 'none'}"
        )
    known = read_videos(frames)
    taken = {raster.label for raster in project.rasters}
    new: dict[str, VideoFrame] = {}
    for index in sorted(cameras):
        frame = VideoFrame(video, int(index), float(times[index]), lens)
        name = name_frame(frame, known)
        if name in taken:
            raise DocumentError(f"{path}: a raster {name!r} exists already; remove it first")
        new[name] = frame
    write_videos(frames, known | new)
    return [
        project.add_raster(name, frames / name, cameras[frame.index], exposure=exposure)
        for name, frame in new.items()
    ]


def follow_folder(rasters: list[RasterEntry], old: Path, new: Path) -> None:
    """Let frames of videos, and masks beside them, follow a result folder that was copied."""
    if old == new:
        return
    frames = read_videos(old / FRAMES)
    if frames:
        write_videos(new / FRAMES, frames)
    old, new = absolute(old), absolute(new)
    for raster in rasters:
        raster.path = moved(raster.path, old, new)
        raster.mask = None if raster.mask is None else moved(raster.mask, old, new)


def bring_videos(rasters: list[RasterEntry], folder: Path) -> None:
    """Let rasters whose names lie among another project's results have them in `folder`."""
    there = absolute(folder) / FRAMES
    foreign = [r for r in rasters if is_frames_folder(r.path.parent) and r.path.parent != there]
    frames = video_frames(raster.path for raster in foreign)
    if not frames:
        return
    known = read_videos(there)
    for raster in foreign:
        frame = frames.get(raster.path)
        if frame is None:
            continue
        path = there / name_frame(frame, known)
        known[path.name] = frame
        if raster.sequence == folder_name(raster.path, None):
            raster.sequence = folder_name(path, None)
        raster.path = path
    write_videos(there, known)
