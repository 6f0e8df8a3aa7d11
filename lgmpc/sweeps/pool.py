"""Fault-tolerant worker processes: a task that raises, hangs or ends its process affects no other task."""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, TimeoutError, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from time import monotonic
from typing import Generic, Protocol, TypeVar

__all__ = ["Died", "Executor", "Hung", "Pool", "available_cores"]

T = TypeVar("T")
R = TypeVar("R")

_POLL_S = 0.5
_START_S = 60.0


def available_cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Executor(Protocol):
    """Applies functions to tasks: on this machine (:class:`Pool`) or on a cluster (:class:`~.cluster.DaskPool`)."""

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
        ...


class Hung(Exception):
    """A task exceeded the time limit; its process was killed."""


class Died(Exception):
    """A task's process ended before the task."""


class _Worker:
    """One process with an executor of its own, so that the end of the process is attributed to its task."""

    def __init__(self, initialize: Callable[[], None]) -> None:
        self._executor = ProcessPoolExecutor(1, get_context("spawn"), initialize)
        self._pid: Future[int] | None = None

    @property
    def started(self) -> bool:
        """Whether its process accepts tasks."""
        return self._pid is not None and self._pid.done()

    def submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        """Submit a task to its process, which is started for the first one."""
        if self._pid is None:
            self._pid = self._executor.submit(os.getpid)
        return self._executor.submit(function, task)

    def kill(self) -> None:
        """Kill its process, also one that is still starting, which would begin its task otherwise."""
        if self._pid is not None:
            with suppress(BrokenProcessPool, CancelledError, TimeoutError, ProcessLookupError):
                os.kill(self._pid.result(_START_S), signal.SIGKILL)
        self._executor.shutdown(wait=False, cancel_futures=True)


@dataclass
class _Running(Generic[T]):
    worker: _Worker
    task: T
    started: float | None = None

    def age_s(self) -> float:
        """Return how long the task has run, s; the start of its process does not count."""
        if self.started is None and self.worker.started:
            self.started = monotonic()
        return 0.0 if self.started is None else monotonic() - self.started


class Pool:
    """Processes, started once (``spawn``) and replaced when they end, that apply functions to tasks.

    Args:
        workers: largest number of processes.
        initialize: called first in each process; importable by name.
        time_limit_s: longest time of a task, s.
    """

    def __init__(self, workers: int, initialize: Callable[[], None], time_limit_s: float) -> None:
        self._count, self._initialize, self._limit = workers, initialize, time_limit_s
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in [*self._idle, *self._busy]:
            worker.kill()

    def map(
        self, function: Callable[[T], R], tasks: Iterable[T], workers: int | None = None
    ) -> Iterator[tuple[T, R | Exception]]:
        """Yield each task with its result or exception as they finish; see :meth:`Executor.map`."""
        waiting = iter(tasks)
        running: dict[Future[R], _Running[T]] = {}
        exhausted = False
        while True:
            while not exhausted and len(running) < (workers or self._count):
                for task in itertools.islice(waiting, 1):
                    worker, future = self._submit(function, task)
                    running[future] = _Running(worker, task)
                    break
                else:
                    exhausted = True
            if not running:
                return
            done = wait(running, _POLL_S, FIRST_COMPLETED).done
            for future in done:
                finished = running.pop(future)
                result = self._result(future, finished.worker)
                yield finished.task, result
            for future in [each for each in running if running[each].age_s() > self._limit]:
                late = running.pop(future)
                self._busy.remove(late.worker)
                late.worker.kill()
                yield late.task, Hung(f"still computing after {self._limit:g} s (time_limit_s)")

    def _submit(self, function: Callable[[T], R], task: T) -> tuple[_Worker, Future[R]]:
        """Submit a task to an idle process, or to a new one; one that ended while it was idle is replaced."""
        while True:
            worker = self._idle.pop() if self._idle else _Worker(self._initialize)
            self._busy.append(worker)  # first, so that a signal from here on ends this process too
            try:
                return worker, worker.submit(function, task)
            except BrokenProcessPool:
                self._busy.remove(worker)
                worker.kill()

    def _result(self, future: Future[R], worker: _Worker) -> R | Exception:
        self._busy.remove(worker)
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            worker.kill()
            return Died("its process ended: killed, out of memory, or crashed in native code")
        self._idle.append(worker)
        if isinstance(error, Exception):
            return error
        return future.result()
