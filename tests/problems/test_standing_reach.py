"""Talos reaches with a hand and keeps its balance: forces by inverse dynamics, figures by hand, bad input."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.ocp import Trajectory, check_derivatives
from lgmpc.problems import Scenario
from lgmpc.problems.motion import carry, reactions
from lgmpc.problems.standing_reach import (
    StandingReachSettings,
    build_standing_reach,
    center_of_pressure,
    in_axes_of,
    sole_corners,
)
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import LineSearchSqp, Status

SOLES = ("left_sole_link", "right_sole_link")
BOTH = np.ones((1, 2), dtype=np.bool_)
REACH = StandingReachSettings(frame="gripper_left_base_link", position_m=(0.7, 0.25, 1.05), rpy_deg=(0.0, -90.0, 0.0))


@lru_cache
def talos() -> Robot:
    return load_robot(RobotSpec(model="talos", contact_frames=SOLES, armature_kg_m2={"gripper_*": 0.1}))


@lru_cache
def scenario() -> Scenario:
    return build_standing_reach(talos(), REACH)


def test_soles_carry_the_weight_at_rest() -> None:
    robot = talos()
    wrench, effort = carry(robot, robot.q_reference, BOTH[0], 6)
    weight = robot.mass * 9.81
    np.testing.assert_allclose(wrench[:, :3].sum(axis=0), [0.0, 0.0, weight], rtol=0, atol=1e-9 * weight)
    again = reactions(robot, Trajectory(np.tile(robot.x_reference, (2, 1)), effort[None]), np.ones(1), BOTH, 6)
    np.testing.assert_allclose(again.wrenches[0], wrench, rtol=0, atol=1e-8 * weight)
    assert again.misfit[0] < 1e-9 * weight
    # At rest the ground's pressure is centred below the centre of mass.
    com = pin.centerOfMass(robot.model, robot.create_data(), robot.q_reference)
    places = stance()
    moment = wrench[:, 3:].sum(axis=0) + sum(
        np.cross(p.translation, f[:3]) for p, f in zip(places, wrench, strict=True)
    )
    total = np.concatenate([wrench[:, :3].sum(axis=0), moment])
    np.testing.assert_allclose(center_of_pressure(total), com[:2], rtol=0, atol=1e-9)


def stance() -> list[pin.SE3]:
    robot, data = talos(), talos().create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    return [data.oMf[i].copy() for i in robot.contact_ids]


def test_wrenches_are_those_that_move_the_robot() -> None:
    """Pinocchio's forward dynamics under random wrenches and efforts, and back."""
    robot, rng = talos(), np.random.default_rng(0)
    q = pin.integrate(robot.model, robot.q_reference, 0.2 * rng.standard_normal(robot.nv))
    v, u, wrenches = rng.standard_normal(robot.nv), rng.standard_normal(robot.nu), 100.0 * rng.standard_normal((2, 6))
    data = robot.create_data()
    pin.computeJointJacobians(robot.model, data, q)
    pin.updateFramePlacements(robot.model, data)
    effort = np.concatenate([np.zeros(6), u])
    for i, wrench in zip(robot.contact_ids, wrenches, strict=True):
        effort += pin.getFrameJacobian(robot.model, data, i, pin.LOCAL_WORLD_ALIGNED).T @ wrench
    a = pin.aba(robot.model, data, q, v, effort)
    h = 0.01
    states = np.array([np.concatenate([q, v]), np.concatenate([q, v + h * a])])
    found = reactions(robot, Trajectory(states, u[None]), np.array([h]), BOTH, 6)
    np.testing.assert_allclose(found.wrenches[0], wrenches, rtol=0, atol=1e-7)
    assert found.misfit[0] < 1e-8
    less = reactions(robot, Trajectory(states, u[None]), np.array([h]), np.array([[True, False]]), 6)
    assert less.misfit[0] > 1.0 and not less.wrenches[0, 1].any()  # the wrench of one sole does not balance it


def test_pressure_and_corners_by_hand() -> None:
    """100 N at (0.03, -0.02): its moment about the origin is p x f."""
    force, point = np.array([5.0, -3.0, 100.0]), np.array([0.03, -0.02, 0.0])
    np.testing.assert_allclose(center_of_pressure(np.concatenate([force, np.cross(point, force)])), point[:2])
    corners = sole_corners(pin.SE3(pin.exp3(np.array([0, 0, np.pi / 2])), np.array([1.0, 2.0, 0.0])), (0.2, 0.1))
    np.testing.assert_allclose(corners[0], [0.9, 2.2, 0.0], rtol=0, atol=1e-12)


