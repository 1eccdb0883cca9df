"""The sample store: frames are projected once, and every texel's history is read in one piece.

A store is chunks of at most 256 frames (samples/chunks.py), 5 bytes a sample, or 9 of frames that
have more than 8 bits. Readers get blocks of
texels whose samples are the concatenation of a few slices, in the order of the frames.

write_store   project every frame; runs of frames that an earlier store has are taken from it
SampleStore   read blocks of texels, or some texels, on all cores
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from tokenize import TokenError
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..blocks import room, taken
from ..errors import DocumentError
from ..jit import kernel
from ..spread import Spread
from ..threads import thread_count
from .chunks import (
    COLUMNS,
    KINDS,
    MOST_FRAMES,
    TEXEL_BYTES,
    WORDS,
    Chunk,
    FileChunk,
    Held,
    Make,
    SampledFrame,
    bytes_of,
    columns,
    words_of,
)

DESCRIPTION = "store.json"
UNREADABLE = (
    OSError, ValueError, KeyError, TypeError, EOFError, OverflowError, RecursionError, SyntaxError,
    TokenError,
)  # fmt: skip
"""What NumPy, JSON and what is made of them raise on damaged files."""

Result = TypeVar("Result")

STEP = 16
"""Samples that are moved at once: a texel has few in a chunk."""


class Block(NamedTuple):
    """The samples of the texels first..stop, texel by texel, in the frames' order.

    offsets : (B+1,) int64 into the samples
    frame : (n,) int32; value : (n, 4) uint8, sRGB and quality, or uint16 (samples/chunks.py)
    """

    first: int
    stop: int
    offsets: np.ndarray
    frame: np.ndarray
    value: np.ndarray

    @property
    def rgb(self) -> np.ndarray:
        return self.value[:, :3]

    @property
    def quality(self) -> np.ndarray:
        return self.value[:, 3]


@kernel
def _add_counts(offsets, total):
    for i in range(len(total)):
        total[i] += np.int64(offsets[i + 1]) - np.int64(offsets[i])


@kernel
def _merge(spans, base, first_frame, frame, value, offsets, out_frame, out_value):
    """Put every texel's samples together, chunk after chunk, in whole steps of `STEP`.

    spans : (C, B + 1), offsets of the texels in the chunks; base : (C,), where a chunk's samples
    begin in frame and value; these and what is written have room for a step at their end
    """
    chunks, k = spans.shape[0], np.uint64(0)
    for i in range(len(offsets) - 1):
        for c in range(chunks):
            n, j = np.uint64(spans[c, i + 1] - spans[c, i]), np.uint64(0)
            start = np.uint64(base[c] + spans[c, i] - spans[c, 0])
            while j < n:
                for s in range(np.uint64(STEP)):
                    out_frame[k + j + s] = first_frame[c] + np.int32(frame[start + j + s])
                    out_value[k + j + s] = value[start + j + s]
                j += np.uint64(STEP)
            k += n
        offsets[i + 1] = k


@kernel
def _gather(low, high, frame, value, first_frame, cursor, out_frame, out_value):
    """Append each texel's slice low..high of a chunk to the block."""
    for i in range(len(cursor)):
        k = cursor[i]
        for j in range(low[i], high[i]):
            out_frame[k] = first_frame + frame[j]
            out_value[k] = value[j]
            k += 1
        cursor[i] = k


Found = tuple[Chunk, np.ndarray, np.ndarray]
"""A chunk, and of each of its frames how many samples there are and their mean quality."""


