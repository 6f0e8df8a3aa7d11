"""External poses, late and noisy, keep the estimate of a walking robot from drifting."""

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config import load_config
from lgmpc.config.build import prepare
from lgmpc.control.interface import Measurement
from lgmpc.estimation import LeggedEstimator
from lgmpc.robot import Robot

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


@pytest.mark.parametrize(("rate", "delay"), [(50, 0.03), (200, 0.005)])
def test_an_external_pose_ends_the_drift(rate: float, delay: float) -> None:
    config = load_config(
        "solo12_velocity_inekf", [*WALK, f"sensors.external_rate_hz={rate}", f"sensors.external_delay_s={delay}"]
    )
    log = prepare(config).run(lambda progress: None).log
    assert log.estimate_q is not None
    late = log.time > 0.3
    errors = np.linalg.norm(log.estimate_q[late, :3] - log.q[late, :3], axis=1)
    assert errors.max() < 5e-3, errors.max()
    headings = np.abs(np.sum(log.estimate_q[late, 3:7] * log.q[late, 3:7], axis=1))
    assert 2.0 * np.arccos(np.minimum(headings, 1.0)).max() < 0.01


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
