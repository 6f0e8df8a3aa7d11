"""Each number of the tasks' targets is written at most once a tick, whatever the robot does."""

from typing import Any

import numpy as np
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.modes import Mode
from lgmpc.control.reference import MotionTasks
from lgmpc.simulation import Tick
from lgmpc.wbc import Task


class Counted(np.ndarray[Any, Any]):
    """An array that counts how often each of its entries is assigned to."""

    counts: np.ndarray

    def __setitem__(self, where: Any, values: Any) -> None:
        self.counts[where] += 1
        super().__setitem__(where, values)


def watched(task: Task) -> np.ndarray:
    """Count the assignments to the targets of a task; return the counts of all of them."""

    def counted(array: np.ndarray, counts: np.ndarray) -> Counted:
        found = array.view(Counted)
        found.counts = counts
        return found

    counts, first = np.zeros(len(task.targets_together), dtype=int), 0
    for name in task.target._names:
        array = getattr(task.target, name)
        setattr(task.target, name, counted(array, counts[first : first + array.size].reshape(array.shape)))
        first += array.size
    assert first == len(counts)
    task.targets_together = counted(task.targets_together, counts)
    return counts


@pytest.mark.parametrize(
    ("name", "seconds", "mode"),
    [
        ("solo12_rise", 0.7, Mode.RISE),
        ("solo12_catch", 0.5, Mode.MANEUVER),
        ("solo12_com_circle", 0.05, Mode.STAND),
        ("solo12_balance_full_body", 0.05, Mode.STAND),
    ],
)
def test_targets_have_one_writer_a_tick(name: str, seconds: float, mode: Mode) -> None:
    session = prepare(load_config(name, [f"duration_s={seconds}", "gate={}"]))
    assert isinstance(session, ClosedLoopSession)
    tasks, report = MotionTasks.of(session.controller.wbc.tasks), session.controller.report
    counts = [watched(task) for task in vars(tasks).values()]
    most: dict[Mode, int] = {}

    def watch(tick: Tick) -> bool:
        nonlocal report
        before, report = report, session.controller.report
        if report.mode is before.mode:  # a mode begins with targets of rest
            most[report.mode] = max(most.get(report.mode, 0), *(int(each.max()) for each in counts))
        for each in counts:
            each[:] = 0
        return True

    session.watch = watch
    session.run(lambda progress: None)
    assert most.pop(Mode.LIE, 0) == 0 and mode in most
    assert set(most.values()) == {1}, most
