"""Leg sensing against Pinocchio, and the contact switch."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.estimation import ContactDetector, LegSensing
from lgmpc.lie import so3
from lgmpc.robot import Robot

ENCODER, FOOT = 3e-3, 1e-3


@pytest.fixture(scope="module")
def sensing(solo12: Robot) -> LegSensing:
    return LegSensing(solo12, ENCODER, FOOT)


@pytest.mark.parametrize("seed", range(3))
def test_positions_covariances_and_rates_are_pinocchios(solo12: Robot, sensing: LegSensing, seed: int) -> None:
    rng, model, data = np.random.default_rng(seed), solo12.model, solo12.create_data()
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[7:] = solo12.q_reference[7:] + 0.3 * rng.normal(size=12)
    v[6:] = rng.normal(size=12)
    sensing.update(q[7:], v[6:], np.zeros(12), so3.exp(rng.normal(size=3)))
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    for i, frame in enumerate(solo12.contact_ids):
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:, 6:]
        np.testing.assert_allclose(sensing.positions[i], data.oMf[frame].translation, atol=1e-14)
        expected = ENCODER**2 * jacobian[:3] @ jacobian[:3].T + FOOT**2 * np.eye(3)
        np.testing.assert_allclose(sensing.covariances[i], expected, atol=1e-17)
        np.testing.assert_allclose(sensing.rates[i], jacobian[3:] @ v[6:], atol=1e-13)


def test_forces_balance_the_torques_and_the_legs_at_rest(solo12: Robot, sensing: LegSensing) -> None:
    rng, model, data = np.random.default_rng(1), solo12.model, solo12.create_data()
    rotation = so3.exp(np.array([0.3, -0.2, 1.0]))
    q = solo12.q_reference.copy()
    q[3:7] = pin.Quaternion(rotation).coeffs()
    forces = rng.normal(size=(4, 3)) + [0.0, 0.0, 6.0]
    torques = pin.computeGeneralizedGravity(model, data, q)[6:].copy()
    for force, frame in zip(forces, solo12.contact_ids, strict=True):
        torques -= pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:].T @ force
    sensing.update(q[7:], np.zeros(12), torques, rotation)
    np.testing.assert_allclose(sensing.forces, forces, atol=0.05)  # the damping's share


def test_a_stretched_leg_gives_finite_forces(solo12: Robot, sensing: LegSensing) -> None:
    sensing.update(np.zeros(12), np.zeros(12), np.full(12, 0.5), np.eye(3))
    assert np.isfinite(sensing.forces).all()


def test_a_robot_without_feet_or_with_bad_noise_is_refused(solo12: Robot) -> None:
    with pytest.raises(InputError, match="^encoder_noise: got -1"):
        LegSensing(solo12, -1.0, FOOT)
    with pytest.raises(InputError, match="^foot_noise: got 0"):
        LegSensing(solo12, ENCODER, 0.0)


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
