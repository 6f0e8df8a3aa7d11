"""Pushes on legs in the air, and the friction of their joints: on motions of known torques, and in closed loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.interface import RobotState
from lgmpc.errors import InputError
from lgmpc.estimation import FreeLegs, JointFrictionEstimator, JointFrictionSettings
from lgmpc.robot import Robot

PERIOD = 1e-3
FRICTION = np.linspace(0.02, 0.13, 12)
FLYING = np.zeros(4, dtype=np.bool_)


def motion(robot: Robot, seconds: float) -> tuple[list[np.ndarray], np.ndarray, list[np.ndarray]]:
    """Return positions, velocities and torques of joints that swing about the reference posture, each in its rhythm."""
    rng, data = np.random.default_rng(0), robot.create_data()
    rates, phases = rng.uniform(8.0, 12.0, 12), rng.uniform(0.0, 6.0, 12)
    v, torques, q = np.zeros((round(seconds / PERIOD) + 1, 18)), [], [robot.q_reference.copy()]
    v[:, 6:] = 8.0 * np.cos(rates * PERIOD * np.arange(len(v))[:, None] + phases)
    for before, after in zip(v, v[1:], strict=False):
        torques.append(pin.rnea(robot.model, data, q[-1], before, (after - before) / PERIOD)[6:])
        q.append(pin.integrate(robot.model, q[-1], PERIOD * before))
    return q, v, torques


def swing(robot: Robot, learner: JointFrictionEstimator, *, stance: np.ndarray = FLYING) -> None:
    """Swing the joints for 2 s with friction and a constant error of 0.05 N.m."""
    q, v, torques = motion(robot, 2.0)
    for k, acted in enumerate(torques):
        measured = acted + FRICTION * np.sign(v[k, 6:]) + 0.05
        learner.update(RobotState(PERIOD * (k + 1), q[k + 1], v[k + 1], stance, measured), stance)


def test_a_push_on_a_leg_in_the_air_is_estimated_and_remembered_on_the_ground(solo12: Robot) -> None:
    """Beyond a tenth of the limits of 1.8 N.m, smoothed over 5 ms; on the ground it fades with 0.1 s."""
    legs, push, touching = FreeLegs(solo12, PERIOD), np.zeros(12), np.array([True, False, True, True])
    push[3:6] = 0.5, -0.9, 0.1  # torques of the force on the joints of the second leg
    expected = np.zeros(12)
    expected[3:5] = 0.5 - 0.18, 0.18 - 0.9
    q, v, torques = motion(solo12, 0.2)
    for k in range(100):
        legs.update(RobotState(PERIOD * k, q[k], v[k], touching, torques[k - 1] - push))
    np.testing.assert_allclose(legs.opposed[3:6], -push[3:6], atol=1e-9)
    np.testing.assert_allclose(legs.load, expected, atol=1e-6)
    for k in range(100, 150):
        legs.update(RobotState(PERIOD * k, q[k], v[k], np.ones(4, dtype=np.bool_), np.zeros(12)))
    np.testing.assert_allclose(legs.load[3:5], np.exp(-0.5) * push[3:5] + [-0.18, 0.18], atol=1e-6)
    assert legs.update(RobotState(0.15, q[150], v[150], FLYING)).any()  # no torques: nothing new
    legs.reset()
    assert not legs.update(RobotState(0.151, q[151], v[151], FLYING, np.ones(12))).any()


def test_friction_is_distinguished_from_a_constant_error(solo12: Robot) -> None:
    learner = JointFrictionEstimator(solo12, PERIOD)
    swing(solo12, learner)
    assert learner.excited.all()
    np.testing.assert_allclose(learner.estimate, FRICTION, atol=1e-9)
    np.testing.assert_allclose(learner.friction, FRICTION, rtol=0.02)  # it follows with a lag


def test_legs_on_the_ground_teach_nothing(solo12: Robot) -> None:
    learner = JointFrictionEstimator(solo12, PERIOD)
    swing(solo12, learner, stance=np.ones(4, dtype=np.bool_))
    assert not learner.excited.any() and not learner.friction.any()


def test_joints_of_standing_legs_take_after_those_of_flying_ones(solo12: Robot) -> None:
    learner, stance = JointFrictionEstimator(solo12, PERIOD), np.array([False, True, True, True])
    swing(solo12, learner, stance=stance)
    assert learner.excited.tolist() == [True] * 3 + [False] * 9
    np.testing.assert_allclose(learner.friction[3:], learner.friction[:3].mean())


def test_a_motion_one_way_tells_nothing(solo12: Robot) -> None:
    learner = JointFrictionEstimator(solo12, PERIOD)
    v = np.full(18, 6.0)
    for _ in range(500):
        learner.update(RobotState(0.0, solo12.q_reference, v, FLYING, np.full(12, 0.1)), FLYING)
    assert not learner.excited.any() and not learner.friction.any()


def test_the_estimate_is_bounded_and_begins_with_what_is_known(solo12: Robot) -> None:
    settings = JointFrictionSettings(largest_share=0.05)
    learner = JointFrictionEstimator(solo12, PERIOD, settings)
    swing(solo12, learner)
    np.testing.assert_allclose(learner.estimate, np.minimum(FRICTION, 0.05 * 1.8), atol=1e-9)
    known = JointFrictionEstimator(replace(solo12, joint_friction=np.full(12, 0.03)), PERIOD)
    np.testing.assert_array_equal(known.friction, 0.03)


def test_a_missed_tick_is_not_compared(solo12: Robot) -> None:
    learner = JointFrictionEstimator(solo12, PERIOD)
    for k in range(500):
        v = np.full(18, 6.0 if k % 2 else -6.0)
        learner.update(RobotState(0.0, solo12.q_reference, v, FLYING, np.zeros(12)), FLYING, missed=1)
    assert not learner.excited.any()


@pytest.mark.parametrize("period", [0.0, -1.0])
def test_bad_input_is_refused(solo12: Robot, period: float) -> None:
    with pytest.raises(InputError, match="^period: got"):
        JointFrictionEstimator(solo12, period)


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "friction", "tolerance"), [("mujoco", 0.0, 1e-3), ("pinocchio", 0.1, 0.01)])
def test_a_trot_learns_the_friction_of_the_plant(plant: str, friction: float, tolerance: float) -> None:
    """MuJoCo's own is soft: it is less than its bound for a while after each reversal (0.08 is found for 0.1)."""
    commands = "commands=[{at_s: 0.2, velocity_m_s: [0.3, 0.0, 0.0], gait: trot}]"
    changes = (f"plant.kind={plant}", f"plant.joint_friction_nm={friction}", "joint_friction={}", commands)
    session = prepare(load_config("solo12_velocity", [*changes, "duration_s=3.0"]))
    assert isinstance(session, ClosedLoopSession)
    result = session.run(lambda progress: None)
    assert result.metrics is not None and result.metrics.joint_friction_nm == pytest.approx(friction, abs=tolerance)
    assert result.log.joint_friction is not None and not result.log.joint_friction[0].any()
