"""Points picked on the mesh and in a frame: our CSV and JSON, and MeshLab's own list.

CSV, one point a line, `#` begins a comment; `# frame: NAME` names the frame of the lines below:

    # frame: walk_000000.jpg
    # x, y, z, column, row
    0.12, 1.30, 0.41, 812.5, 430

JSON:  {"frames": [{"frame": "walk_000000.jpg",
                    "points": [{"world": [x, y, z], "pixel": [column, row]}]}]}

MeshLab's "Raster alignment based on 2D/3D correspondences" exports a text of lines
`Corr PP0 x y z column row`, with rows counted upwards from the picture's bottom.

World coordinates are the project's, after the layer's matrix. Pixels are of the frame as it was
filmed, pixel centres at whole numbers, rows downwards. The frame is a file name, or a number.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np

from ..errors import DocumentError
from .reconstruction import read_text

MESHLAB = "-------RASTER ALIGNMENT DATA"


@dataclass(frozen=True)
class PickedPoints:
    """The points of one frame.

    frame : what the file says of it: a name, a number, or "" where it says nothing
    world : (N, 3) float64; pixels : (N, 2) float64
    upwards : whether rows count from the bottom, at pixel edges, as MeshLab's do
    """

    where: str
    frame: str
    world: np.ndarray
    pixels: np.ndarray
    upwards: bool = False

    def in_frame(self, width: int, height: int) -> np.ndarray:
        """The pixels in a frame of that size, rows from the top; DocumentError if outside."""
        pixels = self.pixels.copy()
        if self.upwards:
            pixels[:, 1] = height - 1 - pixels[:, 1]
        outside = (pixels < -0.5) | (pixels > [width - 0.5, height - 0.5])
        if outside.any():
            bad = self.pixels[outside.any(axis=1)][0]
            raise DocumentError(
                f"{self.where}: the point at column {bad[0]:g}, row {bad[1]:g} is outside of the "
                f"frame, which has {width}×{height} pixels; pick in the frame as it was filmed"
            )
        return pixels


def read_points(path: Path) -> list[PickedPoints]:
    """The picked points of a file, frame by frame.

    Raises
    ------
    DocumentError : the file is missing, holds no points, or a line is not what it should be.
    """
    text = read_text(path)
    if path.suffix.lower() == ".json":
        found = _json(path, text)
    elif text.startswith(MESHLAB):
        found = _meshlab(path, text)
    else:
        found = _csv(path, text)
    if not found:
        raise DocumentError(f"{path}: holds no points; expected lines of x, y, z, column, row")
    return found


def _csv(path: Path, text: str) -> list[PickedPoints]:
    frames: dict[str, list[list[float]]] = {}
    frame = ""
    for number, line in enumerate(text.splitlines(), 1):
        words, hash_sign, comment = line.partition("#")
        name, colon, value = comment.partition(":")
        if hash_sign and colon and name.strip().lower() == "frame" and not words.strip():
            frame = value.strip()
        if not words.strip():
            continue
        row = _row(words.replace(",", " ").replace(";", " ").split(), 5)
        if row is None:
            raise DocumentError(
                f"{path}, line {number}: expected x, y, z, column, row, found {line.strip()!r}"
            )
        frames.setdefault(frame, []).append(row)
    return [_picked(str(path), name, rows) for name, rows in frames.items()]


def _meshlab(path: Path, text: str) -> list[PickedPoints]:
    frame, rows = "", []
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("Raster:"):
            # The path as it was on the machine where it was picked
            frame = PureWindowsPath(line.removeprefix("Raster:").strip()).name
        if line.startswith("Corr "):
            row = _row(line.split()[2:], 5)
            if row is None:
                raise DocumentError(
                    f"{path}, line {number}: expected Corr NAME x y z column row, found {line!r}"
                )
            rows.append(row)
    return [_picked(str(path), frame, rows, upwards=True)] if rows else []


def _json(path: Path, text: str) -> list[PickedPoints]:
    where = str(path)
    try:
        content = json.loads(text)
        entries = content.get("frames", [content])
        found = []
        for index, entry in enumerate(entries):
            where = f"{path}: frames[{index}]"
            rows = []
            for k, point in enumerate(entry["points"]):
                row = _row([*point["world"], *point["pixel"]], 5)
                if row is None or len(point["world"]) != 3:
                    raise ValueError(f"point {k}: {point}")
                rows.append(row)
            if rows:
                found.append(_picked(where, str(entry.get("frame", "")), rows))
        return found
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DocumentError(
            f'{where}: expected {{"frame": NAME, "points": [{{"world": [x, y, z], "pixel": '
            f"[column, row]}}]}}, found {error!r}"
        ) from None


def _row(words: list, count: int) -> list[float] | None:
    """The words as finite numbers, None where they are not."""
    try:
        row = [float(word) for word in words]
    except (TypeError, ValueError):
        return None
    return row if len(row) == count and np.isfinite(row).all() else None


def _picked(
    where: str, frame: str, rows: list[list[float]], *, upwards: bool = False
) -> PickedPoints:
    values = np.array(rows, np.float64)
    return PickedPoints(where, frame, values[:, :3].copy(), values[:, 3:].copy(), upwards)
