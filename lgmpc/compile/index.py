"""Kernels found by what they were made from: their expressions are not written again.

The library of a function is found by the function itself (:mod:`lgmpc.compile.native`), which must have been written
first: expressions, derivatives, simplification. That takes ten times as long as loading the library. So the cache also
holds an index from what a function was written from (the robot's model, structural settings) to what was made of it.

An entry cannot be another function's. It is named by a hash of the arguments' content, of the function that makes it,
of lgmpc's own sources, of the versions of the libraries that take part and of the compiler; and it is made from a copy
of the arguments, which contains nothing that is not in the hash. What cannot be identified in this way (a
class or function from outside the package, an expression, sources that changed since they were imported) is made anew.
The hash does not cover functions of lgmpc that a program replaces at run time: ``LGMPC_JIT=0`` always writes anew.

Entries are data (:mod:`lgmpc.compile.content`): the only code that reading them executes is that of libraries of the
cache, whose folders and files only this user may write to.
"""

import contextlib
import ctypes
import functools
import hashlib
import logging
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

import casadi

from lgmpc import __imported_ns__
from lgmpc.compile import cache
from lgmpc.compile.compiler import compiler_for_functions
from lgmpc.compile.content import Content, NoContentError, read_content, write_content

T = TypeVar("T")

_log = logging.getLogger("lgmpc.compile")
_DIGEST = 32  # bytes, or hexadecimal digits of a name
_ENTRIES = 4096
"""Most entries of one state of the sources; the oldest half is removed beyond it."""
_STATES = 64
"""Most states of the sources whose entries are kept."""
_PACKAGE = os.path.dirname(os.path.dirname(__file__))
_CODE = (".py", ".c")
_JUST_NOW = 2_000_000_000
"""Files that changed less than this before the import, ns, may have changed after it: clocks of files are coarse."""


_anew: ContextVar[bool] = ContextVar("lgmpc_compile_anew", default=False)


@contextlib.contextmanager
def made_anew() -> Iterator[None]:
    """Have :func:`cached` make its results anew within the block: their libraries then know their sources."""
    token = _anew.set(True)
    try:
        yield
    finally:
        _anew.reset(token)


def cached(make: Callable[..., T], *arguments: Any) -> T:
    """Return ``make(*arguments)``, from the cache if it was made before from equal arguments.

    Args:
        make: a function of a module of lgmpc whose result depends on its arguments and the environment variables of
            :mod:`lgmpc.compile` alone, and holds kernels, compiled functions and plain values. It returns
            another object at every call.
        arguments: what the result depends on. ``make`` does not receive what a class excludes from its structural
            state.

    Raises:
        CompileError: the compiler failed.
        InputError: the environment (cache folder, ``CC``) cannot be used; or from ``make``.
    """
    compiler = None if _anew.get() else compiler_for_functions()
    content = None if compiler is None else _content(make, arguments)
    index = None if content is None else _index()
    if compiler is None or content is None or index is None:
        return make(*arguments)
    key = cache.request_key(*_versions(), compiler.identity, hashlib.sha256(content.data).hexdigest())
    entry = index / key
    found: list[T] = _read(entry)
    if not found:
        _, given = content.restored()
        found = [make(*given)]
        _write(entry, found[0])
    return found[0]


def _content(make: Callable[..., Any], arguments: tuple[Any, ...]) -> Content | None:
    """Return the content of ``make`` and its arguments; None if they have none."""
    try:
        return write_content((make, arguments))
    except NoContentError as error:
        _log.debug("%s is not cached: %s", make.__name__, error)
        return None


def _versions() -> tuple[str, ...]:
    """Return the versions of all that takes part in writing expressions, besides lgmpc."""
    imported = (
        f"{name} {getattr(sys.modules.get(name), '__version__', '')}" for name in ("numpy", "scipy", "pinocchio")
    )
    return (sys.version, platform.machine(), casadi.CasadiMeta.version(), *imported)


def _index() -> Path | None:
    """Return the folder of the entries that this process's sources made; None if they are not known.

    Raises:
        InputError: others may write to it.
    """
    sources = _sources()
    try:
        return (
            None
            if sources is None
            else cache.private_folder(cache.private_folder(cache.cache_folder() / "kernels") / sources)
        )
    except OSError as error:
        _log.debug("no index: %s", error)
        return None


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
    """Return the value of an entry, as a list of one; an empty list if there is none that can be used."""
    data = cache.read_private(entry) or b""
    try:
        if hashlib.sha256(data[_DIGEST:]).digest() != data[:_DIGEST]:
            raise NoContentError("its content is not what was written")
        return [read_content(data[_DIGEST:], _library)]
    except (NoContentError, OSError) as error:  # a library that it names is gone, or damaged
        _log.debug("index entry %s is made again: %s", entry.name, error)
        cache.discard(entry)
        return []


def _write(entry: Path, value: Any) -> None:
    """Add an entry, unless the sources changed; a cache that cannot be written to is left as it is."""
    try:
        if _changed():
            return
        data = write_content(value, _library_name).data
        _keep_youngest(entry.parent.parent, _STATES)
        _keep_youngest(entry.parent, _ENTRIES)
        cache.write_private(entry, hashlib.sha256(data).digest() + data)
    except (NoContentError, OSError) as error:  # what is not written is made again
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
                cache.discard(path)


def _library_name(library: ctypes.CDLL) -> str:
    """Return the name of a library's file, which holds the hash of its bytes."""
    path = Path(library._name)
    if path.parent != cache.cache_folder():
        raise NoContentError(f"{path} is not in the cache")
    return path.name


def _library(name: str) -> ctypes.CDLL:
    if Path(name).name != name:
        raise NoContentError(f"a library {name}")
    return _load(str(cache.cache_folder() / name))


@functools.lru_cache(maxsize=1024)
def _load(path: str) -> ctypes.CDLL:
    if not cache.is_whole(Path(path)):
        raise FileNotFoundError(path)
    return ctypes.CDLL(path)
