r"""Scalar coefficients, functions of the rotation angle, of the exponentials, logarithms and Jacobians.

With ``Phi = hat(phi)``, ``theta = |phi|`` and ``Phi^3 = -theta^2 Phi``, every power series in ``Phi`` is
``f0 I + f1 Phi + f2 Phi^2`` with even functions of ``theta``::

    exp(Phi)         = I + a Phi + b Phi^2      a = sin(theta) / theta          b = (1 - cos(theta)) / theta^2
    J_left           = I + b Phi + c Phi^2      c = (theta - sin(theta)) / theta^3
    J_left^{-1}      = I - Phi/2 + d Phi^2      d = (1 - (theta/2) cot(theta/2)) / theta^2
    D J_left         needs  beta = b'/theta = (a - 2 b) / theta^2,  gamma = c'/theta = (b - 3 c) / theta^2
    D J_left^{-1}    needs  delta = d'/theta
    Gamma_2          = I/2 + c Phi + e Phi^2    e = (1/2 - b) / theta^2         double integral of exp

The closed forms cancel digits where ``theta`` is small. Up to ``theta^2 = SEAM`` (just beyond pi^2, so that
nothing switches inside the injectivity radius) they are therefore evaluated as series: all but ``d, delta`` as Taylor
series, whose terms at pi exceed the sum at most fourfold; ``d, delta`` by the expansion of the cotangent in its poles,

    d = 2 / (4 pi^2 - t) + sum_k r_k t^k,    r_k = 2 (zeta(2k+2) - 1) / (2 pi)^(2k+2),    t = theta^2,

all of whose terms are positive. All are accurate to 1e-14, relative, from 1e-12 to pi.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scalar = TypeVar("Scalar", float, Array)

SEAM = 10.0
"""Squared angle, rad^2, up to which the series are used."""

_FOUR_PI_SQUARED = 4.0 * math.pi**2
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


_A = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 1)))
_B = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 2)))
_C = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 3)))
_BETA = _alternating(lambda k: Fraction(-2 * (k + 1), math.factorial(2 * k + 4)))
_GAMMA = _alternating(lambda k: Fraction(-2 * (k + 1), math.factorial(2 * k + 5)))
_E = _alternating(lambda k: Fraction(1, math.factorial(2 * k + 4)))
_D = _pole_remainder()
_DELTA = tuple(2.0 * k * r for k, r in enumerate(_D))[1:]


def horner(series: Sequence[float], t: Any) -> Any:
    """Evaluate ``sum_k series[k] t^k``."""
    value = series[-1]
    for coefficient in series[-2::-1]:
        value = value * t + coefficient
    return value


class Coefficient:
    """An even function of the angle: a series in ``t = theta^2`` up to the seam, a closed form beyond.

    Args:
        series: of ``t``.
        closed: of the module of the sines (numpy or CasADi), ``theta`` and ``t``.
    """

    def __init__(self, series: Callable[[Any], Any], closed: Callable[[Any, Any, Any], Any]) -> None:
        self._series, self._closed = series, closed

    def __call__(self, theta: Scalar) -> Scalar:
        """Evaluate at angles, each formula only within its domain; NaN where an angle is infinite."""
        t = theta * theta
        if isinstance(theta, float):
            if t <= SEAM:
                return cast(float, self._series(t))
            return float(self._closed(np, theta, t)) if t < math.inf else math.nan
        beyond = t > SEAM
        if not beyond.any():
            return cast(Array, self._series(t))
        far = np.where(beyond, np.where(t < math.inf, theta, math.nan), 4.0)
        closed, series = self._closed(np, far, far * far), self._series(np.where(beyond, SEAM, t))
        return cast(Array, np.where(beyond, closed, series))

    def symbolic(self, t: Any) -> Any:
        """Return the CasADi expression in the squared angle.

        It has no square root below the seam, so that derivatives of any order are exact at 0. The argument of each
        branch stays within that branch's domain, because ``if_else`` differentiates both.
        """
        import casadi as ca

        near = t <= SEAM
        far = ca.if_else(near, 16.0, t)
        return ca.if_else(near, self._series(ca.if_else(near, t, 0.0)), self._closed(ca, ca.sqrt(far), far))


a = Coefficient(lambda t: horner(_A, t), lambda m, u, t: m.sin(u) / u)
b = Coefficient(lambda t: horner(_B, t), lambda m, u, t: (1.0 - m.cos(u)) / t)
c = Coefficient(lambda t: horner(_C, t), lambda m, u, t: (u - m.sin(u)) / (u * t))
beta = Coefficient(lambda t: horner(_BETA, t), lambda m, u, t: (u * m.sin(u) + 2.0 * m.cos(u) - 2.0) / (t * t))
gamma = Coefficient(
    lambda t: horner(_GAMMA, t), lambda m, u, t: (3.0 * m.sin(u) - u * m.cos(u) - 2.0 * u) / (u * (t * t))
)
d = Coefficient(
    lambda t: 2.0 / (_FOUR_PI_SQUARED - t) + horner(_D, t), lambda m, u, t: (1.0 - 0.5 * u / m.tan(0.5 * u)) / t
)
"""The inverse of the left Jacobian has poles at the angles 2 pi k, k > 0."""


def _delta_beyond(m: Any, u: Any, t: Any) -> Any:
    sine = m.sin(0.5 * u)
    return (0.25 / (sine * sine) + 0.5 / (u * m.tan(0.5 * u)) - 2.0 / t) / t


def _delta_near(t: Any) -> Any:
    gap = _FOUR_PI_SQUARED - t
    return 4.0 / (gap * gap) + horner(_DELTA, t)


delta = Coefficient(_delta_near, _delta_beyond)
e = Coefficient(lambda t: horner(_E, t), lambda m, u, t: (0.5 * t + m.cos(u) - 1.0) / (t * t))


def sinc(theta: Scalar) -> Scalar:
    """Return ``sin(theta) / theta``, 1 at 0 and NaN at infinity; as accurate as the sine."""
    if isinstance(theta, float):
        if not math.isfinite(theta):
            return math.nan
        return math.sin(theta) / theta if theta else 1.0
    zero = theta == 0.0
    with np.errstate(invalid="ignore"):
        return np.where(zero, 1.0, np.sin(theta) / np.where(zero, 1.0, theta))


def cosine(theta: Scalar) -> Scalar:
    """Return ``cos(theta)``, NaN at infinity."""
    if isinstance(theta, float):
        return math.cos(theta) if math.isfinite(theta) else math.nan
    with np.errstate(invalid="ignore"):
        return np.cos(theta)


def a_b(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``a`` and ``b`` from sines, which are as accurate: the exponential."""
    half = sinc(0.5 * theta)
    return sinc(theta), 0.5 * half * half


def b_c(theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return ``b`` and ``c``: the left Jacobian."""
    half = sinc(0.5 * theta)
    return 0.5 * half * half, c(theta)
