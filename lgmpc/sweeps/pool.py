"""Tasks in child processes, of this machine or of Dask's workers: one that raises, hangs or dies affects no other."""

from __future__ import annotations

import faulthandler
import itertools
import os
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import partial
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import Any, TypeVar

from lgmpc.errors import ClusterError, InputError, MissingDependencyError
from lgmpc.runs import versions

__all__ = ["DaskPool", "Died", "Hung", "Pool", "available_cores"]

T = TypeVar("T")
R = TypeVar("R")

_POLL_S = 0.5
_CONNECT_S = 5


def available_cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Hung(Exception):
    """A task exceeded the time limit; its process was killed."""


class Died(Exception):
    """A task's process ended before the task."""


class Pool:
    """Child processes of this machine, started (``spawn``) when tasks need them and replaced when they end.

    A context manager that ends them. Each task occupies one process, so that the end of the process is attributed to
    it. Threads drive the processes, where no signal interrupts: none falls between the start of a process and its
    registration.

    Args:
        workers: largest number of processes.
        initialize: called first in each process; importable by name.
        time_limit_s: longest time of a task, s; the start of its process does not count.
    """

    def __init__(self, workers: int, initialize: Callable[[], None], time_limit_s: float) -> None:
        self._workers, self._initialize, self._limit = workers, initialize, time_limit_s
        self._executor: Executor = ThreadPoolExecutor(workers)
        self._compute: Callable[..., Any] = self._compute_in_child
        self._lock, self._closed = threading.Lock(), False
        self._all: list[_Child] = []
        self._idle: list[_Child] = []

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._closed = True
            for child in self._all:
                child.process.kill()
                child.process.join()
        self._executor.shutdown(wait=False, cancel_futures=True)

    def map(
        self, function: Callable[[T], R], tasks: Iterable[T], workers: int | None = None
    ) -> Iterator[tuple[T, R | Exception]]:
        """Yield each task with the value that the function returned or the exception that it raised, as they finish.

        Args:
            function: function of a task; importable by name.
            tasks: tasks; the next one is drawn when it can be computed at once.
            workers: largest number of tasks at once; as many as there are processes if not given.

        Yields:
            The task and its result. One that did not finish has :class:`Hung` or :class:`Died`.
        """
        waiting, running = iter(tasks), dict[Future[R], T]()
        while True:
            for task in itertools.islice(waiting, max(0, (workers or self._capacity()) - len(running))):
                running[self._executor.submit(self._compute, function, task)] = task
            if not running:
                return
            # As a list, because Dask computes a finished task again, whose worker ends, while its future is referenced.
            done = [(running.pop(each), self._result(each)) for each in wait(running, _POLL_S, FIRST_COMPLETED).done]
            yield from done

    def _capacity(self) -> int:
        return self._workers

    def _result(self, future: Future[Any]) -> Any:
        try:
            return future.result()
        except Exception as error:
            return error

    def _compute_in_child(self, function: Callable[[T], R], task: T) -> R:
        """Return the value of a function of a task, computed in a child process, or raise its exception."""
        child = self._take()
        value, error = child.compute(function, task, self._limit)
        if not child.pipe.closed:
            self._idle.append(child)
        if error is not None:
            raise error
        return value  # type: ignore[no-any-return]

    def _take(self) -> _Child:
        """Return an idle process or a new one; those that ended while they were idle are dropped."""
        with self._lock:
            if self._closed:
                raise Died("all processes were ended")
            while self._idle:
                child = self._idle.pop()
                if child.process.is_alive():
                    return child
                child.pipe.close()
            child = _Child(self._initialize)
            self._all = [*(each for each in self._all if not each.pipe.closed), child]
            return child


class _Child:
    """A process with a pipe to it, which is closed when the process has ended."""

    def __init__(self, initialize: Callable[[], None]) -> None:
        context = get_context("spawn")
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there, initialize), daemon=True)
        self._ready = False
        with there:
            self.process.start()

    def compute(self, function: Callable[[T], R], task: T, limit_s: float) -> tuple[Any, Exception | None]:
        """Return the value of a function of a task, or the exception that it raised."""
        try:
            self._ready = self._ready or self.pipe.recv()
            self.pipe.send((function, task))
            if self.pipe.poll(limit_s):
                return self.pipe.recv()  # type: ignore[no-any-return]
            error: Exception = Hung(f"still computing after {limit_s:g} s (time_limit_s)")
        except (EOFError, OSError):
            error = Died("its process ended: killed, out of memory, or crashed in native code")
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return None, error


