"""Transfer of state between two graphs of objects that were built in the same way from different settings.

A closed loop has state in about forty objects: the plant, queues of delays, generators of random numbers, filters, gait
clock, contact events, warm starts of solvers. None of them declares it. State is defined as what a run changes:
:class:`Beginning` records a graph right after it was built, and :func:`take_over` compares the graph with that record,
number by number, and writes the differences into the corresponding object of the other graph. Values that the run has
not changed follow from the settings, and the other graph has its own. New settings therefore act from then on, new
attributes of a class are included without declaration, and a test checks completeness: with equal settings the other
graph continues bit for bit.

Three rules complete this. Objects that a run has replaced (a plan, a lazily created sampler) are moved, and their
references to objects of the first graph are replaced by the counterparts. Memory of C++ libraries cannot be compared,
and bound machine code contains addresses: an object that owns either has a method ``take_over(old)``, called last.
Where the two graphs differ in structure (a longer horizon, another model), the innermost enclosing object with a method
``reset`` is reset, which is reported.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, partial
from pathlib import PurePath
from types import BuiltinFunctionType, CellType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.settings import Settings

__all__ = ["Beginning", "take_over"]

_VALUES = (
    type(None), bool, int, float, complex, str, bytes, slice, range, type, Enum, PurePath, Settings, ModuleType,
    BuiltinFunctionType, np.generic, np.dtype,
)  # fmt: skip
"""Types of values without parts that a run could change."""
_LIBRARIES = frozenset("casadi pinocchio mujoco proxsuite piqp osqp numpy scipy ctypes _ctypes typing builtins".split())
"""Packages whose objects are not traversed."""
_ABSENT = object()
Path = tuple[Hashable, ...]
"""Attributes, keys and positions that lead from the root to an object."""


class Beginning:
    """A record of a graph of objects.

    Args:
        root: the object from which all others are reached. It must not have been run before.

    Attributes:
        root: the same object.
    """

    def __init__(self, root: object) -> None:
        self.root = root
        self._objects: dict[int, object] = {}  # references, so that no identity is reused
        self._parts: dict[int, Mapping[Hashable, object]] = {}
        self._arrays: dict[int, np.ndarray[Any, Any]] = {}
        found = [root]
        while found:
            each = found.pop()
            if id(each) in self._objects or isinstance(each, _VALUES):
                continue
            self._objects[id(each)] = each
            if isinstance(each, np.ndarray):
                self._arrays[id(each)] = each.copy()
            parts = self._parts[id(each)] = _parts(each)
            found += parts.values()

    def parts(self, of: object) -> Mapping[Hashable, object]:
        """Return the recorded parts of an object."""
        return self._parts.get(id(of), {})

    def changed(self, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Return flags of the elements of an array whose bits differ from the record."""
        before = self._arrays[id(array)]
        different: np.ndarray[Any, Any] = _bits(array) != _bits(before)
        return different


def take_over(old: Beginning, new: object, *, draws: bool = True) -> tuple[str, ...]:
    """Write the state of a graph that has run into one that has not.

    The old graph cannot be used afterwards: some of its objects are part of the new one.

    Args:
        old: record of the graph from before it was run.
        new: root of the other graph.
        draws: whether the state of random number generators is taken over.

    Returns:
        Paths of the objects that were reset, because their structure differs.

    Raises:
        InputError: the structures differ in an object that cannot be reset.
    """
    pairs = _Pairs(old)
    pairs.match(old.root, new, ())
    write = _Writer(old, pairs, draws)
    for path, was, now in pairs.found:
        if not pairs.is_anew(path):
            write(was, now)
    for path, was, now in pairs.found:
        if not pairs.is_anew(path) and callable(getattr(type(now), "take_over", None)):
            now.take_over(was)
    outermost = (each for each in pairs.anew if not any(each[: len(at)] == at for at in pairs.anew - {each}))
    return tuple(sorted(map(_dotted, outermost)))


@dataclass
class _Pairs:
    """Objects of the old graph with their counterparts in the new one.

    Attributes:
        old: record of the old graph.
        found: path, old object, new object.
        new_of: counterpart by the old object's identity.
        anew: paths of the objects to reset.
    """

    old: Beginning
    found: list[tuple[Path, Any, Any]] = field(default_factory=list)
    new_of: dict[int, Any] = field(default_factory=dict)
    anew: set[Path] = field(default_factory=set)

    def match(self, was: Any, now: Any, path: Path, resets: Path | None = None) -> None:
        """Pair two objects and their parts; ``resets`` is the path of the innermost enclosing object with ``reset``."""
        if isinstance(was, _VALUES) or isinstance(now, _VALUES) or id(was) in self.new_of or was is now:
            return
        if type(was) is not type(now) or (isinstance(was, np.ndarray) and was.shape != now.shape):
            self._differ(path, resets, was, now)
            return
        if callable(getattr(type(was), "reset", None)):
            resets = path
        self.new_of[id(was)] = now
        self.found.append((path, was, now))
        before, fresh = self.old.parts(was), _parts(now)
        for key, part in before.items():
            if key in fresh:
                self.match(part, fresh[key], (*path, key), resets)

    def is_anew(self, path: Path) -> bool:
        """Return whether an object, or one that contains it, is reset."""
        return any(path[: len(each)] == each for each in self.anew)

    def _differ(self, path: Path, resets: Path | None, was: object, now: object) -> None:
        """Mark the innermost enclosing object for a reset, if the run has changed anything in the differing parts."""
        if not _is_touched(self.old, was):
            return
        if resets is None:
            raise InputError(_dotted(path), _described(now), f"the structure of the run so far, {_described(was)}")
        self.anew.add(resets)


