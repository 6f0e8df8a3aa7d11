"""Dotted keys, such as ``pushes.0.impulse_ns``, of plain tables and lists: assignment, differences."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from lgmpc.errors import InputError

_NAMED = ("world",)
"""Sections for which the name of their kind stands, or a list of kinds in a row."""


def write_at(data: dict[str, Any], key: str, value: Any, defaults: Any = None) -> list[str]:
    """Assign ``value`` to a dotted key; keys of lists are positions from 0, and the one after the last appends.

    Args:
        data: changed in place; missing tables along the key are created.
        key: dotted.
        value: any.
        defaults: tables from which lists that ``data`` lacks are copied.

    Returns:
        The dotted keys of the created tables.

    Raises:
        InputError: the key passes through a plain value, or a position that does not exist.
    """
    made = []
    here: Any = data
    parts = key.split(".")
    for depth, part in enumerate(parts):
        path = ".".join(parts[: depth + 1])
        defaults = defaults.get(part) if isinstance(defaults, dict) else None
        where = _place(here, part, path)
        if depth == len(parts) - 1:
            here[where] = value
            break
        inner = here.get(where) if isinstance(here, dict) else here[where]
        if path in _NAMED and isinstance(inner, str):
            inner = {"kind": inner}
        elif path in _NAMED and isinstance(inner, (list, tuple)) and not parts[depth + 1].isdecimal():
            inner = {"kind": "course", "parts": list(inner)}
        if inner is None and isinstance(defaults, (list, tuple)):
            inner = defaults
        elif inner is None:
            inner = {}
            made.append(path)
        here[where] = list(inner) if isinstance(inner, tuple) else inner
        here = here[where]
    return made


def _place(here: Any, part: str, path: str) -> Any:
    """Return the key or position of ``part`` in a table or list; one after the last appends."""
    if isinstance(here, dict):
        return part
    outer = path.rpartition(".")[0]
    if not isinstance(here, list):
        raise InputError(path, f"a key below {outer} = {here}", f"none: {outer} is a plain value")
    place = int(part) if part.isdecimal() else -1
    if not 0 <= place <= len(here):
        raise InputError(path, f"position {part}", f"a position from 0 to {len(here)} (the list has {len(here)})")
    if place == len(here):
        here.append(None)
    return place


class Difference(NamedTuple):
    """A dotted key whose values differ; ``None`` where a side lacks it."""

    key: str
    first: Any
    second: Any


def differing(first: Any, second: Any, key: str = "") -> Iterator[Difference]:
    """Yield key and both values of the leaves of two tables that differ.

    Lists of equal length that contain tables differ element by element, others as a whole.
    """
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        names: Iterable[Any] = dict.fromkeys([*first, *second])
        parts: list[tuple[Any, Any, Any]] = [(name, first.get(name), second.get(name)) for name in names]
    elif (
        isinstance(first, list)
        and isinstance(second, list)
        and len(first) == len(second)
        and any(isinstance(each, Mapping) for each in first)
    ):
        parts = [(i, *pair) for i, pair in enumerate(zip(first, second, strict=True))]
    else:
        if first != second:
            yield Difference(key, first, second)
        return
    for name, a, b in parts:
        yield from differing(a, b, f"{key}.{name}" if key else str(name))


def leaves(table: Mapping[str, Any], key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys and values of nested tables, as far as the values are no tables."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{key}{name}.")
        else:
            yield f"{key}{name}", value
