"""The cluster part: its bytes are what pickling takes, its arithmetic on paper adds up."""

import numpy as np
import pytest

from benchmarks import cluster
from benchmarks.cluster_tables import PASSES, SAMPLES, WORKLOAD

pytest.importorskip("distributed", reason="needs the extra `cluster`")


def row(workers: int, seconds: float, cpu: float = 1.0, tasks: int = 40) -> dict:
    names = (SAMPLES, *PASSES, "compute_svbrdf_visibility")
    told = (
        {"tasks": tasks, "sent": 50e6, "given": 400, "returned": 2e6, "task_cpu": 7.0}
        if workers
        else {}
    )
    stages = [
        {"name": name, "seconds": seconds, "cpu_seconds": cpu, "workers_cpu": 8.0 * (workers > 0)}
        | (told if name != names[-1] else {})
        for name in names
    ]
    return {
        "scene": WORKLOAD, "workers": workers, "name": cluster._name(workers),
        "stages": stages, "cores": 2, "frames": 300, "texels": 1000, "samples": 10**6,
        "frame_bytes": 3e8, "store_bytes": 5e8,
        "result_bytes": 1e8, "digest": "a", "start": 3.0, "empty": 1e-3,
    }  # fmt: skip


def test_bytes_are_those_of_the_arrays():
    array = np.zeros(10**6)
    assert 0 < cluster._size([array, array[:100].copy()]) - 8 * (10**6 + 100) < 1000


def test_what_is_on_paper_adds_up():
    times, _, one, longer, many = cluster.tables([row(0, 10.0, 40.0), row(2, 4.0)])
    assert [cells[1] for cells in times.cells] == ["50.0", "20.0"]
    assert [cells[-1] for cells in times.cells] == ["yes", "yes"]
    # One core does all 28 s of work; 5 stages of 1 CPU s here do not spread
    assert one.cells[1][1:3] == ["2.5", "28.0"]
    assert float(one.cells[1][-1]) == pytest.approx(2.5 + 28 + 4 * 50e6 / 125e6 + 0.224, 0.01)
    # One process takes 200 CPU s on two cores; of ten times the frames 9 · 28 s more
    assert [table.cells[0][-1] for table in (one, longer)] == ["100.0", "226.0"]
    assert [cells[2] for cells in longer.cells[1:]] == ["280.0", "28.0", "2.8", "0.7"]
    # No more cores are of use than there are tasks
    assert one.cells[3][2] == one.cells[4][2] == "0.7"
    # 10,000 objects of 200 CPU s; each moves .3 + 4 · .5 + .1 GB: the disk is full at 42 machines
    assert [float(cells[1].replace(",", "")) for cells in many.cells[:2]] == [277.8, 27.8]
    assert many.cells[2][1] == many.cells[3][1] == "6.7"
    # With samples in memory .4 GB: 250 machines
    assert [cells[2] for cells in many.cells[2:]] == ["2.8", "1.1"]
    assert "full at 42 machines, or at 250 with" in many.notes[2]


def test_a_result_that_differs_is_told():
    other = row(2, 4.0) | {"digest": "b"}
    assert cluster.tables([row(0, 10.0), other])[0].cells[1][-1] == "NO"
