"""The circle of the centre of mass: forces and figures against Pinocchio, figures of the guess by hand."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.ocp import Trajectory
from lgmpc.problems import Controls, Scenario, Waypoint
from lgmpc.problems.com_circle import ComCircleSettings, build_com_circle
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.solvers import Fddp, Solution, Status

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
SPEC = RobotSpec(
    model="solo12", contact_frames=FEET, effort_limit_nm=1.8, velocity_limit_rad_s=30.0, position_limit_rad=(-3.2, 3.2)
)


@lru_cache
def scenario(turns: float = 0.2) -> Scenario:
    return build_com_circle(load_robot(SPEC), ComCircleSettings(frequency_hz=turns))


@lru_cache
def solution() -> Solution:
    return Fddp(scenario().problem).solve(scenario().guess)


def test_the_error_of_standing_still_is_the_chord() -> None:
    figures = scenario().figures(scenario().guess)
    assert figures["com_error_m"] == pytest.approx(2.0 * 0.065 * np.sin(0.2 * np.pi))  # the chord of a fifth of a turn
    assert figures["foot_displacement_m"] == 0.0


def test_quarters_of_turns_and_the_end_are_marked() -> None:
    whole = scenario(turns=1.0)
    start = whole.waypoints[-1].position
    assert [mark.time for mark in whole.waypoints] == pytest.approx([0.24, 0.5, 0.76, 1.0])  # the nearest nodes
    np.testing.assert_allclose(whole.waypoints[1].position - start, [-0.13, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_contact_forces_explain_pinocchios_acceleration(seed: int) -> None:
    """M a + nle = [0; u] + J^T f for any trajectory, a being that of the action's next velocity."""
    s, rng = scenario(), np.random.default_rng(seed)
    robot, problem = s.robot, s.problem
    x = problem.state.integrate(robot.x_reference, 0.1 * rng.standard_normal(36))
    u = rng.standard_normal(12)
    xs, us = np.tile(x, (51, 1)), np.tile(u, (50, 1))
    xs[4] = problem.evaluate(3, x, u).x_next
    assert s.contact_forces is not None
    forces = s.contact_forces(Trajectory(xs, us))[3]
    model, data = robot.model, robot.create_data()
    a = (xs[4] - x)[robot.nq :] / 0.02
    left = pin.rnea(model, data, x[: robot.nq], x[robot.nq :], a)
    right = np.concatenate([np.zeros(6), u])
    pin.computeJointJacobians(model, data, x[: robot.nq])
    for frame, force in zip(robot.contact_ids, forces, strict=True):
        right += pin.computeFrameJacobian(model, data, x[: robot.nq], frame, pin.LOCAL_WORLD_ALIGNED)[:3].T @ force
    np.testing.assert_allclose(left, right, atol=1e-9)


@pytest.mark.slow
def test_the_circle_is_tracked_within_friction_without_slip() -> None:
    found = solution()
    assert found.status is Status.CONVERGED, found.explain()
    assert np.abs(found.defects()).max() < 1e-9
    figures = scenario().figures(found.trajectory)
    assert figures["com_rms_error_m"] < 1e-3  # measured 0.76 mm: the effort costs something too
    assert figures["foot_displacement_m"] < 1e-3
    assert figures["friction_margin_n"] > -1e-3
    controls = scenario().controls
    assert controls is not None and controls.ratio(found.us) < 1.0


def test_a_robot_without_feet_is_refused() -> None:
    with pytest.raises(InputError, match="contact_frames"):
        build_com_circle(load_robot(RobotSpec(model="panda")))


def test_inconsistent_arguments_are_refused() -> None:
    s = scenario()
    with pytest.raises(InputError, match="durations"):
        Scenario("x", s.robot, s.problem, s.guess, np.ones(3), s.figures)
    few = Controls(("a",), "N", np.zeros(1), np.ones(1))
    with pytest.raises(InputError, match="1 names"):
        Scenario("x", s.robot, s.problem, s.guess, s.durations, s.figures, controls=few)
    with pytest.raises(InputError, match="upper"):
        Controls(("a",), "N", np.zeros(1), np.ones(2))
    assert Waypoint("x", 0.0, np.zeros(3)).rotation is None


def test_a_control_is_compared_with_the_limit_on_its_side() -> None:
    controls = Controls(("a", "b"), "N", np.array([0.0, -4.0]), np.array([2.0, 1.0]))
    assert controls.ratio(np.array([[1.0, -2.0]])) == 0.5
    assert controls.ratio(np.array([[1.0, 1.5]])) == 1.5
    assert controls.ratio(np.array([[-1e-3, 0.0]])) > 1.0  # a rotor that pulls
    assert controls.ratio(np.zeros((0, 2))) == 0.0
