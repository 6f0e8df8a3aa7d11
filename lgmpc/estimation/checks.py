"""Validation of the estimators' input, beyond that of the groups."""

from __future__ import annotations

import math

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.typing import Array

__all__ = ["duration_of", "three"]

_THREE = checks.tangent(3)


def three(name: str, value: object) -> Array:
    """Return one 3-vector of finite numbers.

    Raises:
        InputError: wrong shape, not finite, or not positive.
    """
    vector = _THREE(name, value)
    if vector.ndim != 1:
        raise InputError(name, f"shape {vector.shape}", "shape (3,)")
    return vector


def duration_of(name: str, value: float) -> float:
    """Return a positive number of seconds.

    Raises:
        InputError: wrong shape, not finite, or not positive.
    """
    if not 0.0 < value < math.inf:
        raise InputError(name, value, "a positive number of seconds")
    return float(value)
