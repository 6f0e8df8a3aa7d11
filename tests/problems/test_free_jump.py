"""A jump of free durations."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config import load_solve_config
from lgmpc.config.solving import build_scenario, prepare_solve
from lgmpc.errors import ConfigError
from lgmpc.runs import Outcome


def test_bad_ranges_are_named() -> None:
    with pytest.raises(ConfigError, match=r"flight_range_s.*shortest"):
        load_solve_config("solo12_jump_free_time", ["problem.flight_range_s=[0.5, 0.2]"])


def test_the_guess_has_the_middle_durations() -> None:
    scenario = build_scenario(load_solve_config("solo12_jump_free_time"))
    figures = scenario.figures(scenario.guess)
    assert figures["takeoff_s"] == pytest.approx(np.sqrt(0.2 * 0.5))
    assert figures["flight_s"] == pytest.approx(np.sqrt(0.25 * 0.55))
    times = scenario.times_of(scenario.guess)
    assert times[-1] == pytest.approx(sum(figures[f"{name}_s"] for name in ("takeoff", "flight", "landing")))
    assert scenario.guess.xs.shape == (scenario.problem.nodes + 1, scenario.robot.nq + scenario.robot.nv + 1)


@pytest.mark.slow
def test_it_jumps_as_high_as_the_torques_allow_and_says_so() -> None:
    """With longer intervals than the config's, for speed; the first-order integrator loses height in flight."""
    longer = ["problem.step_s=0.012", "problem.takeoff_range_s=[0.1, 0.5]", "gate.max_slip_m=0.006"]
    session = prepare_solve(load_solve_config("solo12_jump_free_time", longer))
    outcome = session.run(lambda _: None)
    assert outcome.verdict.outcome is Outcome.PASS, outcome.verdict.reasons
    assert "less than requested" in outcome.explanation and "torque of" in outcome.explanation
    assert outcome.figures["effort_ratio"] == pytest.approx(1.0, abs=1e-4)
    robot, log = session.scenario.robot, outcome.log
    data, heights = robot.create_data(), []
    for x in log.xs:
        pin.centerOfMass(robot.model, data, x[: robot.nq], x[robot.nq : robot.nq + robot.nv])
        heights.append((data.com[0][2], data.vcom[0][2]))
    rise = max(height for height, _ in heights) - heights[0][0]
    assert outcome.figures["com_rise_m"] == pytest.approx(rise, abs=1e-9)
    height, rate = heights[np.flatnonzero(~log.contact_flags.any(axis=1))[0]]
    assert rise < height + rate**2 / (2 * 9.81) - heights[0][0] < 0.2505
    spans = [outcome.figures[f"{name}_s"] for name in ("takeoff", "flight", "landing")]
    assert log.times[-1] == pytest.approx(sum(spans))
    assert 0.1 < spans[0] < 0.5 and 0.25 < spans[1] < 0.55
