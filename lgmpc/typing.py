"""Array types of annotations, the acceleration of gravity, and checks of arguments, throughout the package."""

import functools
import inspect
import reprlib
import types
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
P = ParamSpec("P")
R = TypeVar("R")
GRAVITY = 9.81
"""Acceleration of gravity on Earth, m/s2."""


def numbers(name: str, value: object, *shapes: tuple[int, ...], finite: bool = False) -> Array:
    """Return a value as an array of float64.

    Args:
        name: of the argument, in messages.
        value: what the user gave.
        shapes: that it can have; any unless given.
        finite: whether NaN and infinity are errors.

    Raises:
        InputError: no numbers, rows of different lengths, another shape, or not finite.
    """
    expected = " or ".join(f"shape {shape}" if shape else "a number" for shape in shapes)
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError
    except (TypeError, ValueError):
        detail = expected or "in rows of the same length"
        raise InputError(name, reprlib.repr(value), f"numbers, {detail}") from None
    if shapes and array.shape not in shapes:
        raise InputError(name, f"shape {array.shape}", expected)
    if finite and not np.isfinite(array).all():
        raise InputError(name, "NaN or infinity", "finite values")
    return array.astype(np.float64, copy=False)


def identifier(name: str, value: object) -> None:
    """Raise if a name is no C identifier.

    Raises:
        InputError: it is none.
    """
    if not (isinstance(value, str) and value.isidentifier() and value.isascii()):
        raise InputError(name, reprlib.repr(value), "letters, digits and underscores, no digit first")


def instance(name: str, value: object, kind: type | tuple[type, ...], expected: str = "") -> None:
    """Raise if an argument is not of the expected type.

    Args:
        name: of the argument, in messages.
        value: what the user gave.
        kind: type, or several.
        expected: description; that of one type by its name unless given.

    Raises:
        InputError: it is of another type; a bool is no number.
    """
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        got = value if isinstance(value, str | bool | int | float | None) else type(value).__name__
        words = expected or f"a {kind.__name__ if isinstance(kind, type) else kind}"
        raise InputError(name, value.__name__ if isinstance(value, type) else got, words)


def typed(function: Callable[P, R]) -> Callable[P, R]:
    """Check the arguments of a function that are annotated as numbers or by classes, before it runs.

    Raises:
        InputError: by the function, for an argument of another type or a number that is not finite.
    """
    signature = inspect.signature(function)

    @functools.cache
    def kinds() -> dict[str, Any]:
        hints = inspect.get_annotations(function, eval_str=True)
        return {name: kind for name, kind in hints.items() if isinstance(kind, (type, types.UnionType))}

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            kind = kinds().get(name)
            if kind is float:
                numbers(name, value, (), finite=True)
            elif kind is not None and not _is_a(value, kind):
                expected = {int: "a whole number", str: "a text"}.get(kind, f"a {getattr(kind, '__name__', kind)}")
                raise InputError(name, brief(value), expected)
        return function(*args, **kwargs)

    return wrapper


def _is_a(value: object, kind: Any) -> bool:
    try:
        return isinstance(value, (int, np.integer) if kind is int else kind)
    except TypeError:  # a union with generic types, such as arrays
        return True


def brief(value: object) -> str:
    """Return a value in one line of at most 80 characters."""
    text = " ".join(str(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."
