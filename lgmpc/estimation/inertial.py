r"""Inertial kinematics on SE_2(3) and SE_{2+k}(3): columns velocity, position, then k points at rest in the world.

``R' = R [w]x,  v' = R a + g,  p' = v`` with the angular velocity ``w`` (rad/s) and the specific force
``a`` (m/s2) in body axes, gravity ``g`` in world axes. The field is group affine (Barrau and Bonnabel, IEEE TAC 2017),
``f(X Y) = f(X) Y + X f(Y) - X f(I) Y``, so that over any time, exactly,

    X(t) = Gamma(t) phi_t(X(0)) Upsilon(t)                                   (Brossard et al., IEEE TRO 2021)

with gravity's ``Gamma``, the free flow ``phi_t: p -> p + t v`` (an automorphism of the group) and the increment
``Upsilon``, which depends on the measurements alone.
"""

import math

import numpy as np

from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of, number, whole
from lgmpc.lie import checks, coefficients, so3
from lgmpc.lie.coefficients import b_c
from lgmpc.settings import Noise, Settings, key
from lgmpc.typing import Array, numbers


class ImuNoise(Settings):
    """Densities of white noise, as data sheets have them; a sample over ``dt`` has variance ``density^2 / dt``.

    The random walk of a bias integrates white noise: it adds ``density^2 dt`` to the bias's variance.
    """

    gyro_noise_rad_s_rt_hz: Noise = key(1e-4, "Density of the gyro's white noise, rad/s/sqrt(Hz).")
    gyro_bias_walk_rad_s2_rt_hz: Noise = key(
        1e-5, "Density of the noise that the gyro's bias integrates, rad/s2/sqrt(Hz)."
    )
    accelerometer_noise_m_s2_rt_hz: Noise = key(3e-4, "Density of the accelerometer's white noise, m/s2/sqrt(Hz).")
    accelerometer_bias_walk_m_s3_rt_hz: Noise = key(
        1e-4, "Density of the white noise that the accelerometer's bias integrates, m/s3/sqrt(Hz)."
    )

    @property
    def densities(self) -> tuple[float, float, float, float]:
        """Densities of gyro, accelerometer, random walk of the gyro's bias and of the accelerometer's."""
        return (
            self.gyro_noise_rad_s_rt_hz,
            self.accelerometer_noise_m_s2_rt_hz,
            self.gyro_bias_walk_rad_s2_rt_hz,
            self.accelerometer_bias_walk_m_s3_rt_hz,
        )


def free_flow(pose: Array, duration: float) -> Array:
    """Return ``phi_t(pose)``: the position moves with constant velocity. ``phi_t(X Y) = phi_t(X) phi_t(Y)``.

    Raises:
        InputError: ``pose`` is no extended pose with two columns or more, or ``duration`` is not finite.
    """
    moved = _extended("pose", pose).copy()
    moved[:3, 4] += _time("duration", duration) * moved[:3, 3]
    return moved


def gravity_increment(gravity: Array, duration: float, columns: int = 2) -> Array:
    """Return ``Gamma(t)``, (3 + columns, 3 + columns): the effect of gravity (3,) on velocity and position.

    Raises:
        InputError: gravity is no finite 3-vector, or fewer than 2 columns.
    """
    whole("columns", columns, "at least 2: velocity and position", 2)
    gravity, duration = numbers("gravity", gravity, (3,), finite=True), _time("duration", duration)
    result = np.eye(3 + columns)
    result[:3, 3] = duration * gravity
    result[:3, 4] = 0.5 * duration**2 * gravity
    return result


def exponential_increment(gyro: Array, accelerometer: Array, duration: float) -> Array:
    """Return ``Upsilon`` (5, 5) of body rates that are constant over ``duration``, exactly.

    With ``phi = w dt`` and the integrals of the rotation ``Gamma_m(phi) = sum_k Phi^k / (k + m)!`` it is
    ``(Gamma_0, Gamma_1 a dt, Gamma_2 a dt^2)``: Bloesch et al. (RSS 2012), Hartley et al. (IJRR 2020).

    Args:
        gyro: (3,) angular velocity, body axes, rad/s.
        accelerometer: (3,) specific force, body axes, m/s2.
        duration: s, positive.

    Raises:
        InputError: an argument that is no finite 3-vector, or a duration that is not positive.
    """
    force, dt = numbers("accelerometer", accelerometer, (3,), finite=True), duration_of("duration", duration)
    phi = dt * numbers("gyro", gyro, (3,), finite=True)
    angle = math.sqrt(phi @ phi)
    b, c = b_c(angle)
    turn = so3.hat.unchecked(phi)
    square = turn @ turn
    pose = np.eye(5)
    pose[:3, :3] = so3.exp.unchecked(phi)
    pose[:3, 3] = dt * (force + (b * turn + c * square) @ force)
    pose[:3, 4] = dt**2 * (0.5 * force + (c * turn + coefficients.e(angle) * square) @ force)
    return pose


def propagate(pose: Array, increment: Array, gravity: Array, duration: float) -> Array:
    """Return ``Gamma phi(pose) Upsilon``: the pose after ``duration`` s.

    Args:
        pose: (3 + k, 3 + k), k >= 2.
        increment: (5, 5) Upsilon, or (3 + k, 3 + k).
        gravity: (3,) world axes, m/s2.
        duration: s.

    Raises:
        InputError: an argument of another form.
    """
    pose = _extended("pose", pose)
    increment = _extended("increment", increment)
    if increment.shape not in ((5, 5), pose.shape):
        raise InputError("increment", f"shape {increment.shape}", f"shape (5, 5) or {pose.shape}")
    upsilon = np.eye(len(pose))
    upsilon[: len(increment), : len(increment)] = increment
    return gravity_increment(gravity, duration, len(pose) - 3) @ free_flow(pose, duration) @ upsilon


def error_dynamics(gravity: Array, columns: int = 2) -> Array:
    """Return ``A`` of the right-invariant error's exact linear dynamics, (3 + 3 columns, 3 + 3 columns).

    With ``exp(xi) = X_estimate X_true^{-1}`` and neither noise nor biases, ``xi(t) = expm(A t) xi(0)`` for errors of
    any size along any motion, where A depends on gravity alone (Barrau and Bonnabel, IEEE TAC 2017; Hartley et al.,
    IJRR 2020).

    Raises:
        InputError: gravity is no finite 3-vector, or fewer than 2 columns.
    """
    whole("columns", columns, "at least 2: velocity and position", 2)
    result = np.zeros((3 + 3 * columns, 3 + 3 * columns))
    result[3:6, :3] = so3.hat(numbers("gravity", gravity, (3,), finite=True))
    result[6:9, 3:6] = np.eye(3)
    return result


def _extended(name: str, value: Array) -> Array:
    pose = checks.extended_pose(name, value)
    if pose.ndim != 2 or len(pose) < 5:
        raise InputError(name, f"shape {pose.shape}", "one matrix (3 + k, 3 + k) with k >= 2: velocity, position, ...")
    return pose


def _time(name: str, value: object) -> float:
    return number(name, value, "a finite number of seconds")
