"""Worker processes under tasks that raise, hang and kill them."""

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import pytest
from workers import act, nothing

from lgmpc.config.interrupts import stop_signals
from lgmpc.errors import Interrupted
from lgmpc.sweeps.pool import Died, Hung, Pool


def test_each_task_pays_for_itself_only() -> None:
    with Pool(1, nothing, time_limit_s=3.0) as pool:
        found = dict(pool.map(act, ["a", "raise", "b", "die", "hang", "d"]))
        first, second = found["a"], found["b"]
        # A worker stays alive, also after an exception.
        assert str(first).split()[0] == "a"
        assert str(first).split()[2] == str(second).split()[2]
        assert isinstance(found["raise"], ValueError)
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
    """Of the first call, which starts the process, or of the second, which would keep it for ten minutes."""
    whole = ProcessPoolExecutor.submit
    calls = []

    def interrupted(self: ProcessPoolExecutor, *args: Any) -> Any:
        future = whole(self, *args)
        calls.append(args)
        if len(calls) == task + 1:
            os.kill(os.getpid(), signal.SIGTERM)
        return future

    before = set(multiprocessing.active_children())
    monkeypatch.setattr(ProcessPoolExecutor, "submit", interrupted)
    with pytest.raises(Interrupted), stop_signals(), Pool(1, nothing, time_limit_s=60.0) as pool:
        next(pool.map(act, ["hang"]))
    assert len(calls) == task + 1
    for process in set(multiprocessing.active_children()) - before:
        process.join(30.0)
        assert not process.is_alive()
