"""Compiled functions: preallocated buffers around machine code, or around CasADi's interpreter."""

from __future__ import annotations

import ctypes
import functools
import logging
import time
import warnings
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from lgmpc.compile.cache import cache_folder, discard, find_entry, make_entry, request_key
from lgmpc.compile.compiler import Compiler, find_compiler, jit_enabled
from lgmpc.errors import CompileError, InputError
from lgmpc.typing import Array

__all__ = [
    "CompiledFunction",
    "compile_function",
    "compile_functions",
    "densify_function",
    "map_function",
    "stage_view",
]

Progress = Callable[[str], None]

_log = logging.getLogger("lgmpc.compile")
_CODEGEN_VERSION = "1"  # part of every cache key: raise it when the code around CasADi's changes
_warned = False

# One pointer as the only argument costs half of what CasADi's five do to pass from Python.
_ENTRY = """
CASADI_SYMBOL_EXPORT int lgmpc_evaluate(void** frame) {{
  return {name}((const double**) frame[0], (double**) frame[1], (long long int*) frame[2], (double*) frame[3],
    *(const int*) frame[4]);
}}
"""


@dataclass(frozen=True)
class _Signature:
    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_shapes: tuple[tuple[int, ...], ...]
    output_shapes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, function: casadi.Function) -> _Signature:
        return cls(
            function.name(),
            tuple(function.name_in()),
            tuple(function.name_out()),
            tuple(_shape(function.size_in(i)) for i in range(function.n_in())),
            tuple(_shape(function.size_out(i)) for i in range(function.n_out())),
        )


def _shape(size: tuple[int, int]) -> tuple[int, ...]:
    return (size[0],) if size[1] == 1 else size


# Given the buffers, an evaluator returns a call without arguments that returns CasADi's code (0 = done).
_Bind = Callable[[Sequence[Array], Sequence[Array]], Callable[[], int]]


class CompiledFunction:
    """A CasADi function evaluated on buffers that it owns.

    Write into :attr:`inputs`, call :meth:`run`, read :attr:`outputs`. One instance is for one thread at a time (the
    machine code runs without Python's global lock): give every other thread a :meth:`clone`. Made by
    :func:`compile_function`.

    Attributes:
        name: of the CasADi function.
        compiled: whether it is machine code; otherwise CasADi interprets it.
        inputs: one dense, Fortran-ordered float64 array per input, zero at first; column vectors have shape ``(n,)``,
            everything else ``(rows, columns)``. Write into them, never replace them.
        outputs: results of the last :meth:`run`, laid out in the same way; the next run overwrites them.
    """

    __slots__ = ("__weakref__", "_bind", "_evaluate", "_signature", "compiled", "inputs", "name", "outputs")

    def __init__(self, signature: _Signature, bind: _Bind, compiled: bool) -> None:
        self.name = signature.name
        self.compiled = compiled
        self.inputs: tuple[Array, ...] = tuple(np.zeros(shape, order="F") for shape in signature.input_shapes)
        self.outputs: tuple[Array, ...] = tuple(np.zeros(shape, order="F") for shape in signature.output_shapes)
        self._signature = signature
        self._bind = bind
        self._evaluate = bind(self.inputs, self.outputs)

    def run(self) -> None:
        """Evaluate inputs to outputs, without allocation. NaN in the inputs gives NaN in the outputs, not an error.

        Raises:
            RuntimeError: the function itself reported failure (a solver or an interpolation inside it, never plain
                arithmetic); the outputs are then undefined.
        """
        if self._evaluate():
            raise RuntimeError(f"evaluation of '{self.name}' failed")

    def __call__(self, *args: object) -> tuple[Array, ...]:
        """Copy the arguments in, run, and return copies of the outputs.

        Args:
            args: one per input: an array of the input's size (a column may be ``(n,)`` or ``(n, 1)``) or a number,
                which fills it.

        Raises:
            InputError: wrong number of arguments or wrong shape.
        """
        if len(args) != len(self.inputs):
            expected = f"{len(self.inputs)}: {', '.join(self._signature.inputs)}"
            raise InputError(f"arguments of '{self.name}'", len(args), expected)
        for name, buffer, arg in zip(self._signature.inputs, self.inputs, args, strict=True):
            value = np.asarray(arg, dtype=np.float64)
            if value.shape != buffer.shape and value.ndim > 0:
                if buffer.ndim != 1 or value.shape != (buffer.size, 1):
                    raise InputError(f"{self.name}: {name}", f"shape {value.shape}", f"shape {buffer.shape}")
                value = value[:, 0]
            buffer[...] = value
        self.run()
        return tuple(output.copy(order="F") for output in self.outputs)

    def input(self, name: str) -> Array:
        """The buffer of the input with this name.

        Raises:
            InputError: no such input.
        """
        return self.inputs[_index(f"input of '{self.name}'", name, self._signature.inputs)]

    def output(self, name: str) -> Array:
        """The buffer of the output with this name.

        Raises:
            InputError: no such output.
        """
        return self.outputs[_index(f"output of '{self.name}'", name, self._signature.outputs)]

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return self._signature.inputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return self._signature.outputs

    def clone(self) -> CompiledFunction:
        """Return one on the same machine code with buffers of its own, the inputs' values copied."""
        twin = CompiledFunction(self._signature, self._bind, self.compiled)
        for mine, theirs in zip(self.inputs, twin.inputs, strict=True):
            theirs[...] = mine
        return twin

    def __repr__(self) -> str:
        arguments = ", ".join(
            f"{n}{list(s)}" for n, s in zip(self._signature.inputs, self._signature.input_shapes, strict=True)
        )
        how = "compiled" if self.compiled else "interpreted"
        return f"CompiledFunction({self.name}({arguments}) -> ({', '.join(self._signature.outputs)}), {how})"


