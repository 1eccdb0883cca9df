"""How many threads the heavy loops use, and that they alone use them."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from threading import local
from typing import Any, TypeVar

from .blocks import BLOCK

Result = TypeVar("Result")
PIECES = 32

_own = local()


def thread_count() -> int:
    """The processors this process may run on, unless the thread that asks is `alone`."""
    if getattr(_own, "alone", False):
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_pieces(work: Callable[[int, int], Result], count: int) -> list[Result]:
    """`work`(first, stop) on ranges of 0..count, on all cores; the ranges depend on count alone."""
    pieces = max(PIECES, -(-count // BLOCK))
    edges = [count * piece // pieces for piece in range(pieces + 1)]
    if thread_count() == 1:
        return [work(first, stop) for first, stop in pairwise(edges)]
    with ThreadPoolExecutor(thread_count()) as pool:
        return list(pool.map(lambda ends: work(*ends), pairwise(edges)))


def side_by_side(*works: Callable[[], Any]) -> list[Any]:
    """What some works give that do not wait for each other; the first one's error, if several."""
    if thread_count() == 1:
        return [work() for work in works]
    with ThreadPoolExecutor(thread_count()) as pool:
        return list(pool.map(lambda work: work(), works))


def quieten_blas() -> None:
    """Let linear algebra have one thread: more would wait for work in circles, beside our loops.

    To be called before NumPy is imported, by programs; what the user has set stays.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextmanager
def alone() -> Iterator[None]:
    """What this thread does within starts no others: its neighbours do the same work."""
    _own.alone = True
    try:
        yield
    finally:
        _own.alone = False
