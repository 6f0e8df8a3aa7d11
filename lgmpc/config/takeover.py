"""State, taken over from one graph of objects by another that was built in the same way from other settings.

A closed loop has state in some forty objects: the plant, queues of delays, generators of random numbers, filters, gait
clock, contact events, warm starts of solvers. None of them lists it. State is what a run changes: :class:`Beginning`
records a graph right after it was built, and :func:`take_over` compares the graph with that record, number by number,
and writes what differs into the corresponding object of the other graph. What the run has not changed follows from the
settings, and the other graph has its own. So new settings act from there on, an attribute that is added to a class
tomorrow is taken over without being declared, and a test can check completeness: with equal settings the other graph
continues bit for bit.

Three rules complete this. What a run has put in the place of something else (a plan, a lazily made sampler) is moved,
and its references to objects of the first graph are replaced by their counterparts. Memory of C++ libraries cannot be
compared, and bound machine code holds addresses: an object that owns such a thing has a method ``take_over(old)``,
called last. Where the two graphs differ in structure (a longer horizon, another model), the innermost object around
with a method ``reset`` keeps nothing: it begins anew, which is reported.
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
"""What has no parts that a run could change."""
_LIBRARIES = frozenset("casadi pinocchio mujoco proxsuite piqp osqp numpy scipy ctypes _ctypes typing builtins".split())
"""Packages whose objects are not looked into."""
_ABSENT = object()
Path = tuple[Hashable, ...]
"""Attributes, keys and positions that lead from the root to an object."""


class Beginning:
    """What a graph of objects was when this was made.

    Args:
        root: the object from which all others are reached. It must not have been run before.

    Attributes:
        root: as given.
    """

    def __init__(self, root: object) -> None:
        self.root = root
        self._objects: dict[int, object] = {}  # holds them, so that no identity is used twice
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
        """Return the parts that an object had."""
        return self._parts.get(id(of), {})

    def changed(self, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Return which elements of an array have other bits than they had."""
        before = self._arrays[id(array)]
        different: np.ndarray[Any, Any] = _bits(array) != _bits(before)
        return different


def take_over(old: Beginning, new: object, *, draws: bool = True) -> tuple[str, ...]:
    """Write the state of a graph that has run into one that has not.

    The old graph is of no use afterwards: some of its objects are part of the new one.

    Args:
        old: recorded before the graph was run.
        new: root of the other graph.
        draws: whether generators of random numbers go on where the old ones are.

    Returns:
        Paths of the objects that begin anew, because their structure differs.

    Raises:
        InputError: the structures differ where nothing can begin anew.
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
        old: the old graph as it was.
        found: path, old object, new object.
        new_of: counterpart by the old object's identity.
        anew: paths of the objects that begin anew.
    """

    old: Beginning
    found: list[tuple[Path, Any, Any]] = field(default_factory=list)
    new_of: dict[int, Any] = field(default_factory=dict)
    anew: set[Path] = field(default_factory=set)

    def match(self, was: Any, now: Any, path: Path, resets: Path | None = None) -> None:
        """Pair two objects and their parts; ``resets`` is the path of the innermost one around that can begin anew."""
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
        """Whether an object, or one around it, begins anew."""
        return any(path[: len(each)] == each for each in self.anew)

    def _differ(self, path: Path, resets: Path | None, was: object, now: object) -> None:
        """Let the innermost object around begin anew, if the run has changed anything in what differs."""
        if not _is_touched(self.old, was):
            return
        if resets is None:
            raise InputError(_dotted(path), _described(now), f"what it was so far, {_described(was)}")
        self.anew.add(resets)


@dataclass
class _Writer:
    """Writes what a run changed in an old object into the new one."""

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
        """Return the counterpart of an old value, or what the run made with its references translated."""
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
    """Yield what the run put in the place of other parts, or took away (:data:`_ABSENT`)."""
    before, after = old.parts(each), _parts(each)
    for key in {**before, **after}:
        a, b = before.get(key, _ABSENT), after.get(key, _ABSENT)
        derived = isinstance(key, str) and isinstance(getattr(type(each), key, None), cached_property)
        if not derived and not _same(a, b):
            yield key, b


def _is_touched(old: Beginning, root: object) -> bool:
    """Whether the run changed an object, or anything that it consisted of."""
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
    """Whether two parts are one object, or numbers or texts with the same bits; NaN equals itself."""
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
    """Put a part in its place, or take it away."""
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
