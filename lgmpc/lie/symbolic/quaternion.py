""":mod:`lgmpc.lie.quaternion` on CasADi expressions: unit quaternions, x y z w, as columns (SX, MX or DM)."""

from typing import Any

import casadi as ca

from lgmpc.lie.coefficients import a, b, horner

ATAN_SEAM = 0.04
"""Squared tangent of half the angle below which the logarithm uses the series of the arctangent."""

_ATAN_SERIES = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


def compose(q0: Any, q1: Any) -> Any:
    """Return the product ``q0 q1``."""
    u, w = q0[:3], q0[3]
    v, s = q1[:3], q1[3]
    return ca.vertcat(w * v + s * u + ca.cross(u, v), w * s - ca.dot(u, v))


def inverse(q: Any) -> Any:
    """Return the conjugate, the inverse of a unit quaternion."""
    return ca.vertcat(-q[:3], q[3])


def act(q: Any, point: Any) -> Any:
    """Return the rotated 3-vector."""
    twice = 2.0 * ca.cross(q[:3], point)
    return point + q[3] * twice + ca.cross(q[:3], twice)


def canonical(q: Any) -> Any:
    """Return the one of ``q`` and ``-q`` whose scalar part is positive or, if 0, whose first non-zero entry is."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    sign = ca.if_else(w != 0, w, ca.if_else(x != 0, x, ca.if_else(y != 0, y, z)))
    return ca.if_else(sign < 0, -q, q)


def exp(phi: Any) -> Any:
    """Return the quaternion of a rotation vector (3), rad."""
    t = ca.dot(phi, phi)
    half_sinc, half_cosine = 0.5 * a.symbolic(0.25 * t), 1.0 - 0.25 * t * b.symbolic(0.25 * t)
    return ca.vertcat(half_sinc * phi, half_cosine)


def log(q: Any) -> Any:
    """Return the rotation vector (3) of norm at most pi; ``q`` and ``-q`` give the same."""
    positive = canonical(q)
    vector = positive[:3]
    return half_angle_ratio(ca.dot(vector, vector), positive[3]) * vector


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
    return ca.if_else(near, 2.0 * horner(_ATAN_SERIES, u) / cosine_near, 2.0 * ca.atan2(sine, cosine) / sine)


def to_matrix(q: Any) -> Any:
    """Return the rotation matrix (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    return ca.vertcat(
        ca.horzcat(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        ca.horzcat(2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        ca.horzcat(2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(rotation: Any) -> Any:
    """Return the canonical quaternion of a rotation matrix.

    The columns of ``4 q q^T`` are linear in the matrix; the one with the largest diagonal entry has norm 2 at least, so
    that normalising it is safe, and smooth, everywhere.
    """
    r = rotation
    xx = 1.0 + r[0, 0] - r[1, 1] - r[2, 2]
    yy = 1.0 - r[0, 0] + r[1, 1] - r[2, 2]
    zz = 1.0 - r[0, 0] - r[1, 1] + r[2, 2]
    ww = 1.0 + r[0, 0] + r[1, 1] + r[2, 2]
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    xw, yw, zw = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    best, column = ww, ca.vertcat(xw, yw, zw, ww)
    for diagonal, candidate in (
        (xx, ca.vertcat(xx, xy, xz, xw)),
        (yy, ca.vertcat(xy, yy, yz, yw)),
        (zz, ca.vertcat(xz, yz, zz, zw)),
    ):
        larger = diagonal > best
        best, column = ca.if_else(larger, diagonal, best), ca.if_else(larger, candidate, column)
    return canonical(column / ca.norm_2(column))
