"""Contact points of known height: the correction against a dense Kalman update, and its consistency."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest
from samples import jacobian, retracted
from scipy.stats import chi2

from lgmpc.demos.simulated_trot import simulate_trot
from lgmpc.errors import InputError
from lgmpc.estimation import InvariantEkf
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, RIGHT, ErrorForm
from lgmpc.lie import sek3

pytestmark = pytest.mark.usefixtures("interpreted")
NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_noise_m_s2_rt_hz=2e-2,
    accelerometer_bias_walk_m_s3_rt_hz=1e-2,
)
GRAVITY = np.array([3.0, -2.0, -9.0])
FLOOR = 1e-3  # m


@functools.cache
def make(form: ErrorForm) -> InvariantEkf:
    """A filter with correlations and three feet in contact."""
    rng = np.random.default_rng(0)
    ekf = InvariantEkf(4, NOISE, slip=0.005, gravity=GRAVITY, contact_offset=(0.0, 0.0, 0.02), form=form)
    ekf.reset(sek3.exp(rng.normal(size=9)), rng.uniform(0.02, 0.1, 15), 0.1 * rng.normal(size=3), rng.normal(size=3))
    for foot in (0, 2, 3):
        ekf.predict(rng.normal(size=3), 5.0 * rng.normal(size=3), 0.02)
        ekf.begin_contact(foot, rng.normal(size=3), 1e-4 * np.eye(3))
    return ekf


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_a_correction_is_the_kalman_update_with_a_finite_difference_jacobian(form: ErrorForm) -> None:
    ekf, up = make(form), -GRAVITY / np.linalg.norm(GRAVITY)
    pose, biases, before = (
        ekf.pose.copy(),
        np.concatenate([ekf.gyro_bias, ekf.accelerometer_bias]),
        ekf.covariance.copy(),
    )

    def height(error: np.ndarray) -> np.ndarray:
        return up @ retracted(form, pose, error)[:3, 5 + 2 : 5 + 3]

    matrix = np.hstack([jacobian(height, len(before) - 6), np.zeros((1, 6))])
    measured = float(up @ pose[:3, 5 + 2]) + 0.03
    gain = before @ matrix.T / (matrix @ before @ matrix.T + FLOOR**2)
    ekf.correct_height(2, measured, FLOOR)
    error = 0.03 * gain[:, 0]
    assert np.abs(error).max() > 1e-3
    np.testing.assert_allclose(ekf.pose, retracted(form, pose, error[:-6]), atol=1e-9)
    np.testing.assert_allclose([*ekf.gyro_bias, *ekf.accelerometer_bias], biases - error[-6:], atol=1e-9)
    np.testing.assert_allclose(ekf.covariance, before - gain @ matrix @ before, atol=1e-9)
    np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)
    assert not ekf.points[:, 1].any() and not ekf.covariance[12:15].any()  # not in contact, and stays so


def test_a_trot_on_a_floor_of_known_height_is_consistent_and_its_height_does_not_drift() -> None:
    """Normalised errors squared are chi-square distributed; the height's deviation stays that of the floor."""
    ekf, errors, degrees, drifting = InvariantEkf(4, NOISE, slip=0.005), 0.0, 0, []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        trot = simulate_trot(rng, NOISE, accelerometer_bias=0.05)
        deviations = np.repeat([0.01, 0.02, 1e-3, 0.005, 0.05], 3)
        start = trot.poses[0].copy()
        start[:5, :5] = sek3.compose(sek3.exp(deviations[:9] * rng.normal(size=9)), start)
        for known in (False, True):
            ekf.reset(start, deviations)
            for k in trot.run(ekf):
                if known and k:
                    for foot in np.flatnonzero(trot.touching[k] & ~trot.touching[k - 1]).tolist():
                        ekf.correct_height(foot, trot.points[k, foot, 2] + FLOOR * rng.normal(), FLOOR)
            spread = ekf.form.from_differences(ca.DM(ekf.pose))
            plain = np.linalg.solve(np.array(ca.DM(spread)), np.eye(len(ekf.covariance) - 6))
            drifting.append(np.sqrt((plain @ ekf.covariance[:-6, :-6] @ plain.T)[8, 8]))
        error, count = trot.normalised_error(ekf, len(trot.touching) - 1)
        errors, degrees = errors + error, degrees + count
    low, high = chi2.ppf([0.005, 0.995], degrees)
    assert low < errors < high
    assert max(drifting[1::2]) < 0.6 * min(drifting[::2])


@pytest.mark.parametrize(
    ("foot", "height", "deviation", "expected"),
    [
        (4, 0.0, FLOOR, "a number from 0 to 3"),
        (1, 0.0, FLOOR, "one in contact"),
        (0, np.nan, FLOOR, "a finite number"),
        (0, 0.0, 0.0, "a positive length"),
        (0, 0.0, np.inf, "a positive length"),
    ],
)
def test_bad_heights_are_refused(foot: int, height: float, deviation: float, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        make(RIGHT).correct_height(foot, height, deviation)
