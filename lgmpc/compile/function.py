"""Compiled functions: preallocated buffers around machine code, or around CasADi's interpreter."""

from __future__ import annotations

import ctypes
import functools
import logging
import math
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
    "compile_map",
    "densify_function",
    "map_function",
]

Progress = Callable[[str], None]

_log = logging.getLogger("lgmpc.compile")
_CODEGEN_VERSION = "1"  # part of every cache key: raise it when the code around CasADi's changes
_warned = False

# One pointer as the only argument costs half of what CasADi's five do to pass from Python, and the loop over stages is
# here rather than in casadi.Function.map: that copies every output twice and every shared input once per stage.
_ENTRY = """
CASADI_SYMBOL_EXPORT int lgmpc_evaluate(void** frame) {{
  double** base = (double**) frame[0];
  const long long int* plan = (const long long int*) frame[1];
  const double** arg = (const double**) frame[2];
  double** res = (double**) frame[3];
  long long int k;
  int i, status;
  for (k = 0; k < plan[0]; ++k) {{
    for (i = 0; i < {n_in}; ++i) arg[i] = base[i] + k * plan[2 + i];
    for (i = 0; i < {n_out}; ++i) res[i] = base[{n_in} + i] + k * plan[2 + {n_in} + i];
    status = {name}(arg, res, (long long int*) frame[4], (double*) frame[5], (int) plan[1]);
    if (status) return status;
  }}
  return 0;
}}
"""


@dataclass(frozen=True)
class _Argument:
    """Name, shape and batch of one input or output; ``stages`` is None where there is one value for all stages."""

    name: str
    shape: tuple[int, ...]
    stages: int | None

    @property
    def size(self) -> int:
        """Number of entries of one stage."""
        return math.prod(self.shape)

    def allocate(self) -> tuple[Array, Array]:
        """Memory in the order of CasADi (stage after stage, column after column), and the view of it for people."""
        memory = np.zeros(self.size * (self.stages or 1))
        if self.stages is None:
            return memory, memory.reshape(self.shape, order="F")
        view = memory.reshape((self.stages, *reversed(self.shape)))
        return memory, view.transpose(0, *range(len(self.shape), 0, -1))


@dataclass(frozen=True)
class _Signature:
    """What a compiled function takes and gives, for a whole horizon if ``stages`` is above 1."""

    name: str
    stages: int
    inputs: tuple[_Argument, ...]
    outputs: tuple[_Argument, ...]

    @classmethod
    def of(cls, function: casadi.Function, stages: int | None = None, shared: Sequence[str] = ()) -> _Signature:
        def describe(name: str, size: tuple[int, int]) -> _Argument:
            shape = (size[0],) if size[1] == 1 else size
            return _Argument(name, shape, None if name in shared else stages)

        return cls(
            function.name(),
            stages or 1,
            tuple(describe(name, function.size_in(i)) for i, name in enumerate(function.name_in())),
            tuple(describe(name, function.size_out(i)) for i, name in enumerate(function.name_out())),
        )

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(argument.name for argument in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        return tuple(argument.name for argument in self.outputs)


# Given the memory of all inputs and outputs, returns a call without arguments that returns CasADi's code (0 = done).
_Bind = Callable[[_Signature, Sequence[Array]], Callable[[], int]]


class CompiledFunction:
    """A CasADi function evaluated on buffers that it owns.

    Write into :attr:`inputs`, call :meth:`run`, read :attr:`outputs`. One instance is for one thread at a time (the
    machine code runs without Python's global lock): give every other thread a :meth:`clone`. Made by
    :func:`compile_function`.

    Attributes:
        name: of the CasADi function.
        compiled: whether it is machine code; otherwise CasADi interprets it.
        inputs: one dense float64 array per input, zero at first: ``(n,)`` for a column, else ``(rows, columns)`` in
            Fortran order; for a horizon (:func:`compile_map`) with the stage as additional first index. Write into
            them, never replace them.
        outputs: results of the last :meth:`run`, laid out in the same way; the next run overwrites them.
    """

    __slots__ = ("__weakref__", "_bind", "_evaluate", "_signature", "compiled", "inputs", "name", "outputs")

    def __init__(self, signature: _Signature, bind: _Bind, compiled: bool) -> None:
        self.name = signature.name
        self.compiled = compiled
        inputs = [argument.allocate() for argument in signature.inputs]
        outputs = [argument.allocate() for argument in signature.outputs]
        self.inputs: tuple[Array, ...] = tuple(view for _, view in inputs)
        self.outputs: tuple[Array, ...] = tuple(view for _, view in outputs)
        self._signature = signature
        self._bind = bind
        self._evaluate = bind(signature, [memory for memory, _ in inputs + outputs])

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
            expected = f"{len(self.inputs)}: {', '.join(self.input_names)}"
            raise InputError(f"arguments of '{self.name}'", len(args), expected)
        for name, buffer, arg in zip(self.input_names, self.inputs, args, strict=True):
            value = np.asarray(arg, dtype=np.float64)
            if value.shape == (*buffer.shape, 1):
                value = value[..., 0]
            if value.ndim > 0 and value.shape != buffer.shape:
                raise InputError(f"{self.name}: {name}", f"shape {value.shape}", f"shape {buffer.shape}")
            buffer[...] = value
        self.run()
        return tuple(output.copy(order="K") for output in self.outputs)

    def input(self, name: str) -> Array:
        """The buffer of the input with this name.

        Raises:
            InputError: no such input.
        """
        return self.inputs[_index(f"input of '{self.name}'", name, self.input_names)]

    def output(self, name: str) -> Array:
        """The buffer of the output with this name.

        Raises:
            InputError: no such output.
        """
        return self.outputs[_index(f"output of '{self.name}'", name, self.output_names)]

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return self._signature.input_names

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return self._signature.output_names

    def clone(self) -> CompiledFunction:
        """Return one on the same machine code with buffers of its own, the inputs' values copied."""
        twin = CompiledFunction(self._signature, self._bind, self.compiled)
        for mine, theirs in zip(self.inputs, twin.inputs, strict=True):
            theirs[...] = mine
        return twin

    def __repr__(self) -> str:
        given = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.input_names, self.inputs, strict=True))
        made = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.output_names, self.outputs, strict=True))
        return f"CompiledFunction({self.name}: ({given}) -> ({made}), {'compiled' if self.compiled else 'interpreted'})"


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
    return _compile(function, None, (), progress)


