"""Machine code: libraries of functions in the cache, and calls of them."""

import contextlib
import ctypes
import functools
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from lgmpc.compile.cache import cache_folder, discard, find_entry, make_entry, request_key
from lgmpc.compile.compiler import Compiler, compiler_for_functions
from lgmpc.compile.simd import SIMD_IDENTITY, generate_simd
from lgmpc.errors import CompileError, InputError
from lgmpc.typing import Array

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
    code = (casadi.CasadiMeta.version(), *SIMD_IDENTITY, str(lanes), str(function.serialize()))
    return _load(function.name(), code, lambda: generate_simd(function, lanes), compiler)


def compile_source(name: str, source: str) -> ctypes.CDLL | None:
    """Load the library of a C source, as :func:`load_library` does.

    Args:
        name: a C identifier, part of the file's name.
        source: one C file; its entry points need default visibility.

    Returns:
        The library; None without a compiler, or with ``LGMPC_JIT=0``.

    Raises:
        CompileError: the compiler failed, or the result cannot be loaded.
        InputError: the environment (cache folder, ``CC``) cannot be used.
    """
    compiler = compiler_for_functions()
    return None if compiler is None else _load(name, ("source", source), lambda: (source,), compiler)


def _load(name: str, content: Sequence[str], write: Callable[[], Sequence[str]], compiler: Compiler) -> ctypes.CDLL:
    """Load a library from the cache, built first if necessary.

    Args:
        name: of the function.
        content: what determines its code.
        write: returns its C files.
        compiler: of a missing library.
    """
    folder, key = cache_folder(), request_key(compiler.identity, *content)
    entry = find_entry(folder, name, key)
    if entry is not None:
        try:
            return _with_sources(ctypes.CDLL(str(entry)), write)
        except OSError as error:
            _log.warning("cache entry %s does not load (%s): it is built again", entry.name, error)
            discard(entry)

    start, sources = time.perf_counter(), write()
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
    return _with_sources(library, write)


def _with_sources(library: ctypes.CDLL, write: Callable[[], Sequence[str]]) -> ctypes.CDLL:
    """Return the library with the function that writes its C files."""
    library.sources = write  # type: ignore[attr-defined]
    return library


_functions: dict[int, tuple[ctypes.CDLL, str]] = {}  # by their addresses, for images of the memory


def address_of(library: ctypes.CDLL, symbol: str) -> int:
    """Return the address of a library's function, which :func:`function_at` recognises from then on."""
    address = ctypes.cast(library[symbol], ctypes.c_void_p).value
    assert address is not None
    _functions[address] = library, symbol
    return address


def function_at(address: int) -> tuple[ctypes.CDLL, str] | None:
    """Return the library and name of the function at an address of :func:`address_of`."""
    return _functions.get(address)


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
    frame = frame_of(base, plan, np.zeros_like(base), aligned_zeros(measure()), keep=memory)
    address_of(library, "lgmpc_evaluate")
    return functools.partial(library.lgmpc_evaluate, ctypes.byref(frame))


def frame_of(*parts: Array | NDArray[Any] | ctypes.Array[Any], keep: Sequence[object] = ()) -> Any:
    """Return the addresses of arrays and other frames, the argument of machine code; these live as long as it does."""
    addresses = (ctypes.addressof(p) if isinstance(p, ctypes.Array) else p.ctypes.data for p in parts)
    frame = (ctypes.c_void_p * len(parts))(*addresses)
    frame.keep = (*parts, *keep)  # type: ignore[attr-defined]
    return frame


def sequence_of(*calls: Callable[[], int]) -> Any:
    """Return the addresses of the functions and frames of calls of machine code, to be made in this order."""
    sequence = (ctypes.c_void_p * (2 * len(calls)))()
    for k, call in enumerate(calls):
        assert isinstance(call, functools.partial)
        function: Any = call.func
        sequence[2 * k] = ctypes.cast(function, ctypes.c_void_p).value
        sequence[2 * k + 1] = ctypes.addressof(call.args[0]._obj)
    sequence.keep = calls  # type: ignore[attr-defined]
    return sequence
