"""What befalls a worker, done to it by Dask's `Client.run`: it has to be importable there."""

import os
import signal
import time

from meshlab_svbrdf.samples.capture import FrameSampler

_sample = FrameSampler.sample


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


def well() -> None:
    FrameSampler.sample = _sample  # type: ignore[method-assign]
    full_disk(-1)
