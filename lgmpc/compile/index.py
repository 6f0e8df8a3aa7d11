"""Kernels recalled by what they were made from: their expressions are not written again.

The library of a function is found by the function itself (:mod:`lgmpc.compile.native`), which must have been written
first: expressions, derivatives, simplification. That takes ten times as long as loading the library. So the cache also
holds an index from what a function was written from (the robot's model, structural settings) to what was made of it.

An entry cannot be another function's. It is named by a hash of the pickled arguments, of the function that makes it, of
lgmpc's own sources, of the versions of the libraries that take part and of the compiler; and it is made from the
*unpickled* arguments, which contain nothing that is not in the hash. What cannot be identified in this way (a
class or function from outside the package, an expression, sources that changed since they were imported) is made anew.
The hash does not cover functions of lgmpc that a program replaces at run time: ``LGMPC_JIT=0`` always writes anew.
"""

from __future__ import annotations

import contextlib
import copyreg
import ctypes
import functools
import hashlib
import io
import logging
import os
import pickle
import platform
import shutil
import sys
import tempfile
import types
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar, cast

import casadi

from lgmpc import __imported_ns__
from lgmpc.compile.cache import cache_folder, discard, is_whole, request_key
from lgmpc.compile.compiler import compiler_for_functions
from lgmpc.compile.native import Progress

__all__ = ["recall"]

T = TypeVar("T")

_log = logging.getLogger("lgmpc.compile")
_PROTOCOL = 5
_DIGEST = 32  # bytes, or hexadecimal digits of a name
_ENTRIES = 4096
"""Most entries of one state of the sources; the oldest half is removed beyond it."""
_STATES = 64
"""Most states of the sources whose entries are kept."""
_PACKAGE = os.path.dirname(os.path.dirname(__file__))
_CODE = (".py", ".c")
_JUST_NOW = 2_000_000_000
"""Files that changed less than this before the import, ns, may have changed after it: clocks of files are coarse."""
# Code that is identified by lgmpc's sources and by the versions in the hash. Anything else may change without them.
_IDENTIFIED = frozenset(
    {"lgmpc", "builtins", "casadi", "collections", "copyreg", "functools", "numpy", "pathlib", "pinocchio"}
)


def recall(make: Callable[..., T], *arguments: Any, progress: Progress | None = None) -> T:
    """Return ``make(*arguments, progress=progress)``, from the cache if it was made before from equal arguments.

    Args:
        make: a function of a module of lgmpc whose result depends on its arguments and the environment variables of
            :mod:`lgmpc.compile` alone, and holds kernels, compiled functions and plain values. It returns
            another object at every call.
        arguments: what the result depends on. ``make`` does not receive what a class excludes when it is pickled.
        progress: called with a description of what is being compiled.

    Raises:
        CompileError: the compiler failed.
        InputError: the environment (cache folder, ``CC``) cannot be used; or from ``make``.
    """
    compiler = compiler_for_functions()
    content = None if compiler is None else _content(make, arguments)
    index = None if content is None else _index()
    if compiler is None or content is None or index is None:
        return make(*arguments, progress=progress)
    key = request_key(*_versions(), compiler.identity, hashlib.sha256(content).hexdigest())
    entry = index / key
    found: list[T] = _read(entry)
    if not found:
        _, given = pickle.loads(content)
        found = [make(*given, progress=progress)]
        _write(entry, found[0])
    return found[0]


class _ContentPickler(pickle.Pickler):
    """Write values by content and code by name; refuse code from elsewhere, which its name does not identify."""

    def reducer_override(self, thing: Any) -> Any:
        reduce = getattr(type(thing), "reduce_to_structure", None)
        if reduce is not None:
            return reduce(thing)
        if isinstance(thing, (type, types.FunctionType, types.BuiltinFunctionType)):
            if (thing.__module__ or "").partition(".")[0] not in _IDENTIFIED:
                raise pickle.PicklingError(f"{thing!r} is not lgmpc's")
            return NotImplemented
        kind: Any = type(thing)
        derived = _derived(kind).intersection(getattr(thing, "__dict__", ()))
        if not derived:
            return NotImplemented
        reduced = thing.__reduce_ex__(_PROTOCOL)
        if reduced[0] is not copyreg.__newobj__ or type(reduced[2]) is not dict:  # type: ignore[attr-defined]
            return reduced
        state = {name: value for name, value in reduced[2].items() if name not in derived}
        return (*reduced[:2], state, *reduced[3:])


