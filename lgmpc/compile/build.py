"""Compilation of functions, for one point or for a whole horizon; interpretation where nothing can be compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi

from lgmpc.compile.compiler import compiler_for_functions
from lgmpc.compile.function import CompiledFunction, Signature, index_of
from lgmpc.compile.native import Progress, bind_library, load_library
from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["compile_function", "compile_functions", "compile_map", "densify_function", "map_function"]


def compile_function(function: casadi.Function, *, progress: Progress | None = None) -> CompiledFunction:
    """Compile a function, or load it from the cache.

    Values that change between calls must be inputs: a change of the expressions compiles again. Without a C compiler
    (with one warning a process), or with ``LGMPC_JIT=0``, the function is interpreted.

    Args:
        function: inputs and outputs of any sparsity; sparse ones become dense.
        progress: called with a description of what is being compiled, when that takes time; it is always logged.

    Returns:
        The function with buffers of its own.

    Raises:
        CompileError: the function has no C code, or the compiler failed on it.
        InputError: the cache folder, ``CC``, ``LGMPC_CFLAGS`` or ``LGMPC_JIT`` cannot be used.
    """
    return _compile(function, None, (), progress)


def compile_map(
    function: casadi.Function, stages: int, *, shared: Sequence[str] = (), progress: Progress | None = None
) -> CompiledFunction:
    """Compile a function for all stages of a horizon in one call, with the loop in C; see :func:`compile_function`.

    The first index of every buffer is the stage: ``(stages, n)`` or ``(stages, rows, columns)``. The machine code
    does not depend on the number of stages.

    Args:
        function: of one stage.
        stages: their number, at least 1.
        shared: names of the inputs that all stages share; their buffers have no stage index.
        progress: as for :func:`compile_function`.

    Raises:
        CompileError: the function has no C code, or the compiler failed on it.
        InputError: ``stages`` is not positive, a name in ``shared`` is no input, or the environment is unusable.
    """
    _check_map(function, stages, shared)
    return _compile(function, stages, tuple(shared), progress)


def compile_functions(
    functions: Sequence[casadi.Function], *, progress: Progress | None = None, jobs: int = 2
) -> tuple[CompiledFunction, ...]:
    """Compile several functions, ``jobs`` compilers at a time; see :func:`compile_function`.

    ``progress`` is called from several threads.
    """
    pool = ThreadPoolExecutor(max_workers=jobs)
    try:
        return tuple(pool.map(lambda function: compile_function(function, progress=progress), functions))
    finally:
        pool.shutdown(cancel_futures=True)


def densify_function(function: casadi.Function) -> casadi.Function:
    """Return the function with dense inputs and outputs (itself if they are dense)."""
    inputs, outputs = range(function.n_in()), range(function.n_out())
    if all(function.sparsity_in(i).is_dense() for i in inputs) and all(
        function.sparsity_out(i).is_dense() for i in outputs
    ):
        return function
    # An SX function remains one flat list of scalar operations; any other is called from a wrapper.
    symbol: Any = casadi.SX.sym if function.is_a("SXFunction") else casadi.MX.sym
    names = function.name_in()
    arguments = [symbol(names[i], *function.size_in(i)) for i in inputs]
    results: list[Any] = function.call([casadi.project(a, function.sparsity_in(i)) for i, a in enumerate(arguments)])
    return casadi.Function(function.name(), arguments, [casadi.densify(r) for r in results], names, function.name_out())


def map_function(function: casadi.Function, stages: int, shared: Sequence[str] = ()) -> casadi.Function:
    """Return the CasADi function of a whole horizon, one column a stage.

    For use within other CasADi expressions, such as a nonlinear programme. To evaluate a horizon from Python,
    :func:`compile_map` copies less, and its machine code does not depend on the number of stages.

    Args:
        function: of one stage.
        stages: their number, at least 1.
        shared: names of the inputs that all stages share; they keep their size.

    Returns:
        A function ``<name>_map<stages>``; an argument ``(rows, columns)`` becomes ``(rows, stages * columns)``.

    Raises:
        InputError: ``stages`` is not positive, or a name in ``shared`` is no input.
    """
    _check_map(function, stages, shared)
    indices = [function.index_in(name) for name in shared]
    return densify_function(function).map(f"{function.name()}_map{stages}", "serial", stages, indices, [])


def _check_map(function: casadi.Function, stages: int, shared: Sequence[str]) -> None:
    if stages < 1:
        raise InputError("stages", stages, "at least one")
    for name in shared:
        index_of(f"shared input of '{function.name()}'", name, tuple(function.name_in()))


def _compile(
    function: casadi.Function, stages: int | None, shared: tuple[str, ...], progress: Progress | None
) -> CompiledFunction:
    dense = densify_function(function)
    signature = Signature.of(dense, stages, shared)
    compiler = compiler_for_functions()
    if compiler is not None:
        library = load_library(dense, compiler, progress)
        return CompiledFunction(signature, functools.partial(bind_library, library), compiled=True)
    horizon = dense if stages is None else map_function(dense, stages, shared)
    return CompiledFunction(signature, functools.partial(_bind_interpreter, horizon), compiled=False)


def _bind_interpreter(function: casadi.Function, signature: Signature, memory: Sequence[Array]) -> Callable[[], int]:
    buffer: Any
    buffer, evaluate = function.buffer()
    n_in = len(signature.inputs)
    for i, array in enumerate(memory[:n_in]):
        buffer.set_arg(i, array.data)
    for i, array in enumerate(memory[n_in:]):
        buffer.set_res(i, array.data)

    def call() -> int:
        try:
            evaluate()
        except RuntimeError:
            return 1
        return int(buffer.ret())

    return call
