"""Tasks on the workers of a Dask scheduler: placing, retries and progress are Dask's own.

connected    a scheduler that is there, or one of this machine's processes, while the block lasts
"""

from __future__ import annotations

import logging
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError as FutureCancelledError
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from .errors import SvbrdfError
from .spread import Item, Result
from .threads import alone, thread_count

LOCAL = "local"
RETRIES = 2
"""Of a task that raised; one whose worker died is tried again as Dask's configuration says."""
ALIKE = ("meshlab-svbrdf", "numpy", "numba", "opencv-contrib-python-headless")
"""What has to have the same version everywhere, that results are the same."""
PATIENCE = 30
"""Seconds that a scheduler and its first worker are waited for."""

log = logging.getLogger("meshlab_svbrdf")


class Cluster:
    """The workers of a client's scheduler (`spread.Spread`)."""

    def __init__(self, client: Any) -> None:
        self.client = client

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """`work` goes to every worker once; what is not asked for any more is cancelled.

        Raises
        ------
        SvbrdfError : a task failed, and again; workers died of one, or all that knew `work`.
        """
        sent = self.client.scatter(work, broadcast=True, hash=False)
        futures = [
            self.client.submit(_do, sent, item, pure=False, retries=RETRIES) for item in items
        ]
        try:
            for k in range(len(items)):
                result = self._result(futures[k])
                futures[k] = None
                yield result
        finally:
            self.client.cancel([future for future in futures if future is not None])

    def _result(self, future: Any) -> Any:
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            raise SvbrdfError(
                f"the workers that had a task died of it, the last {error.last_worker.address}: "
                "give them more memory, or fewer threads each; what is finished is kept"
            ) from None
        except (CancelledError, FutureCancelledError):
            raise SvbrdfError(
                "all workers that had the data are gone: start others; the same command goes on "
                "from what is finished"
            ) from None


def _do(work: Callable[[Item], Result], item: Item) -> Result:
    """A task, on a worker: other tasks have the other cores."""
    from distributed import get_worker

    try:
        with alone():
            return work(item)
    except (SvbrdfError, OSError, MemoryError) as error:
        told = str(error) or "there is not enough memory"
        raise SvbrdfError(f"{told} (on the worker {get_worker().address})") from None


@contextmanager
def connected(scheduler: str, folder: Path, say: Callable[[str], None]) -> Iterator[Cluster]:
    """The workers of `scheduler`: an address, or LOCAL, a process for each core of this machine.

    folder : of results, made if need be, which all workers have to share

    Raises
    ------
    SvbrdfError : no Dask here, no scheduler there, no worker, another version, another disk.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise SvbrdfError("--scheduler needs Dask: pip install 'meshlab-svbrdf[cluster]'") from None
    with ExitStack() as stack:
        if scheduler == LOCAL:
            scheduler = stack.enter_context(
                LocalCluster(n_workers=thread_count(), threads_per_worker=1, dashboard_address=":0")
            ).scheduler_address
        try:
            client = stack.enter_context(Client(scheduler, timeout=PATIENCE))
            client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise SvbrdfError(
                f"{scheduler}: no Dask scheduler with a worker answers there ({error}); start them "
                "with `dask scheduler` and `dask worker ADDRESS`"
            ) from None
        _check(client, folder)
        workers = len(client.scheduler_info(n_workers=-1)["workers"])
        say(f"{workers} workers at {scheduler}; dashboard: {client.dashboard_link}")
        yield Cluster(client)


def _check(client: Any, folder: Path) -> None:
    """Refuse workers of other software, or that do not see this folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with NamedTemporaryFile(dir=folder, prefix=".shared-") as token:
        found = client.run(_about, token.name)
    own = _versions()
    for worker, (sees, versions) in found.items():
        if not sees:
            raise SvbrdfError(
                f"the worker {worker} does not see {folder}: results have to lie in a folder that "
                "all machines share, under the same path"
            )
        other = [f"{k} {versions[k]} (here {own[k]})" for k in ALIKE if versions[k] != own[k]]
        if other:
            raise SvbrdfError(f"the worker {worker} has {', '.join(other)}: install the same")


def _about(token: str) -> tuple[bool, dict[str, str]]:
    return Path(token).exists(), _versions()


def _versions() -> dict[str, str]:
    return {name: version(name) for name in ALIKE}
