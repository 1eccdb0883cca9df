"""How many threads the heavy loops use, and that they alone use them."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import local
from typing import Any

_own = local()


def thread_count() -> int:
    """The processors this process may run on, unless the thread that asks is `alone`."""
    if getattr(_own, "alone", False):
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
