"""The workload's frames as files: an image each, or a video for each turn around the object."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from ..document.atomic import replacing
from ..threads import thread_count

SUFFIXES = {"jpeg": ".jpg", "png": ".png", "h264": ".mp4"}
RATE = 30  # frames per second, and between two key frames
ENCODER = {"preset": "veryfast", "crf": "18", "g": str(RATE), "threads": "1"}
Result = TypeVar("Result")


def write_image(path: Path, image: np.ndarray, quality: int) -> None:
    """(H, W, 3) uint8 sRGB as JPEG of that quality or PNG, by the suffix; whole or not at all."""
    setting = (
        [cv2.IMWRITE_JPEG_QUALITY, quality]
        if path.suffix == ".jpg"
        else [cv2.IMWRITE_PNG_COMPRESSION, 1]
    )
    _, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), setting)
    path.parent.mkdir(exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def write_video(path: Path, images: Iterable[np.ndarray]) -> None:
    """Images as H.264, 4:2:0 in Rec. 709 and limited range, as cameras record; whole or not."""
    import av  # takes a tenth of a second, and is not wanted by most
    from av.video.reformatter import ColorRange, Colorspace

    with replacing(path) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=RATE, options=ENCODER)
        context = stream.codec_context
        context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
        for index, image in enumerate(images):
            if index == 0:
                stream.height, stream.width, stream.pix_fmt = *image.shape[:2], "yuv420p"
            picture = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
                format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
            )
            picture.pts = index
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))


def ahead(make: Callable[[int], Result], indices: Iterable[int]) -> Iterator[Result]:
    """What `make` gives for the indices, in their order, made on all cores a little ahead."""
    with ThreadPoolExecutor(thread_count()) as pool:
        pending: deque[Future[Result]] = deque()
        for index in indices:
            pending.append(pool.submit(make, index))
            if len(pending) > 2 * thread_count():
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
