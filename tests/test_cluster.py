"""Runs on three worker processes of a real scheduler: results are those of one process, bit by bit,
also where a worker is killed or slow. What failed on a full one is said, and gone on with."""

import os
import sys

import numpy as np
import pytest
import troubles
from totems import GLOSS, SAMPLES, TEXELS, WALK, contents, film, run

from meshlab_svbrdf.batch import run_batch
from meshlab_svbrdf.batch_list import DONE, FAILED, Entry
from meshlab_svbrdf.cluster import Cluster, connected
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters import _samples
from meshlab_svbrdf.filters._stages import read_observations

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
SMALL = {TEXELS: {"texture_size": 48}}
JOINT = SMALL | {GLOSS: {"estimator": "joint"}}


@pytest.fixture(scope="module")
def machines():
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    with (
        distributed.LocalCluster(
            n_workers=3, threads_per_worker=1, dashboard_address=":0", memory_limit=0
        ) as found,
        distributed.Client(found) as client,
    ):
        yield client


@pytest.fixture
def client(machines, monkeypatch):
    monkeypatch.setattr(_samples, "LEAST", 3)  # frames a task
    yield machines
    machines.wait_for_workers(3)
    machines.run(troubles.well)


@pytest.fixture
def here(tmp_path_factory, tmp_path):
    """The film's samples, projected by this process."""
    document = Document.open(film(tmp_path_factory, WALK), tmp_path / "here")
    run(document, SAMPLES, **SMALL)
    return document


@pytest.fixture
def there(tmp_path_factory, tmp_path, client):
    """The same film, to be run on the workers."""
    document = Document.open(film(tmp_path_factory, WALK), tmp_path / "there")
    document.spread = Cluster(client)
    return document


def same_samples(a: Document, b: Document) -> None:
    one, other = (read_observations(d, visibility=False).store for d in (a, b))
    assert one.names == other.names
    for x, y in zip(one.read(0, one.texels), other.read(0, one.texels), strict=True):
        np.testing.assert_array_equal(x, y)


def one(client) -> list[str]:
    return [min(client.scheduler_info()["workers"])]


def test_every_result_is_that_of_one_process(there, tmp_path_factory, tmp_path):
    """The whole chain with the fit: all files but the chunks of samples and the record of times."""
    alone = Document.open(film(tmp_path_factory, WALK), tmp_path / "here")
    run(alone, **JOINT)
    run(there, **JOINT)
    chunks = len(list((there.folder / "samples").glob("*.offsets.npy")))
    assert chunks > len(list((alone.folder / "samples").glob("*.offsets.npy")))
    assert not list((there.folder / "samples").glob("part-*"))
    found, expected = (
        {k: v for k, v in contents(d.folder).items() if k[:8] != "samples/" and k != "svbrdf.json"}
        for d in (there, alone)
    )
    assert found == expected
    same_samples(there, alone)


def test_a_killed_worker_changes_nothing(there, here, client):
    before = set(client.run(os.getpid).values())
    client.run(troubles.dying, workers=one(client))
    run(there, SAMPLES, **SMALL)
    same_samples(there, here)
    client.wait_for_workers(3)
    assert len(before & set(client.run(os.getpid).values())) == 2


def test_a_slow_worker_changes_nothing(there, here, client):
    client.run(troubles.slow, 0.2, workers=one(client))
    run(there, SAMPLES, **SMALL)
    same_samples(there, here)


def test_a_full_disk_is_said_and_what_was_done_is_kept(there, here, client):
    client.run(troubles.full_disk, 2000)
    with pytest.raises(SvbrdfError, match=r"part-.*make room on the disk.*on the worker tcp:"):
        run(there, SAMPLES, **SMALL)
    assert not there.has("samples")
    client.run(troubles.well)
    run(there, SAMPLES, **SMALL)
    same_samples(there, here)


def test_lack_of_memory_is_said(client):
    with pytest.raises(SvbrdfError, match=r"Unable to allocate .* \(on the worker tcp:"):
        list(Cluster(client)(np.empty, [1 << 45]))


def test_a_task_that_kills_its_workers_is_given_up(client, monkeypatch):
    monkeypatch.setattr(client.cluster.scheduler, "allowed_failures", 0)
    with pytest.raises(SvbrdfError, match="the workers that had a task died of it"):
        list(Cluster(client)(troubles.die, [0]))


def test_objects_of_a_batch_are_tasks(client, tmp_path):
    (tmp_path / "lost.mlp").write_text("<MeshLabDocument/>")
    entries = [Entry(tmp_path / "lost.mlp", "lost")]
    found = run_batch(entries, tmp_path / "out", [], spread=Cluster(client))
    assert [(result.state, result.attempts) for result in found] == [(FAILED, 1)]
    assert "is not a MeshLab project" in found[0].error
    assert (tmp_path / "out" / "batch.html").exists()


def test_a_project_whose_worker_died_is_let_go_of_and_done_by_another(client, tmp_path):
    """Its run, which holds the project, ends with the worker: else the next attempt would fail."""
    (tmp_path / "run.py").write_text(troubles.KILLS_ITS_WORKER)
    (tmp_path / "object.mlp").touch()
    client.run(troubles.batch_runs, [sys.executable, str(tmp_path / "run.py")])
    before = set(client.run(os.getpid).values())
    entries = [Entry(tmp_path / "object.mlp", "object")]
    (found,) = run_batch(entries, tmp_path / "out", [], spread=Cluster(client), retries=2)
    assert (found.state, found.outcomes) == (DONE, {"stub": "second"}), found.error
    client.wait_for_workers(3)
    assert len(before & set(client.run(os.getpid).values())) == 2


def test_a_folder_that_workers_do_not_share_is_refused(client, tmp_path):
    """Another machine has a file of its own, or none, where ours is."""
    client.run(troubles.elsewhere, workers=one(client))
    with (
        pytest.raises(SvbrdfError, match=r"the worker tcp:.* does not see .*out: .* all machines"),
        connected(client.scheduler.address, tmp_path / "out", print),
    ):
        pass
    client.run(troubles.well)
    with connected(client.scheduler.address, tmp_path / "out", print) as cluster:
        assert list(cluster(abs, [-1])) == [1]


def test_what_is_wrong_with_a_scheduler_is_said(client, tmp_path, monkeypatch):
    said: list[str] = []
    address = client.scheduler.address
    with connected(address, tmp_path / "new", said.append) as cluster:
        assert list(cluster(abs, [-1, 2, -3])) == [1, 2, 3]
    assert said[0].startswith(f"3 workers at {address}")
    monkeypatch.setattr("meshlab_svbrdf.cluster.PATIENCE", 1)
    with (
        pytest.raises(SvbrdfError, match="no Dask scheduler with a worker answers"),
        connected("tcp://127.0.0.1:1", tmp_path, said.append),
    ):
        pass
    monkeypatch.setattr("meshlab_svbrdf.cluster.version", lambda name: "0.0")
    with (
        pytest.raises(SvbrdfError, match=r"has meshlab-svbrdf .* \(here 0.0\).*install the same"),
        connected(address, tmp_path, said.append),
    ):
        pass
