"""Chunks of the sample store: the samples of some frames, texel-major (CSR).

`offsets` (T+1) uint32, and per sample `frame` uint8 (within the chunk) and `value` 4 × uint8: sRGB
and the quality (7 bits, the top bit marks clipped). 5 bytes a sample. Of frames with more than 8
bits `value` is 4 × uint16: codes of radiance, and the same quality. 9 bytes a sample.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..blocks import room
from ..errors import DocumentError
from ..jit import kernel
from ..npy import write_npy

MOST_FRAMES = 256  # of a chunk: a byte counts them
COLUMNS = ("frame", "value")
ROWS: dict[str, tuple[type, tuple[int, ...]]] = {
    "offsets": (np.uint32, ()), "frame": (np.uint8, ()), "value": (np.uint8, (4,)),
}  # fmt: skip
"""The type and shape of a column's rows, of values as of 8 bits."""
KINDS: dict[int, type] = {8: np.uint8, 16: np.uint16}
"""Types of values, by their bits."""
TRANSPOSED = 2048
"""Texels that are transposed at once: their samples fit a core's cache."""
TEXEL_BYTES = 4
"""A sample's, before it is transposed, besides its value."""
HELD_BYTES = TEXEL_BYTES + 4
"""A sample's, before it is transposed: its texel and its value."""
WORDS: dict[Any, np.dtype[Any]] = {
    np.dtype(np.uint8): np.dtype(np.uint32),
    np.dtype(np.uint16): np.dtype(np.uint64),
}
"""Four numbers as one, by their type."""


class Chunk(Protocol):
    """frames : how many; the rows of "offsets" and of COLUMNS."""

    frames: int

    def read(self, name: str, first: int, rows: np.ndarray[Any, Any]) -> None:
        """Fill `rows` with a column's, from `first` on."""

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        """All rows, to be read here and there; let go of it soon."""

    def save(self, folder: Path, index: int) -> FileChunk:
        """The chunk as number `index` of a folder."""


class MemoryChunk:
    """A chunk held in memory."""

    def __init__(self, frames: int, columns: dict[str, np.ndarray]) -> None:
        self.frames, self._columns = frames, columns

    def read(self, name: str, first: int, rows: np.ndarray[Any, Any]) -> None:
        rows[:] = self._columns[name][first : first + len(rows)]

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        return self._columns[name]

    def save(self, folder: Path, index: int) -> FileChunk:
        for name, column in self._columns.items():
            write_npy(_path(folder, index, name), column)
        return FileChunk(folder, index, self.frames, self._columns["value"].dtype.type)


class FileChunk:
    """A chunk in files, neither mapped nor kept open: many frames make many files."""

    def __init__(self, folder: Path, index: int, frames: int, kind: type = np.uint8) -> None:
        """kind : of the values"""
        self.frames = frames
        self._rows = ROWS | {"value": (kind, (4,))}
        self._paths = {name: _path(folder, index, name) for name in ROWS}
        self._layout = {
            name: _layout(path, *self._rows[name]) for name, path in self._paths.items()
        }

    def read(self, name: str, first: int, rows: np.ndarray[Any, Any]) -> None:
        with open(self._paths[name], "rb", buffering=0) as file:
            file.seek(self._layout[name][0] + first * rows.strides[0])
            if file.readinto(rows.data) != rows.nbytes:
                raise DocumentError(
                    f"{self._paths[name]} has been cut off: apply compute_svbrdf_samples again, "
                    "with --force"
                )

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        start, shape = self._layout[name]
        return np.asarray(np.memmap(self._paths[name], self._rows[name][0], "r", start, shape))

    def save(self, folder: Path, index: int) -> FileChunk:
        """Shared with the other folder where the disk can: chunks are never written into."""
        for name, path in self._paths.items():
            try:
                os.link(path, _path(folder, index, name))
            except OSError:
                shutil.copyfile(path, _path(folder, index, name))
        return FileChunk(folder, index, self.frames, self._rows["value"][0])


def _path(folder: Path, index: int, name: str) -> str:
    return str(folder / f"chunk{index:04d}.{name}.npy")


def _layout(path: str, kind: type, row: tuple[int, ...]) -> tuple[int, tuple[int, ...]]:
    """Where an array starts in its file, and its shape; ValueError where it is of another kind."""
    array = np.load(path, mmap_mode="r")
    if (array.dtype, array.shape[1:]) != (kind, row):
        raise ValueError(f"{path}: expected rows of {kind.__name__} {row}")
    return array.offset, array.shape


