"""The scalar coefficients against 150-digit decimals, as numpy floats, numpy arrays and CasADi expressions."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import casadi as ca
import numpy as np
import pytest

from lgmpc.lie import coefficients, quaternion as numeric_quaternion, se3, sek3, so3
from lgmpc.lie.symbolic import quaternion

ANGLES = sorted(
    {
        *np.geomspace(1e-12, math.pi, 60).tolist(),
        *(math.pi - 10.0**-k for k in range(1, 16, 2)),
        *np.linspace(0.1, math.pi, 40).tolist(),
        1e-8,
        1.0,
    }
)
BEYOND_PI = [math.sqrt(coefficients.SEAM) - 1e-12, math.sqrt(coefficients.SEAM) + 1e-12, 3.5, 5.0, 6.2, 20.0]


def decimal_sin_cos(x: Decimal) -> tuple[Decimal, Decimal]:
    sine, cosine, term, k = Decimal(0), Decimal(0), Decimal(1), 0
    while abs(term) > Decimal(10) ** -160:
        if k % 2:
            sine += term if k % 4 == 1 else -term
        else:
            cosine += term if k % 4 == 0 else -term
        k += 1
        term = term * x / k
    return sine, cosine


def reference(angle: float) -> dict[str, float]:
    """The closed forms in 150 digits, enough for their cancellation."""
    with localcontext() as context:
        context.prec = 150
        x = Decimal(angle)
        sine, cosine = decimal_sin_cos(x)
        half_sine, half_cosine = decimal_sin_cos(x / 2)
        cotangent = half_cosine / half_sine
        a, b, c = sine / x, (1 - cosine) / x**2, (x - sine) / x**3
        d = (1 - x / 2 * cotangent) / x**2
        d_slope = -(cotangent / 2 - x / 4 / half_sine**2) / x**2 - 2 * (1 - x / 2 * cotangent) / x**3
        exact = {"a": a, "b": b, "c": c, "beta": (a - 2 * b) / x**2, "gamma": (b - 3 * c) / x**2, "d": d}
        exact |= {"e": (Decimal("0.5") - b) / x**2}
        return {name: float(value) for name, value in {**exact, "delta": d_slope / x}.items()}


def numeric(angle: float | np.ndarray) -> dict[str, float | np.ndarray]:
    a, b = coefficients.a_b(angle)
    b_again, c = coefficients.b_c(angle)
    assert np.array_equal(b, b_again, equal_nan=True)
    others = {name: getattr(coefficients, name)(angle) for name in ("beta", "gamma", "d", "delta", "e")}
    return {"a": a, "b": b, "c": c} | others


@pytest.mark.parametrize("angle", [*ANGLES, *BEYOND_PI])
def test_coefficients_are_accurate_to_1e_14_relative(angle: float) -> None:
    exact, single = reference(angle), numeric(angle)
    batch = numeric(np.array([angle, 0.3]))
    for name, value in exact.items():
        # Beyond pi, b vanishes at 2 pi k and its relative error with it; the error is that of the angle's rounding.
        tolerance = 1e-14 if angle <= math.pi else 1e-13
        assert abs(single[name] / value - 1.0) < tolerance, name
        assert abs(batch[name][0] / value - 1.0) < tolerance, name


def test_coefficients_at_zero_are_the_limits() -> None:
    limits = {"a": 1.0, "b": 1 / 2, "c": 1 / 6, "beta": -1 / 12, "gamma": -1 / 60, "d": 1 / 12, "delta": 1 / 360}
    limits |= {"e": 1 / 24}
    for angle in (0.0, 5e-324, 1e-200):
        for name, value in numeric(angle).items():
            assert value == pytest.approx(limits[name], rel=3e-16), name


def test_a_batch_on_both_sides_of_the_seam() -> None:
    angles = np.array([0.0, 1e-9, 3.0, 3.2, 5.0])
    for name, values in numeric(angles).items():
        for angle, value in zip(angles.tolist(), values, strict=True):
            assert value == pytest.approx(numeric(angle)[name], rel=1e-15), name


@pytest.mark.parametrize("angle", [math.inf, -math.inf, math.nan])
def test_coefficients_of_angles_that_are_no_numbers_are_nan(angle: float) -> None:
    for values in (numeric(angle), numeric(np.array([angle, 0.3]))):
        for name, value in values.items():
            assert np.isnan(value if isinstance(value, float) else value[0]), name
    phi = np.array([angle, 0.0, 0.0])
    for group, vector in ((so3, phi), (se3, np.r_[phi, phi]), (sek3, np.r_[phi, phi, phi])):
        for name in ("exp", "left_jacobian", "right_jacobian_inverse"):
            function = getattr(group, name).unchecked
            with np.errstate(invalid="ignore"):
                assert np.isnan(function(vector)).any() and np.isnan(function(np.stack([vector, vector]))).any()
    assert np.isnan(numeric_quaternion.exp.unchecked(phi)).any()


def test_symbolic_coefficients_equal_the_decimals() -> None:
    t = ca.SX.sym("t")
    for name in ("a", "b", "c", "beta", "gamma", "d", "delta", "e"):
        function = ca.Function(name, [t], [getattr(coefficients, name).symbolic(t)])
        for angle in [*ANGLES, *BEYOND_PI]:
            exact = reference(angle)[name]
            # As a function of the squared angle, a = sin(theta)/theta has no relative accuracy at pi, only absolute.
            assert float(function(angle**2)) == pytest.approx(exact, rel=1e-14, abs=5e-15 if name == "a" else 0.0)


def test_symbolic_derivatives_at_zero_are_the_taylor_coefficients() -> None:
    t = ca.SX.sym("t")
    taylor = {
        "a": (1.0, -1 / 6, 1 / 60),
        "b": (1 / 2, -1 / 24, 1 / 360),
        "c": (1 / 6, -1 / 120, 1 / 2520),
        "beta": (-1 / 12, 1 / 180, -1 / 3360),
        "gamma": (-1 / 60, 1 / 1260, -1 / 30240),
        "d": (1 / 12, 1 / 720, 1 / 15120),
        "delta": (1 / 360, 1 / 7560, 1 / 100800),
        "e": (1 / 24, -1 / 720, 1 / 20160),
    }
    for name, expected in taylor.items():
        value = getattr(coefficients, name).symbolic(t)
        first = ca.jacobian(value, t)
        function = ca.Function(name, [t], [value, first, ca.jacobian(first, t)])
        assert [float(out) for out in function(0.0)] == pytest.approx(expected, rel=1e-14), name


def test_the_arctangent_series_meets_the_arctangent() -> None:
    s, w = ca.SX.sym("s"), ca.SX.sym("w")
    function = ca.Function("f", [s, w], [quaternion.half_angle_ratio(s, w)])
    for half in (1e-12, 1e-6, 0.1, math.atan(0.2) - 1e-9, math.atan(0.2) + 1e-9, 0.7, math.pi / 2):
        expected = 2 * half / math.sin(half)
        assert float(function(math.sin(half) ** 2, math.cos(half))) == pytest.approx(expected, rel=1e-15)
