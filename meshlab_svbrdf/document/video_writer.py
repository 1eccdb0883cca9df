"""Films that any player shows: H.264 in MP4, written picture by picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import Colorspace

from ..errors import DocumentError
from .atomic import replacing

QUALITY = "16"  # constant rate factor: hardly to be told from the pictures


@contextmanager
def writing_video(path: str | Path, rate: int) -> Iterator[Callable[[np.ndarray], None]]:
    """Give a function that appends a picture (H, W, 3) uint8 sRGB; the film appears at the end.

    rate : pictures a second. Odd sizes lose their last row or column: H.264 has pixels in pairs.
    Raises DocumentError where the name is not that of an MP4.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise DocumentError(f"{path}: films are written as .mp4")
    with replacing(path) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": QUALITY})
        stream.pix_fmt = "yuv420p"
        stream.codec_context.colorspace = Colorspace.ITU709

        def append(picture: np.ndarray) -> None:
            height, width = (size - size % 2 for size in picture.shape[:2])
            if not stream.codec_context.is_open:
                stream.width, stream.height = width, height
            image = np.ascontiguousarray(picture[:height, :width])
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            container.mux(
                stream.encode(frame.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709))
            )

        yield append
        container.mux(stream.encode(None))
