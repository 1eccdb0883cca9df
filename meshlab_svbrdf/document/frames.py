"""The frames of a project, wherever they lie: image files, and videos that are never extracted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any

import numpy as np

from ..errors import DocumentError
from .coding import Coding, Light
from .deep_images import as_seen, kind_of, read_seen, read_values
from .exposure import told_exposure
from .images import check_size, frame_problem, reduced
from .project import RasterEntry
from .video import VideoReader
from .video_file import coding_of, video_problem
from .video_names import VIDEOS, VideoFrame, is_frames_folder, video_frames


class Frames:
    """Pixels and files of rasters; close it, or use it in `with`, for videos stay open.

    A frame of a video is read from the video, also where its image was extracted for MeshLab. It is
    decoded once if the frames are read once, roughly in the rasters' order; any number of threads
    may read.

    rasters : those that will be asked for
    coding : how their numbers stand for light, where that is known; None: their files tell
    """

    def __init__(self, rasters: Iterable[RasterEntry], coding: Coding | None = None) -> None:
        self.coding = coding or Coding()
        self.videos = video_frames(raster.path for raster in rasters)
        self._readers: dict[Path, VideoReader] = {}
        self._lock = Lock()
        self._video_problem = cache(video_problem)
        self._video_coding = cache(coding_of)

    def read(self, raster: RasterEntry, reduce: int = 1) -> np.ndarray:
        """The frame, (H, W, 3) uint8, sRGB; `reduce`d, the means of so many pixels each way.

        Of more than 8 bits it is what people would see; `light` tells all.

        Raises
        ------
        DocumentError : image or video is missing or damaged, or not of the camera's size.
        """
        if self.coding.known:
            return reduced(as_seen(self.light(raster).radiance, self.coding.white), reduce)
        frame = self.videos.get(raster.path)
        if frame is None:
            size = (raster.camera.width, raster.camera.height)
            return read_seen(raster.path, label=raster.label, size=size, reduce=reduce)
        return reduced(self._shown(raster, frame, False), reduce)

    def light(self, raster: RasterEntry, reduce: int = 1) -> Light:
        """The frame as linear light, and from where on it is clipped; `reduce`d, means of it.

        Raises DocumentError as `read`, and where its floats are no light.
        """
        frame = self.videos.get(raster.path)
        if frame is None:
            size = (raster.camera.width, raster.camera.height)
            values = read_values(raster.path, label=raster.label, size=size)
            return self.coding.light(values, reduce)
        told = self._video_coding(frame.video)
        values = self._shown(raster, frame, told.deep)
        return self.coding.light(values, reduce, told.transfer, told.wide_gamut)

    def told(self, raster: RasterEntry) -> tuple[str, bool]:
        """The transfer function that the frame's own file tells, and whether it has more than 8
        bits; nothing is decoded."""
        frame = self.videos.get(raster.path)
        if frame is not None:
            coding = self._video_coding(frame.video)
            return coding.transfer, coding.deep
        kind = kind_of(raster.path)
        return "linear" if kind == "float" else "srgb", kind != "8"

    def _shown(self, raster: RasterEntry, frame: VideoFrame, deep: bool) -> np.ndarray:
        """A video's frame as it is coded, undistorted."""
        where = f"raster {raster.label!r}"
        try:
            image = self._reader(frame.video).read(frame.time, deep)
        except DocumentError as error:
            raise DocumentError(f"{where}: {error}") from None
        size = (raster.camera.width, raster.camera.height)
        check_size(image, size, f"{where}: {frame.video}")
        return image if frame.lens is None else frame.lens.undistort(image)

    def problem(self, raster: RasterEntry) -> str:
        """What a glance at its file tells against a frame, the file named; "" for nothing."""
        frame = self.videos.get(raster.path)
        if frame is not None:
            return self._video_problem(frame.video)
        found = frame_problem(raster.path)
        if found and is_frames_folder(raster.path.parent):
            found += f", and {VIDEOS} beside it does not say which frame of a video it is"
        return f"{raster.path} {found}" if found else ""

    def exposure(self, raster: RasterEntry, *, asked: bool = False) -> float | None:
        """What a photograph's file tells (`told_exposure`); None for videos."""
        return None if raster.path in self.videos else told_exposure(raster.path, asked=asked)

    def file(self, raster: RasterEntry) -> Path:
        """The file that holds the frame: an image or a video."""
        frame = self.videos.get(raster.path)
        return raster.path if frame is None else frame.video

    def stamp(self, raster: RasterEntry) -> list[Any]:
        """What tells whether the frame is the one that results were made from."""
        frame = self.videos.get(raster.path)
        if frame is None:
            return file_stamp(raster.path)
        lens = [] if frame.lens is None else [asdict(frame.lens)]
        return [raster.path.name, frame.time, *lens, *file_stamp(frame.video)]

    def close(self) -> None:
        for reader in self._readers.values():
            reader.close()
        self._readers.clear()

    def __enter__(self) -> Frames:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _reader(self, video: Path) -> VideoReader:
        with self._lock:
            if video not in self._readers:
                times = (frame.time for frame in self.videos.values() if frame.video == video)
                self._readers[video] = VideoReader(video, times)
            return self._readers[video]


class FramesInOrder:
    """The pixels of rasters by their place."""

    def __init__(self, pixels: Frames, rasters: Sequence[RasterEntry]) -> None:
        self.pixels, self.rasters = pixels, rasters

    def __len__(self) -> int:
        return len(self.rasters)

    def __getitem__(self, index: int, /) -> np.ndarray:
        return self.pixels.read(self.rasters[index])


def file_stamp(path: Path) -> list[Any]:
    """Name, size and date of a file; one that is missing counts as such."""
    try:
        status = path.stat()
    except OSError:
        return [path.name, "missing"]  # the filter that reads frames says so
    return [path.name, status.st_size, status.st_mtime_ns]
