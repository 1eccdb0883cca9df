"""How many threads the heavy loops use, and that they alone use them."""

import os


def thread_count() -> int:
    """The processors this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def quieten_blas() -> None:
    """Let linear algebra have one thread: more would wait for work in circles, beside our loops.

    To be called before NumPy is imported, by programs; what the user has set stays.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