def _index(what: str, name: str, names: tuple[str, ...]) -> int:
    try:
        return names.index(name)
    except ValueError:
        raise InputError(what, repr(name), "one of its names", names) from None


def compile_function(function: casadi.Function, *, progress: Progress | None = None) -> CompiledFunction:
    """Build (or find in the cache) the machine code of a function.

    Everything that changes between calls belongs among the function's inputs: only a change of its expressions compiles
    again. Without a C compiler, or with ``LGMPC_JIT=0``, the function is interpreted; the former warns once a process.

    Args:
        function: inputs and outputs of any sparsity; sparse ones become dense.
        progress: told in a few words what is being compiled, when that takes time; the log is told in any case.

    Returns:
        The function with buffers of its own.

    Raises:
        CompileError: the function has no C code, or the compiler failed on it.
        InputError: the cache folder, ``CC``, ``LGMPC_CFLAGS`` or ``LGMPC_JIT`` cannot be used.
    """
    dense = densify_function(function)
    signature = _Signature.of(dense)
    compiler = find_compiler() if jit_enabled() else None
    if compiler is None:
        if jit_enabled():
            _warn_once()
        return CompiledFunction(signature, functools.partial(_bind_interpreter, dense), compiled=False)
    library = _load(dense, compiler, progress)
    return CompiledFunction(signature, functools.partial(_bind_library, signature.name, library), compiled=True)


def compile_functions(
    functions: Sequence[casadi.Function], *, progress: Progress | None = None, jobs: int = 2
) -> tuple[CompiledFunction, ...]:
    """Compile several functions, ``jobs`` compilers at a time; see :func:`compile_function`."""
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        return tuple(pool.map(lambda function: compile_function(function, progress=progress), functions))


def densify_function(function: casadi.Function) -> casadi.Function:
    """The same function with dense inputs and outputs (itself if they are so already)."""
    inputs, outputs = range(function.n_in()), range(function.n_out())
    if all(function.sparsity_in(i).is_dense() for i in inputs) and all(
        function.sparsity_out(i).is_dense() for i in outputs
    ):
        return function
    # An SX function stays one flat list of scalar operations; anything else is called from a wrapper.
    symbol: Any = casadi.SX.sym if function.is_a("SXFunction") else casadi.MX.sym
    names = function.name_in()
    arguments = [symbol(names[i], *function.size_in(i)) for i in inputs]
    results: list[Any] = function.call([casadi.project(a, function.sparsity_in(i)) for i, a in enumerate(arguments)])
    return casadi.Function(function.name(), arguments, [casadi.densify(r) for r in results], names, function.name_out())


def map_function(function: casadi.Function, n: int, shared: Sequence[str] = ()) -> casadi.Function:
    """A function that evaluates all ``n`` stages of a horizon in one call, by a loop in C.

    Stage ``k`` reads and writes the ``k``-th block of columns of every argument, so an input ``(rows, columns)``
    becomes ``(rows, n * columns)``: :func:`stage_view` shows such a buffer with the stage as first index. The generated
    code does not grow with ``n``.

    Args:
        function: of one stage.
        n: number of stages, at least 1.
        shared: names of the inputs that are the same for all stages; they keep their size.

    Returns:
        The mapped function, named ``<function>_map<n>``.

    Raises:
        InputError: ``n`` is not positive, or a name in ``shared`` is no input.
    """
    if n < 1:
        raise InputError("n", n, "at least one stage")
    names = tuple(function.name_in())
    indices = [_index(f"shared input of '{function.name()}'", name, names) for name in shared]
    stage = densify_function(function)
    mapped = stage.map(f"{stage.name()}_map{n}", "serial", n, indices, [])
    # map() leaves the names out when inputs are shared: put them back.
    arguments = [casadi.MX.sym(name, *mapped.size_in(i)) for i, name in enumerate(names)]
    return casadi.Function(mapped.name(), arguments, mapped.call(arguments), list(names), stage.name_out())


