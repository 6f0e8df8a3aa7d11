"""Tasks in child processes: one that raises, hangs or dies affects no other."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from multiprocessing import connection, get_context, parent_process
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")

_POLL_S = 0.5


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
        self._threads = ThreadPoolExecutor(workers)
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
        self._threads.shutdown(wait=False, cancel_futures=True)

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
            for task in itertools.islice(waiting, (workers or self._workers) - len(running)):
                running[self._threads.submit(self._compute_in_child, function, task)] = task
            if not running:
                return
            for future in wait(running, _POLL_S, FIRST_COMPLETED).done:
                try:
                    result: R | Exception = future.result()
                except Exception as error:
                    result = error
                yield running.pop(future), result

    def _compute_in_child(self, function: Callable[[T], R], task: T) -> R:
        """Return the value of a function of a task, computed in a child process, or raise its exception."""
        child = self._take()
        value, error = child.compute(function, task, self._limit)
        if not child.pipe.closed:
            self._idle.append(child)
        if error is not None:
            raise error
        return value

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
                return self.pipe.recv()
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
