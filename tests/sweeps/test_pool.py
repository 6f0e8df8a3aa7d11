"""Worker processes under tasks that raise, hang and kill them."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.process import BaseProcess
from typing import Any

import pytest
from workers import act, nothing

from lgmpc.config.session import stop_signals
from lgmpc.errors import Interrupted
from lgmpc.sweeps.pool import Died, Hung, Pool
from lgmpc.sweeps.trial import start_worker


def test_each_task_pays_for_itself_only() -> None:
    with Pool(1, start_worker, time_limit_s=3.0) as pool:
        odd = ["unpicklable", "error that does not unpickle", "die", "hang"]
        found = dict(pool.map(act, ["a", "raise", "terminate", "b", *odd, "d"]))
        first, second = found["a"], found["b"]
        # A worker stays alive, also after an exception.
        assert str(first).split()[0] == "a"
        assert str(first).split()[2] == str(second).split()[2]
        assert isinstance(found["raise"], ValueError)
        # A scheduler sends SIGTERM to all processes of a job; the worker's point is then computed elsewhere.
        assert str(found["terminate"]).startswith("terminate in ")
        assert isinstance(found["unpicklable"], RuntimeError) and "pickle" in str(found["unpicklable"])
        assert isinstance(found["error that does not unpickle"], TypeError)
        assert isinstance(found["die"], Died)
        assert isinstance(found["hang"], Hung)
        assert str(found["d"]).startswith("d in ")
        # A process that ends while it is idle is replaced.
        os.kill(int(str(found["d"]).rpartition(" ")[2]), signal.SIGKILL)
        time.sleep(0.2)
        ((_, last),) = pool.map(act, ["e"])
    assert str(last).startswith("e in ")


def test_tasks_are_drawn_when_a_process_is_free_and_no_process_is_left_behind() -> None:
    drawn = []

    def tasks() -> Iterator[str]:
        for name in "abc":
            drawn.append(name)
            yield name

    with Pool(1, nothing, time_limit_s=60.0) as pool:
        _, result = next(pool.map(act, tasks()))
        assert drawn == ["a"]
    process = int(str(result).rpartition(" ")[2])
    for _ in range(200):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail(f"process {process} still runs")


@pytest.mark.parametrize("task", [0, 1])
def test_a_signal_while_a_task_is_handed_over_leaves_no_process_behind(
    monkeypatch: pytest.MonkeyPatch, task: int
) -> None:
    """Of the first task, which starts a process, or of the second, which would keep it for ten minutes."""
    whole = ThreadPoolExecutor.submit
    calls = []

    def interrupted(self: ThreadPoolExecutor, *args: Any) -> Any:
        future = whole(self, *args)
        calls.append(args)
        if len(calls) == task + 1:
            os.kill(os.getpid(), signal.SIGTERM)
        return future

    before = set(multiprocessing.active_children())
    monkeypatch.setattr(ThreadPoolExecutor, "submit", interrupted)
    with pytest.raises(Interrupted), stop_signals(), Pool(1, nothing, time_limit_s=60.0) as pool:
        list(pool.map(act, ["a", "hang"]))
    assert len(calls) == task + 1
    for process in set(multiprocessing.active_children()) - before:
        begun = time.monotonic()
        while process.exitcode is None and time.monotonic() - begun < 60.0:  # another thread may have waited for it
            time.sleep(0.01)
        assert process.exitcode == -signal.SIGKILL


def test_a_process_that_is_starting_when_the_pool_ends_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread of the task is between the start of the process and the end of its registration."""
    started, ended = threading.Event(), threading.Event()
    whole = BaseProcess.start

    def slow(self: BaseProcess) -> None:
        whole(self)
        started.set()
        ended.wait(0.2)  # the end of the pool waits for the lock meanwhile

    before = set(multiprocessing.active_children())
    monkeypatch.setattr(BaseProcess, "start", slow)
    with pytest.raises(Interrupted), Pool(1, nothing, time_limit_s=60.0) as pool:
        tasks = pool.map(act, ["hang"])
        threading.Thread(target=lambda: started.wait() and signal.raise_signal(signal.SIGTERM)).start()
        with stop_signals():
            next(tasks)
    for process in set(multiprocessing.active_children()) - before:
        begun = time.monotonic()
        while process.exitcode is None and time.monotonic() - begun < 60.0:  # another thread may have waited for it
            time.sleep(0.01)
        assert process.exitcode == -signal.SIGKILL
