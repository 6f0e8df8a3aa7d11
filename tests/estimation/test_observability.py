"""Both invariant forms are one filter up to the adjoint; what each takes feet to tell about yaw and position."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from lgmpc.estimation import InvariantEkf
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import LEFT, RIGHT, ErrorForm
from lgmpc.lie import sek3

pytestmark = pytest.mark.usefixtures("interpreted")
NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_noise_m_s2_rt_hz=2e-2,
    accelerometer_bias_walk_m_s3_rt_hz=1e-2,
)
SLIP, SIGHT = 0.005, 0.01
OFFSET = (0.0, 0.0, 0.02)
LANDMARKS = np.array([[2.0, 1.0, 0.5], [1.0, -2.0, 1.0], [-2.0, 0.5, 0.2]])
SIZE = 15 + 3 * 4
SEEN = np.array([0.8, -0.5, 0.3])
SPREAD = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]]) * 1e-3
DEVIATIONS = np.repeat([0.1, 0.2, 0.1, 0.005, 0.05], 3)


@functools.cache
def blank(form: ErrorForm) -> InvariantEkf:
    """One filter for all tests: making one costs more than using it."""
    return InvariantEkf(4, NOISE, slip=SLIP, contact_offset=OFFSET, form=form)


def relative(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point of the world as the base sees it."""
    return pose[:3, :3].T @ (point - pose[:3, 4])


def test_left_and_right_are_one_filter_up_to_the_adjoint() -> None:
    left, right = blank(LEFT), blank(RIGHT)
    start = sek3.exp(np.random.default_rng(1).normal(size=9))
    for ekf in (left, right):
        ekf.reset(start, np.repeat([0.05, 0.1, 0.1, 0.01, 0.1], 3))
        ekf.begin_contact(1, np.array([0.2, 0.1, -0.3]), 1e-4 * np.eye(3))
        ekf.predict(np.array([1.0, 2.0, -1.0]), np.array([3.0, 1.0, 9.0]), 0.05)
    prior = right.pose.copy()
    np.testing.assert_allclose(left.pose, prior, atol=1e-9)
    change = np.eye(SIZE)
    change[:-6, :-6] = sek3.adjoint(prior)
    change[np.repeat([False] * 3 + [*~right.touching] + [False] * 2, 3)] = 0.0
    np.testing.assert_allclose(right.covariance, change @ left.covariance @ change.T, atol=1e-9)
    seen = np.array([0.2, 0.1, -0.3]) + [0.02, -0.01, 0.03]
    for ekf in (left, right):
        ekf.correct(np.tile(seen, (4, 1)), np.tile(SPREAD, (4, 1, 1)))
    assert np.abs(right.pose - prior).max() > 1e-3
    np.testing.assert_allclose(left.pose, right.pose, atol=1e-9)
    np.testing.assert_allclose(left._bias, right._bias, atol=1e-9)
    np.testing.assert_allclose(right.covariance, change @ left.covariance @ change.T, atol=1e-9)  # about the prior


@functools.cache
def _information(form: ErrorForm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information about yaw and position: at first, after corrections by the feet, and after an external pose."""
    rng = np.random.default_rng(9)
    ekf = InvariantEkf(4, ImuNoise(**dict.fromkeys(ImuNoise.model_fields, 0.0)), slip=0.0, form=form)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.full(15, 0.3))
    for i in range(4):
        ekf.begin_contact(i, rng.normal(size=3), 1e-4 * np.eye(3))

    def information() -> np.ndarray:
        shift = np.zeros((SIZE, 4))  # a turn about gravity and a shift of the world, as right-invariant errors
        shift[2, 0] = 1.0
        shift[6:-6, 1:] = np.tile(np.eye(3), (5, 1))
        if form is LEFT:
            shift[:-6] = sek3.adjoint(sek3.inverse(ekf.pose)) @ shift[:-6]
        return np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))

    before = information()
    for _ in range(100):
        ekf.predict(rng.normal(size=3), rng.normal(size=3) + [0.0, 0.0, 9.81], 0.01)
        seen = np.array([relative(ekf.pose, point) for point in ekf.points.T]) + 0.05 * rng.normal(size=(4, 3))
        ekf.correct(seen, np.tile(SPREAD, (4, 1, 1)))
    after = information()
    ekf.correct_pose(ekf.pose[:3, [0, 1, 2, 4]].T.ravel(), (0.05, 0.05))
    return before, after, information()


def test_feet_give_no_information_about_yaw_and_position() -> None:
    """A turn about gravity and a shift of the world change no measurement: exactly so in right-invariant errors."""
    before, after, with_pose = _information(RIGHT)
    assert (after <= before * (1.0 + 1e-6)).all()
    assert (with_pose > 2.0 * after).all()


def test_the_left_form_gains_false_information_about_yaw_and_position() -> None:
    """The same shifts and turns of the world, in the left-invariant error of the present estimate."""
    before, after, _ = _information(LEFT)
    assert (after > 1.05 * before).any()
