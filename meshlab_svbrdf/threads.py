"""How many threads the heavy loops use."""

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


@contextmanager
def alone() -> Iterator[None]:
    """What this thread does within starts no others: its neighbours do the same work."""
    _own.alone = True
    try:
        yield
    finally:
        _own.alone = False
