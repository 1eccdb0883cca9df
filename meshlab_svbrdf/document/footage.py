"""Frames that have no camera yet: a video, or a folder of images.

open_video, open_images   all frames of one, as a Clip
Clip.chosen               every n-th, from first to last, or the sharpest of every n
ClipFrames                their pixels by index, for the registration
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from ..errors import DocumentError
from ..geometry.lens import Lens
from ..progress import Progress
from .deep_images import kind_of, read_seen, read_values
from .project_entries import absolute
from .video import VideoReader
from .video_file import frame_times
from .video_names import VideoFrame, name_frame

IMAGES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".exr", ".hdr")
BLOCK = 24  # frames of a video that are decoded at a time where they are read backwards
SMALL = 640  # pixels: sharpness is judged at this width


@dataclass(frozen=True)
class Clip:
    """Frames in their order.

    source : the video, or the folder of the images
    names : of each frame, as the raster will be labelled
    indices : each frame's place in the source, from 0
    files : each frame's image; empty for a video
    times : each frame's time in the video, seconds; empty for images
    size : width, height in pixels
    """

    source: Path
    names: list[str]
    indices: list[int]
    files: list[Path]
    times: list[float]
    size: tuple[int, int]

    @property
    def is_video(self) -> bool:
        return not self.files

    def __len__(self) -> int:
        return len(self.names)

    def file(self, k: int) -> Path:
        """The image of frame k, or the video."""
        return self.source if self.is_video else self.files[k]

    def only(self, places: Sequence[int]) -> Clip:
        """The frames at these places."""
        return replace(
            self,
            names=[self.names[k] for k in places],
            indices=[self.indices[k] for k in places],
            files=[self.files[k] for k in places] if self.files else [],
            times=[self.times[k] for k in places] if self.times else [],
        )

    def chosen(
        self,
        step: int = 1,
        first: int = 0,
        last: int = -1,
        *,
        sharpest: bool = False,
        always: Sequence[int] = (),
        progress: Progress | None = None,
    ) -> Clip:
        """Of the frames from `first` to `last` (−1: the end), every `step`-th.

        sharpest : of every `step` frames the sharpest, rather than the first; all are decoded
        always : frames (their indices) that are taken too: those whose cameras are known

        Raises DocumentError where no frame is in the range.
        """
        end = self.indices[-1] if last < 0 else last
        places = [k for k, index in enumerate(self.indices) if first <= index <= end]
        if not places:
            raise DocumentError(
                f"{self.source}: has the frames {self.indices[0]} to {self.indices[-1]}, none is "
                f"between first={first} and last={last}"
            )
        windows = [places[k : k + step] for k in range(0, len(places), step)]
        if sharpest and step > 1:
            part = self.only(places)
            scores = dict(zip(places, sharpness(part, progress or Progress()), strict=True))
            kept = [max(window, key=scores.__getitem__) for window in windows]
        else:
            kept = [window[0] for window in windows]
        kept += [k for k, index in enumerate(self.indices) if index in set(always)]
        return self.only(sorted(set(kept)))


def open_video(path: Path, known: Mapping[str, VideoFrame] | None = None) -> Clip:
    """All frames of a video, in the order of presentation; one is decoded, for the size.

    known : names that are taken by frames of other videos

    Raises DocumentError as `frame_times` does.
    """
    path = absolute(path)
    times = frame_times(path)
    reader = VideoReader(path, times[:1])
    height, width = reader.read(times[0]).shape[:2]
    reader.close()
    frames = [VideoFrame(path, k, float(time)) for k, time in enumerate(times)]
    names = [name_frame(frame, known or {}) for frame in frames]
    return Clip(path, names, list(range(len(times))), [], times.tolist(), (width, height))


def open_images(folder: Path) -> Clip:
    """The images of a folder, in natural order (f2 before f10).

    Raises
    ------
    DocumentError : no such folder, no images, or images of different sizes.
    """
    folder = folder.resolve()
    if not folder.is_dir():
        raise DocumentError(f"{folder}: is no folder; give the folder of the images")
    files = sorted(
        (f for f in folder.iterdir() if f.suffix.lower() in IMAGES and f.is_file()
         and not f.name.startswith(".")),
        key=lambda file: natural(file.name),
    )  # fmt: skip
    if not files:
        raise DocumentError(f"{folder}: holds no images ({', '.join(IMAGES)})")
    sizes = [_size(file) for file in files]
    for file, size in zip(files, sizes, strict=True):
        if size != sizes[0]:
            raise DocumentError(
                f"{file}: has {size[0]}×{size[1]} pixels, {files[0].name} has "
                f"{sizes[0][0]}×{sizes[0][1]}; put images of each size into a folder of their own"
            )
    names = [file.name for file in files]
    return Clip(folder, names, list(range(len(files))), files, [], sizes[0])


def natural(name: str) -> list[tuple[int, int | str]]:
    """A key that sorts numbers in names by their value."""
    parts = re.split(r"(\d+)", name.lower())
    return [(0, int(part)) if part.isdigit() else (1, part) for part in parts]


class ClipFrames:
    """The pixels of a clip by index, undistorted; close it, or use it in `with`.

    Of a video that is read backwards, a block of frames is decoded at a time.

    lenses : of each frame, None where it does not distort
    """

    def __init__(self, clip: Clip, lenses: Sequence[Lens | None] | None = None) -> None:
        self.clip = clip
        self.lenses = [None] * len(clip) if lenses is None else list(lenses)
        self._reader: VideoReader | None = None
        self._held: dict[int, np.ndarray] = {}
        self._last = -1

    def __len__(self) -> int:
        return len(self.clip)

    def __getitem__(self, index: int, /) -> np.ndarray:
        """Frame `index`, (H, W, 3) uint8; DocumentError where it cannot be read."""
        image = self.raw(index)
        lens = self.lenses[index]
        return image if lens is None else lens.undistort(image)

    def raw(self, index: int) -> np.ndarray:
        """The frame as it was filmed."""
        if not 0 <= index < len(self.clip):
            raise IndexError(index)
        if not self.clip.is_video:
            return read_seen(self.clip.files[index], size=self.clip.size)
        if index not in self._held:
            backwards = index < self._last
            start = max(0, index - BLOCK + 1) if backwards else index
            self._held = {k: self._decode(k) for k in range(start, index + 1)}
        self._last = index
        return self._held[index]

    def _decode(self, index: int) -> np.ndarray:
        if self._reader is None:
            self._reader = VideoReader(self.clip.source, self.clip.times)
        return self._reader.read(self.clip.times[index])

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        self._held = {}

    def __enter__(self) -> ClipFrames:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def sharpness(clip: Clip, progress: Progress) -> list[float]:
    """How sharp each frame is beside its neighbours: the variance of the Laplacian."""
    found = []
    with ClipFrames(clip) as frames:
        for k in progress.over(range(len(clip)), "sharpness"):
            grey = cv2.cvtColor(frames.raw(k), cv2.COLOR_RGB2GRAY)
            scale = min(1.0, SMALL / max(grey.shape))
            small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            found.append(float(cv2.Laplacian(small, cv2.CV_32F).var()))
    return found


def _size(file: Path) -> tuple[int, int]:
    if kind_of(file) == "float":
        height, width = read_values(file).shape[:2]
        return width, height
    try:
        with Image.open(file) as image:
            return image.size
    except OSError as error:
        raise DocumentError(f"{file}: cannot be read as an image ({error})") from None
