"""Validation of the arguments of the groups' public functions.

A function decorated with :func:`checked` validates and converts its arguments; its attribute ``unchecked`` is the
undecorated function, for hot loops on float64 arrays that are known to be valid.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar, cast

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie.coefficients import Array
from lgmpc.lie.components import rows
from lgmpc.typing import brief

P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)
Check = Callable[[str, object], Array]

TOLERANCE = 1e-6
"""Tolerance on the orthonormality of rotations, the norm of quaternions and the constants of bottom rows."""

LARGEST = 1e100
"""Entries of this size or larger are rejected like non-finite ones: their squares would overflow."""


class Checked(Protocol[P, R_co]):
    """A function that validates its arguments."""

    @property
    def unchecked(self) -> Callable[P, R_co]:
        """The function without validation."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R_co:
        """Validate, then evaluate; raises InputError naming the argument."""


ArrayFunction = Checked[..., Array]


def checked(*checks: Check) -> Callable[[Callable[P, R]], Checked[P, R]]:
    """Validate the positional arguments of a function, one check each, before it runs."""

    def decorate(function: Callable[P, R]) -> Checked[P, R]:
        signature = inspect.signature(function)
        names = tuple(signature.parameters)

        @functools.wraps(function)
        def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
            given = signature.bind(*args, **kwargs).args if kwargs or len(args) != len(checks) else args
            arrays = [check(name, value) for check, name, value in zip(checks, names, given, strict=True)]
            try:
                return cast(Callable[..., R], function)(*arrays)
            except ValueError as error:
                if isinstance(error, InputError):
                    raise
                shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True))
                raise InputError(function.__name__, shapes, "shapes that broadcast to one batch") from error

        result = cast(Any, wrapper)
        result.unchecked = function
        return cast(Checked[P, R], result)

    return decorate


def finite(name: str, value: object) -> Array:
    """Convert to a float64 array of finite entries (below 1e100 in size).

    Raises:
        InputError: not numeric, complex, NaN, infinite or too large.
    """
    try:
        raw = np.asarray(value)
        array = np.asarray(raw, dtype=np.float64) if raw.dtype.kind in "fiu" else None
    except (TypeError, ValueError):  # ragged lists
        array = None
    if array is None:
        raise InputError(name, brief(value), "an array of real numbers")
    if not (np.abs(array) < LARGEST).all():
        raise InputError(name, brief(array), "finite entries, smaller than 1e100 in size")
    return array


def _shaped(expected: str, fits: Callable[[tuple[int, ...]], bool]) -> Check:
    """Check the shape of arrays of finite entries."""

    def check(name: str, value: object) -> Array:
        array = finite(name, value)
        if not fits(array.shape):
            raise InputError(name, f"shape {array.shape}", f"shape (..., {expected}")
        return array

    return check


def tangent(size: int) -> Check:
    """Check vectors of ``size`` entries along the last axis."""
    return _shaped(f"{size})", lambda shape: shape[-1:] == (size,))


def matrix(size: int) -> Check:
    """Check square matrices of ``size`` rows along the last two axes."""
    return _shaped(f"{size}, {size})", lambda shape: shape[-2:] == (size, size))


extended_tangent = _shaped("3 + 3 k) with k >= 1", lambda s: bool(s) and s[-1] >= 6 and s[-1] % 3 == 0)
"""Check tangent vectors of SE_k(3): 3 + 3k entries along the last axis."""
ambient = _shaped("3 + k) with k >= 1", lambda s: bool(s) and s[-1] >= 4)
"""Check vectors that SE_k(3) acts on: 3 + k entries along the last axis."""
extended_matrix = _shaped("3 + k, 3 + k) with k >= 1", lambda s: len(s) > 1 and s[-1] == s[-2] >= 4)
"""Check square matrices of 3 + k >= 4 rows along the last two axes."""


