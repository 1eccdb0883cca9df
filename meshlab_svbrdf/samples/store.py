"""The sample store: frames are projected once, and every texel's history is read in one piece.

On disk a store is a folder of chunks of at most 256 frames. A chunk holds its samples texel-major
(CSR): `offsets` (T+1) uint32, and per sample `frame` uint8 (within the chunk), `rgb` 3 × uint8
(sRGB) and `quality` uint8 (7 bits, the top bit marks clipped): 5 bytes a sample. Readers get
blocks of texels whose samples are the concatenation of a few slices, in the order of the frames.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit

from ..threads import thread_count

_COLUMNS = {"frame": (np.uint8, ()), "rgb": (np.uint8, (3,)), "quality": (np.uint8, ())}


Result = TypeVar("Result")


class Block(NamedTuple):
    """The samples of the texels first..stop, texel by texel, in the frames' order.

    offsets : (B+1,) int64 into the samples
    frame : (n,) int32; rgb : (n, 3) uint8 sRGB; quality : (n,) uint8
    """

    first: int
    stop: int
    offsets: np.ndarray
    frame: np.ndarray
    rgb: np.ndarray
    quality: np.ndarray


@njit(cache=True, nogil=True)
def _count(texel, counts):
    for i in range(len(texel)):
        counts[texel[i]] += 1


@njit(cache=True, nogil=True)
def _scatter(texel, frame, rgb, quality, cursor, out_frame, out_rgb, out_quality):
    """Append one frame's samples to their texels' runs."""
    for i in range(len(texel)):
        k = cursor[texel[i]]
        cursor[texel[i]] = k + 1
        out_frame[k] = frame
        out_rgb[k, 0], out_rgb[k, 1], out_rgb[k, 2] = rgb[i, 0], rgb[i, 1], rgb[i, 2]
        out_quality[k] = quality[i]


@njit(cache=True, nogil=True)
def _gather(
    offsets, base, frame, rgb, quality, first_frame, cursor, out_frame, out_rgb, out_quality
):
    """Append one chunk's slices to the block; `base` is where the slice starts in the chunk."""
    for i in range(len(cursor)):
        k = cursor[i]
        for j in range(np.int64(offsets[i]) - base, np.int64(offsets[i + 1]) - base):
            out_frame[k] = first_frame + frame[j]
            out_rgb[k, 0], out_rgb[k, 1], out_rgb[k, 2] = rgb[j, 0], rgb[j, 1], rgb[j, 2]
            out_quality[k] = quality[j]
            k += 1
        cursor[i] = k


SampledFrame = tuple[np.ndarray, np.ndarray, np.ndarray]


