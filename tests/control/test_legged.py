"""The controller as the loop sees it: it never raises, and keeps the last safe command."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import build_controller, build_robot, prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.interface import RobotState
from lgmpc.control.legged import LeggedController
from lgmpc.control.modes import Mode
from lgmpc.control.reference import CircleReference
from lgmpc.errors import InputError
from lgmpc.estimation import FrictionMonitor
from lgmpc.lie import so3
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.robot import Robot
from lgmpc.robot.lying import lying_posture, place_feet
from lgmpc.status import Status
from lgmpc.wbc import WholeBodyController, standard_tasks

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_balance.yaml"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(load_config(CONFIG))


@pytest.fixture
def controller(robot: Robot) -> LeggedController:
    return build_controller(load_config(CONFIG), robot)


def test_standing_needs_the_static_torques(controller: LeggedController, robot: Robot) -> None:
    command = controller.update(RobotState(0.0, robot.q_reference, np.zeros(robot.nv)))
    weight = controller.wbc.forces[:, 2].sum()
    assert weight == pytest.approx(robot.mass * 9.81, rel=1e-4)
    assert np.abs(command.tau).max() < 1.0
    assert not command.kd.any()
    np.testing.assert_allclose(controller.target, controller.wbc.terms.com)


def test_a_state_that_is_not_finite_keeps_the_last_torques_with_damping(
    controller: LeggedController, robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    rest = np.zeros(robot.nv)
    good = controller.update(RobotState(0.0, robot.q_reference, rest))
    broken = robot.q_reference.copy()
    broken[9] = np.nan
    with caplog.at_level(logging.WARNING):
        for k in range(1, 30):
            command = controller.update(RobotState(1e-3 * k, broken, rest))
            np.testing.assert_array_equal(command.tau, good.tau)
            assert (command.kd > 0.0).all()
    assert controller.wbc.status is Status.NOT_FINITE
    assert controller.report.plan is not None and controller.report.plan.status is Status.NOT_FINITE
    assert len([record for record in caplog.records if "whole-body" in record.message]) == 1
    recovered = controller.update(RobotState(0.03, robot.q_reference, rest))
    assert controller.wbc.status is Status.CONVERGED
    assert not recovered.kd.any() and np.isfinite(recovered.tau).all()


def test_a_stale_plan_is_not_followed(controller: LeggedController, robot: Robot) -> None:
    """With the plan stale, the whole-body QP regulates the centre of mass to the user's target."""
    rest = np.zeros(robot.nv)
    controller.update(RobotState(0.0, robot.q_reference, rest))
    planner = controller.planner
    assert planner is not None
    mass = planner.mpc.problem.view("mass")  # type: ignore[attr-defined]
    mass[:] = np.nan  # the fault: a number of the MPC's model is lost, all else is sound
    for k in range(1, 80):
        command = controller.update(RobotState(1e-3 * k, robot.q_reference, rest))
        assert controller.wbc.status is Status.CONVERGED
        assert np.isfinite(command.tau).all()
    assert planner.plan is not None and planner.plan.status is Status.STALE
    np.testing.assert_array_equal(controller.wbc.tasks["com"].target.position, controller.target)
    mass[:] = robot.mass
    for k in range(80, 100):
        controller.update(RobotState(1e-3 * k, robot.q_reference, rest))
    assert planner.plan is not None and planner.plan.status is Status.STEPPED


def test_a_tick_without_solution_is_left_out_of_the_observation(controller: LeggedController, robot: Robot) -> None:
    """While a fall-back acts, the motion is not that of the QP's acceleration, and must not be taken for a push."""
    rest, moving = np.zeros(robot.nv), np.zeros(robot.nv)
    moving[0] = 0.5
    controller.update(RobotState(0.0, robot.q_reference, rest))
    planner = controller.planner
    assert planner is not None
    weight = controller.wbc.tasks["com"].weight
    kept = weight.copy()
    weight[:] = np.nan  # the fault: a tick's QP cannot be solved
    controller.update(RobotState(0.001, robot.q_reference, rest))
    assert controller.wbc.status is Status.NOT_FINITE
    weight[:] = kept
    controller.update(RobotState(0.002, robot.q_reference, moving))  # it gained speed unobserved
    np.testing.assert_allclose(planner.observer.wrench, 0.0, atol=1e-6)


def test_it_waits_for_a_first_finite_state(controller: LeggedController, robot: Robot) -> None:
    command = controller.update(RobotState(0.0, np.full(robot.nq, np.nan), np.zeros(robot.nv)))
    np.testing.assert_array_equal(command.tau, 0.0)
    assert (command.kd > 0.0).all()
    controller.update(RobotState(0.001, robot.q_reference, np.zeros(robot.nv)))
    assert controller.wbc.status is Status.CONVERGED
    assert np.isfinite(controller.target).all()


