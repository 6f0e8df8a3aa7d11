"""Leg sensing against Pinocchio, and the contact switch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lgmpc import load_config
from lgmpc.control.interface import Measurement
from lgmpc.errors import InputError
from lgmpc.estimation import ContactDetector, LegSensing
from lgmpc.lie import so3
from lgmpc.robot import Robot, load_robot

PERIOD, ENCODER, FOOT = 1e-3, 3e-3, 1e-3
NOTHING = np.zeros(12)


@pytest.fixture(scope="module")
def legs(solo12: Robot) -> LegSensing:
    return LegSensing(solo12, PERIOD, ENCODER, FOOT)


def reading(joints, speeds=NOTHING, torques=NOTHING, gyro=NOTHING[:3], accelerometer=NOTHING[:3]):
    return Measurement(0.0, gyro, accelerometer, joints, speeds, torques)


@pytest.mark.parametrize("seed", range(3))
def test_positions_covariances_and_motion_are_pinocchios(solo12: Robot, legs: LegSensing, seed: int) -> None:
    rng, model, data = np.random.default_rng(seed), solo12.model, solo12.create_data()
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[7:] = solo12.q_reference[7:] + 0.3 * rng.normal(size=12)
    v[6:] = rng.normal(size=12)
    rotation, velocity, gyro, bias = so3.exp(rng.normal(size=3)), *rng.normal(size=(3, 3))
    legs.reset()
    legs.update(reading(q[7:], v[6:], gyro=gyro + bias), rotation, velocity, bias)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    for i, frame in enumerate(solo12.contact_ids):
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:, 6:]
        np.testing.assert_allclose(legs.positions[i], data.oMf[frame].translation, atol=1e-14)
        expected = ENCODER**2 * jacobian[:3] @ jacobian[:3].T + FOOT**2 * np.eye(3)
        np.testing.assert_allclose(legs.covariances[i], expected, atol=1e-17)
        np.testing.assert_allclose(legs.rates[i], jacobian[3:] @ v[6:], atol=1e-13)
        world = rotation @ jacobian[:3]
        np.testing.assert_allclose(legs.spreads[i], world @ world.T, atol=1e-14)
    # The moving base as Pinocchio has it: the velocity of the material point below each foot's centre.
    q[3:7], v[:3], v[3:6] = pin.Quaternion(rotation).coeffs(), rotation.T @ velocity, gyro
    pin.forwardKinematics(model, data, q, v)
    for i, frame in enumerate(solo12.contact_ids):
        motion = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        expected = motion.linear + np.cross(motion.angular, [0.0, 0.0, -solo12.contact_radius])
        np.testing.assert_allclose(legs.velocities[i], expected, atol=1e-13)


def test_forces_balance_the_torques_and_the_legs_at_rest(solo12: Robot, legs: LegSensing) -> None:
    rng, model, data = np.random.default_rng(1), solo12.model, solo12.create_data()
    rotation = so3.exp(np.array([0.3, -0.2, 1.0]))
    q = solo12.q_reference.copy()
    q[3:7] = pin.Quaternion(rotation).coeffs()
    forces = rng.normal(size=(4, 3)) + [0.0, 0.0, 6.0]
    torques = pin.computeGeneralizedGravity(model, data, q)[6:].copy()
    for force, frame in zip(forces, solo12.contact_ids, strict=True):
        torques -= pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ force
    legs.reset()
    still = np.zeros(3)
    legs.update(reading(q[7:], torques=torques, accelerometer=-solo12.gravity @ rotation), rotation, still, still)
    np.testing.assert_allclose(legs.forces, forces, atol=0.05)  # the damping's share


@pytest.mark.parametrize("seed", range(3))
def test_forces_are_those_of_legs_and_base_that_accelerate(solo12: Robot, legs: LegSensing, seed: int) -> None:
    """Against the inverse dynamics of the whole robot: a leg that swings quickly has no contact force."""
    rng, model, data = np.random.default_rng(seed), solo12.model, solo12.create_data()
    rotation = so3.exp(0.3 * rng.normal(size=3))
    q, v, a = solo12.q_reference.copy(), 2.0 * rng.normal(size=18), 100.0 * rng.normal(size=18)
    q[3:7] = pin.Quaternion(rotation).coeffs()
    a[:6] /= 20.0
    forces = rng.normal(size=(4, 3)) + [0.0, 0.0, 6.0]
    forces[1] = forces[2] = 0.0
    torques = pin.rnea(model, data, q, v, a)[6:].copy()
    for force, frame in zip(forces, solo12.contact_ids, strict=True):
        torques -= pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ force
    # Two readings from which the accelerations follow; Pinocchio's of the base leaves out the turning of its axes.
    felt = a[:3] + np.cross(v[3:6], v[:3]) - solo12.gravity @ rotation
    periods = 1 + 2 * (seed % 2)  # readings between them may be lost
    velocity, bias, before = rotation @ v[:3], np.zeros(3), v - periods * PERIOD * a
    legs.reset()
    legs.update(reading(q[7:], before[6:], gyro=before[3:6]), rotation, velocity, bias)
    legs.update(reading(q[7:], v[6:], torques, v[3:6], felt), rotation, velocity, bias, periods)
    np.testing.assert_allclose(legs.forces, forces, atol=0.05)  # the damping's share
    # Without the accelerations, the legs in the air would seem to carry.
    legs.reset()
    legs.update(reading(q[7:], v[6:], torques, v[3:6], felt), rotation, velocity, bias)
    assert np.abs(legs.forces[1:3]).max() > 0.5


def test_the_noise_of_loads_is_that_of_readings_with_noise(solo12: Robot, legs: LegSensing) -> None:
    rng, deviation = np.random.default_rng(6), 0.05
    expected, loads, still = legs.load_noise(solo12.q_reference[7:], deviation), [], np.zeros(3)
    legs.reset()
    for _ in range(4000):
        legs.update(reading(solo12.q_reference[7:], deviation * rng.normal(size=12)), np.eye(3), still, still)
        loads.append(legs.forces[:, 2].copy())
    np.testing.assert_allclose(np.std(loads[1:], axis=0), expected, rtol=0.05)


def test_known_friction_of_the_joints_is_no_force_of_the_feet(solo12: Robot, legs: LegSensing) -> None:
    """The motors of joints that turn overcome it, in their direction."""
    rng, friction = np.random.default_rng(5), np.linspace(0.02, 0.2, 12)
    rubbing = LegSensing(replace(solo12, joint_friction=friction), PERIOD, ENCODER, FOOT)
    speeds, torques = rng.choice([-5.0, 5.0], 12), rng.normal(size=12)
    for each, applied in ((legs, torques), (rubbing, torques + friction * np.sign(speeds))):
        each.reset()
        each.update(reading(solo12.q_reference[7:], speeds, applied), np.eye(3), np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(rubbing.forces, legs.forces, atol=1e-9)


def test_a_stretched_leg_gives_finite_forces(legs: LegSensing) -> None:
    legs.update(reading(np.zeros(12), torques=np.full(12, 0.5)), np.eye(3), np.zeros(3), np.zeros(3))
    assert np.isfinite(legs.forces).all()


def test_a_robot_without_feet_or_with_bad_noise_is_refused(solo12: Robot) -> None:
    with pytest.raises(InputError, match="^encoder_noise: got -1"):
        LegSensing(solo12, PERIOD, -1.0, FOOT)
    with pytest.raises(InputError, match="^foot_noise: got 0"):
        LegSensing(solo12, PERIOD, ENCODER, 0.0)
    with pytest.raises(InputError, match="^period: got 0"):
        LegSensing(solo12, 0.0, ENCODER, FOOT)


def test_the_contact_switch_has_hysteresis_and_ignores_what_is_not_finite() -> None:
    detector = ContactDetector(2, touch_force=1.0, release_force=0.3)
    seen = [
        detector.update(np.array(forces)).tolist()
        for forces in ([0.9, 2.0], [1.1, 0.5], [0.4, 0.2], [np.nan, 0.9], [0.2, -5.0])
    ]
    assert seen == [[False, True], [True, True], [True, False], [True, False], [False, False]]
    detector.update(np.array([9.0, 9.0]))
    detector.reset()
    assert not detector.touching.any()


@pytest.mark.parametrize(("feet", "touch", "release"), [(0, 1.0, 0.5), (4, 1.0, 2.0), (4, np.nan, 0.0), (4, 1.0, -1.0)])
def test_impossible_switches_are_refused(feet: int, touch: float, release: float) -> None:
    with pytest.raises(InputError):
        ContactDetector(feet, touch, release)


def test_the_wrench_under_a_sole_follows_from_its_legs_torques() -> None:
    """Its force and its moment, from whatever corner forces: of these, sums are determined and nothing else."""
    robot = load_robot(load_config("talos_legs_stand").robot)
    rng, model, data, q = np.random.default_rng(2), robot.model, robot.create_data(), robot.q_reference.copy()
    rotation = so3.exp(np.array([0.1, -0.2, 0.4]))
    q[3:7] = pin.Quaternion(rotation).coeffs()
    corners = rng.normal(scale=20.0, size=(8, 3)) + [0.0, 0.0, 60.0]
    torques = pin.computeGeneralizedGravity(model, data, q)[6:].copy()
    for force, frame in zip(corners, robot.contact_ids, strict=True):
        torques -= pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ force
    legs, still = LegSensing(robot, PERIOD, ENCODER, FOOT), np.zeros(3)
    legs.update(reading(q[7:], np.zeros(12), torques, accelerometer=-robot.gravity @ rotation), rotation, still, still)
    pin.framesForwardKinematics(model, data, q)
    arms = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
    arms -= robot.foot_points.mean(arms)[robot.foot_points.of]
    for values, scale in ((lambda f: f, 1.0), (lambda f: np.cross(arms, f), 0.1)):
        found, expected = (robot.foot_points.total(values(f)) for f in (legs.forces, corners))
        np.testing.assert_allclose(found, expected, atol=0.5 * scale)
