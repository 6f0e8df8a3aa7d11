"""External poses and velocities, late and noisy: Jacobians, drift, convergence, outliers."""

import logging
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from samples import jacobian, retracted

from lgmpc.config import load_config
from lgmpc.config.build import prepare
from lgmpc.control.interface import Measurement
from lgmpc.estimation import InvariantEkf, LeggedEstimator, LeggedEstimatorSettings
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, ErrorForm
from lgmpc.lie import sek3, so3
from lgmpc.robot import Robot
from lgmpc.runs.log import SENSOR_FAULTS

WALK = [
    "duration_s=2.0",
    "gate={}",
    "commands=[{at_s: 0.1, velocity_m_s: [0.4, 0.1, 0], yaw_rate_rad_s: 0.5, gait: trot}]",
    "estimator.floor_noise_m=null",
    "log.rate_hz=1000",
]


def resting(robot: Robot, rotation: np.ndarray) -> Measurement:
    """Measurement of a robot at rest, with the torques that carry it."""
    data, q = robot.create_data(), robot.q_reference.copy()
    q[3:7] = pin.Quaternion(rotation).coeffs()
    torques = pin.computeGeneralizedGravity(robot.model, data, q)[6:].copy()
    share = np.array([0.0, 0.0, robot.mass * 9.81 / 4.0])
    for frame in robot.contact_ids:
        torques -= pin.computeFrameJacobian(robot.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ share
    return Measurement(0.0, np.zeros(3), -robot.gravity @ rotation, q[7:], np.zeros(12), torques)


@pytest.mark.parametrize(
    ("plant", "rate", "delay", "velocity"),
    [("mujoco", 50, 0.03, None), ("mujoco", 200, 0.005, 0.01), ("pinocchio", 50, 0.03, 0.01)],
)
def test_an_external_source_ends_the_drift(plant: str, rate: float, delay: float, velocity: float | None) -> None:
    sensors = {"rate_hz": rate, "delay_s": delay, "velocity_noise_m_s": "null" if velocity is None else velocity}
    given = [f"sensors.external_{name}={value}" for name, value in sensors.items()]
    config = load_config("solo12_velocity_inekf", [*WALK, *given, f"plant.kind={plant}"])
    log = prepare(config).run(lambda progress: None).log
    assert log.estimate_q is not None and log.estimate_v is not None and not log.sensor_faults.any()
    late = log.time > 0.3
    errors = np.linalg.norm(log.estimate_q[late, :3] - log.q[late, :3], axis=1)
    assert errors.max() < 5e-3, errors.max()
    headings = np.abs(np.sum(log.estimate_q[late, 3:7] * log.q[late, 3:7], axis=1))
    assert 2.0 * np.arccos(np.minimum(headings, 1.0)).max() < 0.01
    off = log.estimate_v[late, :3] - log.v[late, :3]
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.012


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_corrections_are_kalman_updates_with_finite_difference_jacobians(form: ErrorForm) -> None:
    rng = np.random.default_rng(3)
    ekf = InvariantEkf(2, ImuNoise(), form=form)
    ekf.reset(sek3.exp(rng.normal(size=9)), rng.uniform(0.02, 0.1, 15), 0.1 * rng.normal(size=3), rng.normal(size=3))
    ekf.predict(rng.normal(size=3), 5.0 * rng.normal(size=3), 0.02)
    ekf.begin_contact(1, rng.normal(size=3), 1e-4 * np.eye(3))
    size = len(ekf.covariance)

    def turned(pose: np.ndarray, reference: np.ndarray) -> np.ndarray:  # rotation in world axes, and position
        return np.concatenate([so3.log(pose[:3, :3] @ reference[:3, :3].T), pose[:3, 4] - reference[:3, 4]])

    def moving(pose: np.ndarray) -> np.ndarray:
        return pose[:3, :3].T @ pose[:3, 3]

    def check(slope: np.ndarray, spread: np.ndarray, off: np.ndarray, correct: Callable[[float], float]) -> None:
        pose, before, state = ekf.pose.copy(), ekf.covariance.copy(), ekf._state.copy()
        matrix = np.hstack([slope, np.zeros((len(slope), 6))])
        innovation = matrix @ before @ matrix.T + spread
        square = off @ np.linalg.solve(innovation, off)
        assert correct(0.99 * square) == pytest.approx(square, rel=1e-6)
        np.testing.assert_array_equal(ekf._state, state)  # beyond the gate
        correct(1.01 * square)
        gain = before @ matrix.T @ np.linalg.inv(innovation)
        np.testing.assert_allclose(ekf.pose, retracted(form, pose, (gain @ off)[:-6]), atol=1e-9)
        np.testing.assert_allclose(ekf.covariance, before - gain @ matrix @ before, atol=1e-9)

    off, first = np.array([0.03, -0.02, 0.01, 0.02, 0.05, -0.04]), ekf.pose.copy()
    measured = np.column_stack([so3.exp(off[:3]) @ first[:3, :3], first[:3, 4] + off[3:]]).ravel(order="F")
    slope = jacobian(lambda e: turned(retracted(form, first, e), first), size - 6)
    spread = np.diag(np.repeat([0.02**2, 0.03**2], 3))
    check(slope, spread, off, lambda gate: ekf.correct_pose(measured, (0.02, 0.03), gate))
    then, shift = ekf.pose.copy(), off[3:]
    slope, measured = jacobian(lambda e: moving(retracted(form, then, e)), size - 6), moving(then) + shift
    check(slope, 0.04**2 * np.eye(3), shift, lambda gate: ekf.correct_velocity(measured, 0.04, gate))


@pytest.mark.parametrize("delay", [0.0, 0.005, 0.03])
def test_a_late_velocity_finds_the_speed_of_a_robot_whose_feet_are_in_the_air(solo12: Robot, delay: float) -> None:
    """Without pose or contact; the robot turns and accelerates, so that a late velocity is another one by then."""
    estimator = LeggedEstimator(
        solo12, 1e-3, LeggedEstimatorSettings(start_velocity_m_s=1.0, contact_force_n=(1e3, 2e3))
    )
    rotation, velocity, late = np.eye(3), np.array([0.8, -0.5, 0.3]), []
    turn, force = np.array([0.3, -0.2, 2.0]), np.array([1.0, 0.5, 10.5])
    reading = Measurement(0.0, np.zeros(3), -solo12.gravity, solo12.q_reference[7:], np.zeros(12), np.zeros(12))
    estimator.update(reading)
    for k in range(1, 301):
        velocity = velocity + 1e-3 * (rotation @ so3.left_jacobian(1e-3 * turn) @ force + solo12.gravity)
        rotation = rotation @ so3.exp(1e-3 * turn)
        late.append(rotation.T @ velocity)
        known = reading._replace(time=1e-3 * k, gyro=turn, accelerometer=force)
        back = k - 1 - round(1e3 * delay)
        if k % 10 == 0 and back >= 0:
            given = np.concatenate([late[back], np.full(3, np.nan)])
            known = known._replace(external_velocity=given, external_age=delay)
        state = estimator.update(known)
    assert np.linalg.norm(state.v[:3] - rotation.T @ velocity) < 5e-3
    assert not estimator.contacts.any()


def test_outliers_are_left_out_counted_and_named(solo12: Robot, caplog: pytest.LogCaptureFixture) -> None:
    estimator, reading = LeggedEstimator(solo12, 1e-3), resting(solo12, np.eye(3))
    pose, still = solo12.q_reference[:7].copy(), np.zeros(6)
    wrong, bits = pose + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], {name: 1 << k for k, name in enumerate(SENSOR_FAULTS)}
    for k in range(100):
        given = reading._replace(time=1e-3 * k)
        if k % 5 == 0:
            given = given._replace(external_pose=pose, external_velocity=still, external_age=0.0)
        if k == 60:
            given = given._replace(external_pose=wrong, external_velocity=still + [2.0, 0, 0, 0, 0, 0])
        with caplog.at_level(logging.WARNING):
            state = estimator.update(given)
        assert estimator.monitor is not None
        faults = bits["external_pose"] | bits["external_velocity"] if k == 60 else 0
        assert estimator.monitor.faults == faults, k
        assert np.linalg.norm(state.q[:3] - pose[:3]) < 2e-3 and np.linalg.norm(state.v[:3]) < 5e-3
    assert estimator.monitor.counts["external_pose"] == estimator.monitor.counts["external_velocity"] == 1
    assert "external_pose" in caplog.text and "left out" in caplog.text
    for k in range(100, 200):  # a source that persists is believed
        state = estimator.update(reading._replace(time=1e-3 * k, external_pose=wrong, external_age=0.0))
    assert np.linalg.norm(state.q[:3] - wrong[:3]) < 5e-3
    for age in (-1.0, np.nan, 5.0):  # no such moment: not used
        after = estimator.update(reading._replace(time=0.2, external_velocity=np.full(6, 9.0), external_age=age))
    assert np.linalg.norm(after.v[:3] - state.v[:3]) < 1e-3


def test_the_first_external_pose_defines_the_world(solo12: Robot) -> None:
    estimator, reading = LeggedEstimator(solo12, 1e-3), resting(solo12, np.eye(3))
    for k in range(20):
        estimator.update(reading._replace(time=1e-3 * k))
    turned = np.array([0.0, 0.0, np.sin(0.6), np.cos(0.6)])
    pose = np.concatenate([[3.0, -2.0, 0.4], turned])
    state = estimator.update(reading._replace(time=0.02, external_pose=pose, external_age=0.0))
    np.testing.assert_allclose(state.q[:7], pose, atol=1e-9)
    for k in range(21, 200):
        given = pose if k % 10 == 0 else np.full(7, np.nan) if k % 10 == 1 else None
        state = estimator.update(reading._replace(time=1e-3 * k, external_pose=given, external_age=0.005))
    np.testing.assert_allclose(state.q[:7], pose, atol=1e-6)
    assert estimator.contacts.all() and not estimator.rejected.any()
