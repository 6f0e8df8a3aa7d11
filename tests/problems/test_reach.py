"""Reaching arms: the trajectory against Pinocchio's dynamics, and refused robots."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.problems import Scenario
from lgmpc.problems.reach import ReachSettings, build_reach
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import BoxFddp, LineSearchSqp, LineSearchSqpSettings, Solution, Status

TARGET = ReachSettings(frame="link2", position_m=(0.0290872, 0.06, 0.115), nodes=20, node_s=0.02)
"""Reached by the first joint alone: the frame is at the second one's axis, 10 cm from the first one's."""


@lru_cache
def pendulum(effort: float = 2.0) -> Robot:
    return load_robot(
        RobotSpec(
            model="double_pendulum", effort_limit_nm=effort, velocity_limit_rad_s=20.0, position_limit_rad=(-3.0, 3.0)
        )
    )


@lru_cache
def solved() -> tuple[Scenario, Solution]:
    scenario = build_reach(pendulum(), TARGET)
    return scenario, BoxFddp(scenario.problem).solve(scenario.guess)


def test_it_reaches_the_target_at_rest() -> None:
    scenario, solution = solved()
    assert solution.status is Status.CONVERGED, solution.explain()
    figures = scenario.figures(solution.trajectory)
    assert figures["position_error_m"] < 1e-3
    assert figures["final_joint_velocity_rad_s"] < 1e-3
    assert figures["joint_limit_violation_rad"] == figures["joint_velocity_violation_rad_s"] == 0.0
    assert "rotation_error_deg" not in figures


def test_every_interval_is_a_step_of_pinocchios_forward_dynamics() -> None:
    scenario, solution = solved()
    robot = scenario.robot
    data = robot.create_data()
    for k, u in enumerate(solution.us):
        q, v = solution.xs[k, : robot.nq], solution.xs[k, robot.nq :]
        v_next = v + scenario.durations[k] * pin.aba(robot.model, data, q, v, u)
        q_next = pin.integrate(robot.model, q, scenario.durations[k] * v_next)
        np.testing.assert_allclose(solution.xs[k + 1], np.concatenate([q_next, v_next]), atol=1e-9)


def test_weak_motors_are_used_up_to_their_limit_and_no_further() -> None:
    scenario = build_reach(pendulum(effort=0.8), TARGET)
    solution = LineSearchSqp(scenario.problem).solve(scenario.guess)
    assert solution.status is Status.CONVERGED, solution.explain()
    promised = LineSearchSqpSettings().tolerance  # of the constraints, N.m
    assert np.abs(solution.us).max() == pytest.approx(0.8, abs=promised)
    assert scenario.controls is not None and scenario.controls.ratio(solution.us) == pytest.approx(1.0, abs=promised)
    assert np.abs(solved()[1].us).max() > 0.8  # which strong motors pass
    assert scenario.figures(solution.trajectory)["position_error_m"] < 1e-3


def test_another_solver_finds_the_same() -> None:
    scenario, solution = solved()
    other = LineSearchSqp(scenario.problem).solve(scenario.guess)
    assert other.cost == pytest.approx(solution.cost, rel=1e-8)
    np.testing.assert_allclose(other.xs, solution.xs, atol=1e-4)


def test_the_requested_rotation_is_the_figures_and_the_waypoints() -> None:
    robot = load_robot(RobotSpec(model="panda"))
    scenario = build_reach(
        robot, ReachSettings(frame="panda_hand_tcp", position_m=(0.4, 0.0, 0.4), rpy_deg=(180.0, 0.0, 30.0))
    )
    (place,) = scenario.waypoints
    turn = pin.rpy.rpyToMatrix(np.pi, 0.0, np.pi / 6.0)
    np.testing.assert_allclose(place.rotation, turn, atol=1e-12)
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    now = data.oMf[robot.frame("panda_hand_tcp")]
    figures = scenario.figures(scenario.guess)
    expected = np.degrees(pin.AngleAxis(turn.T @ now.rotation).angle)
    assert figures["rotation_error_deg"] == pytest.approx(expected, abs=1e-6)
    assert figures["position_error_m"] == pytest.approx(np.linalg.norm(now.translation - [0.4, 0.0, 0.4]))


def test_weights_are_parameters_that_recompile_nothing() -> None:
    one, other = (build_reach(pendulum(), TARGET.replace({"weights.rest": rest})) for rest in (1e3, 7.0))
    assert one.problem.parameters.shape == other.problem.parameters.shape
    assert not np.array_equal(one.problem.parameters, other.problem.parameters)


def test_unfit_robots_and_frames_are_refused() -> None:
    with pytest.raises(InputError, match="link2"):
        build_reach(pendulum(), TARGET.replace({"frame": "link3"}))
    iris = load_robot(RobotSpec(model="iris"))
    with pytest.raises(InputError, match="fixed base"):
        build_reach(iris, TARGET.replace({"frame": "iris__base"}))