@dataclass
class _Writer:
    """Writes the changes of an old object into its counterpart."""

    old: Beginning
    pairs: _Pairs
    draws: bool
    moved: set[int] = field(default_factory=set)

    def __call__(self, was: Any, now: Any) -> None:
        if isinstance(was, np.ndarray):
            changed = self.old.changed(was)
            if changed.any() and now.flags.writeable:
                now[changed] = was[changed]
        elif isinstance(was, np.random.Generator):
            if self.draws:
                now.bit_generator.state = was.bit_generator.state
        else:
            changes = dict(_changes(self.old, was))
            if isinstance(was, (list, deque, set)) and (
                _ABSENT in changes.values() or len(was) > len(self.old.parts(was))
            ):
                _refill(now, [self.translated(each) for each in was])
            else:
                for key, value in changes.items():
                    _write(now, key, value if value is _ABSENT else self.translated(value))

    def translated(self, value: Any) -> Any:
        """Return the counterpart of an old value, or a new value of the run with its references translated."""
        if isinstance(value, _VALUES):
            return value
        if id(value) in self.pairs.new_of:
            return self.pairs.new_of[id(value)]
        if isinstance(value, np.ndarray) or id(value) in self.moved:
            return value
        self.moved.add(id(value))
        if isinstance(value, tuple):
            parts = [self.translated(each) for each in value]
            if all(a is b for a, b in zip(parts, value, strict=True)):
                return value
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        for key, part in _parts(value).items():
            other = self.translated(part)
            if other is not part:
                _write(value, key, other)
        return value


def _changes(old: Beginning, each: object) -> Iterator[tuple[Hashable, Any]]:
    """Yield the parts that the run replaced or removed (:data:`_ABSENT`)."""
    before, after = old.parts(each), _parts(each)
    for key in {**before, **after}:
        a, b = before.get(key, _ABSENT), after.get(key, _ABSENT)
        derived = isinstance(key, str) and isinstance(getattr(type(each), key, None), cached_property)
        if not derived and not _same(a, b):
            yield key, b


def _is_touched(old: Beginning, root: object) -> bool:
    """Return whether the run changed an object or any of its parts."""
    found, seen = [root], set()
    while found:
        each = found.pop()
        if id(each) in seen or isinstance(each, _VALUES):
            continue
        seen.add(id(each))
        if old.changed(each).any() if isinstance(each, np.ndarray) else any(True for _ in _changes(old, each)):
            return True
        found += old.parts(each).values()
    return False


def _same(a: object, b: object) -> bool:
    """Return whether two parts are the same object, or numbers or texts with equal bits; NaN equals itself."""
    if a is b:
        return True
    if isinstance(a, float) and isinstance(b, float):
        return math.isnan(a) if math.isnan(b) else a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
    return type(a) is type(b) and isinstance(a, (bool, int, str, bytes)) and a == b


def _parts(each: Any) -> dict[Hashable, Any]:
    """Return the parts of an object by attribute, key or position; none of values and of libraries' objects."""
    if isinstance(each, (dict, MappingProxyType)):
        return dict(each)
    if isinstance(each, (list, tuple, deque, set, frozenset)):
        return dict(enumerate(each))
    if isinstance(each, FunctionType):
        cells = zip(each.__code__.co_freevars, each.__closure__ or (), strict=True)
        return {name: cell.cell_contents for name, cell in cells if _filled(cell)}
    if isinstance(each, MethodType):
        return {"__self__": each.__self__}
    if isinstance(each, partial):
        return {"func": each.func, "args": each.args, "keywords": each.keywords}
    if isinstance(each, (*_VALUES, np.ndarray)) or type(each).__module__.partition(".")[0] in _LIBRARIES:
        return {}
    slots = (name for kind in type(each).__mro__ for name in _slots(kind) if hasattr(each, name))
    return {**{name: getattr(each, name) for name in slots}, **getattr(each, "__dict__", {})}


def _slots(kind: type) -> tuple[str, ...]:
    names = kind.__dict__.get("__slots__", ())
    return tuple(name for name in ((names,) if isinstance(names, str) else names) if not name.startswith("__"))


def _filled(cell: CellType) -> bool:
    try:
        return cell.cell_contents is not _ABSENT
    except ValueError:
        return False


def _write(owner: Any, key: Any, value: Any) -> None:
    """Set or remove a part of an object."""
    if isinstance(owner, (dict, list)):
        if value is not _ABSENT:
            owner[key] = value
        elif key in owner:
            del owner[key]
    elif isinstance(owner, FunctionType):
        cells: Mapping[str, CellType] = dict(zip(owner.__code__.co_freevars, owner.__closure__ or (), strict=True))
        cells[key].cell_contents = value
    elif value is _ABSENT:
        vars(owner).pop(key, None)
    else:
        object.__setattr__(owner, key, value)  # also where the class is frozen


def _refill(owner: Any, values: list[Any]) -> None:
    """Replace the content of a list, a queue or a set."""
    owner.clear()
    (owner.update if isinstance(owner, set) else owner.extend)(values)


def _bits(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return the bits of floating-point numbers, so that NaN equals itself and zeros of two signs differ."""
    return array.view(np.int64) if array.dtype == np.float64 else array


def _described(each: object) -> str:
    return f"shape {each.shape}" if isinstance(each, np.ndarray) else type(each).__name__


def _dotted(path: Path) -> str:
    return ".".join(str(key).lstrip("_") for key in path) or "the closed loop"
