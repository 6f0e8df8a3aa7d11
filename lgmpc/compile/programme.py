"""Libraries from other C sources: the functions of a nonlinear programme, and lgmpc's own code."""

from __future__ import annotations

from pathlib import Path

import casadi

from lgmpc.compile.cache import cache_folder, find_entry, make_entry, request_key
from lgmpc.compile.compiler import compiler_for_functions
from lgmpc.compile.native import Progress
from lgmpc.errors import CompileError

__all__ = ["compile_programme", "compile_source"]


def compile_programme(solver: casadi.Function, *, progress: Progress | None = None) -> Path | None:
    """Compile the functions of a solver made by ``casadi.nlpsol``, or find them in the cache.

    Args:
        solver: made from expressions; its name and options determine its functions.
        progress: called with a description of what is being compiled, if anything is.

    Returns:
        A library to pass to ``casadi.nlpsol`` (under the same name) in place of the expressions; None where nothing can
        be compiled.

    Raises:
        CompileError: the compiler failed.
        InputError: the environment (cache folder, ``CC``) cannot be used.
    """
    name = solver.name()
    generator = casadi.CodeGenerator(f"{name}.c", {"with_header": False})
    try:
        for function in (solver.oracle(), *(solver.get_function(part) for part in solver.get_function())):
            generator.add(function)
        source = str(generator.dump())
    except RuntimeError as error:
        raise CompileError(name, "CasADi code generation", str(error)) from error
    return compile_source(name, source, progress=progress)


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
