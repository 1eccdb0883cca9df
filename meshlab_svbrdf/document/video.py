"""The pixels of a video's frames, for many threads: each frame is decoded once."""

from __future__ import annotations

import logging
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Lock

import av
import numpy as np

from ..errors import DocumentError
from ..threads import thread_count
from .video_file import Timeline, decoded, opened
from .video_pixels import to_rgb

log = logging.getLogger("meshlab_svbrdf")

Source = tuple[av.container.InputContainer, av.VideoStream]
Stamped = tuple[int, av.VideoFrame]  # with its time stamp
WORTH_SEEKING = 8  # frames: decoding fewer is cheaper


class VideoReader:
    """The frames of a video, asked for from many threads, roughly in order; close it at the end.

    Frames passed on the way to the one that is asked for are held, if they will be asked for. So
    each is decoded once; of frames asked for far out of order some are decoded again.

    path : the video
    times : seconds, of the frames that will be asked for
    decoded : how many frames were decoded so far
    """

    def __init__(self, path: Path, times: Iterable[float]) -> None:
        self.path = path
        self.decoded = 0
        self._line = Timeline.read(path)
        self._due = sorted({self._line.pts[k] for k in map(self._line.look, times) if k >= 0})
        self._lock = Lock()
        self._held: dict[int, av.VideoFrame] = {}
        self._room = max(16, 4 * thread_count())
        self._lost: set[int] = set()
        self._seekable = True
        self._told = False
        self._file = ExitStack()
        self._close()

    def read(self, time: float, deep: bool = False) -> np.ndarray:
        """The frame shown at `time`, (H, W, 3) uint8; `deep`: uint16.

        Raises
        ------
        DocumentError : there is no such frame, or it is damaged.
        """
        pts = self._line.find(time)
        with self._lock:
            frame = self._held.pop(pts, None)
            if frame is None and pts not in self._lost:
                frame = self._fetch(pts)
            at = bisect_left(self._due, pts)
            if self._due[at : at + 1] == [pts]:
                del self._due[at]
            if not self._due:
                self._close()
        if frame is None:
            raise DocumentError(
                f"{self.path}: the frame at {time:.3f} s cannot be decoded: the video is damaged; "
                "copy it again, convert it, or remove the raster"
            )
        try:
            return to_rgb(frame, deep)
        except (av.FFmpegError, ValueError) as error:
            raise DocumentError(
                f"{self.path}: its pixels cannot be turned into RGB ({error}); convert it to H.264"
            ) from None

    def close(self) -> None:
        with self._lock:
            self._close()

    def _close(self) -> None:
        self._file.close()
        self._source: Source | None = None
        self._frames: Iterator[Stamped] = iter(())
        self._newest: Stamped | None = None
        self._position = float("-inf")  # all frames up to here were decoded or passed over

    def _fetch(self, pts: int) -> av.VideoFrame | None:
        """Decode on to a frame and hold those on the way that are due; None where it is lost."""
        due = self._due[bisect_right(self._due, self._position) : bisect_left(self._due, pts)]
        passed = [stop for stop in due if stop not in self._held]
        for stop in passed if len(passed) <= self._room else ():
            frame = self._decode_to(stop)
            if frame is not None:
                self._hold(stop, frame)
        return self._decode_to(pts)

    def _hold(self, pts: int, frame: av.VideoFrame) -> None:
        self._held[pts] = frame
        if len(self._held) > self._room:
            del self._held[min(self._held)]

    def _decode_to(self, stop: int) -> av.VideoFrame | None:
        key = self._line.key_before(stop)
        skipped = 0 if key is None else self._line.between(self._position, key)
        if self._source is None or stop <= self._position or skipped >= WORTH_SEEKING:
            self._begin(key)
        self._position = stop
        while self._newest is not None and self._newest[0] < stop:
            self._newest = next(self._frames, None)
        if self._newest is not None and self._newest[0] == stop:
            return self._newest[1]
        self._lost.add(stop)
        return None

    def _begin(self, key: int | None) -> None:
        """Go to a keyframe; to the start where seeking does not find it."""
        if key is not None and key > self._line.pts[0] and self._seekable:
            container, stream = self._source or self._open()
            try:
                container.seek(key, stream=stream)
                self._frames = self._stamped(decoded(container, stream))
                self._newest = next((each for each in self._frames if each[0] >= key), None)
            except av.FFmpegError:
                self._newest = None
            if self._newest is not None and self._newest[0] == key:
                return
            self._seekable = False
        self._frames = self._stamped(decoded(*self._open()))
        self._newest = next(self._frames, None)

    def _open(self) -> Source:
        self._file.close()
        container, stream = self._source = self._file.enter_context(opened(self.path))
        stream.thread_type = "AUTO"
        return container, stream

    def _stamped(self, frames: Iterator[av.VideoFrame]) -> Iterator[Stamped]:
        for frame in frames:
            self.decoded += 1
            if frame.interlaced_frame and not self._told:
                self._told = True
                log.warning(
                    "%s is interlaced: its frames hold two moments; deinterlace it, or film "
                    "progressively", self.path,
                )  # fmt: skip
            if frame.pts is not None:
                yield frame.pts, frame
