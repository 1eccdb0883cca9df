"""What this machine can do, measured: memory copied and multiply-adds done per second.

And starting measurements in processes of their own, on some of the cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SvbrdfError
from ..jit import kernel
from ..threads import thread_count

COPIED = 64 << 20  # bytes per thread and copy: beyond the caches
ROUNDS = 1 << 22


def machine() -> dict[str, float]:
    """cores; copy_bytes : bytes read and written per second by copying; operations : per second.

    Operations are multiplications and additions of single numbers in float64, eight chains at once:
    what a kernel without vector instructions reaches at best.
    """
    threads = thread_count()
    sources = [np.ones(COPIED // 8) for _ in range(threads)]
    targets = [np.zeros_like(source) for source in sources]

    def copy(k: int) -> None:
        np.copyto(targets[k], sources[k])

    def add(k: int) -> None:
        _multiply_add(ROUNDS, 1 + 1e-9 * k)

    _multiply_add(1, 1.0)
    return {
        "cores": threads,
        "copy_bytes": 2 * threads * COPIED / _fastest(copy, threads),
        "operations": 16 * threads * ROUNDS / _fastest(add, threads),
    }


@kernel
def _multiply_add(rounds, x):
    a = b = c = d = e = f = g = h = x
    for _ in range(rounds):
        a, b, c, d = a * x + 1e-9, b * x + 2e-9, c * x + 3e-9, d * x + 4e-9
        e, f, g, h = e * x + 5e-9, f * x + 6e-9, g * x + 7e-9, h * x + 8e-9
    return a + b + c + d + e + f + g + h


def _fastest(work: Callable[[int], None], threads: int, times: int = 5) -> float:
    """Seconds of the fastest of several goes, `work(k)` on each thread."""
    taken = []
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(times):
            start = time.perf_counter()
            list(pool.map(work, range(threads)))
            taken.append(time.perf_counter() - start)
    return min(taken)


@contextmanager
def cores(count: int | None) -> Iterator[None]:
    """What starts inside runs on that many of this process's cores; None: on all."""
    if count is None:
        yield
        return
    if not hasattr(os, "sched_setaffinity"):
        raise SvbrdfError("this system cannot keep a process to some of the cores (Linux can)")
    ours = os.sched_getaffinity(0)
    if count > len(ours):
        raise SvbrdfError(f"{count} threads asked for, this process has {len(ours)} cores")
    os.sched_setaffinity(0, sorted(ours)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, ours)


def measure(
    task: str, threads: int | None = None, environment: dict[str, str] | None = None, **arguments
) -> dict[str, Any]:
    """Run a task of `child.py` in a process of its own.

    Raises SvbrdfError where it fails; what it wrote to stderr was shown.
    """
    with tempfile.TemporaryDirectory(prefix="svbrdf-bench-") as place:
        request, answer = Path(place) / "request.json", Path(place) / "answer.json"
        request.write_text(json.dumps({"task": task, "arguments": arguments}))
        command = [sys.executable, "-m", "meshlab_svbrdf.bench.child", str(request), str(answer)]
        with cores(threads):
            done = subprocess.run(command, env=os.environ | (environment or {}))
        if done.returncode != 0:
            raise SvbrdfError(f"the measurement {task} ended with {done.returncode}, see above")
        return json.loads(answer.read_text())