def test_a_robot_on_its_side_gets_no_torque(controller: LeggedController, robot: Robot) -> None:
    rest = np.zeros(robot.nv)
    controller.update(RobotState(0.0, robot.q_reference, rest))
    rolled = robot.q_reference.copy()
    rolled[3:7] = [np.sin(0.55), 0.0, 0.0, np.cos(0.55)]  # 63 degrees about x
    for q in (rolled, robot.q_reference):  # it does not jump up again when rolled back
        command = controller.update(RobotState(0.001, q, rest))
        assert controller.fallen
        np.testing.assert_array_equal(command.tau, 0.0)
        assert (command.kd > 0.0).all()


def test_the_observer_estimates_a_push() -> None:
    """Pushed with 10 N sideways at the base's centre of mass, which is near the whole robot's."""
    push = "pushes=[{body: base_link, time_s: 0.1, duration_s: 0.2, impulse_ns: [0.0, 2.0, 0.0]}]"
    session = prepare(load_config(CONFIG, [push, "duration_s=0.28"]))
    assert isinstance(session, ClosedLoopSession)
    session.run(lambda progress: None)
    planner = session.controller.planner
    assert planner is not None
    np.testing.assert_allclose(planner.observer.wrench[:3], [0.0, 10.0, 0.0], atol=0.05)


def test_a_push_is_predicted_to_fade_with_its_time_constant(robot: Robot) -> None:
    """The wrench that the MPC receives decays over the nodes by exp(-t / wrench_decay_s)."""
    controller = build_controller(load_config(CONFIG, ["mpc.wrench_decay_s=0.05"]), robot)
    controller.update(RobotState(0.0, robot.q_reference, np.zeros(robot.nv)))
    planner = controller.planner
    assert planner is not None
    planner.observer.skip()
    planner.observer.wrench[:] = [1.0, -2.0, 0.5, 0.1, 0.0, 0.0]
    for k in range(1, 11):
        controller.update(RobotState(1e-3 * k, robot.q_reference, np.zeros(robot.nv)))
        planner.observer.skip()
        planner.observer.wrench[:] = [1.0, -2.0, 0.5, 0.1, 0.0, 0.0]
    seen = planner.mpc.problem.view("external_wrench")[:20]  # type: ignore[attr-defined]
    expected = np.exp(-0.02 * np.arange(20) / 0.05)[:, None] * planner.observer.wrench
    np.testing.assert_allclose(seen, expected, atol=1e-12)


def test_the_mpc_receives_position_and_momentum_of_the_reference(robot: Robot) -> None:
    circle = "reference={kind: com_circle, radius_m: 0.02, frequency_hz: 0.5, start_s: 0.0, ramp_s: 0.5}"
    controller = build_controller(load_config(CONFIG, [circle]), robot)
    for k in range(3):
        controller.update(RobotState(1e-3 * k, robot.q_reference, np.zeros(robot.nv)))
    planner = controller.planner
    assert planner is not None
    seen = planner.mpc.problem.view("x_reference")  # type: ignore[attr-defined]
    times = 0.02 * np.arange(21)
    offset, velocity, _ = CircleReference(radius_m=0.02, frequency_hz=0.5, start_s=0.0, ramp_s=0.5).sample(times)
    np.testing.assert_allclose(seen[:, :3], controller.wbc.terms.com + offset, atol=1e-9)
    np.testing.assert_allclose(seen[:, 3:6], robot.mass * velocity, atol=1e-12)
    assert np.abs(velocity).max() > 0.01


@pytest.mark.parametrize("broken", [False, True])
def test_targets_that_no_plan_has_are_those_of_standing(robot: Robot, broken: bool) -> None:
    """A plan of the legs that a centroidal or a stale one follows leaves no trace in the targets."""
    controller = build_controller(load_config(CONFIG, ["mpc.stale_after=1"]), robot)
    rest, planner = np.zeros(robot.nv), controller.planner
    controller.update(RobotState(0.0, robot.q_reference, rest))
    assert planner is not None
    names = ("base_orientation", "posture", "angular_momentum")
    base, posture, momentum = (controller.wbc.tasks[name].target for name in names)
    upright = base.rotation.copy()
    for k in range(1, 41):
        base.rotation[:], posture.position[:] = np.eye(3)[[1, 2, 0]], 0.5
        momentum.momentum[:] = momentum.rate[:] = 9.0
        if broken:
            planner.mpc.problem.view("mass")[:] = np.nan  # type: ignore[attr-defined]
        controller.update(RobotState(1e-3 * k, robot.q_reference, rest))
    assert planner.plan is not None and planner.plan.status is (Status.STALE if broken else Status.STEPPED)
    np.testing.assert_allclose(base.rotation, upright, atol=1e-12)
    np.testing.assert_array_equal(posture.position, robot.q_reference[robot.joint_q])
    np.testing.assert_allclose(momentum.rate, 0.0, atol=0.05)
    np.testing.assert_allclose(momentum.momentum, 0.0, atol=0.05)


