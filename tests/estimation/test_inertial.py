"""Inertial kinematics and increments against matrix exponentials and DOP853."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from lgmpc.errors import InputError
from lgmpc.estimation.inertial import (
    ImuNoise,
    error_dynamics,
    exponential_increment,
    free_flow,
    gravity_increment,
    propagate,
)
from lgmpc.lie import sek3, so3

GRAVITY = np.array([0.3, -0.2, -9.81])  # not along an axis: no coordinate is special


def vector_field(pose: np.ndarray, gyro: np.ndarray, accelerometer: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """``R' = R [w]x,  v' = R a + g,  p' = v``, points at rest: the field whose flow the increments are."""
    rate, rotation = np.zeros_like(pose), pose[:3, :3]
    rate[:3, :3] = rotation @ so3.hat(gyro)
    rate[:3, 3], rate[:3, 4] = rotation @ accelerometer + gravity, pose[:3, 3]
    return rate


def random_pose(rng: np.random.Generator, columns: int = 2) -> np.ndarray:
    pose = sek3.exp(rng.normal(size=3 + 3 * columns))
    pose[:3, 3:] *= 3.0
    return pose


@pytest.mark.parametrize("columns", [2, 6])
def test_the_field_is_group_affine(columns: int) -> None:
    rng = np.random.default_rng(columns)
    for _ in range(20):
        x, y = random_pose(rng, columns), random_pose(rng, columns)
        w, a = rng.normal(size=3), 5.0 * rng.normal(size=3)

        def field(pose: np.ndarray, w: np.ndarray = w, a: np.ndarray = a) -> np.ndarray:
            return vector_field(pose, w, a, GRAVITY)

        expected = field(x) @ y + x @ field(y) - x @ field(sek3.identity(columns)) @ y
        np.testing.assert_allclose(field(x @ y), expected, atol=1e-12)


def test_a_field_whose_velocity_were_in_body_axes_is_not_group_affine() -> None:
    """The check above can fail: SE(3) x R^3 with p' = R v (body velocity) is not of that form."""
    rng = np.random.default_rng(5)
    x, y, w, a = random_pose(rng), random_pose(rng), rng.normal(size=3), rng.normal(size=3)

    def field(pose: np.ndarray) -> np.ndarray:
        rate = vector_field(pose, w, a, GRAVITY)
        rate[:3, 4] = pose[:3, :3] @ pose[:3, 3]
        return rate

    defect = field(x @ y) - (field(x) @ y + x @ field(y) - x @ field(sek3.identity(2)) @ y)
    assert np.abs(defect).max() > 0.1


def test_the_free_flow_is_an_automorphism() -> None:
    rng = np.random.default_rng(1)
    x, y = random_pose(rng, 3), random_pose(rng, 3)
    np.testing.assert_allclose(free_flow(x @ y, 0.7), free_flow(x, 0.7) @ free_flow(y, 0.7), atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-10, 1e-4, 0.3, 3.0, 3.3, 9.0])
def test_the_exponential_increment_is_a_matrix_exponential(angle: float) -> None:
    rng = np.random.default_rng(3)
    dt, a = 0.1, np.array([1.0, -9.0, 4.0])
    axis = rng.normal(size=3)
    w = axis / np.linalg.norm(axis) * angle / dt
    generator = np.zeros((5, 5))
    generator[:3, :3], generator[:3, 3], generator[3, 4] = so3.hat(w), a, 1.0
    expected = expm(dt * generator)
    expected[3, 4] = 0.0  # the flow of time itself, which is not part of the increment
    np.testing.assert_allclose(exponential_increment(w, a, dt), expected, atol=3e-15)


def test_a_propagated_pose_solves_the_differential_equation() -> None:
    rng = np.random.default_rng(4)
    start, w, a, duration = random_pose(rng, 3), rng.normal(size=3), 5.0 * rng.normal(size=3), 0.8

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        pose = flat.reshape(6, 6).copy()
        pose[:3, :3] = so3.project(pose[:3, :3])
        return vector_field(pose, w, a, GRAVITY).ravel()

    solution = solve_ivp(rate, (0.0, duration), start.ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    end = propagate(start, exponential_increment(w, a, duration), GRAVITY, duration)
    np.testing.assert_allclose(end, solution.y[:, -1].reshape(6, 6), atol=1e-10)


def test_the_right_invariant_error_is_exactly_log_linear() -> None:
    """Errors of 2 rad and metres along a wild motion: expm(A t) xi_0 to rounding."""
    rng = np.random.default_rng(6)
    true = random_pose(rng, 4)
    xi = rng.normal(size=15)
    xi[:3] *= 2.0 / np.linalg.norm(xi[:3])
    estimate = sek3.exp(xi) @ true
    dynamics, dt, steps = error_dynamics(GRAVITY, 4), 0.01, 200
    for k in range(1, steps + 1):
        step = exponential_increment(3.0 * rng.normal(size=3), 20.0 * rng.normal(size=3), dt)
        true, estimate = propagate(true, step, GRAVITY, dt), propagate(estimate, step, GRAVITY, dt)
        if k in (1, 50, steps):
            error = sek3.log(so3_exact(estimate @ sek3.inverse(so3_exact(true))))
            np.testing.assert_allclose(error, expm(dynamics * dt * k) @ xi, atol=1e-9)


def so3_exact(pose: np.ndarray) -> np.ndarray:
    clean = pose.copy()
    clean[:3, :3] = so3.project(pose[:3, :3])
    return clean


def test_gravity_is_the_increment_of_a_fall() -> None:
    fall = gravity_increment(GRAVITY, 2.0)
    np.testing.assert_allclose(fall[:3, 3], 2.0 * GRAVITY)
    np.testing.assert_allclose(fall[:3, 4], 2.0 * GRAVITY)


@pytest.mark.parametrize(
    ("argument", "sample"),
    [
        ("gyro", ([0.0, np.nan, 0.0], [0.0, 0.0, 0.0], 0.1)),
        ("gyro", ([0.0, 0.0], [0.0, 0.0, 0.0], 0.1)),
        ("accelerometer", ([0.0, 0.0, 0.0], [[0.0, 0.0, 0.0]], 0.1)),
        ("duration", ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0)),
        ("duration", ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], np.inf)),
    ],
)
def test_impossible_samples_are_refused(argument: str, sample: tuple) -> None:
    with pytest.raises(InputError, match=f"^{argument}: got"):
        exponential_increment(*sample)


def test_other_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="^pose: got"):
        free_flow(2.0 * np.eye(5), 1.0)
    with pytest.raises(InputError, match="^duration: got nan"):
        free_flow(np.eye(5), np.nan)
    with pytest.raises(InputError, match="^increment: got"):
        propagate(np.eye(6), np.eye(7), GRAVITY, 0.1)
    with pytest.raises(InputError, match="^columns: got 1"):
        error_dynamics(GRAVITY, 1)
    with pytest.raises(InputError, match="^gyro_noise_rad_s_rt_hz: got -1"):
        ImuNoise(gyro_noise_rad_s_rt_hz=-1.0)
