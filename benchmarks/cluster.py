"""What more than one machine gains: run time by workers, bytes moved, overhead, and from them what
100 machines and 10,000 objects would take.

The work is `meshlab-svbrdf bench`'s; workers are processes of one thread each on this machine, and
run each kernel once before the clock starts. Bytes are those of the pickled objects.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from meshlab_svbrdf.bench.child import metered, sizes_of, warm_up
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.cluster import Cluster
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.samples.store import SampleStore
from meshlab_svbrdf.script import run_script
from meshlab_svbrdf.spread import Item, Result

from .cluster_tables import EMPTY, PROCESSOR, WORKLOAD, tables
from .ledger import Row, Task
from .solve import TEXTURE

__all__ = ["PART", "tables", "tasks"]
PART = "cluster"
WORKERS = (0, 1, 2)  # 0: the threads of one process
PLAIN = {"NUMBA_CPU_NAME": "generic"}
"""What kernels are compiled for, as if a worker's processor had no wide vectors."""
FEW = 24  # frames that such a worker is given


def tasks(frames: int, texture: int, cache: Path | None) -> tuple[list[Task], list[str]]:
    """What is measured, and what cannot be. frames, texture : of the workload, kept in `cache`"""
    if find_spec("distributed") is None:
        return [], [f"{PART}: left out, Dask is not installed (meshlab-svbrdf[cluster])"]
    about = f"{frames} frames, {texture} texels"
    found = [
        Task(PART, WORKLOAD, _name(n), about, partial(_measure, n, frames, texture, cache))
        for n in WORKERS
    ]
    make = partial(_other_processor, texture // 2, cache)
    found.append(Task(PART, PROCESSOR, "plain x86-64", f"{texture} texels", make))
    return found, []


def _name(workers: int) -> str:
    return "one process" if workers == 0 else f"{workers} worker{'s' * (workers > 1)}"


class _Counted:
    """The workers, and how much they were given and gave."""

    def __init__(self, client: Any) -> None:
        self.client, self.cluster = client, Cluster(client)
        self.told: dict[str, float] = {}

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        told = {"tasks": len(items), "sent": _size(work), "given": sum(map(_size, items))}
        told |= {"returned": 0, "task_cpu": 0.0}
        for result, seconds in self.cluster(_Timed(work), items):
            told["returned"] += _size(result)
            told["task_cpu"] += seconds
            yield result
        self.told = {key: self.told.get(key, 0) + value for key, value in told.items()}


class _Timed:
    """What a task gives, and the CPU seconds it took: an idle worker takes some as well."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.work = work

    def __call__(self, item: Any) -> tuple[Any, float]:
        began = time.process_time()
        return self.work(item), time.process_time() - began


def _size(value: Any) -> int:
    """Bytes of an object as Dask sends it."""
    from distributed.protocol import pickle

    buffers: list[Any] = []
    return len(pickle.dumps(value, buffer_callback=buffers.append)) + sum(
        b.raw().nbytes for b in buffers
    )


@contextmanager
def _workers(count: int, **environment: str) -> Iterator[Any]:
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        if count == 0:
            yield None
            return
        started = stack.enter_context(
            LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                dashboard_address=":0",
                memory_limit=0,
                env=environment,
            )
        )
        yield stack.enter_context(Client(started))


def _measure(workers: int, frames: int, texture: int, cache: Path | None, folder: Path) -> Row:
    workload = make_workload(cache, frames, Options())
    warm_up()
    row: Row = {"workers": workers, "cores": len(os.sched_getaffinity(0))}
    began = time.perf_counter()
    with _workers(workers) as client:
        if client is not None:
            row["start"] = time.perf_counter() - began
            client.run(warm_up)
            began = time.process_time()
            for _ in Cluster(client)(abs, range(EMPTY)):
                pass
            row["empty"] = (time.process_time() - began) / EMPTY
        document = Document.open(workload.first(frames), folder)
        row["stages"] = list(_stages(document, client, texture))
        row |= sizes_of(document)
    row["frame_bytes"] = workload.bytes / workload.frames * frames
    row["result_bytes"] = _bytes_of(folder) - row["store_bytes"]
    row["digest"] = hashlib.sha256(document.attribute("diffuse").tobytes()).hexdigest()
    return row


def _other_processor(texture: int, cache: Path | None, folder: Path) -> Row:
    """How far D is from one process's where all that spreads was compiled for another processor."""
    workload = make_workload(cache, FEW, Options())
    steps = chain("joint", "full", {TEXTURE: str(texture)})
    steps = steps[: [step.name for step in steps].index("compute_svbrdf_diffuse_color") + 1]
    found = []
    with _workers(1, **PLAIN) as client:
        for name, spread in (("here", None), ("there", Cluster(client))):
            document = Document.open(workload.first(FEW), folder / name)
            document.spread = spread
            for _ in run_script(document, steps):
                pass
            store = SampleStore.open(document.folder / "samples").read(0, len(document.texels()))
            found.append((store, document.attribute("diffuse")))
    (one, d), (other, e) = found
    row: Row = {"frames": FEW, "samples": len(one.value), "others": len(other.value)}
    if len(one.value) == len(other.value):
        row["differ"] = int((one.value != other.value).any(1).sum())
    away = np.abs(d - e)[np.isfinite(d) & np.isfinite(e)]
    row["most"], row["typical"] = float(away.max()), float(np.quantile(away, 0.999))
    return row


def _stages(document: Document, client: Any, texture: int) -> Iterator[dict[str, Any]]:
    steps = chain("joint", "full", {TEXTURE: str(texture)})
    outcomes = run_script(document, steps)
    while True:
        document.spread = spread = None if client is None else _Counted(client)
        before = _cpu(client)
        with metered() as figures:
            outcome = next(outcomes, None)
        if outcome is None:
            return
        told = spread.told if spread else {}
        yield {"name": outcome.name, "workers_cpu": _cpu(client) - before, **figures, **told}


def _cpu(client: Any) -> float:
    """CPU seconds of all workers so far."""
    return 0.0 if client is None else sum(client.run(time.process_time).values())


def _bytes_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
