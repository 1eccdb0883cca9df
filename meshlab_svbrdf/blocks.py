"""Long arrays block by block: what is computed from a block may be large, the block is not.

blocks      slices of a long array             room     a long array that need not be in memory
rowwise     what is computed from each row     resting  a copy that need not be
taken       the rows at some places            places   where a mask is true
transposed  rows turned into columns           counted  how often each label comes
in_pieces   work on ranges, on all cores
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from .errors import SvbrdfError
from .threads import thread_count

Result = TypeVar("Result")
BLOCK = 1 << 18
PIECES = 32
LARGE = int(os.environ.get("MESHLAB_SVBRDF_LARGE", 64 << 20))
"""Bytes from which on a working array lies in a file."""


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices that cover 0..count in order, `size` elements each but for the last."""
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


def room(shape: int | tuple[int, ...], kind: Any) -> np.ndarray:
    """An array to be filled: a large one in a temporary file without a name, mapped.

    Its pages leave memory where that is wanted. The disk's room is taken at once.

    Raises SvbrdfError where the disk has none.
    """
    empty = np.empty(0, kind)
    size = int(np.prod(shape, dtype=np.int64)) * empty.itemsize
    if size < LARGE or not hasattr(os, "posix_fallocate"):
        return np.empty(shape, kind)
    with tempfile.TemporaryFile(prefix="svbrdf-") as file:
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            raise SvbrdfError(
                f"{tempfile.gettempdir()}: no room for {size / 1e9:.1f} GB that are worked on "
                f"({error.strerror}): make room on the disk, or set TMPDIR to a folder that has it"
            ) from None
        return np.asarray(np.memmap(file, empty.dtype, "r+", shape=shape))


def resting(values: np.ndarray) -> np.ndarray:
    """The same values; large ones in a temporary file (`room`)."""
    if values.nbytes < LARGE:
        return values
    copy = room(values.shape, values.dtype)
    copy[...] = values
    return copy


def rowwise(work: Callable[..., np.ndarray], *columns: np.ndarray) -> np.ndarray:
    """`work` of columns that are as long as one another, which gives a row for each row."""
    whole = work(*(column[:0] for column in columns))
    whole = room((len(columns[0]), *whole.shape[1:]), whole.dtype)
    for own in blocks(len(whole)):
        whole[own] = work(*(column[own] for column in columns))
    return whole


def transposed(rows: np.ndarray, kind: Any) -> np.ndarray:
    """The columns of rows (n, k) as (k, n) of that type, which may be long."""
    columns = room(rows.shape[::-1], kind)
    columns[...] = rows.T
    return columns


def taken(values: np.ndarray, *at: np.ndarray) -> np.ndarray:
    """values[at], which may be long."""
    return rowwise(lambda *own: values[own], *at)


def places(mask: np.ndarray) -> np.ndarray:
    """np.flatnonzero of a mask (n,) bool, int64, which may be long."""
    found, count = room(int(np.count_nonzero(mask)), np.int64), 0
    for own in blocks(len(mask)):
        here = np.flatnonzero(mask[own])
        found[count : count + len(here)] = here + own.start
        count += len(here)
    return found


def counted(labels: np.ndarray) -> np.ndarray:
    """np.bincount of the labels (n,) int that are 0 or more."""
    count = np.zeros(int(labels.max(initial=-1)) + 1, np.int64)
    for own in blocks(len(labels)):
        here = labels[own]
        count += np.bincount(here[here >= 0], minlength=len(count))
    return count


def in_pieces(work: Callable[[int, int], Result], count: int) -> list[Result]:
    """`work`(first, stop) on ranges of 0..count, on all cores; the ranges depend on count alone."""
    pieces = max(PIECES, -(-count // BLOCK))
    edges = [count * piece // pieces for piece in range(pieces + 1)]
    if thread_count() == 1:
        return [work(first, stop) for first, stop in pairwise(edges)]
    with ThreadPoolExecutor(thread_count()) as pool:
        return list(pool.map(lambda ends: work(*ends), pairwise(edges)))
