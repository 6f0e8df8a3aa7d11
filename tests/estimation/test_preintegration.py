"""Preintegration: independence of the start, bias Jacobian, covariance, and the order of both forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from lgmpc.errors import InputError
from lgmpc.estimation.inertial import (
    ImuNoise,
    IncrementRule,
    Preintegration,
    exponential_increment,
    propagate,
    vector_field,
    zero_order_hold_increment,
)
from lgmpc.lie import sek3, so3

GRAVITY = np.array([0.0, 0.0, -9.81])
NOISE = ImuNoise(gyro_noise_rad_s_rt_hz=2e-3, accelerometer_noise_m_s2_rt_hz=2e-2)
RULES = [exponential_increment, zero_order_hold_increment]
NONE = np.zeros(3)


def gyro(t: float) -> np.ndarray:
    return np.array([1.0 + np.sin(3.0 * t), 0.5 * np.cos(5.0 * t), -2.0 * np.sin(t)])


def force(t: float) -> np.ndarray:
    return np.array([3.0 * np.sin(4.0 * t), 2.0 * np.cos(3.0 * t), 9.0 + np.sin(6.0 * t)])


def samples(dt: float, duration: float = 0.5) -> np.ndarray:
    """Body rates in the middle of each interval, (n, 6)."""
    times = dt * (0.5 + np.arange(round(duration / dt)))
    return np.array([np.concatenate([gyro(t), force(t)]) for t in times])


def integrated(
    rows: np.ndarray, dt: float, rule: IncrementRule = exponential_increment, bias: np.ndarray | None = None
) -> Preintegration:
    bias = np.zeros(6) if bias is None else bias
    motion = Preintegration(NOISE, bias[:3], bias[3:], rule)
    for row in rows:
        motion.integrate(row[:3], row[3:], dt)
    return motion


def test_it_predicts_what_sample_by_sample_propagation_gives_from_any_start() -> None:
    rng, rows, dt = np.random.default_rng(0), samples(0.01), 0.01
    motion = integrated(rows, dt)
    for _ in range(3):
        start = pose = sek3.exp(rng.normal(size=9))
        for row in rows:
            pose = propagate(pose, exponential_increment(row[:3], row[3:], dt).pose, GRAVITY, dt)
        np.testing.assert_allclose(motion.predict(start, GRAVITY), pose, atol=1e-13)
        np.testing.assert_allclose(motion.residual(start, pose, GRAVITY, NONE, NONE), 0.0, atol=1e-12)


@pytest.mark.parametrize(("rule", "order"), [(exponential_increment, 2.0), (zero_order_hold_increment, 1.0)])
def test_order_of_accuracy_for_changing_body_rates(rule: IncrementRule, order: float) -> None:
    """Midpoint samples make the exact form second order; the zero-order hold stays of first order."""
    start = sek3.identity(2)
    start[:3, 3] = [0.5, 0.0, 0.0]

    def rate(t: float, flat: np.ndarray) -> np.ndarray:
        pose = flat.reshape(5, 5).copy()
        pose[:3, :3] = so3.project(pose[:3, :3])
        return vector_field(pose, gyro(t), force(t), GRAVITY).ravel()

    solution = solve_ivp(rate, (0.0, 0.5), start.ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    exact = solution.y[:, -1].reshape(5, 5)
    errors = [
        np.abs(integrated(samples(dt), dt, rule).predict(start, GRAVITY)[:3, 3:] - exact[:3, 3:]).max()
        for dt in (0.01, 0.005, 0.0025)
    ]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, order, atol=0.05)


@pytest.mark.parametrize("rule", RULES)
def test_the_bias_jacobian_is_the_derivative_of_integrating_again(rule: IncrementRule) -> None:
    rows, dt, bias, h = samples(0.01), 0.01, np.array([0.01, -0.02, 0.03, 0.1, 0.2, -0.1]), 1e-5
    motion = integrated(rows, dt, rule, bias)
    back, numeric = sek3.inverse(motion.pose), np.zeros((9, 6))
    for j in range(6):
        ahead, behind = (integrated(rows, dt, rule, bias + s * h * np.eye(6)[j]).pose for s in (1.0, -1.0))
        numeric[:, j] = (sek3.log(back @ ahead) - sek3.log(back @ behind)) / (2.0 * h)
    np.testing.assert_allclose(motion.bias_jacobian, numeric, atol=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_correction_for_a_bias_leaves_an_error_of_second_order(rule: IncrementRule) -> None:
    rows, dt = samples(0.01), 0.01
    motion = integrated(rows, dt, rule)
    direction = np.array([1.0, -2.0, 1.5, 3.0, -1.0, 2.0])
    errors = []
    for size in (0.02, 0.01, 0.005):
        change = size * direction
        again = integrated(rows, dt, rule, change).pose
        errors.append(np.linalg.norm(sek3.log(sek3.inverse(again) @ motion.corrected(change[:3], change[3:]))))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05)


@pytest.mark.parametrize(
    "rule", [exponential_increment, pytest.param(zero_order_hold_increment, marks=pytest.mark.slow)]
)
def test_the_covariance_is_that_of_a_monte_carlo(rule: IncrementRule) -> None:
    """Mahalanobis lengths are chi-square distributed with 9 degrees of freedom: their mean within four sigma."""
    rng, rows, dt, runs = np.random.default_rng(2), samples(0.02, 0.25), 0.02, 600
    motion = integrated(rows, dt, rule)
    sigma = np.repeat(NOISE.densities[:2], 3) / np.sqrt(dt)
    back = sek3.inverse(motion.pose)
    errors = np.array(
        [sek3.log(back @ integrated(rows + sigma * rng.normal(size=rows.shape), dt, rule).pose) for _ in range(runs)]
    )
    squares = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(motion.covariance), errors)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 9 * runs) / runs
    assert low < squares.mean() < high
    ratio = errors.T @ errors / runs
    scale = np.sqrt(np.diag(motion.covariance))
    np.testing.assert_allclose(ratio / np.outer(scale, scale), motion.covariance / np.outer(scale, scale), atol=0.2)


def test_both_forms_differ_by_the_first_order_in_the_interval() -> None:
    errors = []
    for dt in (0.01, 0.005, 0.0025):
        first, second = (integrated(samples(dt), dt, rule) for rule in RULES)
        jacobians = np.abs(first.bias_jacobian - second.bias_jacobian).max()
        errors.append([np.abs(first.pose - second.pose).max(), jacobians])
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.05)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="^gyro_bias: got"):
        Preintegration(NOISE, np.zeros(2), NONE)
    motion = Preintegration(NOISE, NONE, NONE)
    with pytest.raises(InputError, match="^gyro: got"):
        motion.integrate(np.full(3, np.inf), NONE, 0.01)
    with pytest.raises(InputError, match="^duration: got -1"):
        motion.integrate(NONE, NONE, -1.0)
    with pytest.raises(InputError, match="^start: got"):
        motion.predict(np.eye(6), GRAVITY)
    with pytest.raises(InputError, match="^gravity: got"):
        motion.predict(np.eye(5), np.array([0.0, np.nan, 0.0]))
