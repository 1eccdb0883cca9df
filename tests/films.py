"""Small videos, made by the library that reads them.

noise        pictures no two of which are alike
write_video  pictures as a video, lossless unless told otherwise
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

TICK = Fraction(1, 1000)


def noise(count: int, height: int = 48, width: int = 64) -> np.ndarray:
    """(count, height, width, 3) uint8: blocks of chance colours."""
    rng = np.random.default_rng(5)
    small = rng.integers(0, 256, (count, height // 8, width // 8, 3), np.uint8)
    return small.repeat(8, 1).repeat(8, 2)


def write_video(
    path: Path,
    pictures: Sequence[np.ndarray],
    times: Sequence[int] | None = None,
    *,
    codec: str = "libx264rgb",
    pixels: str = "rgb24",
    source: str = "rgb24",
    options: dict[str, str] | None = None,
    **context: Any,
) -> Path:
    """A video with a keyframe every tenth frame and frames that refer to later ones.

    times : milliseconds; None: 25 frames a second
    pixels, source : how the video and `pictures` hold them
    context : attributes of the encoder (colorspace …)
    """
    times = [40 * k for k in range(len(pictures))] if times is None else times
    lossless = {"qp": "0", "g": "10", "bf": "2", "sc_threshold": "0"}
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            codec, rate=25, options=lossless if options is None else options
        )
        picture = av.VideoFrame.from_ndarray(np.asarray(pictures[0]), format=source)
        stream.width, stream.height, stream.pix_fmt = picture.width, picture.height, pixels
        stream.codec_context.time_base = TICK
        for name, value in context.items():
            setattr(stream.codec_context, name, value)
        for time, pixel_values in zip(times, pictures, strict=True):
            picture = av.VideoFrame.from_ndarray(np.asarray(pixel_values), format=source)
            picture.pts, picture.time_base = time, TICK
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path