def write_store(
    folder: Path,
    texels: int,
    frames: int,
    sample: Callable[[int], SampledFrame],
    *,
    memory: int = 256 << 20,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> SampleStore:
    """Project every frame and write the store.

    Parameters
    ----------
    folder : an empty folder
    texels, frames : how many there are
    sample : frame index to (texel ascending int32, rgb uint8, quality uint8); called from threads
    memory : bytes of samples to hold before a chunk is written
    """
    chunks: list[int] = []
    seen = np.zeros(frames, np.int64)
    with ThreadPoolExecutor(thread_count()) as pool:
        held: list[SampledFrame] = []
        ahead = 2 * thread_count()
        pending = [pool.submit(sample, f) for f in range(min(ahead, frames))]
        for f in range(frames):
            held.append(pending.pop(0).result())
            if f + ahead < frames:
                pending.append(pool.submit(sample, f + ahead))
            seen[f] = len(held[-1][0])
            size = sum(len(part[0]) for part in held) * 8
            if size > memory or len(held) == 256 or f == frames - 1:
                _write_chunk(folder, len(chunks), texels, held)
                chunks.append(len(held))
                held = []
            progress(f + 1, frames)
    description = {"texels": texels, "frames": frames, "chunks": chunks, "seen": seen.tolist()}
    (folder / "store.json").write_text(json.dumps(description))
    return SampleStore(folder)


def _write_chunk(folder: Path, index: int, texels: int, held: Sequence[SampledFrame]) -> None:
    """Transpose the held frames to texel-major and write them."""
    counts = np.zeros(texels + 1, np.uint32)
    for texel, _, _ in held:
        _count(texel, counts[1:])
    offsets = np.cumsum(counts, dtype=np.uint32)
    total = int(offsets[-1])
    columns = {name: np.empty((total, *shape), dtype) for name, (dtype, shape) in _COLUMNS.items()}
    cursor = offsets[:-1].copy()
    for local, (texel, rgb, quality) in enumerate(held):
        _scatter(
            texel, local, rgb, quality, cursor, columns["frame"], columns["rgb"], columns["quality"]
        )
    np.save(folder / f"chunk{index:04d}.offsets.npy", offsets)
    for name, column in columns.items():
        np.save(folder / f"chunk{index:04d}.{name}.npy", column)


@njit(cache=True, nogil=True)
def _gather_texels(
    low, high, frame, rgb, quality, first_frame, cursor, out_frame, out_rgb, out_quality
):
    """As `_gather`, of texels whose slices low..high lie apart."""
    for i in range(len(cursor)):
        k = cursor[i]
        for j in range(low[i], high[i]):
            out_frame[k] = first_frame + frame[j]
            out_rgb[k, 0], out_rgb[k, 1], out_rgb[k, 2] = rgb[j, 0], rgb[j, 1], rgb[j, 2]
            out_quality[k] = quality[j]
            k += 1
        cursor[i] = k


class _Column:
    """Rows of an array file. Neither mapped nor kept open: many frames make many files."""

    def __init__(self, path: Path):
        self.path = path
        array = np.load(path, mmap_mode="r")
        self.dtype, self.shape, self.start = array.dtype, array.shape[1:], array.offset
        self.row = array.itemsize * int(np.prod(self.shape))

    def read(self, first: int, stop: int) -> np.ndarray[Any, Any]:
        """The rows first..stop."""
        items = (stop - first) * self.row // self.dtype.itemsize
        flat = np.fromfile(self.path, self.dtype, items, offset=self.start + first * self.row)
        return flat.reshape(stop - first, *self.shape)

    def mapped(self) -> np.ndarray[Any, Any]:
        """All rows, to be read here and there; let go of it soon."""
        return np.asarray(np.load(self.path, mmap_mode="r"))


class SampleStore:
    """Reads what `write_store` wrote; memory stays at a block, whatever the number of frames."""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        description = json.loads((self.folder / "store.json").read_text())
        self.texels: int = description["texels"]
        self.frames: int = description["frames"]
        self.seen = np.array(description["seen"], np.int64)
        self._chunks = []
        first = 0
        for index, size in enumerate(description["chunks"]):
            columns = {
                name: _Column(self.folder / f"chunk{index:04d}.{name}.npy")
                for name in ("offsets", *_COLUMNS)
            }
            self._chunks.append((first, columns))
            first += size

    def __len__(self) -> int:
        """How many samples there are."""
        return int(self.seen.sum())

    def counts(self) -> np.ndarray:
        """Samples per texel, (T,) int64."""
        total = np.zeros(self.texels, np.int64)
        for _, columns in self._chunks:
            total += np.diff(columns["offsets"].read(0, self.texels + 1).astype(np.int64))
        return total

    def read(self, first: int, stop: int) -> Block:
        """The samples of the texels first..stop."""
        spans = [columns["offsets"].read(first, stop + 1) for _, columns in self._chunks]
        offsets = np.zeros(stop - first + 1, np.int64)
        for span in spans:
            offsets[1:] += np.diff(span.astype(np.int64))
        np.cumsum(offsets, out=offsets)
        frame = np.empty(offsets[-1], np.int32)
        rgb, quality = np.empty((offsets[-1], 3), np.uint8), np.empty(offsets[-1], np.uint8)
        cursor = offsets[:-1].copy()
        for (first_frame, columns), span in zip(self._chunks, spans, strict=True):
            low, high = int(span[0]), int(span[-1])
            frames, colors, weights = (columns[name].read(low, high) for name in _COLUMNS)
            _gather(
                span, low, frames, colors, weights, first_frame, cursor,
                frame, rgb, quality,
            )  # fmt: skip
        return Block(first, stop, offsets, frame, rgb, quality)

    def block_bounds(self, samples: int = 1 << 21) -> list[tuple[int, int]]:
        """Ranges of texels with about `samples` samples each; they depend on the store alone."""
        total = np.concatenate([[0], np.cumsum(self.counts())])
        cuts = np.searchsorted(total, np.arange(samples, total[-1], samples))
        edges = np.unique(np.concatenate([[0], cuts, [self.texels]]))
        return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))

    def blocks(self, samples: int = 1 << 21) -> Iterator[Block]:
        """All texels, block by block, in order."""
        for first, stop in self.block_bounds(samples):
            yield self.read(first, stop)

    def map(
        self,
        work: Callable[[Block], Result],
        progress: Callable[[int, int], None] = lambda d, t: None,
    ) -> list[Result]:
        """`work` on every block, on all cores; the results come in the order of the blocks."""
        return list(self.stream(work, progress))

    def stream(
        self,
        work: Callable[[Block], Result],
        progress: Callable[[int, int], None] = lambda d, t: None,
    ) -> Iterator[Result]:
        """As `map`, one result after the other: no more are held than there are threads, twice."""
        bounds = self.block_bounds()
        with ThreadPoolExecutor(thread_count()) as pool:
            pending: deque[Future[Result]] = deque()
            for done, _ in enumerate(bounds, 1):
                while len(pending) < 2 * thread_count() and done - 1 + len(pending) < len(bounds):
                    first, stop = bounds[done - 1 + len(pending)]
                    pending.append(pool.submit(lambda a, b: work(self.read(a, b)), first, stop))
                yield pending.popleft().result()
                progress(done, len(bounds))

    def read_texels(self, texels: np.ndarray) -> Block:
        """The samples of some texels (n,), as of the texels 0..n of a smaller store."""
        low, high = np.empty((2, len(self._chunks), len(texels)), np.int64)
        for c, (_, columns) in enumerate(self._chunks):
            offsets = columns["offsets"].mapped()
            low[c], high[c] = offsets[texels], offsets[texels + 1]
        offsets = np.concatenate([[0], np.cumsum((high - low).sum(0))])
        frame = np.empty(offsets[-1], np.int32)
        rgb, quality = np.empty((offsets[-1], 3), np.uint8), np.empty(offsets[-1], np.uint8)
        cursor = offsets[:-1].copy()
        for c, (first_frame, columns) in enumerate(self._chunks):
            frames, colors, weights = (columns[name].mapped() for name in _COLUMNS)
            _gather_texels(
                low[c], high[c], frames, colors, weights, first_frame, cursor,
                frame, rgb, quality,
            )  # fmt: skip
        return Block(0, len(texels), offsets, frame, rgb, quality)

    def map_texels(
        self,
        work: Callable[[Block, slice], Result],
        texels: np.ndarray,
        progress: Callable[[int, int], None] = lambda d, t: None,
        samples: int = 1 << 19,
    ) -> list[Result]:
        """`work` on pieces of some texels (n,), ascending, on all cores, and on no others.

        It is given a piece's samples, from `read_texels`, and which of the n texels they are of;
        results come in the order of the pieces, which depend on the store and the texels alone.
        """
        total = np.concatenate([[0], np.cumsum(self.counts()[texels])])
        cuts = np.searchsorted(total, np.arange(samples, total[-1], samples))
        edges = np.unique(np.concatenate([[0], cuts, [len(texels)]])).tolist()
        pieces = [slice(a, b) for a, b in pairwise(edges)]
        results = []
        with ThreadPoolExecutor(thread_count()) as pool:
            found = pool.map(lambda own: work(self.read_texels(texels[own]), own), pieces)
            for done, result in enumerate(found, 1):
                results.append(result)
                progress(done, len(pieces))
        return results
