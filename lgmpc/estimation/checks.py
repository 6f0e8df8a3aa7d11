"""Validation of the estimators' input, beyond that of the groups, and checked copies into their memory."""

import math

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array


def duration_of(name: str, value: object) -> float:
    """Return a positive number of seconds.

    Raises:
        InputError: wrong shape, not finite, or not positive.
    """
    return number(name, value, "a positive number of seconds", above=0.0)


def number(
    name: str, value: object, expected: str, least: float = -math.inf, *, above: float = -math.inf, finite: bool = True
) -> float:
    """Return one number.

    Args:
        name: name of the argument.
        value: the argument.
        expected: the values accepted, in words.
        least: lowest value.
        above: highest value that is too low.
        finite: whether it must be finite; NaN is refused in any case.

    Raises:
        InputError: no number, or one that is not accepted.
    """
    if isinstance(value, (int, float, np.integer, np.floating)):
        given = float(value)
        if given >= least and (given > above or above == -math.inf) and (math.isfinite(given) or not finite):
            return given
    raise InputError(name, value, expected)


def whole(name: str, value: object, expected: str, least: int = 0, below: float = math.inf) -> int:
    """Return a whole number from ``least`` to ``below``, exclusive; arguments and errors as of :func:`number`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool) and least <= value < below:
        return int(value)
    raise InputError(name, value, expected)


def index_of(name: str, index: int, count: int) -> None:
    """Check an index from 0 to ``count - 1``."""
    whole(name, index, f"a number from 0 to {count - 1}" if count else "a filter with at least one", 0, count)


def write(name: str, value: Array, buffer: Array) -> None:
    """Copy a finite array into a buffer of its shape; called at every tick."""
    if np.shape(value) != buffer.shape:
        raise InputError(name, f"shape {np.shape(value)}", f"shape {buffer.shape}")
    if not math.isfinite(np.add.reduce(value, axis=None)):
        raise InputError(name, value, "finite numbers")
    buffer[...] = value


def read_only(array: Array) -> Array:
    """Return a view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view
