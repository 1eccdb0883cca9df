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

from meshlab_svbrdf.bench.child import metered, sizes_of, warm_up
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.cluster import Cluster
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import run_script
from meshlab_svbrdf.spread import Item, Result

from .ledger import Row, Task
from .solve import TEXTURE
from .tables import Table

PART = "cluster"
WORKERS = (0, 1, 2, 3)  # 0: the threads of one process
EMPTY = 1000  # tasks that do nothing
NETWORK = 125e6  # bytes a second of a machine's line of 1 Gbit/s
DISK = 1e9  # bytes a second of a shared disk
PASSES = ("compute_svbrdf_luminance_threshold", "compute_svbrdf_diffuse_color",
          "compute_svbrdf_material_specular")  # fmt: skip
SAMPLES = "compute_svbrdf_samples"
OBJECTS, MACHINES = 10_000, (1, 10, 100, 1000)


def tasks(frames: int, texture: int, cache: Path | None) -> tuple[list[Task], list[str]]:
    """What is measured, and what cannot be. frames, texture : of the workload, kept in `cache`"""
    if find_spec("distributed") is None:
        return [], [f"{PART}: left out, Dask is not installed (meshlab-svbrdf[cluster])"]
    about = f"{frames} frames, {texture} texels"
    return [
        Task(PART, "workload", _name(n), about, partial(_measure, n, frames, texture, cache))
        for n in WORKERS
    ], []


def _name(workers: int) -> str:
    return "one process" if workers == 0 else f"{workers} worker{'s' * (workers > 1)}"


class _Counted:
    """The workers, and how much they were given and gave."""

    def __init__(self, client: Any) -> None:
        self.client, self.cluster = client, Cluster(client)
        self.told: dict[str, int] = {}

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        told = {"tasks": len(items), "sent": _size(work), "given": sum(map(_size, items))}
        told["returned"] = 0
        for result in self.cluster(work, items):
            told["returned"] += _size(result)
            yield result
        self.told = {key: self.told.get(key, 0) + value for key, value in told.items()}


def _size(value: Any) -> int:
    """Bytes of an object as Dask sends it."""
    from distributed.protocol import pickle

    buffers: list[Any] = []
    return len(pickle.dumps(value, buffer_callback=buffers.append)) + sum(
        b.raw().nbytes for b in buffers
    )


