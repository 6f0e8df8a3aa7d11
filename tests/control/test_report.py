"""The report of a tick: durations by part, and buffers instead of copies."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config
from lgmpc.control import legged
from lgmpc.control.interface import RobotState
from lgmpc.control.legged import LeggedController
from lgmpc.control.modes import Mode
from lgmpc.status import Status


@pytest.fixture
def controller() -> LeggedController:
    config = load_config("solo12_step_recovery")
    return build_controller(config, build_robot(config))


def test_planning_and_forecasts_have_durations_of_their_own(
    controller: LeggedController, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that only the stand-ins of contacts ahead, predictive controller, forecast and QP advance."""
    now = [0.0]

    def takes(owner: object, name: str, seconds: float) -> None:
        plain = getattr(owner, name)

        def slow(*arguments: object) -> object:
            now[0] += seconds
            return plain(*arguments)

        setattr(owner, name, slow)

    monkeypatch.setattr(legged, "perf_counter", lambda: now[0])
    planner = controller.planner
    assert planner is not None
    takes(controller.feet, "write_horizon", 0.5)
    takes(planner.mpc, "update", 4.0)
    takes(controller.wbc, "solve", 0.25)
    q, v = controller.robot.q_reference, np.zeros(controller.robot.nv)

    def durations(time: float) -> tuple[float, ...]:
        controller.update(RobotState(time, q, v))
        report = controller.report
        assert (report.time, report.planned) == (time, report.plan_ms > 0.0)
        return report.tick_ms, report.plan_ms, report.forecast_ms

    assert durations(0.0) == (250.0, 4500.0, 0.0)
    assert durations(0.001) == (250.0, 0.0, 0.0)
    monkeypatch.setattr(controller.uncommanded_steps, "evaluate", lambda _: True)
    takes(controller.uncommanded_steps, "evaluate", 2.0)
    assert durations(0.002) == (250.0, 0.0, 2000.0)


def test_a_report_refers_to_what_was_sensed_decided_and_solved(controller: LeggedController) -> None:
    before = controller.report
    assert np.isnan(before.time) and before.plan is None
    robot = controller.robot
    controller.update(RobotState(0.0, robot.q_reference, np.zeros(robot.nv)))
    report = controller.report
    assert (report.mode, report.status, report.finite) == (Mode.STAND, Status.CONVERGED, True)
    assert report.stance.all() and report.gait.name == "stand"
    assert report.forces is controller.wbc.forces and report.contact_points is controller.wbc.terms.contact_points
    assert report.forces[:, 2].sum() == pytest.approx(9.81 * robot.mass, rel=1e-3)
    assert controller.planner is not None and report.plan is controller.planner.plan
    broken = np.full(robot.nq, np.nan)
    controller.update(RobotState(0.001, broken, np.zeros(robot.nv)))
    assert (controller.report.finite, controller.report.status) == (False, Status.NOT_FINITE)
