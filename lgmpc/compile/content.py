"""Values as text and bytes: a tree of JSON beside the numbers of arrays, from which only data can be restored.

Objects are written as their class's name and their attributes, and restored without running code of theirs: a class
states with ``structural_state() -> dict[str, Any]`` which attributes count, else all do but cached properties.
"""

import copy
import ctypes
import enum
import functools
import importlib
import json
import re
import types
from collections.abc import Callable, Hashable
from typing import Any, cast

import casadi
import numpy as np

# Code that is identified by lgmpc's sources and by the versions in the cache's keys. Any other may change without them.
_IDENTIFIED = frozenset({"lgmpc", "builtins", "casadi", "collections", "functools", "numpy", "pathlib", "pinocchio"})
# Modules of classes whose objects are their attributes. Others, such as compiled ones and containers, consist of more.
_PLAIN = re.compile(r"(lgmpc|abc|typing|collections\.abc|pydantic)(\.|$)")
_SEQUENCES: dict[type, str] = {tuple: "tuple", set: "set", frozenset: "frozenset"}
# Classes whose objects are made by a call, with the arguments that their ``__reduce__`` returns.
_MADE = ("lgmpc.robot.symbolic.model:SymbolicModel",)
_LENGTH = 8  # bytes, of the tree's size


class NoContentError(Exception):
    """A value cannot be written, or what was read is no content."""


class Content:
    """A written value.

    Attributes:
        data: the tree and the arrays' numbers; equal values have equal data.
        originals: models of Pinocchio, matrices and functions of CasADi, in order: the data hold their content, but
            they are not restored from it.
    """

    def __init__(self, data: bytes, originals: list[Any]) -> None:
        self.data, self.originals = data, originals

    def restored(self) -> Any:
        """Return a copy of the value, which contains nothing that is not in the data."""
        return read_content(self.data, _unknown_library, self.originals)


def write_content(value: Any, name_of: Callable[[ctypes.CDLL], str] | None = None) -> Content:
    """Write a value.

    Args:
        value: numbers, strings, containers, arrays, slices, objects of lgmpc that consist of these; also classes,
            functions, models of Pinocchio, matrices and functions of CasADi unless libraries can be written.
        name_of: returns the name of a library, for values that hold compiled functions.

    Raises:
        NoContentError: it holds anything else.
    """
    writer = _Writer(name_of)
    try:
        tree = json.dumps(writer.write(value), separators=(",", ":")).encode()
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise NoContentError(str(error)) from error
    return Content(b"".join([len(tree).to_bytes(_LENGTH, "little"), tree, *writer.numbers]), writer.originals)


def read_content(data: bytes, library: Callable[[str], ctypes.CDLL], originals: list[Any] | None = None) -> Any:
    """Return the value that data describe.

    Args:
        data: of :class:`Content`.
        library: returns the library of this name.
        originals: of :class:`Content`; None where the data are of a file: it names no functions then.

    Raises:
        NoContentError: the data do not describe a value.
    """
    try:
        start = _LENGTH + int.from_bytes(data[:_LENGTH], "little")
        return _Reader(data[start:], library, originals).read(json.loads(data[_LENGTH:start]))
    except NoContentError:
        raise
    except Exception as error:  # what was not written by lgmpc can have any fault
        raise NoContentError(f"{type(error).__name__}: {error}") from error


def _unknown_library(name: str) -> ctypes.CDLL:
    raise NoContentError(f"library {name}")


class _Writer:
    """Trees of values; mutable objects that occur more than once are written once."""

    def __init__(self, name_of: Callable[[ctypes.CDLL], str] | None) -> None:
        self.numbers: list[bytes] = []
        self.originals: list[Any] = []
        self._name_of, self._size = name_of, 0
        self._known: dict[
            int, tuple[int, Any]
        ] = {}  # with the objects, whose addresses are theirs as long as they live

    def write(self, value: Any) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, float, str):
            return value
        if kind in _SEQUENCES:
            return [_SEQUENCES[kind], *map(self.write, value if kind is tuple else sorted(value, key=repr))]
        if kind is slice:
            return ["slice", *map(self.write, (value.start, value.stop, value.step))]
        if isinstance(value, enum.Enum):
            return ["enum", _name(kind), value.name]
        if isinstance(value, (type, types.FunctionType, types.BuiltinFunctionType)):
            if self._name_of is not None:
                raise NoContentError(f"{value!r} is code")
            return ["code", _name(value)]
        if isinstance(value, np.generic):
            return ["scalar", *self._numbers(np.asarray(value))]
        known = self._known.get(id(value))
        if known is not None:
            return ["again", known[0]]
        self._known[id(value)] = len(self._known), value
        return self._write_object(kind, value)

    def _write_object(self, kind: type, value: Any) -> Any:
        if kind is list:
            return ["list", *map(self.write, value)]
        if kind is dict:
            return ["dict", *([self.write(key), self.write(each)] for key, each in value.items())]
        if kind is np.ndarray:
            return ["array", *self._numbers(value)]
        if isinstance(value, ctypes.CDLL) and self._name_of is not None:
            return ["library", self._name_of(value)]
        whole = None if self._name_of is not None else _whole_content(kind, value)
        if whole is not None:
            self.originals.append(value)
            self._add(whole)
            return ["original", len(self.originals) - 1, len(whole)]
        if "__reduce__" in _members(kind):
            made_by, arguments = value.__reduce__()
            return ["made", _name(made_by), self.write(arguments)]
        if not all(_PLAIN.match(base.__module__) for base in kind.__mro__[:-1]):
            raise NoContentError(f"a {kind.__name__}")
        return ["object", _name(kind), self.write(_state(value))]

    def _numbers(self, array: np.ndarray[Any, Any]) -> list[Any]:
        """Return type, shape, and place of an array's numbers."""
        if array.dtype.hasobject:
            raise NoContentError("an array of objects")
        return [array.dtype.str, list(array.shape), self._add(array.tobytes())]

    def _add(self, data: bytes) -> int:
        """Add bytes beside the tree, and return where they begin."""
        self.numbers.append(data)
        self._size += len(data)
        return self._size - len(data)


