"""Monte Carlo over trots with known truth: consistency and convergence of invariant and quaternion filters.

NEES: the normalised squared error of a consistent filter is chi-square distributed with as many degrees of freedom as
there are states, so its mean over independent runs has known bounds (Bar-Shalom, Li and Kirubarajan 2001, 5.4.2).
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from lgmpc.demos.simulated_trot import simulate_trot
from lgmpc.errors import InputError
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, InvariantEkf
from lgmpc.lie import so3

NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    accelerometer_noise_m_s2_rt_hz=2e-2,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_bias_walk_m_s3_rt_hz=1e-2,
)
SLIP, RUNS = 0.005, 30
DEVIATIONS = np.repeat([0.1, 0.2, 0.1, 0.005, 0.05], 3)


@functools.cache
def monte_carlo(form: str, far: bool) -> dict[str, np.ndarray]:
    """Tilt error (deg) and speed error in the body (m/s) at all instants of all runs; NEES over its freedom, sparsely.

    ``far``: 45 degrees about a random horizontal axis and 1 m/s in a random direction, with the same standard
    deviations; otherwise errors drawn from DEVIATIONS.
    """
    ekf = InvariantEkf(4, NOISE, slip=SLIP, form=FORMS[form])
    deviations = DEVIATIONS.copy()
    if far:
        deviations[:6] = np.repeat([np.radians(45.0), 1.0], 3)
    errors, ratios, freedoms = [], [], []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        walk = simulate_trot(rng, NOISE, duration=1.0, slip=SLIP)
        drawn = deviations[:9] * rng.normal(size=9)
        if far:
            drawn[2] = 0.0
            drawn[:3] *= np.radians(45.0) / np.linalg.norm(drawn[:3])
            drawn[3:6] /= np.linalg.norm(drawn[3:6])
        start = walk.poses[0].copy()
        start[:3, :3] = so3.exp(drawn[:3]) @ start[:3, :3]
        start[:3, 3:] += drawn[3:].reshape(2, 3).T
        ekf.reset(start, deviations)
        history, squares = [], []
        for k in walk.run(ekf):
            true = walk.poses[k]
            sine = np.linalg.norm(np.cross(true[2, :3], ekf.rotation[2]))
            tilt = np.degrees(np.arctan2(sine, true[2, :3] @ ekf.rotation[2]))
            speed = np.linalg.norm(ekf.rotation.T @ ekf.velocity - true[:3, :3].T @ true[:3, 3])
            history.append((tilt, speed))
            if k % 20 == 0:
                squares.append(walk.normalised_error(ekf, k))
        errors.append(history)
        ratios.append([square for square, _ in squares])
        freedoms.append([freedom for _, freedom in squares])
    return {"errors": np.array(errors), "nees": np.array(ratios), "freedom": np.array(freedoms)}


def mean_bounds(freedom: np.ndarray, probability: float = 1e-4) -> tuple[float, float]:
    total = int(freedom.sum())
    low, high = chi2.ppf([probability, 1.0 - probability], total) / total
    return float(low), float(high)


@pytest.mark.slow
def test_the_right_invariant_filter_is_consistent() -> None:
    found = monte_carlo("right", far=False)
    for k in range(found["nees"].shape[1]):
        low, high = mean_bounds(found["freedom"][:, k])
        assert low < found["nees"][:, k].sum() / found["freedom"][:, k].sum() < high, k


@pytest.mark.slow
def test_the_right_invariant_filter_is_not_overconfident_even_from_45_degrees_and_1_metre_per_second() -> None:
    found = monte_carlo("right", far=True)
    for k in range(found["nees"].shape[1]):
        assert found["nees"][:, k].sum() / found["freedom"][:, k].sum() < mean_bounds(found["freedom"][:, k])[1], k


@pytest.mark.slow
def test_the_quaternion_filter_is_not_consistent_from_there() -> None:
    found = monte_carlo("multiplicative", far=True)
    for k in range(found["nees"].shape[1]):
        assert found["nees"][:, k].sum() / found["freedom"][:, k].sum() > 10.0, k  # measured 30 and more


@pytest.mark.slow
def test_convergence_from_45_degrees_and_1_metre_per_second() -> None:
    """Worst run of the right-invariant filter against the median one of the quaternion filter, 0.5 s on."""
    invariant, quaternion = (monte_carlo(form, far=True)["errors"][:, 100] for form in ("right", "multiplicative"))
    assert invariant[:, 0].max() < 2.0  # deg; measured 1.3, where the quaternion filter's median has 10
    assert invariant[:, 1].max() < 0.1  # m/s; 0.05 and 0.18
    assert np.median(quaternion[:, 0]) > 3.0 * invariant[:, 0].max()
    assert np.median(quaternion[:, 1]) > 2.0 * invariant[:, 1].max()


@pytest.mark.slow
def test_the_left_invariant_filter_converges_too() -> None:
    errors = monte_carlo("left", far=True)["errors"][:, 100]
    assert errors[:, 0].max() < 2.0 and errors[:, 1].max() < 0.1


@pytest.mark.usefixtures("interpreted")
def test_a_short_trot_is_followed() -> None:
    """In a second: from 0.1 rad and 0.2 m/s to a fraction of that, through changes of the feet."""
    rng = np.random.default_rng(3)
    walk = simulate_trot(rng, NOISE, duration=0.6, slip=SLIP)
    assert 2 <= walk.touching.sum(axis=1).min() < walk.touching.sum(axis=1).max() == 4
    start = walk.poses[0].copy()
    start[:3, :3] = so3.exp(np.array([0.1, -0.1, 0.0])) @ start[:3, :3]
    start[:3, 3] += 0.2
    ekf = InvariantEkf(4, NOISE, slip=SLIP)
    ekf.reset(start, DEVIATIONS)
    for _ in walk.run(ekf):
        pass
    assert ekf.touching.tolist() == walk.touching[-1].tolist()
    assert np.linalg.norm(ekf.velocity - walk.poses[-1][:3, 3]) < 0.06
    assert np.degrees(np.linalg.norm(so3.log(ekf.rotation @ walk.poses[-1][:3, :3].T)[:2])) < 1.5


@pytest.mark.usefixtures("interpreted")
def test_innovations_of_consistent_errors_are_chi_square_distributed() -> None:
    """Of one foot they are white over time, so their squares add up to a chi-square number (NIS, Bar-Shalom 5.4.2)."""
    ekf, squares, rejected = InvariantEkf(4, NOISE, slip=SLIP, outlier_probability=0.01), [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        walk = simulate_trot(rng, NOISE, duration=1.0, slip=SLIP)
        start = walk.poses[0].copy()
        drawn = DEVIATIONS[:9] * rng.normal(size=9)
        start[:3, :3] = so3.exp(drawn[:3]) @ start[:3, :3]
        start[:3, 3:] += drawn[3:].reshape(2, 3).T
        ekf.reset(start, DEVIATIONS)
        for _ in walk.run(ekf):
            if ekf.innovations_squared[0] > 0.0:
                squares.append(ekf.innovations_squared[0])
                rejected.append(ekf.rejected[0])
    low, high = mean_bounds(np.full(len(squares), 3))
    assert low < np.sum(squares) / (3 * len(squares)) < high
    assert np.sum(rejected) <= binom.ppf(0.9999, len(rejected), 0.01)
    np.testing.assert_array_equal(rejected, np.array(squares) > chi2.isf(0.01, 3))


@pytest.mark.usefixtures("interpreted")
def test_a_sliding_foot_does_not_correct_a_filter_with_a_gate() -> None:
    """One foot slides ahead at 0.5 m/s in its first stance; ungated, it draws the estimate along."""
    walk = simulate_trot(np.random.default_rng(5), NOISE, duration=0.29, slip=SLIP)
    assert walk.touching[:, 0].all(), "one stance"
    slid = 0.5 * walk.period * np.maximum(np.arange(59) - 20, 0)
    measured = walk.measured.copy()
    measured[:, 0] += slid[:, None] * walk.poses[:, 0, :3]  # R^T e_x
    walk = replace(walk, measured=measured)
    worst = {}
    for probability in (0.0, 1e-3):
        ekf = InvariantEkf(4, NOISE, slip=SLIP, outlier_probability=probability)
        ekf.reset(walk.poses[0], 0.1 * DEVIATIONS)
        errors = [np.linalg.norm(ekf.velocity - walk.poses[k][:3, 3]) for k in walk.run(ekf)]
        worst[probability] = max(errors)
        assert ekf.rejected.tolist() == [probability > 0.0, False, False, False]
    assert worst[1e-3] < 0.3 * worst[0.0], worst


@pytest.mark.usefixtures("interpreted")
def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="^period: got 2"):
        simulate_trot(np.random.default_rng(0), NOISE, duration=1.0, period=2.0)
    walk = simulate_trot(np.random.default_rng(0), NOISE, duration=0.01)
    with pytest.raises(InputError, match="^outlier_probability: got 1"):
        InvariantEkf(4, outlier_probability=1.0)
    with pytest.raises(InputError, match="^ekf: got a filter for 3 feet"):
        next(walk.run(InvariantEkf(3)))