def write_store(
    folder: Path | None,
    texels: int,
    frames: int,
    sample: Callable[[int], SampledFrame],
    *,
    names: Sequence[str] | None = None,
    earlier: Sequence[SampleStore] = (),
    memory: int = 128 << 20,
    bits: int = 8,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> SampleStore:
    """Project every frame and write the store.

    After each chunk the folder holds a whole store of the frames so far, `earlier` to the next run.

    Parameters
    ----------
    folder : an empty folder; None: the samples stay in memory
    texels, frames : how many there are
    sample : frame index to its samples, their texels ascending; called from threads
    names : of each frame: the same name, the same samples; None: they have none
    earlier : stores whose chunks are linked where the names of all their frames come in a row
    memory : bytes of samples to hold before a chunk is written
    bits : of the samples' values, 8 or 16
    """
    names = list(names) if names is not None else [""] * frames
    if len(names) != frames:
        raise ValueError(f"names: expected one for each of the {frames} frames")
    store = SampleStore(texels, [], names=[], seen=[], quality=[], bits=bits)
    numbers = count()

    def keep(chunk: Chunk) -> Chunk:
        return chunk if folder is None else chunk.save(folder, next(numbers))

    with ThreadPoolExecutor(thread_count()) as pool:

        def project(first: int, stop: int) -> Iterator[Found]:
            return _project(
                pool, sample, first, stop, texels, memory, store.kind, keep, folder is not None,
                lambda done: progress(done, frames),
            )  # fmt: skip

        for first, stop, taken in runs_known(names, texels, bits, earlier):
            for chunk, seen, quality in (
                [(keep(taken[0]), *taken[1:])] if taken else project(first, stop)
            ):
                own = names[store.frames : store.frames + chunk.frames]
                store.append(chunk, own, seen, quality)
                if folder is not None:
                    store.describe(folder)
            if taken:
                progress(stop, frames)
    if folder is not None:
        store.describe(folder)
    return store


def runs_known(
    names: Sequence[str], texels: int, bits: int, earlier: Sequence[SampleStore]
) -> Iterator[tuple[int, int, Found | None]]:
    """Runs first..stop of the frames of these names: a chunk of an earlier store that has them, or
    None where none has."""
    known = {
        tuple(store.names[first : first + chunk.frames]): (
            chunk,
            store.seen[first : first + chunk.frames],
            store.quality[first : first + chunk.frames],
        )
        for store in earlier
        if (store.texels, store.bits) == (texels, bits)
        for first, chunk in store.placed()
        if all(store.names[first : first + chunk.frames])
    }
    starts: dict[str, list[tuple[str, ...]]] = {}
    for run in known:
        starts.setdefault(run[0], []).append(run)
    first = at = 0
    while at < len(names):
        runs = (r for r in starts.get(names[at], ()) if tuple(names[at : at + len(r)]) == r)
        run = max(runs, key=len, default=())
        if not run:
            at += 1
            continue
        if first < at:
            yield first, at, None
        yield at, at + len(run), known[run]
        first = at = at + len(run)
    if first < at:
        yield first, at, None


def _project(
    pool: ThreadPoolExecutor, sample: Callable[[int], SampledFrame], first: int, stop: int,
    texels: int, memory: int, kind: type, keep: Callable[[Chunk], Chunk], written_out: bool,
    done: Callable[[int], None],
) -> Iterator[Found]:  # fmt: skip
    """Chunks of the frames first..stop, kept; the next one is filled meanwhile.

    written_out : whether `keep` lets go of what a chunk is made of, which the next one then is made
        of: fresh memory is slow the first time that it is touched
    """
    each = TEXEL_BYTES + WORDS[np.dtype(kind)].itemsize
    most = texels + min(memory // each, texels * min(stop - first, MOST_FRAMES))
    make: Make = room if each * texels > memory else np.empty  # of a huge object, that is
    held, spare = Held(most, kind, make), Held(most, kind, make)
    again = columns(most, kind, make) if written_out else None
    written: Future[Found] | None = None

    def finish(full: Held) -> Found:
        out = again or columns(full.samples, kind)
        return keep(full.transpose(texels, pool, out)), full.seen, full.quality

    ahead = int(np.clip(2 * memory // (each * max(texels, 1)), 1, 2 * thread_count()))
    pending = deque(pool.submit(sample, f) for f in range(first, min(first + ahead, stop)))
    with ThreadPoolExecutor(1) as writer:
        try:
            for f in range(first, stop):
                held.append(pending.popleft().result())
                if f + ahead < stop:
                    pending.append(pool.submit(sample, f + ahead))
                if held.bytes > memory or len(held) == MOST_FRAMES or f == stop - 1:
                    if written:
                        yield written.result()
                    written = writer.submit(finish, held)
                    held, spare = spare, held
                    held.clear()
                done(f + 1)
        except (Exception, KeyboardInterrupt):
            if written:
                yield written.result()
            raise
        if written:
            yield written.result()


def _check(chunk: Chunk, texels: int, index: int) -> None:
    """Kernels follow the offsets without looking: they must stay within the chunk's columns."""
    offsets, frame, value = (chunk.mapped(name) for name in ("offsets", *COLUMNS))
    right = (
        isinstance(chunk.frames, int)
        and len(offsets) == texels + 1
        and offsets[0] == 0
        and offsets[-1] == len(frame) == len(value)
        and bool((offsets[1:] >= offsets[:-1]).all())
    )
    if not right:
        raise ValueError(f"chunk {index} does not fit together")


def _damaged(folder: Path, why: object) -> DocumentError:
    return DocumentError(
        f"{folder}: the samples are damaged ({why}): apply compute_svbrdf_samples again, with "
        "--force"
    )


def _cut(counts: np.ndarray, samples: int) -> np.ndarray:
    """Where texels (n,) are cut into pieces of about so many samples: 0, …, n."""
    total = room(len(counts) + 1, np.int64)
    total[0] = 0
    np.cumsum(counts, out=total[1:])
    cuts = np.searchsorted(total, np.arange(samples, total[-1], samples))
    return np.unique(np.concatenate([[0], cuts, [len(counts)]]))


@dataclass(frozen=True)
class _Reading:
    """Work on a block that is read where the work is done."""

    store: SampleStore
    work: Callable[[Block], Any]

    def __call__(self, bounds: tuple[int, int]) -> Any:
        return self.work(self.store.read(*bounds))


class SampleStore:
    """Chunks in the frames' order; memory stays at a block, whatever the number of frames.

    texels, frames : how many there are; seen : (F,) int64, samples of each frame
    quality : (F,) float64, the mean of a frame's samples
    names : what each frame's samples were made from, "" where that is not known
    bits : of the samples' values, 8 or 16; kind : their type
    spread : where `rows` has its work done; None: on this process's threads
    """

    def __init__(
        self,
        texels: int,
        chunks: Sequence[Chunk],
        *,
        names: Sequence[str],
        seen: Sequence[int],
        quality: Sequence[float],
        bits: int = 8,
    ) -> None:
        self.texels = texels
        self.chunks = list(chunks)
        self.names = list(names)
        self.seen = np.array(seen, np.int64)
        self.quality = np.array(quality, np.float64)
        self.folder: Path | None = None
        self.bits = bits
        self.kind = KINDS[bits]
        self.spread: Spread | None = None
        self._counts: np.ndarray | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What a worker needs of it; of chunks in files that is their place."""
        return self.__dict__ | {"spread": None, "_counts": None}

    @classmethod
    def open(cls, folder: Path) -> SampleStore:
        """What `write_store` left in a folder.

        Raises DocumentError where it is damaged, or not there.
        """
        try:
            told = json.loads((folder / DESCRIPTION).read_text())
            texels, sizes, names = told["texels"], told["chunks"], told["names"]
            bits = told.get("bits", 8)
            chunks = [FileChunk(folder, k, size, KINDS[bits]) for k, size in enumerate(sizes)]
            store = cls(
                texels, chunks, names=names, seen=told["seen"], quality=told["quality"], bits=bits
            )
            if not (sum(sizes) == len(names) == store.frames == len(store.quality)):
                raise ValueError(f"{DESCRIPTION}: the frames of its chunks are others than its own")
            for k, chunk in enumerate(chunks):
                _check(chunk, texels, k)
        except UNREADABLE as error:
            raise _damaged(folder, error) from None
        store.folder = folder
        return store

    @property
    def frames(self) -> int:
        return len(self.seen)

    def append(
        self, chunk: Chunk, names: Sequence[str], seen: np.ndarray, quality: np.ndarray
    ) -> None:
        self.chunks.append(chunk)
        self._counts = None
        self.names += names
        self.seen = np.concatenate([self.seen, seen])
        self.quality = np.concatenate([self.quality, quality])

    def describe(self, folder: Path) -> None:
        """Write what `open` reads, whole or not at all."""
        told = {
            "texels": self.texels, "chunks": [chunk.frames for chunk in self.chunks],
            "names": self.names, "seen": self.seen.tolist(), "quality": self.quality.tolist(),
            "bits": self.bits,
        }  # fmt: skip
        temporary = folder / f".{DESCRIPTION}.part"
        temporary.write_text(json.dumps(told))
        temporary.replace(folder / DESCRIPTION)

    def placed(self) -> Iterator[tuple[int, Chunk]]:
        """Every chunk with its first frame."""
        first = 0
        for chunk in self.chunks:
            yield first, chunk
            first += chunk.frames

    def __len__(self) -> int:
        """How many samples there are."""
        return int(self.seen.sum())

    def counts(self) -> np.ndarray:
        """Samples per texel, (T,) int64, not to be written to."""
        if self._counts is None:
            total = room(self.texels, np.int64)
            total[:] = 0
            for chunk in self.chunks:
                offsets = room(self.texels + 1, np.uint32)
                chunk.read("offsets", 0, offsets)
                _add_counts(offsets, total)
            total.flags.writeable = False
            self._counts = total
        return self._counts

    def read(self, first: int, stop: int) -> Block:
        """The samples of the texels first..stop."""
        spans = np.empty((len(self.chunks), stop - first + 1), np.uint32)
        for span, chunk in zip(spans, self.chunks, strict=True):
            chunk.read("offsets", first, span)
        sizes = spans[:, -1].astype(np.int64) - spans[:, 0]
        base = np.concatenate([[0], np.cumsum(sizes)])
        total = int(base[-1])
        frames = np.empty(total + STEP, np.uint8)
        values: np.ndarray = np.empty((total + STEP, 4), self.kind)
        for chunk, low, (a, b) in zip(self.chunks, spans[:, 0], pairwise(base), strict=True):
            for name, rows in zip(COLUMNS, (frames, values), strict=True):
                chunk.read(name, int(low), rows[a:b])
            self._check_frames(frames[a:b], chunk.frames)
        offsets = np.zeros(stop - first + 1, np.int64)
        frame = np.empty(total + STEP, np.int32)
        value = np.empty(total + STEP, WORDS[np.dtype(self.kind)])
        starts = np.array([first_frame for first_frame, _ in self.placed()], np.int32)
        _merge(spans, base, starts, frames, words_of(values), offsets, frame, value)
        return Block(first, stop, offsets, frame[:total], bytes_of(value[:total]))

    def _check_frames(self, frame: np.ndarray, frames: int) -> None:
        """Kernels look cameras up by these numbers."""
        if len(frame) and frame.max() >= frames:
            raise _damaged(self.folder or Path(), f"one is of frame {frame.max()} of {frames}")

    def block_bounds(self, samples: int = 1 << 21) -> list[tuple[int, int]]:
        """Ranges of texels with about `samples` samples each; they depend on the store alone."""
        edges = _cut(self.counts(), samples)
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

    def rows(
        self,
        work: Callable[[Block], Sequence[np.ndarray]],
        progress: Callable[[int, int], None] = lambda d, t: None,
    ) -> list[np.ndarray]:
        """Arrays with a row per texel: `work` gives those of every block, wherever it runs.

        work : as `Spread` wants it
        """
        bounds = self.block_bounds()
        parts = self.spread(_Reading(self, work), bounds) if self.spread else self.stream(work)
        whole: list[np.ndarray] = []
        for done, ((first, stop), part) in enumerate(zip(bounds, parts, strict=True), 1):
            whole = whole or [room((self.texels, *p.shape[1:]), p.dtype) for p in part]
            for rows, own in zip(whole, part, strict=True):
                rows[first:stop] = own
            progress(done, len(bounds))
        return whole

    def read_texels(self, texels: np.ndarray) -> Block:
        """The samples of some texels (n,), as of the texels 0..n of a smaller store."""
        low, high = np.empty((2, len(self.chunks), len(texels)), np.int64)
        for c, chunk in enumerate(self.chunks):
            offsets = chunk.mapped("offsets")
            low[c], high[c] = offsets[texels], offsets[texels + 1]
        offsets = np.concatenate([[0], np.cumsum((high - low).sum(0))])
        frame = np.empty(offsets[-1], np.int32)
        value = np.empty(offsets[-1], WORDS[np.dtype(self.kind)])
        cursor = offsets[:-1].copy()
        for c, (first_frame, chunk) in enumerate(self.placed()):
            frames, values = (chunk.mapped(name) for name in COLUMNS)
            _gather(low[c], high[c], frames, words_of(values), first_frame, cursor, frame, value)
        self._check_frames(frame, self.frames)
        return Block(0, len(texels), offsets, frame, bytes_of(value))

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
        edges = _cut(taken(self.counts(), texels), samples)
        pieces = [slice(a, b) for a, b in pairwise(edges.tolist())]
        results = []
        with ThreadPoolExecutor(thread_count()) as pool:
            found = pool.map(lambda own: work(self.read_texels(texels[own]), own), pieces)
            for done, result in enumerate(found, 1):
                results.append(result)
                progress(done, len(pieces))
        return results
