"""Figures of the modes, from a synthetic log of which each is known by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lgmpc.runs import Gate, RunLog, compute_metrics, judge
from lgmpc.runs.log import MODES

TICK = 1e-3


def moded_log(standing: RunLog) -> RunLog:
    """Stand; low from 0.3 s, damped from 0.4 s, folded from 0.6 s, rising from 0.7 s, standing from 0.9 s to 1 s."""
    arrays = {name: np.array(array) for name, array in standing.arrays().items() if np.ndim(array)}
    time, n = arrays["time"], len(arrays["time"])
    mode = np.full(n, MODES.index("stand"), dtype=np.int8)
    for begin, name in ((0.4, "damp"), (0.6, "lie"), (0.7, "rise"), (0.9, "stand")):
        mode[time >= begin - 1e-9] = MODES.index(name)
    arrays["q"][(time >= 0.3 - 1e-9) & (time < 0.9 - 1e-9), 2] = 0.05
    damped = mode == MODES.index("damp")
    arrays["tau"][damped] = np.where(np.arange(12) % 2, 0.1, -0.1)
    arrays["tau"][time >= 0.75 - 1e-9] += 0.2
    return replace(standing, **(arrays | {"mode": mode}))


def test_a_fall_and_the_rise_from_it_are_measured(standing: RunLog) -> None:
    metrics = compute_metrics(moded_log(standing))
    modes = metrics.modes
    assert modes is not None and metrics.falls == 1
    assert metrics.survived_s == pytest.approx(0.3)
    assert modes.give_up_s == pytest.approx(0.1)
    assert modes.damped_rms_torque_nm == pytest.approx(0.1)
    assert (modes.rises, modes.descents) == (1, 0)
    assert modes.torque_step_nm == pytest.approx(0.2)


def test_a_robot_that_lies_rises_and_sits_has_not_fallen(standing: RunLog) -> None:
    log = moded_log(standing)
    low = np.where(log.mode == MODES.index("damp"), MODES.index("sit"), log.mode).astype(np.int8)
    low[(log.time >= 0.3 - 1e-9) & (log.time < 0.4 - 1e-9)] = MODES.index("sit")
    metrics = compute_metrics(replace(log, mode=low))
    assert metrics.modes is not None
    assert metrics.falls == 0 and not metrics.fell
    assert (metrics.modes.give_up_s, metrics.modes.damped_rms_torque_nm) == (None, None)
    assert metrics.modes.descents == 1


def test_a_robot_that_never_gives_up_is_measured_to_the_end(standing: RunLog) -> None:
    log = moded_log(standing)
    upright = np.full(log.ticks, MODES.index("stand"), dtype=np.int8)
    modes = compute_metrics(replace(log, mode=upright)).modes
    assert modes is not None and modes.give_up_s == pytest.approx(0.6)


def test_a_second_fall_begins_after_the_legs_were_folded(standing: RunLog) -> None:
    log = moded_log(standing)
    q = log.q.copy()
    q[-50:, 2] = 0.05
    assert compute_metrics(replace(log, q=q)).falls == 2
    assert compute_metrics(replace(standing, q=q)).falls == 1, "without modes every fall is one"


def test_gates_count_falls(standing: RunLog) -> None:
    metrics = compute_metrics(moded_log(standing))
    limits = {"max_slip_m": None, "min_base_height_fraction": None}
    assert judge(metrics, Gate(**limits)).reasons == ("the robot fell after 0.3 s",)
    assert judge(metrics, Gate(**limits, max_falls=1, min_rises=1, max_give_up_s=0.11)).passed
    (reason,) = judge(metrics, Gate(**limits, max_falls=None, max_give_up_s=0.05)).reasons
    assert reason == "time after a fall until the joints are damped: 0.1 s, allowed at most 0.05 s (max_give_up_s)"