def _both(*checks: Callable[[str, Any], Array | None]) -> Check:
    """Return the check of several conditions in turn; the first one converts."""

    def check(name: str, value: object) -> Array:
        array = cast(Array, checks[0](name, value))
        for condition in checks[1:]:
            condition(name, array)
        return array

    return check


_FOUR = _shaped("4): x y z w", lambda shape: shape[-1:] == (4,))


def quaternion(name: str, value: object) -> Array:
    """Check unit quaternions (..., 4), x y z w."""
    array = _FOUR(name, value)
    length = np.sqrt(np.einsum("...i,...i->...", array, array))
    if np.any(np.abs(length - 1.0) > TOLERANCE):
        raise InputError(name, f"norm {_worst(length, 1.0):.9g}", f"norm 1 to {TOLERANCE:g}")
    return array


def _check_rotation(name: str, array: Array) -> None:
    a, b, c, d, e, f, g, h, i = rows(array if array.shape[-1] == 3 else array[..., :3, :3])
    defects = (
        a * a + d * d + g * g - 1.0,
        b * b + e * e + h * h - 1.0,
        c * c + f * f + i * i - 1.0,
        a * b + d * e + g * h,
        a * c + d * f + g * i,
        b * c + e * f + h * i,
    )
    # A reflection has the third column opposite to the cross product of the first two.
    handedness = (d * h - g * e) * c + (g * b - a * h) * f + (a * e - d * b) * i
    single = isinstance(a, float)
    worst = max(map(abs, defects)) if single else max(float(np.abs(defect).max(initial=0.0)) for defect in defects)
    if worst > TOLERANCE:
        raise InputError(
            name,
            f"a matrix R with |R^T R - I| = {worst:.3g}",
            f"a rotation, orthonormal to {TOLERANCE:g} (lgmpc.lie.so3.project gives the nearest one)",
        )
    if handedness < 0.0 if single else (handedness < 0.0).any():
        raise InputError(name, "a reflection, determinant -1", "a rotation, determinant +1")


def _check_bottom(name: str, array: Array) -> None:
    size = array.shape[-1]
    if (np.abs(array[..., 3:, :] - np.eye(size)[3:]) > TOLERANCE).any():
        raise InputError(name, f"bottom rows {brief(array[..., 3:, :])}", f"bottom rows of the identity ({size - 3})")


def _check_skew(name: str, array: Array) -> None:
    array = array[..., :3, :3]
    asymmetry = np.abs(array + np.swapaxes(array, -1, -2)).max(initial=0.0)
    if asymmetry > TOLERANCE * max(1.0, float(np.abs(array).max(initial=0.0))):
        raise InputError(name, f"a matrix S with |S + S^T| = {asymmetry:.3g}", "a skew-symmetric (3, 3) block")


def _check_zero_rows(name: str, array: Array) -> None:
    if np.any(np.abs(array[..., 3:, :]) > TOLERANCE):
        raise InputError(name, f"bottom rows {brief(array[..., 3:, :])}", "bottom rows of zeros")


def _worst(values: Array, target: float) -> float:
    flat = np.ravel(values)
    return float(flat[np.argmax(np.abs(flat - target))])


rotation = _both(matrix(3), _check_rotation)
"""Check rotation matrices (..., 3, 3)."""
placement = _both(matrix(4), _check_rotation, _check_bottom)
"""Check homogeneous matrices (..., 4, 4)."""
extended_pose = _both(extended_matrix, _check_rotation, _check_bottom)
"""Check elements of SE_k(3), (..., 3 + k, 3 + k)."""
skew = _both(matrix(3), _check_skew)
"""Check skew matrices (..., 3, 3)."""
twist_matrix = _both(matrix(4), _check_skew, _check_zero_rows)
"""Check elements of the Lie algebra of SE(3), (..., 4, 4)."""
extended_twist_matrix = _both(extended_matrix, _check_skew, _check_zero_rows)
"""Check elements of the Lie algebra of SE_k(3), (..., 3 + k, 3 + k)."""
