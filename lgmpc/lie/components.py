"""Splitting and joining of entries: floats for a single element, arrays over the batch otherwise.

numpy's overhead on 3-vectors is a hundred times the arithmetic, so a single element is computed in Python floats and
becomes an array only at the end.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lgmpc.lie.coefficients import Array

Entries = Sequence[Any]
"""Floats, or arrays (and floats) that broadcast to the batch shape."""


def parts(array: Array) -> Entries:
    """Split the last axis: floats of a single vector, arrays of a batch."""
    if array.ndim == 1:
        return array.tolist()
    return [array[..., i] for i in range(array.shape[-1])]


def rows(array: Array) -> Entries:
    """Split the last two axes, row by row: 9 entries for a (3, 3) matrix or a batch of them."""
    if array.ndim == 2:
        return [entry for row in array.tolist() for entry in row]
    return [array[..., i, j] for i in range(array.shape[-2]) for j in range(array.shape[-1])]


def vector(entries: Entries) -> Array:
    """Stack entries along a new last axis; the first must be a float if, and only if, all are."""
    if isinstance(entries[0], float):
        return np.array(entries, dtype=np.float64)
    batch = np.broadcast_shapes(*(np.shape(entry) for entry in entries))
    result = np.empty((*batch, len(entries)))
    for index, entry in enumerate(entries):
        result[..., index] = entry
    return result


def matrix(entries: Entries, size: int) -> Array:
    """Stack ``size * size`` entries, row by row, into square matrices; same rule for the first entry."""
    flat = vector(entries)
    return flat.reshape(*flat.shape[:-1], size, size)


def norm(x: Any, y: Any, z: Any) -> Any:
    """Return the Euclidean norm."""
    square = x * x + y * y + z * z
    return math.sqrt(square) if isinstance(square, float) else np.sqrt(square)


def quaternion_product(first: Entries, second: Entries) -> tuple[Any, Any, Any, Any]:
    """Return the entries (x, y, z, w) of the product of two quaternions, also of CasADi expressions."""
    x, y, z, w = first
    a, b, c, d = second
    return (
        w * a + d * x + y * c - z * b,
        w * b + d * y + z * a - x * c,
        w * c + d * z + x * b - y * a,
        w * d - x * a - y * b - z * c,
    )


def quaternion_rows(q: Entries) -> Entries:
    """Return the 9 entries of the rotation matrix of a unit quaternion, row by row."""
    x, y, z, w = q
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    xw, yw, zw = 2.0 * x * w, 2.0 * y * w, 2.0 * z * w
    return 1.0 - yy - zz, xy - zw, xz + yw, xy + zw, 1.0 - xx - zz, yz - xw, xz - yw, yz + xw, 1.0 - xx - yy
