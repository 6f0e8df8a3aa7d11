"""Unit quaternions, x y z w: the double cover of SO(3).

``q`` and ``-q`` are the same rotation. A quaternion computed from a rotation matrix is the *canonical* one of the two:
scalar part positive or, at exactly half a turn where it is 0, first non-zero entry positive. Arrays are (..., 4),
single or batched; every function validates its arguments (InputError), ``f.unchecked`` does not.
"""

import math
from typing import Any

import numpy as np

from lgmpc.lie import checks
from lgmpc.lie.checks import checked
from lgmpc.lie.coefficients import Array, cosine, sinc
from lgmpc.lie.components import Entries, matrix, norm, parts, quaternion_product, quaternion_rows, rows, vector

_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def identity() -> Array:
    """Return the unit quaternion (0, 0, 0, 1)."""
    return np.array([0.0, 0.0, 0.0, 1.0])


@checked(checks.quaternion, checks.quaternion)
def compose(first: Array, second: Array) -> Array:
    """Return the product: rotate by ``second``, then by ``first``."""
    return vector(quaternion_product(parts(first), parts(second)))


@checked(checks.quaternion)
def inverse(q: Array) -> Array:
    """Return the conjugate, the inverse of a unit quaternion."""
    return q * _CONJUGATE


@checked(checks.quaternion, checks.tangent(3))
def act(q: Array, point: Array) -> Array:
    """Return the rotated 3-vectors (..., 3)."""
    x, y, z, w = parts(q)
    a, b, c = parts(point)
    u, v, s = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return vector((a + w * u + y * s - z * v, b + w * v + z * u - x * s, c + w * s + x * v - y * u))


@checked(checks.quaternion)
def canonical(q: Array) -> Array:
    """Return the one of ``q`` and ``-q`` whose scalar part is positive or, if 0, whose first non-zero entry is."""
    return vector(_canonical(parts(q)))


@checked(checks.tangent(3))
def exp(phi: Array) -> Array:
    """Return the quaternion of rotation vectors (..., 3), rad; continuous, so of either sign beyond pi."""
    x, y, z = parts(phi)
    half = 0.5 * norm(x, y, z)
    ratio = 0.5 * sinc(half)
    return vector((ratio * x, ratio * y, ratio * z, cosine(half)))


@checked(checks.quaternion)
def log(q: Array) -> Array:
    """Return rotation vectors (..., 3) of norm at most pi; ``q`` and ``-q`` give the same, bit for bit.

    At exactly half a turn (scalar part 0) the two vectors +-pi u are equally near: the one with positive first non-zero
    entry is returned.
    """
    return vector(_log(parts(q)))


@checked(checks.quaternion)
def to_matrix(q: Array) -> Array:
    """Return rotation matrices (..., 3, 3)."""
    return matrix(quaternion_rows(parts(q)), 3)


@checked(checks.rotation)
def from_matrix(rotation: Array) -> Array:
    """Return the canonical quaternion of rotation matrices (..., 3, 3).

    The columns of ``4 q q^T`` are linear in the matrix; the longest, of norm 2 or more, is normalised (Bar-Itzhack's
    matrix, with the choice of column Shepperd made, "Quaternion from rotation matrix", J. Guidance and Control 1978).
    """
    return vector(_from_rows(rows(rotation)))


def _canonical(q: Entries) -> Entries:
    x, y, z, w = q
    if isinstance(w, float):
        leading = w or x or y or z
        return (-x, -y, -z, -w) if leading < 0.0 else q
    leading = np.where(w != 0.0, w, np.where(x != 0.0, x, np.where(y != 0.0, y, z)))
    sign = np.where(leading < 0.0, -1.0, 1.0)
    return sign * x, sign * y, sign * z, sign * w


def _log(q: Entries) -> Entries:
    x, y, z, w = _canonical(q)
    sine = norm(x, y, z)
    ratio: Any
    if isinstance(sine, float):
        ratio = 2.0 * math.atan2(sine, w) / sine if sine else 2.0
    else:
        zero = sine == 0.0
        ratio = np.where(zero, 2.0, 2.0 * np.arctan2(sine, w) / np.where(zero, 1.0, sine))
    return ratio * x, ratio * y, ratio * z


def _from_rows(r: Entries) -> Entries:
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    xx, yy = 1.0 + r00 - r11 - r22, 1.0 - r00 + r11 - r22
    zz, ww = 1.0 - r00 - r11 + r22, 1.0 + r00 + r11 + r22
    xy, xz, yz = r01 + r10, r02 + r20, r12 + r21
    xw, yw, zw = r21 - r12, r02 - r20, r10 - r01
    columns = ((xx, xy, xz, xw), (xy, yy, yz, yw), (xz, yz, zz, zw), (xw, yw, zw, ww))
    if isinstance(ww, float):
        x, y, z, w = columns[max(range(4), key=(xx, yy, zz, ww).__getitem__)]
        length = math.sqrt(x * x + y * y + z * z + w * w)
        return _canonical((x / length, y / length, z / length, w / length))
    longest = np.argmax(np.stack((xx, yy, zz, ww)), axis=0)
    x, y, z, w = (np.choose(longest, [column[i] for column in columns]) for i in range(4))
    length = np.sqrt(x * x + y * y + z * z + w * w)
    return _canonical((x / length, y / length, z / length, w / length))