def _whole_content(kind: type, value: Any) -> bytes | None:
    """Return the content of an object that its library writes; None of any other."""
    if kind is casadi.DM or kind is casadi.Function:
        return str(value.serialize()).encode()
    if kind.__module__.startswith("pinocchio.") and kind.__name__ == "Model":
        from pinocchio import serialization

        buffer = serialization.StreamBuffer()
        value.saveToBinary(buffer)  # a text could not hold infinities
        return bytes(buffer.tobytes())
    return None


class _Reader:
    """Values of trees."""

    def __init__(self, numbers: bytes, library: Callable[[str], ctypes.CDLL], originals: list[Any] | None) -> None:
        self._numbers, self._library, self._originals = numbers, library, originals
        self._made: list[Any] = []

    def read(self, tree: Any) -> Any:
        if not isinstance(tree, list):
            return tree
        what, *parts = tree
        for kind, name in _SEQUENCES.items():
            if what == name:
                return kind(map(self.read, parts))
        if what == "slice":
            return slice(*map(self.read, parts))
        if what == "enum":
            return _named(parts[0])[parts[1]]
        if what == "code":
            self._refuse_file("code")
            return _named(parts[0])
        if what == "scalar":
            return self._array(*parts)[()]
        if what == "again":
            return self._made[parts[0]]
        self._made.append(None)
        return self._read_object(len(self._made) - 1, what, parts)

    def _read_object(self, place: int, what: str, parts: list[Any]) -> Any:
        made: Any
        if what == "list":
            made = self._made[place] = []
            made.extend(map(self.read, parts))
        elif what == "dict":
            made = self._made[place] = {}
            made.update((self.read(key), self.read(value)) for key, value in parts)
        elif what == "object":
            made = self._made[place] = object.__new__(_class(parts[0]))
            for name, value in self.read(parts[1]).items():
                object.__setattr__(made, name, value)
        elif what == "array":
            made = self._array(*parts)
        elif what == "library":
            made = self._library(parts[0])
        elif what == "original":
            self._refuse_file("no content")
            made = copy.copy(cast(list[Any], self._originals)[parts[0]])
        elif what == "made":
            if parts[0] not in _MADE:
                raise NoContentError(f"a call of {parts[0]}")
            made = _named(parts[0])(*self.read(parts[1]))
        else:
            raise NoContentError(f"'{what}'")
        self._made[place] = made
        return made

    def _refuse_file(self, what: str) -> None:
        if self._originals is None:
            raise NoContentError(f"a file that holds {what}")

    def _array(self, kind: str, shape: list[int], start: int) -> np.ndarray[Any, Any]:
        return np.ndarray(shape, np.dtype(kind), self._numbers, start).copy()


def _state(thing: Any) -> dict[str, Any]:
    """Return the attributes of an object that count."""
    chosen: Callable[[], dict[str, Any]] | None = getattr(thing, "structural_state", None)
    state, derived = vars(thing) if chosen is None else chosen(), _derived(cast(Hashable, type(thing)))
    return {name: value for name, value in state.items() if name not in derived}


def _members(kind: type) -> dict[str, Any]:
    """Return the members of a class and its bases, except of ``object``."""
    return {name: member for base in kind.__mro__[-2::-1] for name, member in vars(base).items()}


@functools.lru_cache(maxsize=1024)
def _derived(kind: Hashable) -> frozenset[str]:
    """Return the names of a class's cached properties."""
    members = _members(cast(type, kind)).items()
    return frozenset(name for name, member in members if isinstance(member, functools.cached_property))


def _name(code: Any) -> str:
    """Return the name by which a class or function can be found again; refuse code that its name does not identify."""
    module = code.__module__ or ""
    name = f"{module}:{code.__qualname__}"
    if module.partition(".")[0] not in _IDENTIFIED or _named(name) is not code:
        raise NoContentError(f"{code!r} is not lgmpc's")
    return name


def _named(name: str) -> Any:
    module, _, path = name.partition(":")
    if module.partition(".")[0] not in _IDENTIFIED:
        raise NoContentError(f"{name} is not lgmpc's")
    return functools.reduce(getattr, path.split("."), importlib.import_module(module))


def _class(name: str) -> type:
    found = _named(name)
    if not (isinstance(found, type) and _PLAIN.match(found.__module__)):
        raise NoContentError(f"{name} is no class of lgmpc")
    return found
