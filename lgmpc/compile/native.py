"""Machine code: libraries of functions in the cache, and calls of them."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path

import casadi
import numpy as np

from lgmpc.compile.cache import cache_folder, discard, find_entry, make_entry, request_key
from lgmpc.compile.compiler import Compiler, compiler_for_functions
from lgmpc.compile.simd import SIMD_IDENTITY, generate_simd
from lgmpc.errors import CompileError, InputError
from lgmpc.typing import Array

__all__ = [
    "aligned_zeros",
    "bind_library",
    "compile_source",
    "load_library",
    "reporting",
]

_log = logging.getLogger("lgmpc.compile")
_listeners: ContextVar[tuple[Callable[[str], object], ...]] = ContextVar("lgmpc_compile_listeners", default=())
_ALIGNMENT = 8  # doubles: the widest vectors hold so many


@contextlib.contextmanager
def reporting(listener: Callable[[str], object]) -> Iterator[None]:
    """Call a function with a description of all that this thread compiles within the block; blocks may be nested.

        with reporting(print):
            solver = Fddp(problem)

    The log ``lgmpc.compile`` has the descriptions too, at the level INFO.
    """
    token = _listeners.set((*_listeners.get(), listener))
    try:
        yield
    finally:
        _listeners.reset(token)


def report(text: str) -> None:
    """Describe what is being compiled."""
    _log.info(text)
    for listener in _listeners.get():
        listener(text)


def load_library(function: casadi.Function, compiler: Compiler, lanes: bool = False) -> ctypes.CDLL:
    """Load the function's library from the cache, built first if it is missing, damaged or cannot be loaded.

    Args:
        function: of one stage, dense, of scalar operations.
        compiler: of a missing library.
        lanes: whether it evaluates several stages at a time; else one after the other.

    Raises:
        CompileError: it is not a list of scalar operations, the compiler failed on it, or the result cannot be loaded.
        InputError: the cache folder cannot be used.
    """
    name = function.name()
    folder = cache_folder()
    code = (casadi.CasadiMeta.version(), *SIMD_IDENTITY, str(lanes), str(function.serialize()))
    key = request_key(compiler.identity, *code)
    entry = find_entry(folder, name, key)
    if entry is not None:
        try:
            return ctypes.CDLL(str(entry))
        except OSError as error:
            _log.warning("cache entry %s does not load (%s): it is built again", entry.name, error)
            discard(entry)

    start, sources = time.perf_counter(), generate_simd(function, lanes)
    size = sum(len(source) for source in sources)
    report(f"compiling '{name}' ({size / 1e6:.1f} MB of C) with {compiler.name}; once, later runs load it")

    def make() -> Path:
        return make_entry(
            folder,
            name,
            key,
            sources,
            lambda files, library: compiler.build(files, library, name, report),
            lambda: report(f"waiting for another process that is compiling '{name}'"),
        )

    entry = make()
    try:
        library = ctypes.CDLL(str(entry if entry.exists() else make()))  # the cache may have been removed meanwhile
    except OSError as error:
        remedy = "is the cache on a volume that forbids execution? Choose another with LGMPC_CACHE_DIR"
        raise CompileError(name, f"loading {entry}", f"{error}; {remedy}") from error
    report(f"compiled '{name}' in {time.perf_counter() - start:.1f} s")
    return library


def aligned_zeros(size: int) -> Array:
    """Return work memory (size,) at an address that is a multiple of the vectors' size."""
    if not isinstance(size, (int, np.integer)) or size < 0:
        raise InputError("size", f"{size!r:.80}", "a whole number, at least 0")
    work = np.zeros(size + _ALIGNMENT)
    start = -(work.ctypes.data // work.itemsize) % _ALIGNMENT
    return work[start : start + size]


def bind_library(
    library: ctypes.CDLL, name: str, memory: Sequence[Array], stages: int, steps: Sequence[int]
) -> Callable[[], int]:
    """Return the call that evaluates a library's function.

    Args:
        library: of :func:`load_library`.
        name: of the function.
        memory: of its inputs, then outputs.
        stages: how often it is evaluated.
        steps: each array's numbers from one stage to the next.
    """
    measure = library[f"{name}_lanes_work"]
    measure.restype = ctypes.c_longlong
    base = np.array([array.ctypes.data for array in memory], dtype=np.uintp)
    plan = np.array([stages, *steps], dtype=np.int64)
    parts = (base, plan, np.zeros_like(base), aligned_zeros(measure()))
    frame = (ctypes.c_void_p * len(parts))(*(part.ctypes.data for part in parts))
    # The frame contains addresses only: keep the arrays alive as long as the frame.
    frame.keep = (*parts, *memory)  # type: ignore[attr-defined]
    return functools.partial(library.lgmpc_evaluate, ctypes.byref(frame))


def compile_source(name: str, source: str) -> Path | None:
    """Compile a C source into a library, or find it in the cache.

    Args:
        name: a C identifier, part of the file's name.
        source: one C file; its entry points need default visibility.

    Returns:
        The library; None without a compiler, or with ``LGMPC_JIT=0``.

    Raises:
        CompileError: the compiler failed.
        InputError: the environment (cache folder, ``CC``) cannot be used.
    """
    compiler = compiler_for_functions()
    if compiler is None:
        return None
    folder = cache_folder()
    key = request_key("source", casadi.CasadiMeta.version(), compiler.identity, source)
    entry = find_entry(folder, name, key)
    if entry is None:
        report(f"compiling '{name}' ({len(source) / 1e6:.1f} MB of C) with {compiler.name}")
        entry = make_entry(folder, name, key, (source,), lambda c, so: compiler.build(c, so, name), lambda: None)
    return entry