def stage_view(buffer: Array, n: int) -> Array:
    """Show a buffer of a mapped function with the stage as first index, without copying.

    Args:
        buffer: ``(rows, n * columns)`` Fortran-ordered (``(rows,)`` if ``n`` and ``columns`` are 1), as
            :attr:`CompiledFunction.inputs` and :attr:`CompiledFunction.outputs` hold.
        n: number of stages.

    Returns:
        ``(n, rows)`` if every stage is one column, else ``(n, rows, columns)``; writing into it writes into the buffer.

    Raises:
        InputError: the columns do not divide into ``n`` blocks, or the buffer is not Fortran-ordered.
    """
    rows, total = buffer.shape[0], 1 if buffer.ndim == 1 else buffer.shape[1]
    if n < 1 or total % n or not buffer.flags.f_contiguous:
        raise InputError("buffer", f"shape {buffer.shape}", f"a Fortran-ordered array of {n} equal blocks of columns")
    columns = total // n
    flat = buffer.reshape(-1, order="F")
    return flat.reshape(n, rows) if columns == 1 else flat.reshape(n, columns, rows).transpose(0, 2, 1)


def _warn_once() -> None:
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            "no C compiler found: functions are interpreted, 10 to 20 times slower. Install gcc (apt install gcc) or "
            "clang, or name a compiler in CC; LGMPC_JIT=0 interprets without this warning",
            RuntimeWarning,
            stacklevel=3,
        )


def _bind_interpreter(
    function: casadi.Function, inputs: Sequence[Array], outputs: Sequence[Array]
) -> Callable[[], int]:
    buffer: Any
    buffer, evaluate = function.buffer()
    for i, array in enumerate(inputs):
        buffer.set_arg(i, array.reshape(-1, order="F").data)
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.reshape(-1, order="F").data)

    def call() -> int:
        evaluate()
        return int(buffer.ret())

    return call


def _bind_library(
    name: str, library: ctypes.CDLL, inputs: Sequence[Array], outputs: Sequence[Array]
) -> Callable[[], int]:
    sizes = [ctypes.c_longlong() for _ in range(4)]
    library[f"{name}_work"](*(ctypes.byref(size) for size in sizes))
    n_arg, n_res, n_iw, n_w = (size.value for size in sizes)
    arg = (ctypes.c_void_p * max(n_arg, 1))(*(array.ctypes.data for array in inputs))
    res = (ctypes.c_void_p * max(n_res, 1))(*(array.ctypes.data for array in outputs))
    iw, w = np.zeros(n_iw, dtype=np.int64), np.zeros(n_w)
    memory = ctypes.c_int(library[f"{name}_checkout"]())
    addresses = (ctypes.addressof(arg), ctypes.addressof(res), iw.ctypes.data, w.ctypes.data, ctypes.addressof(memory))
    frame = (ctypes.c_void_p * 5)(*addresses)
    call = functools.partial(library.lgmpc_evaluate, ctypes.byref(frame))
    # The frame holds addresses only: whatever it points at has to live as long as the call.
    frame.keep = (arg, res, iw, w, memory, tuple(inputs), tuple(outputs))  # type: ignore[attr-defined]
    weakref.finalize(frame, library[f"{name}_release"], memory.value)
    return call


def _generate(function: casadi.Function) -> str:
    generator = casadi.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    try:
        generator.add(function)
        code = str(generator.dump())
    except RuntimeError as error:
        raise CompileError(function.name(), "CasADi code generation", str(error)) from error
    return code + _ENTRY.format(name=function.name())


def _load(function: casadi.Function, compiler: Compiler, progress: Progress | None) -> ctypes.CDLL:
    """Load the function's library from the cache, building it first where it is missing, damaged or refused."""

    def tell(text: str) -> None:
        _log.info(text)
        if progress is not None:
            progress(text)

    name = function.name()
    source = _generate(function)
    folder = cache_folder()
    key = request_key(_CODEGEN_VERSION, casadi.CasadiMeta.version(), compiler.identity, source)
    entry = find_entry(folder, name, key)
    if entry is not None:
        try:
            return ctypes.CDLL(str(entry))
        except OSError as error:
            _log.warning("cache entry %s does not load (%s): it is built again", entry.name, error)
            discard(entry)

    start = time.perf_counter()
    tell(f"compiling '{name}' ({len(source) / 1e6:.1f} MB of C) with {compiler.name}")
    entry = make_entry(
        folder,
        name,
        key,
        source,
        lambda code, library: compiler.build(code, library, name),
        lambda: tell(f"waiting for another process that is compiling '{name}'"),
    )
    try:
        library = ctypes.CDLL(str(entry))
    except OSError as error:
        remedy = "is the cache on a volume that forbids execution? Choose another with LGMPC_CACHE_DIR"
        raise CompileError(name, f"loading {entry}", f"{error}; {remedy}") from error
    tell(f"compiled '{name}' in {time.perf_counter() - start:.1f} s")
    return library
