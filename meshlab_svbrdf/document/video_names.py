"""NAME.svbrdf/frames/videos.json: which frame of which video a raster's file name stands for.

A raster's Plane names `NAME.svbrdf/frames/VIDEO_000123.jpg`, a file that need not exist: MeshLab
keeps file names and drops all else. In the JSON videos are named relative to its folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import Any

from ..errors import DocumentError
from ..geometry.lens import Lens
from .record import write_json

FRAMES = "frames"  # the folder in NAME.svbrdf
VIDEOS = "videos.json"
FORMAT = 1


@dataclass(frozen=True)
class VideoFrame:
    """A frame of a video.

    index : its place in the order of presentation, from 0
    time : seconds, when it is shown; this finds it, whatever the frame rate
    lens : that it was filmed with, where it distorts: the frame is undistorted when it is read
    """

    video: Path
    index: int
    time: float
    lens: Lens | None = None


def is_frames_folder(folder: Path) -> bool:
    return folder.name == FRAMES and folder.parent.suffix == ".svbrdf"


def video_of(name: str) -> str:
    """What a frame's name says of its video: `walk` of walk_000123.jpg."""
    return Path(name).stem.rpartition("_")[0]


def name_frame(frame: VideoFrame, known: Mapping[str, VideoFrame]) -> str:
    """The frame's name beside those that are known: STEM-2 where another video has the STEM."""
    owner = {video_of(name): other.video for name, other in known.items()}
    stem, count = frame.video.stem, 1
    while owner.get(stem, frame.video) != frame.video:
        count += 1
        stem = f"{frame.video.stem}-{count}"
    return f"{stem}_{frame.index:06d}.jpg"


def read_videos(folder: Path) -> dict[str, VideoFrame]:
    """The frames of videos that names in `folder` stand for, {} where it is no such folder.

    Raises
    ------
    DocumentError : the JSON is damaged.
    """
    path = folder / VIDEOS
    if not is_frames_folder(folder) or not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise ValueError(f"format {content['format']}, this version reads {FORMAT}")
        found = {
            str(name): VideoFrame(
                Path(os.path.normpath(folder.resolve() / video["file"])),
                int(frame["index"]),
                float(frame["time"]),
                _lens(video.get("lens")),
            )
            for video in content["videos"]
            for name, frame in video["frames"].items()
        }
        if not all(isfinite(frame.time) for frame in found.values()):
            raise ValueError("a time that is no number")
        return found
    except (
        OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError,
    ) as error:  # fmt: skip
        raise DocumentError(
            f"{path}: does not tell which frames of which videos the rasters are "
            f"({error!r}); restore it, or add the videos again"
        ) from None


def write_videos(folder: Path, frames: Mapping[str, VideoFrame]) -> None:
    """Write the JSON whole or not at all; the folder is made."""
    folder.mkdir(parents=True, exist_ok=True)
    videos: dict[tuple[Path, Lens | None], dict[str, Any]] = {}
    for name, frame in frames.items():
        entry = videos.setdefault(
            (frame.video, frame.lens),
            {"file": relative(frame.video, folder.resolve()), "frames": {}}
            | ({"lens": asdict(frame.lens)} if frame.lens else {}),
        )
        entry["frames"][name] = {"index": frame.index, "time": frame.time}
    write_json(folder / VIDEOS, {"format": FORMAT, "videos": list(videos.values())})


def _lens(entry: dict[str, Any] | None) -> Lens | None:
    if entry is None:
        return None
    fx, fy, cx, cy = (float(entry[name]) for name in ("fx", "fy", "cx", "cy"))
    k1, k2, p1, p2, k3 = (float(value) for value in entry["coefficients"])
    size = int(entry["width"]), int(entry["height"])
    return Lens(*size, fx, fy, cx, cy, (k1, k2, p1, p2, k3))


def video_frames(paths: Iterable[Path]) -> dict[Path, VideoFrame]:
    """Those of the rasters' `paths` that stand for frames of videos."""
    found, known = {}, {}
    for path in paths:
        folder, name = path.parent, path.name
        if folder not in known:
            known[folder] = read_videos(folder)
        if name in known[folder]:
            found[path] = known[folder][name]
    return found


@lru_cache(1 << 14)
def relative(path: Path, folder: Path) -> str:
    """`path` as seen from `folder`, both absolute, with forward slashes."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive on Windows has no relative path
        return path.as_posix()
