r"""Scalar coefficients, functions of the rotation angle, of the exponentials, logarithms and Jacobians.

With ``Phi = hat(phi)``, ``theta = |phi|`` and ``Phi^3 = -theta^2 Phi``, every power series in ``Phi`` is
``f0 I + f1 Phi + f2 Phi^2`` with even functions of ``theta``::

    exp(Phi)         = I + a Phi + b Phi^2      a = sin(theta) / theta          b = (1 - cos(theta)) / theta^2
    J_left           = I + b Phi + c Phi^2      c = (theta - sin(theta)) / theta^3
    J_left^{-1}      = I - Phi/2 + d Phi^2      d = (1 - (theta/2) cot(theta/2)) / theta^2
    D J_left         needs  beta = b'/theta = (a - 2 b) / theta^2,  gamma = c'/theta = (b - 3 c) / theta^2
    D J_left^{-1}    needs  delta = d'/theta
    Gamma_2          = I/2 + c Phi + e Phi^2    e = (1/2 - b) / theta^2         double integral of exp
    D Gamma_2        needs  gamma and epsilon = e'/theta = (c - 4 e) / theta^2

The closed forms cancel digits where ``theta`` is small. Up to ``theta^2 = SEAM`` (just beyond pi^2, so that
nothing switches inside the injectivity radius) they are therefore evaluated as series: all but ``d, delta`` as Taylor
series, whose terms at pi exceed the sum at most fourfold; ``d, delta`` by the expansion of the cotangent in its poles,

    d = 2 / (4 pi^2 - t) + sum_k r_k t^k,    r_k = 2 (zeta(2k+2) - 1) / (2 pi)^(2k+2),    t = theta^2,

all of whose terms are positive. All are accurate to 1e-14, relative, from 1e-12 to pi.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "SEAM",
    "Array",
    "Scalar",
    "a_b",
    "b_c",
    "beta_gamma",
    "d_only",
    "delta_only",
    "e_epsilon",
    "horner",
    "sinc",
]

Array = NDArray[np.float64]
Scalar = TypeVar("Scalar", float, Array)

SEAM = 10.0
"""Squared angle, rad^2, up to which the series are used."""

FOUR_PI_SQUARED = 4.0 * math.pi**2

_TERMS = 16


def _alternating(term: Callable[[int], Fraction]) -> tuple[float, ...]:
    return tuple(float(-term(k) if k % 2 else term(k)) for k in range(_TERMS))


def _bernoulli(count: int) -> list[Fraction]:
    """The Bernoulli numbers B_0 .. B_{count-1}, by their defining recurrence."""
    numbers = [Fraction(1)]
    for m in range(1, count):
        numbers.append(-sum((math.comb(m, k) * b / (m - k + 1) for k, b in enumerate(numbers)), Fraction(0)))
    return numbers


def _pole_remainder() -> tuple[float, ...]:
    """r_k of the module docstring, from zeta(m) = |B_m| (2 pi)^m / (2 m!) for even m = 2k + 2."""
    bernoulli = _bernoulli(2 * _TERMS + 1)
    return tuple(
        float(abs(bernoulli[m]) / math.factorial(m)) - 2.0 / (2.0 * math.pi) ** m for m in range(2, 2 * _TERMS + 1, 2)
    )


A_SERIES = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 1)))
B_SERIES = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 2)))
C_SERIES = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 3)))
BETA_SERIES = _alternating(lambda k: Fraction(-2 * (k + 1), math.factorial(2 * k + 4)))
GAMMA_SERIES = _alternating(lambda k: Fraction(-2 * (k + 1), math.factorial(2 * k + 5)))
E_SERIES = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 4)))
EPSILON_SERIES = _alternating(lambda k: Fraction(-2 * (k + 1), math.factorial(2 * k + 6)))
D_REMAINDER = _pole_remainder()
DELTA_REMAINDER = tuple(2.0 * k * r for k, r in enumerate(D_REMAINDER))[1:]


def horner(series: Sequence[float], t: Scalar) -> Scalar:
    """Evaluate ``sum_k series[k] t^k``."""
    value = series[-1] * t
    for coefficient in series[-2:0:-1]:
        value = (value + coefficient) * t
    return value + series[0]


def _below_seam(theta: Scalar, series: Callable[[Scalar], Scalar], closed: Callable[[Scalar, Scalar], Any]) -> Scalar:
    """Evaluate ``series(t)`` up to the seam and ``closed(theta, t)`` beyond it, each only within its domain."""
    t = theta * theta
    if isinstance(theta, float):
        return series(t) if t <= SEAM else float(closed(theta, t))
    beyond = t > SEAM
    if not beyond.any():
        return series(t)
    far = np.where(beyond, theta, 4.0)
    return np.where(beyond, closed(far, far * far), series(np.where(beyond, SEAM, t)))


def sinc(theta: Scalar) -> Scalar:
    """Return ``sin(theta) / theta``, 1 at 0; as accurate as the sine."""
    if isinstance(theta, float):
        return math.sin(theta) / theta if theta else 1.0
    zero = theta == 0.0
    return np.where(zero, 1.0, np.sin(theta) / np.where(zero, 1.0, theta))


def a_b(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``a`` and ``b``: the exponential."""
    half = sinc(0.5 * theta)
    return sinc(theta), 0.5 * half * half


