"""What befalls a worker, done to it by Dask's `Client.run`: it has to be importable there."""

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from meshlab_svbrdf import batch, cluster
from meshlab_svbrdf.samples.capture import FrameSampler

_sample, _run = FrameSampler.sample, batch.RUN

# Stands for `run` on a worker: at its first attempt the worker dies, and it would go on by itself
KILLS_ITS_WORKER = """
import json, os, pathlib, signal, sys, time
from meshlab_svbrdf.batch_child import watch
from meshlab_svbrdf.document.record import BusyError, ResultFolder
watch()
begun = pathlib.Path(sys.argv[1] + ".begun")
try:
    with ResultFolder(pathlib.Path(sys.argv[3])).locked():
        if not begun.exists():
            begun.touch()
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)
except BusyError as error:
    print(error, file=sys.stderr)
    sys.exit(75)
print(json.dumps({"stages": [{"name": "stub", "message": "second"}]}))
"""


def slow(seconds: float) -> None:
    """Every frame takes so long."""

    def sample(self, *given):
        time.sleep(seconds)
        return _sample(self, *given)

    FrameSampler.sample = sample  # type: ignore[method-assign]


def dying() -> None:
    """The process is killed in the midst of its next task."""

    FrameSampler.sample = die  # type: ignore[method-assign]


def die(*given) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def full_disk(most: int) -> None:
    """No file may have more bytes than this."""
    import resource  # of POSIX

    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))


def batch_runs(command: Sequence[str]) -> None:
    """What a batch runs in place of `run`."""
    batch.RUN = tuple(command)  # type: ignore[assignment]


def elsewhere() -> None:
    """Paths are those of another disk, as on a machine that does not share the folder."""

    cluster.Path = lambda path: Path("/nowhere" + path)  # type: ignore[assignment,misc]


def well() -> None:
    FrameSampler.sample = _sample  # type: ignore[method-assign]
    batch.RUN, cluster.Path = _run, Path  # type: ignore[assignment,misc]
    full_disk(-1)