def test_a_robot_that_halts_stands_above_its_feet_wherever_it_is(robot: Robot) -> None:
    """It was to walk, but its feet stayed: in the reference posture its centre of mass is where it is to be.

    In that of this test it is not above the middle of the feet; the robot is at (3, -2) and turned by 0.7 rad.
    """
    data, q = robot.create_data(), robot.q_reference
    pin.framesForwardKinematics(robot.model, data, q)
    feet = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
    placed = place_feet(robot, q, q[:3], feet + [0.02, 0.01, 0.0])
    assert placed is not None
    robot, turn = replace(robot, q_reference=placed), so3.exp(np.array([0.0, 0.0, 0.7]))
    away = np.abs(LegGeometry.of(robot).feet.mean(axis=0)[:2])
    assert away.min() > 0.005 and abs(away[0] - away[1]) > 0.005
    walk = "commands=[{at_s: 0.0, velocity_m_s: [0.3, 0.1, 0], gait: trot}, {at_s: 0.1, velocity_m_s: [0, 0, 0]}]"
    controller, modes, errors = build_controller(load_config(CONFIG, [walk]), robot), [Mode.STAND], []
    q = np.concatenate([turn @ placed[:3] + [3.0, -2.0, 0.0], [0.0, 0.0, math.sin(0.35), math.cos(0.35)], placed[7:]])
    while Mode.LOCOMOTE not in modes or modes[-1] is Mode.LOCOMOTE:
        controller.update(RobotState(1e-3 * len(modes), q, np.zeros(robot.nv)))
        modes.append(controller.modes.mode)
        errors.append(float(np.linalg.norm(controller.target - controller.wbc.terms.com)))
        assert len(modes) < 1000
    assert modes[-1] is Mode.STAND
    assert max(errors) > 0.005 and errors[-1] < 1e-7


def test_a_robot_rises_from_where_it_lies(robot: Robot) -> None:
    """At (3, -2) and turned by 0.7 rad: the target of its centre of mass begins where that is."""
    controller, lying = build_controller(load_config(CONFIG), robot), lying_posture(robot)
    q = np.concatenate([[3.0, -2.0, lying[2]], [0.0, 0.0, math.sin(0.35), math.cos(0.35)], lying[7:]])
    modes: list[Mode] = []
    while Mode.RISE not in modes:
        controller.update(RobotState(0.01 * len(modes), q, np.zeros(robot.nv)))
        modes.append(controller.modes.mode)
        assert len(modes) < 1000
    assert modes[0] is Mode.LIE
    np.testing.assert_allclose(controller.target, controller.wbc.terms.com, atol=1e-9)


def test_missed_ticks_are_made_up_for(robot: Robot) -> None:
    """The command is limited in acceleration, and leads as far as without them; the observer knows how many."""
    walk = "commands=[{at_s: 0.0, velocity_m_s: [0.5, 0, 0], yaw_rate_rad_s: 0.2, gait: trot}]"
    every, some = (build_controller(load_config(CONFIG, [walk]), robot) for _ in range(2))
    planner, missed = some.planner, []
    assert planner is not None
    planner.observer.miss = missed.append  # type: ignore[method-assign]
    for k in range(40):
        state = RobotState(1e-3 * k, robot.q_reference, np.zeros(robot.nv))
        every.update(state)
        if not 20 <= k < 27:
            some.update(state)
    assert 0.01 < some.command.vx < 0.4
    assert some.command.vx == pytest.approx(every.command.vx, rel=1e-9)
    assert some.command.yaw_rate == pytest.approx(every.command.yaw_rate, rel=1e-9)
    assert missed == [7]


@pytest.mark.parametrize(("floor", "expected"), [(0.3, 0.3), (0.9, 0.6)])
def test_the_mpc_relies_on_no_more_friction_than_it_is_set_to_nor_than_the_floor_has(
    robot: Robot, floor: float, expected: float
) -> None:
    controller = build_controller(load_config(CONFIG, [f"wbc.friction={floor}"]), robot)
    controller.update(RobotState(0.0, robot.q_reference, np.zeros(robot.nv)))
    planner = controller.planner
    assert planner is not None and planner.mpc.settings.friction == 0.6
    np.testing.assert_array_equal(planner.contacts.friction, expected)


def test_tasks_that_it_leads_the_robot_by_are_named_where_they_are_missing(robot: Robot) -> None:
    settings = load_config("solo12_balance").wbc
    tasks = [task for task in standard_tasks(robot, settings) if task.name != "base_position"]
    wbc = WholeBodyController(robot, settings, tasks)
    with pytest.raises(InputError, match=r"tasks: got none called 'base_position'; expected tasks called com, .*swing"):
        LeggedController(robot, wbc, FrictionMonitor(0.6, 1e-3))