def compile_map(
    function: casadi.Function, stages: int, *, shared: Sequence[str] = (), progress: Progress | None = None
) -> CompiledFunction:
    """Like :func:`compile_function`, for all stages of a horizon in one call: the loop runs in C.

    Every buffer gets the stage as its first index: ``(stages, n)`` or ``(stages, rows, columns)``. The machine code
    does not depend on the number of stages: another horizon compiles nothing.

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


def map_function(function: casadi.Function, stages: int, shared: Sequence[str] = ()) -> casadi.Function:
    """The CasADi function of a whole horizon, its stages side by side in columns.

    It is for use within other CasADi expressions (a nonlinear programme, say). To evaluate a horizon from Python,
    :func:`compile_map` copies less, and its machine code serves every horizon.

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
        _index(f"shared input of '{function.name()}'", name, tuple(function.name_in()))


def _compile(
    function: casadi.Function, stages: int | None, shared: tuple[str, ...], progress: Progress | None
) -> CompiledFunction:
    dense = densify_function(function)
    signature = _Signature.of(dense, stages, shared)
    compiler = find_compiler() if jit_enabled() else None
    if compiler is not None:
        library = _load(dense, compiler, progress)
        return CompiledFunction(signature, functools.partial(_bind_library, library), compiled=True)
    if jit_enabled():
        _warn_once()
    horizon = dense if stages is None else map_function(dense, stages, shared)
    return CompiledFunction(signature, functools.partial(_bind_interpreter, horizon), compiled=False)


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


def _bind_interpreter(function: casadi.Function, signature: _Signature, memory: Sequence[Array]) -> Callable[[], int]:
    buffer: Any
    buffer, evaluate = function.buffer()
    n_in = len(signature.inputs)
    for i, array in enumerate(memory[:n_in]):
        buffer.set_arg(i, array.data)
    for i, array in enumerate(memory[n_in:]):
        buffer.set_res(i, array.data)

    def call() -> int:
        evaluate()
        return int(buffer.ret())

    return call


def _bind_library(library: ctypes.CDLL, signature: _Signature, memory: Sequence[Array]) -> Callable[[], int]:
    name = signature.name
    sizes = [ctypes.c_longlong() for _ in range(4)]
    library[f"{name}_work"](*(ctypes.byref(size) for size in sizes))
    n_arg, n_res, n_iw, n_w = (size.value for size in sizes)
    base = np.array([array.ctypes.data for array in memory], dtype=np.uintp)
    steps = [0 if argument.stages is None else argument.size for argument in (*signature.inputs, *signature.outputs)]
    slot = library[f"{name}_checkout"]()
    plan = np.array([signature.stages, slot, *steps], dtype=np.int64)
    arg, res = np.zeros(n_arg, dtype=np.uintp), np.zeros(n_res, dtype=np.uintp)
    iw, w = np.zeros(n_iw, dtype=np.int64), np.zeros(n_w)
    parts = (base, plan, arg, res, iw, w)
    frame = (ctypes.c_void_p * len(parts))(*(part.ctypes.data for part in parts))
    # The frame holds addresses only: whatever they point at has to live as long as the frame.
    frame.keep = (*parts, *memory)  # type: ignore[attr-defined]
    weakref.finalize(frame, library[f"{name}_release"], slot)
    return functools.partial(library.lgmpc_evaluate, ctypes.byref(frame))


def _generate(function: casadi.Function) -> str:
    generator = casadi.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    try:
        generator.add(function)
        code = str(generator.dump())
    except RuntimeError as error:
        raise CompileError(function.name(), "CasADi code generation", str(error)) from error
    return code + _ENTRY.format(name=function.name(), n_in=function.n_in(), n_out=function.n_out())


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
