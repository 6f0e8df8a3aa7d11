"""Steps of a standing robot against pushes, in closed loop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_controller, build_robot, prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.feet import Feet
from lgmpc.control.interface import RobotState
from lgmpc.control.uncommanded_steps import UncommandedSteps
from lgmpc.errors import ConfigError
from lgmpc.locomotion import BaseMotion, MotionCommand
from lgmpc.locomotion.reference import ReferenceBuilder
from lgmpc.locomotion.settings import gaits_of

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_step_recovery.yaml"


def pushed(
    *impulses: tuple[float, float],
    seconds: float,
    overrides: tuple[str, ...] = (),
    lasting: float = 0.2,
    body: str = "base_link",
    finished_apart: bool = False,
) -> ClosedLoopSession:
    """Return the session after pushes ahead and to the left, N.s, the first after 0.3 s, one every 6 s."""
    pushes = ", ".join(
        f"{{body: {body}, time_s: {0.3 + 6.0 * i}, duration_s: {lasting}, impulse_ns: [{x}, {y}, 0.0]}}"
        for i, (x, y) in enumerate(impulses)
    )
    session = prepare(load_config(CONFIG, [f"pushes=[{pushes}]", f"duration_s={seconds}", *overrides]))
    assert isinstance(session, ClosedLoopSession)
    if finished_apart:
        controller = session.controller
        controller.finishes, session.watch = False, lambda _: controller.finish() is None
    session.run(lambda progress: None)
    return session


@pytest.mark.parametrize(
    "impulse",
    [(4.2, 0.0), (3.5, 2.0), *(pytest.param(each, marks=pytest.mark.slow) for each in ((0.0, 2.0), (0.0, -4.2)))],
)
def test_a_push_that_the_feet_can_hold_is_held_in_place(impulse: tuple[float, float]) -> None:
    """At friction 0.6 they hold 4.25 to 4.6 N.s (scripts/push_recovery.py)."""
    session = pushed(impulse, seconds=1.3)
    log = session.recorder.log()
    assert log.stance is not None and log.stance.all()
    assert not session.controller.uncommanded_steps.costs
    moved = np.linalg.norm(log.contact_points[-1, :, :2] - log.contact_points[0, :, :2], axis=1)
    assert moved.max() < 0.02 and not session.controller.fallen


@pytest.mark.parametrize(("margin", "steps"), [(-0.06, False), (0.0, True)])
def test_where_friction_is_low_a_margin_keeps_the_feet_in_place(margin: float, steps: bool) -> None:
    """At friction 0.4 the feet hold 3.45 to 3.6 N.s, though the forecast, in which the push lasts on, leaves them."""
    same = tuple(f"{section}.friction=0.4" for section in ("plant", "mpc", "wbc"))
    session = pushed((0.0, 3.4), seconds=1.3, overrides=(*same, f"locomotion.reaction.margin_m={margin}"))
    log = session.recorder.log()
    assert log.stance is not None and bool(log.stance.all()) is not steps and not session.controller.fallen


def test_the_schedule_followed_is_the_best_of_those_evaluated() -> None:
    session = pushed((2.75, 4.76), seconds=0.55)
    steps, clock = session.controller.uncommanded_steps, session.controller.feet.clock
    assert steps.active and len(steps.costs) == 4
    schedules = session.controller.feet.step_schedules()
    close = [
        schedule for schedule, cost in zip(schedules, steps.costs, strict=True) if cost <= 1.001 * min(steps.costs)
    ]
    assert clock.gait in [schedule.gait for schedule in close]
    stance = session.recorder.log().stance
    assert stance is not None
    first = stance[np.flatnonzero(~stance.all(axis=1))[0]]
    assert any(not first[schedule.first] for schedule in close)
    # As of a loop that has forecasts made once the command is sent.
    apart = pushed((2.75, 4.76), seconds=0.55, finished_apart=True)
    assert apart.controller.uncommanded_steps.costs == steps.costs
    np.testing.assert_array_equal(apart.recorder.log().q, session.recorder.log().q)


@pytest.mark.parametrize(
    ("impulse", "first"), [((3.0, 5.196), "FL_FOOT"), pytest.param((-5.196, 3.0), "HL_FOOT", marks=pytest.mark.slow)]
)
def test_an_oblique_push_is_met_first_by_the_foot_that_it_points_to(impulse: tuple[float, float], first: str) -> None:
    """The other diagonal would brake along its line, and leave that foot loaded until the base has passed it."""
    session = pushed(impulse, seconds=1.5)
    log, feet = session.recorder.log(), session.controller.robot.contact_frames
    assert log.stance is not None and not session.controller.fallen
    lifted = log.stance[np.flatnonzero(~log.stance.all(axis=1))[0]] == 0
    assert lifted.sum() == 2 and lifted[feet.index(first)]


def test_schedules_are_evaluated_for_the_same_state() -> None:
    """A mirrored push exchanges the costs of the diagonals; a later evaluation finds a faster robot, and costs more."""
    left, right = (np.array(pushed((3.0, y), seconds=0.55).controller.uncommanded_steps.costs) for y in (5.196, -5.196))
    np.testing.assert_allclose(left.reshape(2, 2), right.reshape(2, 2)[:, ::-1], rtol=2e-3)
    assert np.abs(left[0] - left[1]) > 5e-3 * left[0]


def test_the_way_back_is_straight_and_ends_where_the_robot_stood() -> None:
    """From 0.3 m ahead and to the right, turned by 0.5 rad: at the speed of the settings, then ever slower."""
    config = load_config(CONFIG)
    robot = build_robot(config)
    controller, settings = build_controller(config, robot), config.locomotion
    feet = Feet(robot, settings, gaits_of(robot, settings), controller.wbc.contacts)
    reference = ReferenceBuilder(robot, feet.legs)
    steps, home, yaw = UncommandedSteps(settings.reaction, feet, reference, robot.mass), np.array([3.0, -2.0]), 0.7
    reference.begin(np.array([*home, 0.0]), yaw)
    fast = np.zeros(robot.nv)
    fast[1] = 1.5
    controller.update(RobotState(0.0, robot.q_reference, fast))
    planner, terms, motion = controller.planner, controller.wbc.terms, BaseMotion(0.0, 0.0, 0.0, 1.5, 0.0)
    assert planner is not None
    feet.begin(0.0, terms.contact_points, None)
    steps.watch(0.0, planner, terms, motion, 0.6, np.ones((4, 3)))
    while not steps.decide(0.0, planner):
        assert steps.evaluate(planner)
    assert steps.active
    reference.begin(np.array([*home + [0.18, 0.24], 0.0]), yaw + 0.5)
    ahead, left, speeds, turns, away = np.array([0.6, 0.8]), np.array([-0.8, 0.6]), [], [], []
    for _ in range(3000):
        command, place = steps.way_back(MotionCommand(gait="walk"))
        if place is not None:
            reference.begin(*place)
        speeds.append(math.hypot(command.vx, command.vy))
        reference.advance(1e-3, command)
        at = np.array([reference.x, reference.y]) - home
        turns.append(reference.yaw - yaw)
        assert abs(at @ left) < 2e-4 and at @ ahead > -1e-9
        away.append(float(at @ ahead))
        if not speeds[-1]:
            break
        assert command.gait == "trot"
    assert (reference.x, reference.y, reference.yaw) == pytest.approx((*home, yaw), abs=1e-12)
    tolerance = settings.reaction.place_tolerance_m
    assert 0.99 * tolerance < away[-2] < tolerance  # the turn was small enough before
    assert max(speeds) == pytest.approx(settings.reaction.return_speed_m_s)
    assert np.diff(speeds).max() < 1e-9 and np.diff(turns).max() < 0.0


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_harder_pushes_are_met_by_steps_and_end_where_the_robot_stood(plant: str) -> None:
    session = pushed((0.0, 5.5), (5.5, 0.0), (2.75, 4.763), seconds=18.5, overrides=(f"plant.kind={plant}",))
    log, feet = session.recorder.log(), session.controller.feet
    assert feet.standing and not session.controller.fallen
    assert np.abs(log.v[-1]).max() < 0.05
    np.testing.assert_allclose(log.base_pose[-1, :2], log.base_pose[0, :2], atol=0.02)
    np.testing.assert_allclose(log.contact_points[-1, :, :2], log.contact_points[0, :, :2], atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["solo12_step_recovery", "solo12_trot_push"])
def test_hard_pushes_keep_joints_within_limits_and_knees_off_the_floor(name: str) -> None:
    """A knee on the floor breaks the balance of momentum, because only forces on feet are measured."""
    result = prepare(load_config(CONFIG.with_name(f"{name}.yaml"))).run(lambda progress: None)
    assert result.certificate is not None
    assert not [str(check) for check in result.certificate.broken]


@pytest.mark.slow
def test_without_steps_the_same_push_throws_the_robot_over() -> None:
    session = pushed((0.0, 5.5), seconds=3.0, overrides=("locomotion.reaction.enabled=false",))
    assert session.controller.fallen


def test_steps_against_a_push_take_as_long_as_in_the_forecast_that_chose_them() -> None:
    """Long steps of a gait may take longer; these must not, or the robot falls."""
    longer = "locomotion.swing.longest_share=1.25"
    assert not pushed((4.33, 2.5), seconds=2.5, overrides=(longer,)).controller.fallen


@pytest.mark.parametrize(
    ("plant", "impulse"),
    [("pinocchio", (5.0, 0.0)), *(pytest.param("mujoco", each, marks=pytest.mark.slow) for each in ((5, 0), (0, 5)))],
)
def test_a_stroke_of_20_ms_is_survived(plant: str, impulse: tuple[float, float]) -> None:
    """Feet that lag because the motors are too weak for their steps were taken for blocked ones, or slid on."""
    session = pushed(impulse, seconds=1.8, overrides=(f"plant.kind={plant}",), lasting=0.02)
    assert not session.controller.fallen and session.controller.uncommanded_steps.active


def test_a_push_on_a_shank_is_survived() -> None:
    """The foot flies off; where the load on the leg was not known, it was to carry on, and the robot fell."""
    session = pushed((-2.0, 0.0), seconds=1.5, body="FL_LOWER_LEG")
    log = session.recorder.log()
    assert not session.controller.fallen and log.tilt_deg.max() < 15.0
    assert log.stance is not None and not log.stance[log.time < 0.35, 0].all()


@pytest.mark.slow
@pytest.mark.parametrize("body", ["FL_SHOULDER", "HR_UPPER_LEG"])
def test_a_push_on_a_hip_or_thigh_makes_no_other_leg_step(body: str) -> None:
    session = pushed((0.0, 2.0), seconds=1.0, body=body)
    log = session.recorder.log()
    others = [foot for foot, name in enumerate(session.robot.foot_names) if name[:2] != body[:2]]
    assert log.stance is not None and log.stance[:, others].all() and log.tilt_deg.max() < 2.0  # 1.2 and 0.9


def test_steps_are_repeatable_bit_by_bit() -> None:
    first, second = (pushed((0.0, 5.5), seconds=0.7).recorder.log().arrays() for _ in range(2))
    assert np.any(first["stance"] == 0)
    for name in first.keys() - {"wbc_ms", "mpc_ms", "forecast_ms"}:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_steps_with_an_unknown_gait_are_refused_before_the_run() -> None:
    with pytest.raises(ConfigError, match=r"locomotion.reaction.gait: got 'trott'; .* Did you mean trot"):
        prepare(load_config(CONFIG, ["locomotion.reaction.gait=trott"]))