def b_c(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``b`` and ``c``: the left Jacobian."""
    half = sinc(0.5 * theta)
    return 0.5 * half * half, _below_seam(theta, lambda t: horner(C_SERIES, t), lambda u, t: (u - np.sin(u)) / (u * t))


def beta_gamma(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``beta = b'/theta`` and ``gamma = c'/theta``: the derivative of the left Jacobian."""
    beta = _below_seam(
        theta,
        lambda t: horner(BETA_SERIES, t),
        lambda u, t: (u * np.sin(u) + 2.0 * np.cos(u) - 2.0) / (t * t),
    )
    gamma = _below_seam(
        theta,
        lambda t: horner(GAMMA_SERIES, t),
        lambda u, t: (3.0 * np.sin(u) - u * np.cos(u) - 2.0 * u) / (u * t * t),
    )
    return beta, gamma


def d_only(theta: Scalar) -> Scalar:
    """Return ``d``: the inverse of the left Jacobian. Its poles are the angles 2 pi k, k > 0."""
    return _below_seam(
        theta,
        lambda t: 2.0 / (FOUR_PI_SQUARED - t) + horner(D_REMAINDER, t),
        lambda u, t: (1.0 - 0.5 * u / np.tan(0.5 * u)) / t,
    )


def delta_only(theta: Scalar) -> Scalar:
    """Return ``delta = d'/theta``: the derivative of the inverse of the left Jacobian."""

    def series(t: Scalar) -> Scalar:
        gap = FOUR_PI_SQUARED - t
        return 4.0 / (gap * gap) + horner(DELTA_REMAINDER, t)

    def closed(u: Scalar, t: Scalar) -> Any:
        tangent, sine = np.tan(0.5 * u), np.sin(0.5 * u)
        return (0.25 / (sine * sine) + 0.5 / (u * tangent) - 2.0 / t) / t

    return _below_seam(theta, series, closed)


def e_epsilon(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``e`` and ``epsilon = e'/theta``: the second integral of the exponential, and its derivative."""
    e = _below_seam(theta, lambda t: horner(E_SERIES, t), lambda u, t: (0.5 * t + np.cos(u) - 1.0) / (t * t))
    epsilon = _below_seam(
        theta,
        lambda t: horner(EPSILON_SERIES, t),
        lambda u, t: (4.0 - t - u * np.sin(u) - 4.0 * np.cos(u)) / (t * t * t),
    )
    return e, epsilon
