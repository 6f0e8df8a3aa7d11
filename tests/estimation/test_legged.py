"""The estimator of a standing robot whose readings are exact: levelling, contacts, skipped readings."""

from __future__ import annotations

import logging

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.control.interface import Measurement
from lgmpc.errors import InputError
from lgmpc.estimation import LeggedEstimator, LeggedEstimatorSettings
from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot

PERIOD = 1e-3


@pytest.fixture(scope="module")
def estimator(solo12: Robot) -> LeggedEstimator:
    return LeggedEstimator(solo12, PERIOD)


def resting(robot: Robot, rotation: np.ndarray) -> Measurement:
    """Measurement of a robot at rest, with the torques that carry it."""
    data, q = robot.create_data(), robot.q_reference.copy()
    q[3:7] = pin.Quaternion(rotation).coeffs()
    torques = pin.computeGeneralizedGravity(robot.model, data, q)[6:].copy()
    share = np.array([0.0, 0.0, robot.mass * 9.81 / 4.0])
    for frame in robot.contact_ids:
        torques -= pin.computeFrameJacobian(robot.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ share
    return Measurement(0.0, np.zeros(3), -robot.gravity @ rotation, q[7:], np.zeros(12), torques)


def test_at_rest_the_estimate_is_level_and_stays(solo12: Robot, estimator: LeggedEstimator) -> None:
    tilted = so3.exp(np.array([0.1, -0.15, 0.0]))
    reading = resting(solo12, tilted)
    estimator.reset()
    state = estimator.update(reading)
    np.testing.assert_allclose(quaternion.to_matrix(state.q[3:7]), tilted, atol=1e-12)
    np.testing.assert_allclose(state.q[:3], solo12.q_reference[:3])
    for _ in range(200):
        state = estimator.update(reading)
    assert estimator.contacts.all()
    np.testing.assert_allclose(quaternion.to_matrix(state.q[3:7]), tilted, atol=1e-9)
    np.testing.assert_allclose(state.q[:3], solo12.q_reference[:3], atol=1e-9)
    np.testing.assert_array_equal(state.q[7:], reading.joints)
    np.testing.assert_allclose(state.v, 0.0, atol=1e-8)


def test_contacts_follow_a_lifted_and_a_set_foot(solo12: Robot, estimator: LeggedEstimator) -> None:
    reading = resting(solo12, np.eye(3))
    estimator.reset()
    for _ in range(5):
        estimator.update(reading)
    before = estimator.ekf.points.copy()
    swing = reading.torques.copy()
    swing[:3] = pin.computeGeneralizedGravity(solo12.model, solo12.create_data(), solo12.q_reference)[6:9]
    estimator.update(reading._replace(torques=swing))
    assert estimator.contacts.tolist() == [False, True, True, True]
    estimator.update(reading)
    assert estimator.contacts.all()
    np.testing.assert_allclose(estimator.ekf.points, before, atol=1e-6)


def test_noise_of_the_joints_speeds_makes_no_foot_in_the_air_touch(solo12: Robot) -> None:
    """Its acceleration's is 0.8 of the threshold of a touchdown here; an impact of the same impulse is one at once."""
    rng, standing, noise = np.random.default_rng(2), resting(solo12, np.eye(3)), 0.1
    estimator = LeggedEstimator(solo12, PERIOD, LeggedEstimatorSettings(joint_velocity_noise_rad_s=noise))
    air = pin.computeGeneralizedGravity(solo12.model, solo12.create_data(), solo12.q_reference)[6:]

    def touches(torques: np.ndarray) -> bool:
        estimator.update(standing._replace(torques=torques, speeds=noise * rng.normal(size=12)))
        return bool(estimator.contacts.any())

    forces, threshold = [], 0.8 * solo12.mass
    for _ in range(2000):
        assert not touches(air)
        forces.append(estimator.legs.forces[:, 2].max())
    assert np.mean(np.array(forces) > threshold) > 0.1
    for _ in range(20):
        for _ in range(20):
            touches(air)
        assert not estimator.contacts.any()
        assert touches(air + 5.0 * (standing.torques - air))


def test_a_sliding_foot_is_in_contact_but_does_not_correct_the_estimate(
    solo12: Robot, estimator: LeggedEstimator
) -> None:
    """One foot slides back at 0.2 m/s: an estimate from all four feet would follow it at a quarter of that."""
    reading = resting(solo12, np.eye(3))
    estimator.reset()
    for _ in range(50):
        state = estimator.update(reading)
    frame = solo12.contact_ids[3]
    jacobian = pin.computeFrameJacobian(
        solo12.model, solo12.create_data(), solo12.q_reference, frame, pin.LOCAL_WORLD_ALIGNED
    )
    rolling = np.cross(jacobian[3:, 15:18].T, [0.0, 0.0, -solo12.contact_radius]).T
    sliding, joints = np.zeros(12), reading.joints.copy()
    sliding[9:] = np.linalg.solve(jacobian[:3, 15:18] + rolling, [-0.2, 0.0, 0.0])
    for k in range(150):
        speeds = min(k / 100.0, 1.0) * sliding
        joints = joints + PERIOD * speeds
        state = estimator.update(reading._replace(joints=joints, speeds=speeds))
        assert estimator.contacts.all()
        if k >= 30:  # 0.06 m/s
            assert estimator.ekf.touching.tolist() == [True, True, True, False]
    np.testing.assert_allclose(state.q[:3], solo12.q_reference[:3], atol=1e-4)
    np.testing.assert_allclose(state.v[:3], 0.0, atol=1e-3)


def test_feet_that_step_on_a_level_floor_distinguish_a_tilt_from_the_bias_of_the_accelerometer(solo12: Robot) -> None:
    """The accelerometer's bias of 0.1 m/s2 seems a tilt of 10 mrad: 4 mm from the front to the hind feet."""
    level = resting(solo12, np.eye(3))
    biased = level._replace(accelerometer=level.accelerometer + [0.1, 0.0, 0.0])
    gravity = pin.computeGeneralizedGravity(solo12.model, solo12.create_data(), solo12.q_reference)[6:]
    tilts = []
    for noise in (None, 1e-3):
        settings = LeggedEstimatorSettings(floor_noise_m=noise, accelerometer_bias_m_s2=0.1, rest_s=0.0)
        estimator = LeggedEstimator(solo12, PERIOD, settings)
        for step in range(24):
            swing = np.array(biased.torques)
            joints = slice(3 * (step % 4), 3 * (step % 4) + 3)
            swing[joints] = gravity[joints]
            for _ in range(10):
                estimator.update(biased)
            for _ in range(5):
                state = estimator.update(biased._replace(torques=swing))
            assert estimator.contacts.sum() == 3
        tilts.append(np.arccos(quaternion.to_matrix(state.q[3:7])[2, 2]))
    assert tilts[0] > 8e-3 and tilts[1] < 3e-3


def test_readings_that_are_not_finite_are_skipped_counted_and_logged_once(
    solo12: Robot, estimator: LeggedEstimator, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no monitor replaces them before."""
    monkeypatch.setattr(estimator, "monitor", None)
    reading = resting(solo12, np.eye(3))
    estimator.reset()
    state = estimator.update(reading)
    with caplog.at_level(logging.WARNING):
        for channel in ("gyro", "accelerometer", "joints", "speeds", "torques"):
            values = getattr(reading, channel)
            again = estimator.update(
                reading._replace(**{channel: np.where(np.arange(len(values)) == 1, np.nan, values)})
            )
            np.testing.assert_array_equal(again.q, state.q)
            np.testing.assert_array_equal(again.v, state.v)
    assert estimator.failures == 5 and len(caplog.records) == 1


def test_the_time_of_readings_that_were_lost_passes(solo12: Robot, estimator: LeggedEstimator) -> None:
    """A base in the air that rises and turns: with one reading in three it is where it is with all of them."""
    first = resting(solo12, np.eye(3))
    gyro, felt = np.array([0.0, 0.0, 0.5]), first.accelerometer + [0.0, 0.0, 1.0]
    weight = pin.computeGeneralizedGravity(solo12.model, solo12.create_data(), solo12.q_reference)[6:]
    states = []
    for each in (1, 3):
        estimator.reset()
        estimator.update(first)
        for k in range(each, 301, each):
            moving = first._replace(time=k * PERIOD, gyro=gyro, accelerometer=felt, torques=1.1 * weight)
            state = estimator.update(moving)
        states.append(state)
        assert not estimator.contacts.any()
    np.testing.assert_allclose(states[1].q, states[0].q, atol=1e-6)
    np.testing.assert_allclose(states[1].v, states[0].v, atol=1e-6)
    assert states[0].v[2] == pytest.approx(0.3, abs=1e-3)  # of the last reading alone, not of the lost ones: 0.1


@pytest.mark.usefixtures("interpreted")
def test_the_start_is_the_given_pose(solo12: Robot) -> None:
    start = np.array([1.0, -2.0, 0.5, 0.0, 0.0, np.sin(0.4), np.cos(0.4)])
    estimator = LeggedEstimator(solo12, PERIOD, LeggedEstimatorSettings(form="left"), start)
    state = estimator.update(resting(solo12, so3.exp(np.array([0.0, 0.0, 0.8]))))
    np.testing.assert_allclose(state.q[:7], start, atol=1e-12)


@pytest.mark.parametrize(
    ("argument", "make"),
    [
        ("form", lambda robot: LeggedEstimatorSettings(form="rigth")),
        ("slip_m_s_rt_hz", lambda robot: LeggedEstimatorSettings(slip_m_s_rt_hz=-1.0)),
        ("period", lambda robot: LeggedEstimator(robot, 0.0)),
        ("start", lambda robot: LeggedEstimator(robot, PERIOD, start=np.zeros(6))),
    ],
)
def test_bad_settings_are_refused(solo12: Robot, argument: str, make) -> None:
    with pytest.raises(InputError, match=f"^{argument}: got"):
        make(solo12)
