""":mod:`lgmpc.lie.coefficients` as CasADi expressions, functions of the squared angle ``t = theta^2``.

As functions of ``t`` they have no square root below the seam: every coefficient is there a polynomial (or a rational
function without a pole nearby), so that derivatives of any order are exact at 0. Beyond the seam, which only vectors
longer than pi exceed, the closed forms hold; the argument of each branch stays within that branch's domain, because
``if_else`` differentiates both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from lgmpc.lie.coefficients import (
    A_SERIES,
    B_SERIES,
    BETA_SERIES,
    C_SERIES,
    D_REMAINDER,
    DELTA_REMAINDER,
    E_SERIES,
    FOUR_PI_SQUARED,
    GAMMA_SERIES,
    SEAM,
)

__all__ = ["a", "b", "beta", "c", "d", "delta", "e", "gamma", "half_cosine", "half_sinc", "half_angle_ratio"]

ATAN_SEAM = 0.04
"""Squared tangent of half the angle below which the logarithm of a quaternion uses the series of the arctangent."""

_ATAN_SERIES = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


def _horner(series: Sequence[float], t: Any) -> Any:
    value = series[-1]
    for coefficient in reversed(series[:-1]):
        value = value * t + coefficient
    return value


def _split(t: Any, series: Callable[[Any], Any], closed: Callable[[Any, Any], Any]) -> Any:
    near = t <= SEAM
    far = ca.if_else(near, 16.0, t)
    return ca.if_else(near, series(ca.if_else(near, t, 0.0)), closed(ca.sqrt(far), far))


def a(t: Any) -> Any:
    """Return ``sin(theta) / theta``."""
    return _split(t, lambda s: _horner(A_SERIES, s), lambda u, _: ca.sin(u) / u)


def b(t: Any) -> Any:
    """Return ``(1 - cos(theta)) / theta^2``."""
    return _split(t, lambda s: _horner(B_SERIES, s), lambda u, s: (1.0 - ca.cos(u)) / s)


def c(t: Any) -> Any:
    """Return ``(theta - sin(theta)) / theta^3``."""
    return _split(t, lambda s: _horner(C_SERIES, s), lambda u, s: (u - ca.sin(u)) / (u * s))


def beta(t: Any) -> Any:
    """Return ``b'/theta``."""
    return _split(
        t,
        lambda s: _horner(BETA_SERIES, s),
        lambda u, s: (u * ca.sin(u) + 2.0 * ca.cos(u) - 2.0) / s**2,
    )


def gamma(t: Any) -> Any:
    """Return ``c'/theta``."""
    return _split(
        t,
        lambda s: _horner(GAMMA_SERIES, s),
        lambda u, s: (3.0 * ca.sin(u) - u * ca.cos(u) - 2.0 * u) / (u * s**2),
    )


def d(t: Any) -> Any:
    """Return ``(1 - (theta/2) cot(theta/2)) / theta^2``."""
    return _split(
        t,
        lambda s: 2.0 / (FOUR_PI_SQUARED - s) + _horner(D_REMAINDER, s),
        lambda u, s: (1.0 - 0.5 * u / ca.tan(0.5 * u)) / s,
    )


def delta(t: Any) -> Any:
    """Return ``d'/theta``."""
    return _split(
        t,
        lambda s: 4.0 / (FOUR_PI_SQUARED - s) ** 2 + _horner(DELTA_REMAINDER, s),
        lambda u, s: (0.25 / ca.sin(0.5 * u) ** 2 + 0.5 / (u * ca.tan(0.5 * u)) - 2.0 / s) / s,
    )


def e(t: Any) -> Any:
    """Return ``(theta^2 / 2 + cos(theta) - 1) / theta^4``."""
    return _split(t, lambda s: _horner(E_SERIES, s), lambda u, s: (0.5 * s + ca.cos(u) - 1.0) / s**2)


def half_sinc(t: Any) -> Any:
    """Return ``sin(theta/2) / theta``: the vector part of the exponential's quaternion."""
    return 0.5 * a(0.25 * t)


def half_cosine(t: Any) -> Any:
    """Return ``cos(theta/2)``: the scalar part of the exponential's quaternion."""
    return 1.0 - 0.25 * t * b(0.25 * t)


def half_angle_ratio(sine_squared: Any, cosine: Any) -> Any:
    """Return ``theta / sin(theta/2)`` from a quaternion with non-negative scalar part.

    Args:
        sine_squared: squared norm of the vector part.
        cosine: scalar part, >= 0. A common factor of both parts of the quaternion drops out of ``theta``.
    """
    near = sine_squared <= ATAN_SEAM * cosine**2
    cosine_near = ca.if_else(near, cosine, 1.0)
    u = ca.if_else(near, sine_squared, 0.0) / cosine_near**2
    sine = ca.sqrt(ca.if_else(near, 1.0, sine_squared))
    return ca.if_else(near, 2.0 * _horner(_ATAN_SERIES, u) / cosine_near, 2.0 * ca.atan2(sine, cosine) / sine)
