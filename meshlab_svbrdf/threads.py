"""How many threads the heavy loops use, and that they alone use them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import local

_own = local()


def thread_count() -> int:
    """The processors this process may run on, unless the thread that asks is `alone`."""
    if getattr(_own, "alone", False):
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
