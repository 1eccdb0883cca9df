"""Tables of what more machines gain, and what 100 machines and 10,000 objects would take.

What is on paper goes by CPU seconds, which other work on the machine changes least: as if the cores
were always busy, which is the least time that it can take.
"""

from __future__ import annotations

from collections.abc import Sequence

from .ledger import Row
from .tables import Table

WORKLOAD, PROCESSOR = "workload", "processor"
EMPTY = 1000  # tasks that do nothing
NETWORK = 125e6  # bytes a second of a machine's line of 1 Gbit/s
DISK = 1e9  # bytes a second of a shared disk
PASSES = ("compute_svbrdf_luminance_threshold", "compute_svbrdf_diffuse_color",
          "compute_svbrdf_material_specular")  # fmt: skip
SAMPLES = "compute_svbrdf_samples"
OBJECTS, MACHINES = 10_000, (1, 10, 100, 1000)
LONGER = (1, 10)
"""As many frames as were measured, for one object on paper."""


def tables(rows: Sequence[Row]) -> list[Table]:
    good = [row for row in rows if "error" not in row and row["scene"] == WORKLOAD]
    made = [_times(good)] if good else []
    some = [row for row in good if row["workers"]]
    here = next((row for row in good if not row["workers"]), None)
    if some:
        made.append(_moved(some[-1]))
    if some and here:
        made += [_one_object(here, some[-1], times) for times in LONGER]
        made.append(_many_objects(here, some[-1]))
    return made + [
        _processor(row) for row in rows if "error" not in row and row["scene"] == PROCESSOR
    ]


def _processor(row: Row) -> Table:
    return Table(
        "Workers whose processor has other vector instructions",
        ["compiled for", "samples here", "there", "of these with another byte",
         "largest difference of D, 0..100", "99.9 % are below"],
        [[
            row["name"], f"{row['samples']:,}", f"{row['others']:,}",
            f"{row['differ']:,}" if "differ" in row else "–", f"{row['most']:.2g}",
            f"{row['typical']:.2g}",
        ]],
    )  # fmt: skip


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
            f"{stage['task_cpu'] / n:.2f}", f"{stage['sent'] / 1e6:.1f}",
            f"{stage['given'] / n:.0f}", f"{stage['returned'] / n / 1e3:,.1f}",
            f"{read / n / 1e6:.1f}", f"{wrote / n / 1e6:.1f}",
        ])  # fmt: skip
    return Table(
        "What moves",
        ["stage", "CPU s here", "tasks", "CPU s each", "MB to each worker, once", "bytes to a task",
         "kB from a task", "MB a task reads", "writes"],
        cells,
        (f"A task that does nothing takes {1e3 * row['empty']:.2f} ms of CPU time of client and "
         f"scheduler, {EMPTY} at once.",),
    )  # fmt: skip


def _one_object(here: Row, row: Row, times: int) -> Table:
    """Amdahl: what spreads is divided, what does not stays, what travels is added.

    times : as many frames as were measured; what spreads grows with them, and nothing else
    """
    cores = here["cores"]
    rest = _sum(row, "cpu_seconds") / cores
    stages = [s for s in row["stages"] if s.get("tasks")]
    once = sum(s["task_cpu"] for s in stages)
    work, most = once * times, max(s["tasks"] for s in stages) * times
    sent, given = (sum(s[key] for s in stages) for key in ("sent", "returned"))
    count = sum(s["tasks"] for s in stages) * times
    disk = (here["frame_bytes"] + (1 + len(PASSES)) * here["store_bytes"]) * times / DISK
    alone = (_sum(here, "cpu_seconds") + work - once) / cores
    cells = [["none: one process", *["–"] * 4, f"{max(alone, disk):.1f}"]]
    for workers in MACHINES:
        each = min(workers, most)
        line = sent * max(workers.bit_length(), 1) / NETWORK + given / NETWORK
        line += count * row["empty"]
        shared = max(work / each, disk)
        cells.append([
            f"{workers}", f"{rest:.1f}", f"{work / each:.1f}", f"{disk:.1f}", f"{line:.1f}",
            f"{rest + shared + line:.1f}",
        ])  # fmt: skip
    return Table(
        f"On paper: one object of {here['frames'] * times:,} frames",
        ["workers' cores", "s that do not spread", "s of work", "s of the shared disk",
         "s of network and scheduler", "s"],
        cells,
        (f"A network of {NETWORK / 1e6:.0f} MB/s and a shared disk of {DISK / 1e6:.0f} MB/s; "
         f"what does not spread keeps {cores} cores busy, as one process does; work and disk "
         "overlap; what is sent to every worker goes on from one to the next, twice as many each "
         f"time; there are no more tasks than {most} in a stage.",),
    )  # fmt: skip


def _many_objects(here: Row, row: Row) -> Table:
    """Objects as tasks: a machine such as this one each, its cores always busy."""
    each = _sum(here, "cpu_seconds") / here["cores"]
    kept = here["frame_bytes"] + here["result_bytes"]
    shared = kept + (1 + len(PASSES)) * here["store_bytes"]
    cells = []
    for machines in MACHINES:
        all_busy = machines / each
        rates = [min(all_busy, DISK / moved) for moved in (shared, kept)]
        cells.append([
            f"{machines:,}", *(f"{OBJECTS / rate / 3600:,.1f}" for rate in rates),
            *(f"{all_busy * moved / 1e6:,.0f}" for moved in (shared, kept)),
            f"{100 * all_busy * row['empty']:.1f} %",
        ])  # fmt: skip
    left = here["result_bytes"] * OBJECTS / 1e12
    return Table(
        f"On paper: {OBJECTS:,} objects of {here['frames']} frames",
        ["machines", "hours, samples on the shared disk", "hours, samples in memory",
         "MB/s of the disk, to keep all busy", "samples in memory", "of the scheduler's time"],
        cells,
        (
            f"An object takes {each * here['cores']:.0f} CPU seconds; a machine has "
            f"{here['cores']} cores that are always busy.",
            f"An object moves {shared / 1e9:.2f} GB, or {kept / 1e9:.2f} with its samples in "
            f"memory. All leave {left:.1f} TB of results, and "
            f"{here['store_bytes'] * OBJECTS / 1e12:.1f} TB of samples on the disk.",
            f"A disk of {DISK / 1e6:.0f} MB/s is full at {DISK / shared * each:.0f} machines, or "
            f"at {DISK / kept * each:.0f} with samples in memory; the scheduler at "
            f"{each / row['empty']:,.0f}.",
        ),
    )  # fmt: skip
