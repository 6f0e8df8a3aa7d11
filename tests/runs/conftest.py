"""A synthetic log whose metrics are known by construction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lgmpc.runs import Recorder, RunLog
from lgmpc.runs.log import MODES

FRAMES = ("FL", "FR", "HL", "HR")
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])


def new_recorder(**changes: Any) -> Recorder:
    arguments: dict[str, Any] = {
        "nq": 19,
        "nv": 18,
        "effort_limit": np.full(12, 1.8),
        "contact_frames": FRAMES,
        "friction": 0.6,
        "contact_radius": 0.016,
        "control_period_s": 0.001,
        "ticks": 1000,
        "mpc_nodes": 20,
        "mpc_period_s": 0.01,
        "mpc_updates": 100,
    }
    return Recorder(**(arguments | changes))


def record_standing(
    recorder: Recorder, ticks: int = 1000, optional: Callable[[int], dict[str, Any]] = lambda tick: {}
) -> None:
    """A robot that stands still, 6 N on each foot, an MPC update every tenth tick; ``optional`` channels by tick."""
    q = np.zeros(19)
    q[2], q[6] = 0.24, 1.0
    forces = np.tile([0.0, 0.0, 6.0], (4, 1))
    com = np.array([0.0, 0.0, 0.2])
    for k in range(ticks):
        time = 0.001 * k
        recorder.append(
            {
                "time": time,
                "q": q,
                "v": np.zeros(18),
                "tau": np.full(12, 0.5),
                "tau_command": np.full(12, 0.5),
                "contact_forces": forces,
                "contact_forces_desired": forces,
                "contact_points": FEET,
                "contact_normals": np.tile([0.0, 0.0, 1.0], (4, 1)),
                "com": com,
                "com_reference": com,
                "momentum": np.zeros(6),
                "base_reference": q[:7],
                "push": np.zeros(6),
                "push_point": np.zeros(3),
                "wbc_status": 0,
                "wbc_ms": 0.1,
                "command": np.zeros(3),
                "mode": MODES.index("stand"),
                "gait_period_s": 0.24,
                "stance": np.ones(4),
                "contact_states": np.zeros(4),
                "swing_targets": FEET,
                "footholds": FEET,
                **optional(k),
            }
        )
        if k % 10 == 0:
            recorder.record_mpc(time, np.tile(com, (21, 1)), forces, 0, 0.5)


@pytest.fixture
def standing() -> RunLog:
    recorder = new_recorder()
    record_standing(recorder)
    return recorder.log()


@pytest.fixture
def changed(standing: RunLog) -> Callable[[Callable[[dict[str, np.ndarray]], None]], RunLog]:
    """Return a function that gives the standing log after a change to writable copies of its arrays."""

    def change(edit: Callable[[dict[str, np.ndarray]], None]) -> RunLog:
        arrays = {name: np.array(array) for name, array in standing.arrays().items() if np.ndim(array)}
        edit(arrays)
        return replace(standing, **arrays)

    return change