@contextmanager
def _workers(count: int) -> Iterator[Any]:
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        if count == 0:
            yield None
            return
        started = stack.enter_context(
            LocalCluster(
                n_workers=count, threads_per_worker=1, dashboard_address=":0", memory_limit=0
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
            began = time.perf_counter()
            for _ in Cluster(client)(abs, range(EMPTY)):
                pass
            row["empty"] = (time.perf_counter() - began) / EMPTY
        document = Document.open(workload.first(frames), folder)
        row["stages"] = list(_stages(document, client, texture))
        row |= sizes_of(document)
    row["frame_bytes"] = workload.bytes / workload.frames * frames
    row["result_bytes"] = _bytes_of(folder) - row["store_bytes"]
    row["digest"] = hashlib.sha256(document.attribute("diffuse").tobytes()).hexdigest()
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


def tables(rows: Sequence[Row]) -> list[Table]:
    good = [row for row in rows if "error" not in row]
    made = [_times(good)] if good else []
    some = [row for row in good if row["workers"]]
    here = next((row for row in good if not row["workers"]), None)
    if some:
        made.append(_moved(some[-1]))
    if some and here:
        made += [_one_object(here, some[-1]), _many_objects(here, some[-1])]
    return made


def _sum(row: Row, key: str, spread: bool | None = None) -> float:
    """Over the stages; spread : over those alone that gave workers something, or over the others"""
    names = (SAMPLES, *PASSES)
    return sum(s[key] for s in row["stages"] if spread is None or (s["name"] in names) == spread)


def _times(rows: Sequence[Row]) -> Table:
    cells = [
        [
            row["name"], f"{_sum(row, 'seconds'):.1f}", f"{_sum(row, 'seconds', True):.1f}",
            f"{_sum(row, 'cpu_seconds'):.1f}", f"{_sum(row, 'workers_cpu'):.1f}",
            f"{row['start']:.1f}" if "start" in row else "–",
            "yes" if row["digest"] == rows[0]["digest"] else "NO",
        ]
        for row in rows
    ]  # fmt: skip
    one = rows[0]
    return Table(
        f"{one['frames']} frames, {one['texels']:,} texels, {one['samples']:,} samples, on "
        f"{one['cores']} cores",
        ["by", "s", "of these stages that spread", "CPU s here", "CPU s of workers",
         "s to start them", "D the same, bit by bit"],
        cells,
    )  # fmt: skip


def _moved(row: Row) -> Table:
    cells = []
    for stage in row["stages"]:
        n = stage.get("tasks")
        if not n:
            cells.append([stage["name"], f"{stage['cpu_seconds']:.1f}", *["–"] * 7])
            continue
        read = row["frame_bytes"] if stage["name"] == SAMPLES else row["store_bytes"]
        wrote = row["store_bytes"] if stage["name"] == SAMPLES else 0
        cells.append([
            stage["name"], f"{stage['cpu_seconds']:.1f}", f"{n}",
            f"{stage['workers_cpu'] / n:.2f}", f"{stage['sent'] / 1e6:.1f}",
            f"{stage['given'] / n:.0f}", f"{stage['returned'] / n / 1e3:,.1f}",
            f"{read / n / 1e6:.1f}", f"{wrote / n / 1e6:.1f}",
        ])  # fmt: skip
    return Table(
        "What moves",
        ["stage", "CPU s here", "tasks", "CPU s each", "MB to each worker, once", "bytes to a task",
         "kB from a task", "MB a task reads", "writes"],
        cells,
        (f"A task that does nothing takes {1e3 * row['empty']:.2f} ms, {EMPTY} at once.",),
    )  # fmt: skip


def _one_object(here: Row, row: Row) -> Table:
    """Amdahl: what spreads is divided, what does not stays, what travels is added."""
    rest = _sum(here, "seconds", False) + _sum(row, "cpu_seconds", True)
    work = _sum(row, "workers_cpu", True)
    stages = [s for s in row["stages"] if s.get("tasks")]
    sent, given = (sum(s[key] for s in stages) for key in ("sent", "returned"))
    count = sum(s["tasks"] for s in stages)
    disk = here["frame_bytes"] + (1 + len(PASSES)) * here["store_bytes"]
    cells = []
    for cores in MACHINES:
        each = min(cores, max(s["tasks"] for s in stages))
        line = sent * max(cores.bit_length(), 1) / NETWORK + given / NETWORK + count * row["empty"]
        shared = max(work / each, disk / DISK)
        cells.append([
            f"{cores}", f"{rest:.1f}", f"{work / each:.1f}", f"{disk / DISK:.1f}", f"{line:.1f}",
            f"{rest + shared + line:.1f}",
        ])  # fmt: skip
    return Table(
        f"On paper: one object of {here['frames']} frames",
        ["workers' cores", "s that do not spread", "s of work", "s of the shared disk",
         "s of network and scheduler", "s"],
        cells,
        (f"A network of {NETWORK / 1e6:.0f} MB/s and a shared disk of {DISK / 1e6:.0f} MB/s; "
         "work and disk overlap; there are no more tasks than "
         f"{max(s['tasks'] for s in stages)} in a stage.",),
    )  # fmt: skip


def _many_objects(here: Row, row: Row) -> Table:
    """Objects as tasks: a machine such as this one each."""
    each = _sum(here, "seconds")
    moved = here["frame_bytes"] + (1 + len(PASSES)) * here["store_bytes"] + here["result_bytes"]
    kept = here["store_bytes"] + here["result_bytes"]
    cells = []
    for machines in MACHINES:
        rate = min(machines / each, DISK / moved)
        cells.append([
            f"{machines:,}", f"{OBJECTS / rate / 3600:,.1f}", f"{machines / each * 3600:,.0f}",
            f"{machines / each * moved / 1e6:,.0f}", f"{100 * rate * row['empty']:.3f} %",
        ])  # fmt: skip
    return Table(
        f"On paper: {OBJECTS:,} objects of {here['frames']} frames",
        ["machines", "hours", "objects an hour, but for the disk", "MB/s of the shared disk",
         "of the scheduler's time"],
        cells,
        (
            f"An object takes {each:.0f} s on {here['cores']} cores and moves "
            f"{moved / 1e9:.2f} GB; {kept / 1e9:.2f} GB stay, {kept * OBJECTS / 1e12:.1f} TB of "
            f"all, {here['result_bytes'] * OBJECTS / 1e12:.1f} TB without samples.",
            f"A disk of {DISK / 1e6:.0f} MB/s is full at {DISK / moved * each:.0f} machines.",
        ),
    )  # fmt: skip
