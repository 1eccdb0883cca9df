"""A video file: opened, its packets, and when its frames are shown, without decoding them.

opened          the file and its main video stream
video_problem   what a glance tells against a file
coding_of       how its numbers stand for light
Timeline        the time stamps of its frames
frame_times     the same in seconds
decoded         its frames, from where the file stands
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path

import av
import numpy as np

from ..errors import DocumentError

# Other demultiplexers take texts, pictures and lists of addresses for videos
CONTAINERS = "mov,matroska,avi,mpegts,mpeg,asf,flv,ogg,mxf,nut,dv"
TRANSFERS = {8: "linear", 16: "pq", 18: "hlg"}
"""By the number of ITU-T H.273; all others are shown as sRGB is."""
BT2020 = 9
SAME = 1e-3  # seconds: a copy in another container may round its times to milliseconds


@contextmanager
def opened(path: Path) -> Iterator[tuple[av.container.InputContainer, av.VideoStream]]:
    """The file and its main video stream; DocumentError where there is none to be decoded."""
    if not path.is_file():
        raise DocumentError(
            f"{path}: does not exist; put the video back, or correct its path in the project's "
            "frames/videos.json"
        )
    try:
        container = av.open(str(path.absolute()), options={"format_whitelist": CONTAINERS})
    except (av.FFmpegError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise DocumentError(
            f"{path}: is not a video, or is cut off ({why}); copy it again, or convert it to MP4"
        ) from None
    with container:
        stream = container.streams.best("video")
        if not isinstance(stream, av.VideoStream):
            raise DocumentError(f"{path}: holds no video; give the file that has the pictures")
        if stream.codec_context is None:
            raise DocumentError(f"{path}: its codec is not known; convert it to H.264")
        yield container, stream


def video_problem(path: Path) -> str:
    """What a glance at the file tells against it, "" for nothing: no frame is decoded."""
    try:
        with opened(path):
            return ""
    except DocumentError as error:
        return str(error)


@dataclass(frozen=True)
class VideoCoding:
    """transfer : "srgb" where the file names none other than that of standard dynamic range

    deep : more than 8 bits; wide_gamut : BT.2020's primaries
    """

    transfer: str
    deep: bool
    wide_gamut: bool


def coding_of(path: Path) -> VideoCoding:
    """What a video's head says of its pixels; DocumentError as `opened`."""
    with opened(path) as (_, stream):
        context = stream.codec_context
        parts = context.format.components if context.format else ()
        bits = max((part.bits for part in parts), default=8)
        return VideoCoding(
            TRANSFERS.get(int(context.color_trc), "srgb"),
            bits > 8,
            int(context.color_primaries) == BT2020,
        )


@dataclass(frozen=True)
class Timeline:
    """pts, keys : ascending time stamps, of all frames and of those that need no other one."""

    path: Path
    pts: list[int]
    keys: list[int]
    tick: float

    @classmethod
    def read(cls, path: Path) -> Timeline:
        """From the packets, which are not decoded."""
        with opened(path) as (container, stream):
            packets = [
                (packet.pts, packet.is_keyframe)
                for packet in _packets(container, stream)
                if not packet.is_discard
            ]
            tick = float(stream.time_base or 0)
        keys = {pts: key for pts, key in packets if pts is not None}
        if len(keys) < len(packets):
            raise DocumentError(
                f"{path}: frames have no time stamps of their own; write it into another container "
                "(ffmpeg -i IN -c copy OUT.mkv), or convert it to MP4"
            )
        if not packets:
            raise DocumentError(f"{path}: holds no frame; copy the video again")
        return cls(path, sorted(keys), sorted(pts for pts, key in keys.items() if key), tick)

    @cached_property
    def times(self) -> np.ndarray:
        """Seconds."""
        return np.array(self.pts) * self.tick

    def look(self, time: float) -> int:
        """The index of the frame at `time`, -1 where there is none."""
        at = int(np.argmin(np.abs(self.times - time)))
        return at if abs(self.times[at] - time) <= SAME else -1

    def find(self, time: float) -> int:
        """The time stamp of the frame at `time`; DocumentError where there is none."""
        at = self.look(time)
        if at < 0:
            raise DocumentError(
                f"{self.path}: has no frame at {time:.3f} s ({len(self.pts)} frames, the last at "
                f"{self.times[-1]:.3f} s): it is cut off, or not the video that was "
                "registered; put that one back"
            )
        return self.pts[at]

    def key_before(self, pts: int) -> int | None:
        """Of the last frame at or before `pts` that needs no other one."""
        at = bisect_right(self.keys, pts)
        return self.keys[at - 1] if at else None

    def between(self, first: float, last: int) -> int:
        """How many frames lie after `first` and before `last`."""
        return bisect_right(self.pts, last - 1) - bisect_right(self.pts, first)


def frame_times(path: str | Path) -> np.ndarray:
    """When each frame is shown, (F,) float64 seconds, ascending; nothing is decoded.

    Raises
    ------
    DocumentError : the file is missing, no video, cut off so that it cannot be opened, or without
        time stamps.
    """
    return Timeline.read(Path(path)).times


def decoded(
    container: av.container.InputContainer, stream: av.VideoStream
) -> Iterator[av.VideoFrame]:
    """The frames from where the file stands, in the order of presentation.

    After damage none comes before the next keyframe, for others refer to what is lost.
    """
    sound = True
    for packet in chain(_packets(container, stream), [None]):
        try:
            for frame in stream.decode(packet):
                sound = (sound or frame.key_frame) and not frame.is_corrupt
                if sound:
                    yield frame
        except av.FFmpegError:
            sound = False


def _packets(container: av.container.InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
    """To the end of the file, or to where it is cut off."""
    try:
        yield from (packet for packet in container.demux(stream) if packet.size)
    except av.FFmpegError:
        return
