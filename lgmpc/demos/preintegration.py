"""IMU preintegration over half a second: exact exponential and zero-order hold, bias correction, covariance.

Chapter 4.11; Forster et al., IEEE TRO 2017; Brossard et al., IEEE TRO 2021.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
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
from lgmpc.typing import GRAVITY, Array

__all__ = ["run"]

_DOWN = np.array([0.0, 0.0, -GRAVITY])
NOISE = ImuNoise(gyro_noise_rad_s_rt_hz=2e-2, accelerometer_noise_m_s2_rt_hz=1e-1)
DURATION, PERIOD, RUNS = 0.5, 0.01, 300
PERIODS = np.array([0.02, 0.01, 0.005, 0.0025])
CHANGES = np.array([0.04, 0.02, 0.01, 0.005])
DIRECTION = np.array([1.0, -2.0, 1.5, 3.0, -1.0, 2.0])
"""Changes of the biases: rad/s, then m/s2."""


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    exact, motion = _solved(np.array([0.0, DURATION]))[-1], _integrated(_samples(PERIOD), PERIOD)
    errors = {
        name: np.array([_position_error(period, rule, exact) for period in PERIODS])
        for name, rule in (("exact exponential", exponential_increment), ("zero-order hold", zero_order_hold_increment))
    }
    corrections = np.array([_correction_error(motion, size) for size in CHANGES])
    spread, deviations, squares = _monte_carlo()
    tolerance = max(abs(chi2.ppf(p, 9 * RUNS) / (9 * RUNS) - 1.0) for p in (1e-4, 1.0 - 1e-4))
    predicted = deviations[-1]
    table = (
        Row("defect of group affinity", 0.0, _affine_defect(), 1e-12),
        Row("exact form less DOP853", 0.0, _constant_rates_error(), 1e-9),
        Row("order of the exact form", 2.0, _slope(PERIODS, errors["exact exponential"]), 0.05),
        Row("order of the zero-order hold", 1.0, _slope(PERIODS, errors["zero-order hold"]), 0.05),
        Row("order of the bias correction", 2.0, _slope(CHANGES, corrections), 0.05),
        Row("noise: NEES / freedom", 1.0, float(squares.mean()) / 9.0, float(tolerance)),
        Row("noise: deviation of height", 1e3 * predicted[8], 1e3 * spread[-1, 8], 0.2e3 * predicted[8], "mm"),
    )
    guide = 0.5 * errors["exact exponential"][0] * (PERIODS / PERIODS[0]) ** 2
    panels = (
        Panel(
            "Position error against DOP853",
            "sample period, s",
            "m",
            (
                *(Curve(name, PERIODS, values) for name, values in errors.items()),
                Curve("second order", PERIODS, guide, dashed=True),
            ),
            log_x=True,
            log_y=True,
        ),
        Panel(
            "Bias correction without repeated integration",
            "change of the gyro's bias, rad/s",
            "error in the tangent",
            (
                Curve("corrected to first order", CHANGES, corrections),
                Curve("second order", CHANGES, 0.5 * corrections[0] * (CHANGES / CHANGES[0]) ** 2, dashed=True),
            ),
            log_x=True,
            log_y=True,
        ),
        _spread_panel(spread, deviations),
    )
    times, poses = _path()
    shapes = (
        Shape("box", (0.06, 0.04, 0.02)),
        Shape("box", (0.02, 0.01, 0.01), (0.04, 0.0, 0.0), 0xE45756),
    )
    return Outcome(
        table,
        panels,
        times,
        (Body("imu", shapes, poses[:, :3, 4], poses[:, :3, :3]),),
        (Path("path", poses[:, :3, 4]),),
        (
            "The first two orders are those for varying body rates; the comparison with DOP853 is for constant ones.",
            "The increment does not depend on the initial state: velocity and gravity are added afterwards.",
            "The exponential form is exact for body rates that are constant over a sample; in the zero-order hold of"
            " Forster et al. the force is constant in world axes.",
        ),
    )


def _body_rates(t: float) -> Array:
    """Return (6,) angular velocity, rad/s, and specific force, m/s2, at a time, s."""
    gyro = [1.0 + np.sin(3.0 * t), 0.5 * np.cos(5.0 * t), -2.0 * np.sin(t)]
    return np.array([*gyro, 3.0 * np.sin(4.0 * t), 2.0 * np.cos(3.0 * t), 9.0 + np.sin(6.0 * t)])


def _samples(period: float) -> Array:
    """Return (n, 6) body rates at the midpoint of each interval."""
    times = period * (0.5 + np.arange(round(DURATION / period)))
    return np.array([_body_rates(t) for t in times])


def _start() -> Array:
    start = sek3.identity(2)
    start[:3, :3] = so3.exp(np.array([0.1, -0.2, 0.3]))
    start[:3, 3] = [0.5, 0.2, 0.0]
    return start


def _integrated(
    rows: Array, period: float, rule: IncrementRule = exponential_increment, bias: Array | None = None
) -> Preintegration:
    biases = np.zeros(6) if bias is None else bias
    motion = Preintegration(NOISE, biases[:3], biases[3:], rule)
    for row in rows:
        motion.integrate(row[:3], row[3:], period)
    return motion


def _solved(times: Array, body_rates: Callable[[float], Array] = _body_rates) -> Array:
    """Return (n, 5, 5) the motion by DOP853, without increments."""

    def rate(t: float, flat: Array) -> Array:
        pose, rates = flat.reshape(5, 5).copy(), body_rates(t)
        pose[:3, :3] = so3.project(pose[:3, :3])
        return vector_field(pose, rates[:3], rates[3:], _DOWN).ravel()

    span = (0.0, float(times[-1]))
    found = solve_ivp(rate, span, _start().ravel(), method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    poses: Array = found.y.T.reshape(-1, 5, 5)
    return poses


def _path() -> tuple[Array, Array]:
    times: Array = np.linspace(0.0, DURATION, 101)
    poses = _solved(times)
    poses[:, :3, :3] = so3.project(poses[:, :3, :3])
    return times, poses


def _position_error(period: float, rule: IncrementRule, exact: Array) -> float:
    end = _integrated(_samples(period), period, rule).predict(_start(), _DOWN)
    return float(np.linalg.norm(end[:3, 4] - exact[:3, 4]))


def _constant_rates_error() -> float:
    rates = np.array([1.0, -2.0, 0.5, 2.0, -3.0, 9.0])
    end = propagate(_start(), exponential_increment(rates[:3], rates[3:], DURATION).pose, _DOWN, DURATION)
    return largest(end - _solved(np.array([0.0, DURATION]), lambda _: rates)[-1])


def _affine_defect() -> float:
    rng = np.random.default_rng(0)
    x, y = (sek3.exp(rng.normal(size=9)) for _ in range(2))
    gyro, force = rng.normal(size=3), rng.normal(size=3)

    def field(pose: Array) -> Array:
        return vector_field(pose, gyro, force, _DOWN)

    return largest(field(x @ y) - field(x) @ y - x @ field(y) + x @ field(np.eye(5)) @ y)


def _correction_error(motion: Preintegration, size: float) -> float:
    change = size * DIRECTION
    again = _integrated(_samples(PERIOD), PERIOD, bias=change).pose
    return float(np.linalg.norm(sek3.log(sek3.inverse(again) @ motion.corrected(change[:3], change[3:]))))


def _monte_carlo() -> tuple[Array, Array, Array]:
    """Return standard deviations after each sample (n, 9), found and predicted, and squared errors (RUNS,)."""
    rng, rows = np.random.default_rng(1), _samples(PERIOD)
    sigma = np.repeat(NOISE.densities[:2], 3) / np.sqrt(PERIOD)
    clean = Preintegration(NOISE, np.zeros(3), np.zeros(3))
    noisy = np.tile(np.eye(5), (RUNS, 1, 1))
    spreads, deviations, errors = [], [], np.zeros((RUNS, 9))
    for row in rows:
        clean.integrate(row[:3], row[3:], PERIOD)
        steps = [
            exponential_increment(sample[:3], sample[3:], PERIOD).pose
            for sample in row + sigma * rng.normal(size=(RUNS, 6))
        ]
        noisy[:, :3, 4] += PERIOD * noisy[:, :3, 3]
        noisy = noisy @ np.array(steps)
        errors = sek3.log(sek3.inverse(clean.pose) @ noisy)
        spreads.append(errors.std(axis=0))
        deviations.append(np.sqrt(np.diag(clean.covariance)))
    squares = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(clean.covariance), errors)
    return np.array(spreads), np.array(deviations), squares


def _spread_panel(found: Array, predicted: Array) -> Panel:
    times: Array = PERIOD * np.arange(1.0, len(found) + 1.0)
    curves = Curve("found", times, 1e3 * found[:, 8]), Curve("predicted", times, 1e3 * predicted[:, 8], dashed=True)
    return Panel.over_time(f"Noise of the height in {RUNS} runs", "standard deviation, mm", *curves)


def _slope(sizes: Array, errors: Array) -> float:
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
