""":mod:`lgmpc.lie.quaternion` on CasADi expressions: unit quaternions, x y z w, as columns (SX, MX or DM)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.lie.symbolic import coefficients

__all__ = ["act", "canonical", "compose", "exp", "from_matrix", "inverse", "log", "to_matrix"]


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
    return ca.vertcat(coefficients.half_sinc(t) * phi, coefficients.half_cosine(t))


def log(q: Any) -> Any:
    """Return the rotation vector (3) of norm at most pi; ``q`` and ``-q`` give the same."""
    positive = canonical(q)
    vector = positive[:3]
    return coefficients.half_angle_ratio(ca.dot(vector, vector), positive[3]) * vector


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