def test_wrenches_in_a_soles_own_axes() -> None:
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, np.pi / 2])), np.ones(3))
    world = np.array([[[0.0, 2.0, 5.0, -3.0, 0.0, 0.0]]])
    np.testing.assert_allclose(in_axes_of([turned], world), [[[2.0, 0.0, 5.0, 0.0, 3.0, 0.0]]], atol=1e-15)


def test_figures_of_standing_still() -> None:
    """Under the guess's efforts the robot stands (to the integrator's error) and does not reach the target."""
    robot = talos()
    start = scenario().guess
    still = Trajectory(np.tile(robot.x_reference, (31, 1)), start.us)
    figures = scenario().figures(still)
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    hand = data.oMf[robot.frame(REACH.frame)]
    assert figures["position_error_m"] == pytest.approx(np.linalg.norm(hand.translation - REACH.position_m))
    com = pin.centerOfMass(robot.model, data, robot.q_reference)
    edges = [0.1 + s * (com[0] - stance()[0].translation[0]) for s in (1, -1)]
    assert figures["com_margin_m"] == pytest.approx(min(edges), abs=1e-9)
    assert figures["zmp_margin_m"] == pytest.approx(figures["com_margin_m"], abs=1e-7)
    assert figures["slip_m"] == pytest.approx(0.0, abs=1e-12) and figures["final_speed_m_s"] == 0.0
    assert scenario().contact_forces is not None
    forces = scenario().contact_forces(still)
    np.testing.assert_allclose(forces.sum(axis=1)[:, 2], robot.mass * 9.81, rtol=1e-9)
    outside = still.xs.copy()
    outside[5, robot.joint_q.start] = robot.joint_upper[0] + 0.1
    assert scenario().figures(Trajectory(outside, start.us))["joint_limit_violation_rad"] == pytest.approx(0.1)


@pytest.mark.slow
def test_talos_reaches_as_far_as_its_balance_allows() -> None:
    solution = LineSearchSqp(scenario().problem).solve(scenario().guess, max_iterations=60)
    assert solution.status is Status.CONVERGED
    figures = scenario().figures(solution.trajectory)
    assert figures["position_error_m"] < 1e-3 and figures["rotation_error_deg"] < 0.1
    # The margin of the soles is the active limit, up to the soles' own motion.
    assert figures["zmp_margin_m"] == pytest.approx(REACH.sole_margin_m, abs=1e-4)
    assert figures["cop_margin_m"] > REACH.sole_margin_m - 1e-4
    assert figures["friction_ratio"] < 1.0
    assert figures["slip_m"] < 1e-3 and figures["sole_turn_deg"] < 0.1
    held = solution.xs[:-1, talos().joint_q]  # the last state, nearly at rest, is bound by no constraint
    assert (held >= talos().joint_lower - 1e-9).all() and (held <= talos().joint_upper + 1e-9).all()
    assert figures["joint_limit_violation_rad"] < 1e-4
    joints = np.abs(np.diff(solution.xs[:, talos().nq :], axis=0))[:, 6:].max(axis=1) / REACH.node_s
    assert joints.max() < 2.0 * np.median(joints) + 2.0  # rad/s2: no late deceleration
    assert (np.abs(solution.us) <= talos().effort_limit * (1 + 1e-6)).all()
    assert solution.residual().largest < 1e-5


@pytest.mark.slow
def test_derivatives_of_the_whole_problem() -> None:
    problem = build_standing_reach(talos(), REACH.replace({"nodes": 1})).problem
    report = check_derivatives(problem, np.random.default_rng(0), spread=0.1)
    assert report.passed, str(report)


def test_joint_limits_are_rows_of_the_constraint_open_only_at_the_given_state() -> None:
    robot, problem = talos(), scenario().problem
    rows = slice(robot.nu, 2 * robot.nu)
    for node in (0, 1):
        point = problem.evaluate(node, robot.x_reference, np.zeros(robot.nu))
        np.testing.assert_allclose(point.constraint[rows], robot.q_reference[robot.joint_q])
        room = np.minimum(point.upper - point.constraint, point.constraint - point.lower)[rows]
        assert room.min() == pytest.approx(1.0 if node == 0 else 0.0)  # a gripper is at its limit


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "gripper_left_bas_link"}, "gripper_left_base_link"),
        ({"sole_margin_m": 0.07}, "sole_margin_m: got 0.07; expected less than 0.065"),
        ({"node_s": 0.0}, "node_s"),
    ],
)
def test_unknown_frames_and_large_margins_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_standing_reach(talos(), REACH.replace(change))


def test_a_robot_without_soles_is_refused() -> None:
    with pytest.raises(InputError, match="robot: got talos without soles"):
        build_standing_reach(load_robot(RobotSpec(model="talos", armature_kg_m2={"gripper_*": 0.1})), REACH)
