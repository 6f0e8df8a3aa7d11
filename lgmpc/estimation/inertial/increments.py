r"""The increment of one IMU sample: an element of SE_2(3), in the two forms of the literature.

With ``phi = w dt`` and the integrals of the rotation ``Gamma_m(phi) = sum_k Phi^k / (k + m)!``:

* exact exponential: the body rates are constant over the interval, ``(Gamma_0, Gamma_1 a dt, Gamma_2 a dt^2)``. The
  closed form of Bloesch et al. (RSS 2012) and Hartley et al. (IJRR 2020); in Brossard et al. (IEEE TRO 2021).
* zero-order hold: the specific force is constant in *world* axes over the interval,
  ``(Gamma_0, a dt, a dt^2 / 2)``: Forster et al. (IEEE TRO 2017), first order in ``dt``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.estimation.checks import duration_of, three
from lgmpc.lie import coefficients, so3
from lgmpc.lie.coefficients import b_c
from lgmpc.typing import Array

__all__ = ["Increment", "IncrementRule", "exponential_increment", "zero_order_hold_increment"]


@dataclass(frozen=True)
class Increment:
    """The increment of one sample.

    Attributes:
        pose: (5, 5) element of SE_2(3): rotation, velocity, position.
        jacobian: (9, 6) its dependence on the sample: ``pose(w + dw, a + da) = pose exp(jacobian [dw; da])`` to first
            order. It also maps noise and, with the opposite sign, biases.
    """

    pose: Array
    jacobian: Array


IncrementRule = Callable[[Array, Array, float], Increment]
"""Angular velocity (3,) rad/s, specific force (3,) m/s2, duration s -> :class:`Increment`."""


def exponential_increment(gyro: Array, accelerometer: Array, duration: float) -> Increment:
    """Return the exact increment of body rates that are constant over ``duration``.

    Args:
        gyro: (3,) angular velocity, body axes, rad/s.
        accelerometer: (3,) specific force, body axes, m/s2.
        duration: s, positive.

    Raises:
        InputError: an argument that is no finite 3-vector, or a duration that is not positive.
    """
    gyro, force, dt = _checked(gyro, accelerometer, duration)
    phi = dt * gyro
    angle = math.sqrt(phi @ phi)
    b, c = b_c(angle)
    e, epsilon = coefficients.e(angle), coefficients.epsilon(angle)
    beta, gamma = coefficients.beta(angle), coefficients.gamma(angle)
    turn = so3.hat.unchecked(phi)
    square = turn @ turn
    gamma1 = np.eye(3) + b * turn + c * square
    gamma2 = 0.5 * np.eye(3) + c * turn + e * square
    # d (f Phi + g Phi^2) a: f and g change along phi, and Phi a = -[a]x phi.
    minus_skew = -so3.hat.unchecked(force)
    of_square = turn @ minus_skew - so3.hat.unchecked(turn @ force)
    slope1 = b * minus_skew + c * of_square + np.outer((beta * turn + gamma * square) @ force, phi)
    slope2 = c * minus_skew + e * of_square + np.outer((gamma * turn + epsilon * square) @ force, phi)
    pose = _pose(phi, dt * gamma1 @ force, dt**2 * gamma2 @ force)
    return Increment(pose, _body(pose, dt * gamma1, dt**2 * slope1, dt * gamma1, dt**3 * slope2, dt**2 * gamma2))


def zero_order_hold_increment(gyro: Array, accelerometer: Array, duration: float) -> Increment:
    """Return the increment of a specific force that is constant in world axes over ``duration``."""
    gyro, force, dt = _checked(gyro, accelerometer, duration)
    phi = dt * gyro
    pose = _pose(phi, dt * force, 0.5 * dt**2 * force)
    none, eye = np.zeros((3, 3)), np.eye(3)
    left_jacobian = so3.left_jacobian.unchecked(phi)
    return Increment(pose, _body(pose, dt * left_jacobian, none, dt * eye, none, 0.5 * dt**2 * eye))


def _checked(gyro: Array, accelerometer: Array, duration: float) -> tuple[Array, Array, float]:
    return three("gyro", gyro), three("accelerometer", accelerometer), duration_of("duration", duration)


def _pose(phi: Array, velocity: Array, position: Array) -> Array:
    pose = np.eye(5)
    pose[:3, :3], pose[:3, 3], pose[:3, 4] = so3.exp.unchecked(phi), velocity, position
    return pose


def _body(pose: Array, turn_w: Array, v_w: Array, v_a: Array, p_w: Array, p_a: Array) -> Array:
    """Return derivatives in world axes, by blocks, as a (9, 6) Jacobian in the body axes at the end."""
    jacobian = np.zeros((9, 6))
    jacobian[:3, :3] = turn_w
    jacobian[3:6, :3], jacobian[3:6, 3:] = v_w, v_a
    jacobian[6:, :3], jacobian[6:, 3:] = p_w, p_a
    back = pose[:3, :3].T
    for i in (0, 3, 6):
        jacobian[i : i + 3] = back @ jacobian[i : i + 3]
    return jacobian