def _serve(there: connection.Connection[Any, Any], initialize: Callable[[], None]) -> None:
    """Compute the tasks that come in, until the process that sends them closes the pipe or ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    initialize()
    there.send(True)
    while True:
        try:
            function, task = there.recv()
        except EOFError:
            return
        answer: tuple[Any, Exception | None]
        try:
            answer = function(task), None
        except KeyboardInterrupt:
            return
        except Exception as error:
            answer = None, error
        try:
            there.send(answer)
        except Exception as error:  # it cannot be pickled
            there.send((None, RuntimeError(f"{type(error).__name__}: {error}")))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


class DaskPool(Pool):
    """Dask's workers, each a process of one thread.

    If a worker ends (killed, its machine lost, or a task exceeds the time limit), Dask computes the task again; after
    the number of failures that the scheduler allows (``distributed.scheduler.allowed-failures``, 3) the result is
    :class:`Died`. :meth:`map` raises :class:`lgmpc.errors.ClusterError` if the connection to the scheduler is lost, or
    if a worker has no access to the folder or other versions of packages.

    Args:
        address: address of the scheduler, such as ``tcp://host:8786``.
        time_limit_s: longest time of a task, s.
        folder: folder of the sweep, on a file system that the workers share.

    Raises:
        InputError: no scheduler answers.
        MissingDependencyError: distributed is not installed.
    """

    def __init__(self, address: str, time_limit_s: float, folder: Path) -> None:
        try:
            import distributed
        except ImportError as error:
            words = "a sweep on a Dask cluster"
            raise MissingDependencyError("distributed", words, 'pip install "lgmpc[dask]"') from error
        try:
            self._client = distributed.Client(address, timeout=_CONNECT_S)
        except (OSError, TimeoutError, ValueError) as error:
            expected = f"the address of a running scheduler, such as tcp://host:8786 ({error})"
            raise InputError("dask", address, expected) from error
        self._executor, self._killed = self._client.get_executor(pure=False), distributed.KilledWorker
        self._compute = partial(_compute_there, time_limit_s, folder.resolve(), dict(versions()))

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):  # the scheduler may be gone
            self._executor.shutdown(wait=False)
            self._client.close()

    def _capacity(self) -> int:
        """Return the number of present workers; 1 before the first one."""
        if self._client.status != "running":
            raise _lost()
        return max(1, len(self._client.nthreads()))

    def _result(self, future: Future[Any]) -> Any:
        result = super()._result(future)
        if isinstance(result, CancelledError):
            raise _lost()
        if isinstance(result, ClusterError):
            raise result
        if isinstance(result, self._killed):
            return Died(
                "every worker that computed it ended: killed, its machine lost, or still computing at time_limit_s"
            )
        return result


def _lost() -> ClusterError:
    return ClusterError("the connection to the Dask scheduler is lost: the same command with --resume continues")


def _compute_there(limit_s: float, folder: Path, wanted: dict[str, str], function: Callable[[T], R], task: T) -> R:
    """Compute a task in this worker, which ends if it still computes at the time limit.

    Raises:
        ClusterError: the worker lacks the folder, or has other versions of packages; names them.
    """
    worker, here = f"the worker on {socket.gethostname()}", versions()
    if not folder.is_dir():
        raise ClusterError(f"{worker} has no folder {folder}: choose a shared folder with --out")
    others = [
        f"{name} {here.get(name, 'none')} instead of {wanted[name]}"
        for name in wanted
        if here.get(name) != wanted[name]
    ]
    if others:
        raise ClusterError(f"{worker} has other versions: {', '.join(others)}")
    faulthandler.dump_traceback_later(limit_s, exit=True, file=2)
    try:
        return function(task)
    finally:
        faulthandler.cancel_dump_traceback_later()
