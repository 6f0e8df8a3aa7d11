"""Points computed by the workers of a Dask cluster: on this machine, at an address, or in jobs of a scheduler."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import socket
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from lgmpc.errors import ClusterError, InputError, MissingDependencyError
from lgmpc.runs import versions
from lgmpc.sweeps.pool import Children, Died, Pool, available_cores

if TYPE_CHECKING:
    import distributed

__all__ = ["LOCAL", "DaskPool", "dask_client"]

T = TypeVar("T")
R = TypeVar("R")

LOCAL = "local"
"""The address that selects a cluster on this machine, created for the sweep."""

_CONNECT_S = 5


@contextmanager
def dask_client(address: str, workers: int | None = None) -> Iterator[distributed.Client]:
    """Connect to a Dask scheduler for the duration of a block.

    Args:
        address: address of the scheduler, such as ``tcp://host:8786``; ``local`` creates a cluster on this machine.
        workers: number of workers of the cluster on this machine; one for each processor unless given.

    Raises:
        InputError: no scheduler answers, or ``workers`` is below 1 or given with an address.
        MissingDependencyError: distributed is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise MissingDependencyError("distributed", "a sweep on a Dask cluster", 'pip install "lgmpc[dask]"') from error
    if workers is not None and (workers < 1 or address != LOCAL):
        expected = "at least 1" if address == LOCAL else "none with the address of a scheduler, which has its own"
        raise InputError("workers", workers, expected)
    if address == LOCAL:
        cluster = distributed.LocalCluster(
            n_workers=workers or available_cores(),
            threads_per_worker=1,
            memory_limit=0,  # the memory of the tasks' own processes is limited instead
            dashboard_address="127.0.0.1:0",  # any free port: several clusters may be on a machine
            silence_logs=logging.CRITICAL,
            preload=[__name__],
        )
        with cluster, distributed.Client(cluster) as client:
            yield client
        return
    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        expected = "the address of a running scheduler, such as tcp://host:8786, or local"
        raise InputError("dask", address, f"{expected} ({error})", ["local"]) from error
    with client:
        yield client


def dask_setup(worker: distributed.Worker) -> None:
    """Ignore Ctrl-C, which ends the sweep, in a worker on this machine; the name is that of Dask's hook."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class DaskPool(Pool):
    """Applies functions to tasks on Dask's workers.

    Each thread of a worker computes in a child process of its own, so that a task that raises, hangs or ends its
    process affects no other one, as on one machine. If a worker or its machine ends, Dask computes the task again on
    another one; after the number of failures that the scheduler allows (``distributed.scheduler.allowed-failures``, 3)
    the result is :class:`lgmpc.sweeps.pool.Died`. :meth:`map` raises :class:`lgmpc.errors.ClusterError` if the
    connection to the scheduler is lost, or if a worker has no access to the folder or other versions of packages.

    Args:
        client: connected client.
        initialize: called first in each process; importable by name.
        time_limit_s: longest time of a task, s.
        folder: folder of the sweep, on a file system that the workers share.
    """

    def __init__(
        self, client: distributed.Client, initialize: Callable[[], None], time_limit_s: float, folder: Path
    ) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        there = tuple(sorted(versions().items()))
        self._remote = _Remote(uuid.uuid4().hex, initialize, time_limit_s, folder.resolve(), there)

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):  # without a scheduler there is no worker to end
            self._executor.shutdown(wait=False)
            self._client.run(_end_processes, self._remote.session)

    def _capacity(self) -> int:
        """Return the number of tasks that the present workers compute at once; 1 before the first worker."""
        if self._client.status != "running":
            raise _lost()
        threads: list[int] = list(self._client.nthreads().values())
        return max(1, sum(threads))

    def _submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        return self._executor.submit(self._remote.compute, function, task)

    def _result(self, future: Future[Any]) -> Any:
        import distributed

        result = super()._result(future)
        if isinstance(result, CancelledError):
            raise _lost()
        if isinstance(result, ClusterError):
            raise result
        if isinstance(result, distributed.KilledWorker):
            return Died("every worker that computed it ended: killed, its machine lost, or out of memory")
        return result


def _lost() -> ClusterError:
    return ClusterError("the connection to the Dask scheduler is lost: the same command with --resume continues")


@dataclass(frozen=True)
class _Remote:
    """The data that a worker requires to compute tasks.

    Attributes:
        session: identifier of the pool.
        initialize: as in :class:`lgmpc.sweeps.pool.Children`, and so is the next one.
        time_limit_s: longest time of a task, s.
        folder: folder that the worker must share with the process that runs the sweep.
        versions: versions of packages that both must have, by name.
    """

    session: str
    initialize: Callable[[], None]
    time_limit_s: float
    folder: Path
    versions: tuple[tuple[str, str], ...]

    def compute(self, function: Callable[[T], R], task: T) -> R:
        """Compute a task in a child process of this worker."""
        with _lock:
            if self.session not in _children:
                self._check()
                multiprocessing.current_process().daemon = False  # Dask's are daemons, which could start no process
                _children[self.session] = Children(self.initialize, self.time_limit_s)
        return _children[self.session].compute(function, task)

    def _check(self) -> None:
        """Raise ClusterError, which names the folder or the versions that differ."""
        worker = f"the worker on {socket.gethostname()}"
        if not self.folder.is_dir():
            raise ClusterError(f"{worker} has no folder {self.folder}: choose a shared folder with --out")
        here = versions()
        differing = [
            f"{name} {here.get(name, 'none')} instead of {wanted}"
            for name, wanted in self.versions
            if here.get(name) != wanted
        ]
        if differing:
            raise ClusterError(f"{worker} has other versions: {', '.join(differing)}")


_lock = Lock()
_children: dict[str, Children] = {}
"""The processes of each session, in a worker."""


def _end_processes(session: str) -> None:
    """Kill the processes of a session in this worker."""
    if session in _children:
        _children.pop(session).close()
