"""Validation of arguments: positive numbers, physically possible inertias; read-only copies."""

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.typing import Array, numbers

_TOLERANCE = 1e-9


def check_positive(name: str, value: object, unit: str) -> float:
    """Return a positive, finite number.

    Raises:
        InputError: not one positive, finite number.
    """
    array = checks.finite(name, value)
    if array.ndim or not array > 0.0:
        raise InputError(name, value, f"a positive number, {unit}")
    return float(array)


def check_inertia(name: str, value: object) -> Array:
    """Return a rotational inertia (3, 3), kg.m^2.

    Raises:
        InputError: wrong shape, not finite, not symmetric, not positive definite, or a principal moment above the sum
            of the other two, which no mass distribution has.
    """
    array = numbers(name, value, (3, 3), finite=True)
    skew = float(np.abs(array - array.T).max())
    if skew > _TOLERANCE * float(np.abs(array).max()):
        raise InputError(name, f"a matrix A with |A - A^T| = {skew:.3g}", "a symmetric matrix")
    low, middle, high = np.linalg.eigvalsh(array).tolist()
    listed = f"{low:.6g}, {middle:.6g}, {high:.6g}"
    if not low > 0.0:
        raise InputError(name, f"eigenvalues {listed}", "a positive definite matrix")
    if high > (low + middle) * (1.0 + _TOLERANCE):
        got = f"principal moments {listed}"
        raise InputError(name, got, "no moment above the sum of the other two (triangle inequality)")
    return array


def frozen(value: ArrayLike) -> Array:
    """Return a read-only copy, which does not follow later changes of the caller's array."""
    array: Array = np.array(value, dtype=np.float64)
    array.setflags(write=False)
    return array