@functools.lru_cache(maxsize=1024)
def _derived(kind: Hashable) -> frozenset[str]:
    """Return the names of a class's cached properties."""
    members = (member for base in cast(type, kind).__mro__ for member in vars(base).items())
    return frozenset(name for name, member in members if isinstance(member, functools.cached_property))


def _content(make: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes | None:
    """Return the bytes from which ``make`` and its arguments can be restored; None if there are none."""
    buffer = io.BytesIO()
    try:
        _ContentPickler(buffer, _PROTOCOL).dump((make, arguments))
    except Exception as error:  # objects raise all kinds of errors where they cannot be pickled
        _log.debug("%s is not recalled: %s", make.__name__, error)
        return None
    return buffer.getvalue()


def _versions() -> tuple[str, ...]:
    """Return the versions of all that takes part in writing expressions, besides lgmpc."""
    imported = (
        f"{name} {getattr(sys.modules.get(name), '__version__', '')}" for name in ("numpy", "scipy", "pinocchio")
    )
    return (sys.version, platform.machine(), casadi.CasadiMeta.version(), *imported)


def _index() -> Path | None:
    """Return the folder of the entries that this process's sources made; None if they are not known."""
    sources = _sources()
    return None if sources is None else cache_folder() / "index" / sources


@functools.cache
def _sources() -> str | None:
    """Return the hash of lgmpc's sources; None if some of them may have changed since they were imported."""
    if _changed():
        return None
    digest = hashlib.sha256()
    for path in _files():
        with open(path, "rb") as file:
            data = file.read()
        digest.update(f"{os.path.relpath(path, _PACKAGE)} {len(data)}\n".encode() + data)
    return digest.hexdigest()[:_DIGEST]


def _files() -> list[str]:
    folders = ((folder, files) for folder, _, files in os.walk(_PACKAGE) if not folder.endswith("__pycache__"))
    return sorted(os.path.join(folder, name) for folder, files in folders for name in files if name.endswith(_CODE))


def _changed() -> bool:
    """Return whether a source file is younger than lgmpc's import, or there are no files."""
    youngest = max((os.stat(path).st_ctime_ns for path in _files()), default=sys.maxsize)
    return youngest > __imported_ns__ - _JUST_NOW


def _read(entry: Path) -> list[Any]:
    """Return what an entry holds, as a list of one; an empty list if there is none that can be used."""
    try:
        data = entry.read_bytes()
    except OSError:
        return []
    try:
        if hashlib.sha256(data[_DIGEST:]).digest() != data[:_DIGEST]:
            raise ValueError("its content is not what was written")
        return [pickle.loads(data[_DIGEST:])]
    except Exception as error:  # of any kind: a library that it names is gone, or damaged
        _log.debug("index entry %s is made again: %s", entry.name, error)
        discard(entry)
        return []


def _write(entry: Path, value: Any) -> None:
    """Add an entry, unless the sources changed; a cache that cannot be written to is left as it is."""
    buffer = io.BytesIO()
    try:
        if _changed():
            return
        _KernelPickler(buffer, _PROTOCOL).dump(value)
        if not entry.parent.is_dir():
            entry.parent.mkdir(mode=0o700, parents=True)
            _keep_youngest(entry.parent.parent, _STATES)
        _keep_youngest(entry.parent, _ENTRIES)
        data = buffer.getvalue()
        with tempfile.NamedTemporaryFile(dir=entry.parent, prefix=".", delete=False) as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(file.name, entry)
    except Exception as error:  # what is not written is made again
        _log.debug("index entry %s is not written: %s", entry.name, error)


def _keep_youngest(folder: Path, most: int) -> None:
    """Remove the older half of a folder's content if there is more than a number of entries."""
    with contextlib.suppress(OSError):
        paths = list(folder.iterdir())
        if len(paths) <= most:
            return
        for path in sorted(paths, key=lambda path: path.stat().st_mtime_ns)[: len(paths) // 2]:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                discard(path)


class _KernelPickler(pickle.Pickler):
    """Write libraries of the cache by their file's name, which holds the hash of their bytes."""

    def reducer_override(self, thing: Any) -> Any:
        if not isinstance(thing, ctypes.CDLL):
            return NotImplemented
        path = Path(thing._name)
        if path.parent != cache_folder():
            raise pickle.PicklingError(f"{path} is not in the cache")
        return _open, (path.name,)


def _open(name: str) -> ctypes.CDLL:
    return _load(str(cache_folder() / name))


@functools.lru_cache(maxsize=1024)
def _load(path: str) -> ctypes.CDLL:
    if not is_whole(Path(path)):
        raise FileNotFoundError(path)
    return ctypes.CDLL(path)
