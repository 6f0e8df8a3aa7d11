"""Machine code: the C source of a CasADi function, libraries in the cache, calls of them."""

from __future__ import annotations

import ctypes
import functools
import logging
import re
import time
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi
import numpy as np

from lgmpc.compile.cache import cache_folder, discard, find_entry, make_entry, request_key
from lgmpc.compile.compiler import Compiler, compiler_for_functions
from lgmpc.compile.simd import LOOP, SCALAR_TRIGONOMETRY, SIMD_IDENTITY, generate_simd, is_scalar_code
from lgmpc.errors import CompileError, InputError
from lgmpc.typing import Array

__all__ = [
    "Progress",
    "aligned_zeros",
    "bind_library",
    "compile_source",
    "generate_source",
    "load_library",
]

Progress = Callable[[str], None]

_log = logging.getLogger("lgmpc.compile")
_ALIGNMENT = 8  # doubles: the widest vectors hold so many
_CODEGEN_VERSION = "4"  # part of every cache key: increase it when the code around CasADi's changes

# CasADi's runtime (dense products, factorisations) consists of loops, 2.7 times faster at -O2 than at the -O1 of the
# long straight-line bodies after it. The pragma is GCC's; clang's -O1 is as fast without one.
_RUNTIME = re.compile(r"^#include <math\.h>\n(.*?)^static int casadi_f\d+\(", re.MULTILINE | re.DOTALL)
_HEADER = "#include <math.h>\n"
_NOT_C = re.compile(r"#error Code generation not supported for (\w+)")
_FAST = '#pragma GCC push_options\n#pragma GCC optimize ("O2")\n'


def generate_source(function: casadi.Function) -> str:
    """Return the C code of the function and of lgmpc's entry point.

    Raises:
        CompileError: CasADi cannot write some part of it in C.
    """
    generator = casadi.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    try:
        generator.add(function)
        code = str(generator.dump())
    except RuntimeError as error:
        raise CompileError(function.name(), "CasADi code generation", str(error)) from error
    missing = _NOT_C.search(code)
    if missing is not None:
        raise CompileError(function.name(), "CasADi code generation", f"{missing[1]} has no C code")
    # Behind the header, whose declarations keep their names.
    code = code.replace(_HEADER, _HEADER + SCALAR_TRIGONOMETRY, 1)
    runtime = _RUNTIME.search(code)
    if runtime is not None:
        start, end = runtime.span(1)
        code = f"{code[:start]}{_FAST}{code[start:end]}#pragma GCC pop_options\n{code[end:]}"
    arguments = "arg, res, (long long int*) frame[4], (double*) frame[5], (int) plan[1]"
    call = f"if ({function.name()}({arguments})) return 1"
    return code + LOOP.format(n_in=function.n_in(), n_out=function.n_out(), call=call)


def _identity(function: casadi.Function) -> str:
    """Return a text that identifies the function, generated in a third of the time of its C code."""
    try:
        return str(function.serialize())
    except RuntimeError:  # CasADi cannot serialise what it calls
        return generate_source(function)


def load_library(
    function: casadi.Function, compiler: Compiler, progress: Progress | None, lanes: bool = False
) -> ctypes.CDLL:
    """Load the function's library from the cache, built first if it is missing, damaged or cannot be loaded.

    Args:
        function: of one stage, dense.
        compiler: of a missing library.
        progress: called with a description of what is being compiled.
        lanes: whether it evaluates several stages at a time; else one after the other.

    Raises:
        CompileError: the function has no C code, or the compiler failed on it, or the result cannot be loaded.
        InputError: the cache folder cannot be used.
    """

    def report(text: str) -> None:
        _log.info(text)
        if progress is not None:
            progress(text)

    name = function.name()
    folder = cache_folder()
    code = (_CODEGEN_VERSION, casadi.CasadiMeta.version(), _FAST, SCALAR_TRIGONOMETRY, *SIMD_IDENTITY, str(lanes))
    key = request_key(compiler.identity, *code, _identity(function))
    entry = find_entry(folder, name, key)
    if entry is not None:
        try:
            return ctypes.CDLL(str(entry))
        except OSError as error:
            _log.warning("cache entry %s does not load (%s): it is built again", entry.name, error)
            discard(entry)

    start, in_lanes = time.perf_counter(), lanes or is_scalar_code(function)
    sources = generate_simd(function, lanes) if in_lanes else (generate_source(function),)
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
    sizes = [ctypes.c_longlong() for _ in range(4)]
    library[f"{name}_work"](*(ctypes.byref(size) for size in sizes))
    n_arg, n_res, n_iw, n_w = (size.value for size in sizes)
    base = np.array([array.ctypes.data for array in memory], dtype=np.uintp)
    slot = library[f"{name}_checkout"]()
    plan = np.array([stages, slot, *steps], dtype=np.int64)
    arg, res = np.zeros(n_arg, dtype=np.uintp), np.zeros(n_res, dtype=np.uintp)
    iw, w = np.zeros(n_iw, dtype=np.int64), aligned_zeros(n_w)
    parts = (base, plan, arg, res, iw, w)
    frame = (ctypes.c_void_p * len(parts))(*(part.ctypes.data for part in parts))
    # The frame contains addresses only: keep the arrays alive as long as the frame.
    frame.keep = (*parts, *memory)  # type: ignore[attr-defined]
    weakref.finalize(frame, library[f"{name}_release"], slot)
    return functools.partial(library.lgmpc_evaluate, ctypes.byref(frame))


def compile_source(name: str, source: str, *, progress: Progress | None = None) -> Path | None:
    """Compile a C source into a library, or find it in the cache.

    Args:
        name: a C identifier, part of the file's name.
        source: one C file; its entry points need default visibility.
        progress: called with a description of what is being compiled, if anything is.

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
        if progress is not None:
            progress(f"compiling '{name}' ({len(source) / 1e6:.1f} MB of C) with {compiler.name}")
        entry = make_entry(folder, name, key, (source,), lambda c, so: compiler.build(c, so, name), lambda: None)
    return entry
