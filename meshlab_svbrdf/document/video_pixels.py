"""A decoded picture of a video as RGB: by its own colour matrix and range, turned upright."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import av
import numpy as np

MATRICES = {
    1: "bt709", 4: "fcc", 5: "bt470", 6: "smpte170m", 7: "smpte240m", 9: "bt2020", 10: "bt2020",
}  # fmt: skip
STANDARD_LINES = 576  # a picture of more lines that does not name its matrix has Rec. 709's
FULL_RANGE = 2
TICK = Fraction(1, 1000)  # a graph wants one; no time goes through it
EXACT = "flags=bicubic+accurate_rnd+full_chroma_int+full_chroma_inp"


def to_rgb(frame: av.VideoFrame, deep: bool = False) -> np.ndarray:
    """The picture as (H, W, 3) uint8, coded as the video's own R'G'B'; `deep`: uint16.

    Where the video does not name its matrix, that is Rec. 709 above 576 lines, else Rec. 601; where
    it does not name its range, it is limited. Chroma is interpolated bicubically.
    """
    matrix = MATRICES.get(int(frame.colorspace))
    if matrix is None:
        lines = min(frame.width, frame.height)  # those of a portrait are its columns
        matrix = "bt709" if lines > STANDARD_LINES else "bt601"
    full = int(frame.color_range) == FULL_RANGE or frame.format.name.startswith("yuvj")
    full = full or frame.format.is_rgb
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=TICK
    )
    scale = graph.add(
        "scale", f"in_color_matrix={matrix}:in_range={'pc' if full else 'tv'}:out_range=pc:{EXACT}"
    )
    rgb, sink = graph.add("format", "rgb48le" if deep else "rgb24"), graph.add("buffersink")
    source.link_to(scale)
    scale.link_to(rgb)
    rgb.link_to(sink)
    graph.configure()
    source.push(frame)
    picture: Any = sink.pull()
    return np.ascontiguousarray(_turned(picture.to_ndarray(), frame))


def _turned(image: np.ndarray, frame: av.VideoFrame) -> np.ndarray:
    """Turned and mirrored as the display matrix says: x' = a x + c y, y' = b x + d y."""
    data: Any = frame.side_data.get("DISPLAYMATRIX")
    if data is None:
        return image
    a, b, _, c, d = np.frombuffer(bytes(data), np.int32)[:5]
    if abs(b) > abs(a):
        image, a, d = image.swapaxes(0, 1), c, b
    return image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]
