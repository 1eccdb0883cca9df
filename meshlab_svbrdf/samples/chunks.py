"""Chunks of the sample store: the samples of some frames, texel-major (CSR).

`offsets` (T+1) uint32, and per sample `frame` uint8 (within the chunk), `rgb` 3 × uint8 (sRGB) and
`quality` uint8 (7 bits, the top bit marks clipped): 5 bytes a sample.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numba import njit

MOST_FRAMES = 256  # of a chunk: a byte counts them
COLUMNS = ("frame", "rgb", "quality")
TRANSPOSED = 4096
"""Texels that are transposed at once: their samples fit a core's cache."""

SampledFrame = tuple[np.ndarray, np.ndarray, np.ndarray]


class Chunk(Protocol):
    """frames : how many; the rows of "offsets" and of COLUMNS."""

    frames: int

    def read(self, name: str, first: int, stop: int) -> np.ndarray[Any, Any]:
        """The rows first..stop of a column."""

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        """All rows, to be read here and there; let go of it soon."""

    def save(self, folder: Path, index: int) -> FileChunk:
        """The chunk as number `index` of a folder."""


class MemoryChunk:
    """A chunk held in memory."""

    def __init__(self, frames: int, columns: dict[str, np.ndarray]) -> None:
        self.frames, self._columns = frames, columns

    def read(self, name: str, first: int, stop: int) -> np.ndarray[Any, Any]:
        return self._columns[name][first:stop]

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        return self._columns[name]

    def save(self, folder: Path, index: int) -> FileChunk:
        for name, column in self._columns.items():
            np.save(_path(folder, index, name), column)
        return FileChunk(folder, index, self.frames)


class FileChunk:
    """A chunk in files, neither mapped nor kept open: many frames make many files."""

    def __init__(self, folder: Path, index: int, frames: int) -> None:
        self.frames = frames
        self._paths = {name: _path(folder, index, name) for name in ("offsets", *COLUMNS)}
        self._layout = {name: _layout(path) for name, path in self._paths.items()}

    def read(self, name: str, first: int, stop: int) -> np.ndarray[Any, Any]:
        start, dtype, shape = self._layout[name]
        row = int(np.prod(shape))
        at = start + first * row * dtype.itemsize
        flat = np.fromfile(self._paths[name], dtype, (stop - first) * row, offset=at)
        return flat.reshape(stop - first, *shape)

    def mapped(self, name: str) -> np.ndarray[Any, Any]:
        return np.asarray(np.load(self._paths[name], mmap_mode="r"))

    def save(self, folder: Path, index: int) -> FileChunk:
        """Shared with the other folder where the disk can: chunks are never written into."""
        for name, path in self._paths.items():
            try:
                os.link(path, _path(folder, index, name))
            except OSError:
                shutil.copyfile(path, _path(folder, index, name))
        return FileChunk(folder, index, self.frames)


def _path(folder: Path, index: int, name: str) -> Path:
    return folder / f"chunk{index:04d}.{name}.npy"


def _layout(path: Path) -> tuple[int, np.dtype, tuple[int, ...]]:
    """Where an array's rows start in its file, their type, and the shape of one."""
    array = np.load(path, mmap_mode="r")
    return array.offset, array.dtype, array.shape[1:]


@njit(cache=True, nogil=True)
def _count(texel, counts):
    for i in range(len(texel)):
        counts[texel[i]] += 1


@njit(cache=True, nogil=True)
def _scatter(texel, rgb, quality, start, stop, cursor, out_frame, out_rgb, out_quality):
    """Append the samples start..stop of each frame to their texels' runs, frame by frame."""
    for f in range(len(start)):
        for i in range(start[f], stop[f]):
            k = cursor[texel[i]]
            cursor[texel[i]] = k + np.uint32(1)
            out_frame[k] = f
            out_rgb[k, 0], out_rgb[k, 1], out_rgb[k, 2] = rgb[i, 0], rgb[i, 1], rgb[i, 2]
            out_quality[k] = quality[i]


def transpose(held: Sequence[SampledFrame], texels: int, pool: ThreadPoolExecutor) -> MemoryChunk:
    """Some frames' samples (texel ascending, rgb, quality), texel by texel."""
    texel, colors, weights = (np.concatenate(column) for column in zip(*held, strict=True))
    counts = np.zeros(texels + 1, np.uint32)
    _count(texel, counts[1:])
    offsets = np.cumsum(counts, dtype=np.uint32)
    frame, rgb = np.empty(len(texel), np.uint8), np.empty((len(texel), 3), np.uint8)
    quality, cursor = np.empty(len(texel), np.uint8), offsets[:-1].copy()
    # Go from one stretch of texels to the next, so that what is written stays in the cache
    edges = np.arange(0, texels + TRANSPOSED, TRANSPOSED)
    starts = np.cumsum([0, *(len(part[0]) for part in held)])[:-1]
    cuts = np.array([np.searchsorted(part[0], edges) for part in held]) + starts[:, None]

    def stretch(k: int) -> None:
        _scatter(
            texel, colors, weights, cuts[:, k], cuts[:, k + 1], cursor, frame, rgb, quality
        )  # fmt: skip

    list(pool.map(stretch, range(len(edges) - 1)))
    return MemoryChunk(
        len(held), {"offsets": offsets, "frame": frame, "rgb": rgb, "quality": quality}
    )
