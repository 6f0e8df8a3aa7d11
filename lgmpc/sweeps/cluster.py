"""Points computed by the workers of a Dask cluster: on this machine, at an address, or in jobs of a scheduler."""

from __future__ import annotations

import itertools
import logging
import multiprocessing
import signal
import socket
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, get_ident
from typing import TYPE_CHECKING, Any, TypeVar

from lgmpc.errors import ClusterError, InputError, MissingDependencyError
from lgmpc.runs import versions
from lgmpc.sweeps.pool import Died, Pool, available_cores

if TYPE_CHECKING:
    import distributed

__all__ = ["LOCAL", "DaskPool", "Machine", "dask_client"]

T = TypeVar("T")
R = TypeVar("R")

LOCAL = "local"
"""The address that selects a cluster on this machine, created for the sweep."""

_POLL_S = 0.5
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


@dataclass(frozen=True)
class Machine:
    """Properties that a worker must share with the process that runs the sweep.

    Attributes:
        folder: folder of the sweep, on a file system of both.
        versions: versions of packages by name.
    """

    folder: Path
    versions: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, folder: Path) -> Machine:
        """Return the properties of this process."""
        return cls(folder.resolve(), tuple(sorted(versions().items())))

    def check(self) -> None:
        """Check that this process has the same properties.

        Raises:
            ClusterError: names the folder or the versions that differ.
        """
        worker = f"the worker on {socket.gethostname()}"
        if not self.folder.is_dir():
            raise ClusterError(f"{worker} has no folder {self.folder}: choose a shared folder with --out")
        there = versions()
        differing = [
            f"{name} {there.get(name, 'none')} instead of {wanted}"
            for name, wanted in self.versions
            if there.get(name) != wanted
        ]
        if differing:
            raise ClusterError(f"{worker} has other versions: {', '.join(differing)}")


class DaskPool:
    """Applies functions to tasks on Dask's workers; the same interface as :class:`lgmpc.sweeps.pool.Pool`.

    Each thread of a worker computes in a child process of its own, so that a task that raises, hangs or ends its
    process affects no other one, as on one machine. If a worker or its machine ends, Dask computes the task again on
    another one; after the number of failures that the scheduler allows (``distributed.scheduler.allowed-failures``, 3)
    the result is :class:`lgmpc.sweeps.pool.Died`.

    Args:
        client: connected client.
        initialize: called first in each process; importable by name.
        time_limit_s: longest time of a task, s.
        machine: properties checked on each worker before its first task.
    """

    def __init__(
        self, client: distributed.Client, initialize: Callable[[], None], time_limit_s: float, machine: Machine
    ) -> None:
        self._client = client
        self._remote = _Remote(uuid.uuid4().hex, initialize, time_limit_s, machine)

    def __enter__(self) -> DaskPool:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):  # without a scheduler there is no worker to end
            self._client.run(_end_processes, self._remote.session)

    def map(
        self, function: Callable[[T], R], tasks: Iterable[T], workers: int | None = None
    ) -> Iterator[tuple[T, R | Exception]]:
        """Yield each task with what the function returned or raised, as they finish; see :meth:`Pool.map`.

        Raises:
            ClusterError: the connection to the scheduler is lost, or a worker cannot be used.
        """
        waiting = iter(tasks)
        running: dict[distributed.Future, T] = {}
        exhausted, news = False, Event()
        try:
            while True:
                while not exhausted and len(running) < (workers or self._threads()):
                    for task in itertools.islice(waiting, 1):
                        future = self._client.submit(_apply, self._remote, function, task, pure=False)
                        future.add_done_callback(lambda _: news.set())
                        running[future] = task
                        break
                    else:
                        exhausted = True
                if not running:
                    return
                news.wait(_POLL_S)
                news.clear()
                for future in [each for each in running if each.done()]:
                    result = self._result(future)
                    yield running.pop(future), result
        finally:
            if running and self._connected():
                self._client.cancel(list(running), force=True)

    def _threads(self) -> int:
        """Return the number of tasks that the present workers compute at once; 1 before the first worker."""
        return max(1, sum(self._client.nthreads().values())) if self._connected() else 1

    def _connected(self) -> bool:
        return bool(self._client.status == "running")

    def _result(self, future: distributed.Future) -> Any:
        import distributed

        if future.status in ("cancelled", "lost"):
            raise ClusterError("the connection to the Dask scheduler is lost: the same command with --resume continues")
        if future.status == "finished":
            return future.result()
        error = future.exception()
        if isinstance(error, distributed.KilledWorker):
            return Died("every worker that computed it ended: killed, its machine lost, or out of memory")
        if isinstance(error, ClusterError) or not isinstance(error, Exception):
            raise error
        return error


@dataclass(frozen=True)
class _Remote:
    """The data that a worker requires to compute tasks: the name of the session and the arguments of its pool."""

    session: str
    initialize: Callable[[], None]
    time_limit_s: float
    machine: Machine


_pools: dict[tuple[str, int], Pool] = {}
"""In a worker: the process of each session and thread."""


def _apply(remote: _Remote, function: Callable[[T], R], task: T) -> R | Exception:
    """Compute a task in this thread's process."""
    key = (remote.session, get_ident())
    if key not in _pools:
        remote.machine.check()
        multiprocessing.current_process().daemon = False  # Dask's workers are daemons, which could start no process
        _pools[key] = Pool(1, remote.initialize, remote.time_limit_s)
    ((_, result),) = _pools[key].map(function, [task])
    return result


def _end_processes(session: str) -> None:
    """Kill the processes of a session in this worker."""
    for key in [each for each in _pools if each[0] == session]:
        _pools.pop(key).__exit__()