def words_of(value: np.ndarray) -> np.ndarray:
    """Colour and quality (n, 4) uint8 as one number each, (n,) uint32, which moves faster; of
    uint16 uint64."""
    return value.view(WORDS[value.dtype])[:, 0]


def bytes_of(words: np.ndarray) -> np.ndarray:
    """Inverse of `words_of`."""
    return words.view(np.uint8 if words.itemsize == 4 else np.uint16).reshape(-1, 4)


class SampledFrame(NamedTuple):
    """What a frame shows of the texels.

    texel : (n,) int32, ascending
    value : (n, 4) uint8: sRGB, interpolated in linear light, and the quality · 127 in seven bits;
        the eighth: any tap was clipped. Or uint16: codes of radiance, and the same quality
    """

    texel: np.ndarray
    value: np.ndarray

    @property
    def rgb(self) -> np.ndarray:
        return self.value[:, :3]

    @property
    def quality(self) -> np.ndarray:
        return self.value[:, 3]


Make = Callable[[int, Any], np.ndarray]
"""Of an array from its length and type: np.empty or `blocks.room`."""


def columns(samples: int, kind: type, make: Make = np.empty) -> tuple[np.ndarray, np.ndarray]:
    """Room for frames (n,) uint8 and for values as words (n,)."""
    return make(samples, np.uint8), make(samples, WORDS[np.dtype(kind)])


@kernel
def _total(value):
    """Of the qualities, in 127ths."""
    total = 0
    for i in range(len(value)):
        total += value[i, 3] & 127
    return total


@kernel
def _count(texel, counts):
    for i in range(len(texel)):
        counts[texel[i]] += 1


@kernel
def _scatter(texel, value, start, stop, cursor, out_frame, out_value):
    """Append the samples start..stop of each frame to their texels' runs, frame by frame."""
    for f in range(len(start)):
        for i in range(start[f], stop[f]):
            k = cursor[texel[i]]
            cursor[texel[i]] = k + np.uint32(1)
            out_frame[k] = f
            out_value[k] = value[i]


class Held:
    """Frames one after the other, until they are transposed."""

    def __init__(self, samples: int, kind: type = np.uint8, make: Make = np.empty) -> None:
        """samples : of which there is room; kind : of their values; make : an array"""
        self._texel, self._value = (make(samples, k) for k in (np.int32, WORDS[np.dtype(kind)]))
        self.clear()

    def __len__(self) -> int:
        """How many frames."""
        return len(self._quality)

    @property
    def samples(self) -> int:
        """How many there are."""
        return self._ends[-1]

    @property
    def bytes(self) -> int:
        return (TEXEL_BYTES + self._value.itemsize) * self.samples

    @property
    def seen(self) -> np.ndarray:
        """Samples of each frame."""
        return np.diff(np.array(self._ends, np.int64))

    @property
    def quality(self) -> np.ndarray:
        """The mean of each frame's samples."""
        return np.array(self._quality) / np.maximum(self.seen, 1)

    def clear(self) -> None:
        self._ends: list[int] = [0]
        self._quality: list[float] = []

    def append(self, frame: SampledFrame) -> None:
        first, stop = self._ends[-1], self._ends[-1] + len(frame.texel)
        self._texel[first:stop] = frame.texel
        self._value[first:stop] = words_of(frame.value)
        self._ends.append(stop)
        self._quality.append(_total(frame.value) / 127)

    def transpose(
        self, texels: int, pool: ThreadPoolExecutor, out: tuple[np.ndarray, np.ndarray]
    ) -> MemoryChunk:
        """The frames' samples, texel by texel.

        out : `columns` with room for them, of which the chunk is made
        """
        ends = np.array(self._ends)
        texel, value = self._texel[: ends[-1]], self._value[: ends[-1]]
        offsets, cursor = room(texels + 1, np.uint32), room(texels, np.uint32)
        offsets[:] = 0
        _count(texel, offsets[1:])
        np.cumsum(offsets, dtype=np.uint32, out=offsets)
        cursor[:] = offsets[:-1]
        frame, word = out[0][: len(texel)], out[1][: len(texel)]
        # Go from one stretch of texels to the next, so that what is written stays in the cache
        edges = np.arange(0, texels + TRANSPOSED, TRANSPOSED)
        cuts = np.array([a + np.searchsorted(texel[a:b], edges) for a, b in pairwise(ends)])
        cuts = cuts.reshape(len(self), len(edges))

        def stretch(k: int) -> None:
            _scatter(texel, value, cuts[:, k], cuts[:, k + 1], cursor, frame, word)

        list(pool.map(stretch, range(len(edges) - 1)))
        return MemoryChunk(len(self), {"offsets": offsets, "frame": frame, "value": bytes_of(word)})
