"""A function on preallocated buffers, for one point or for a whole horizon."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi
import numpy as np

from lgmpc.compile.kernel import Argument, StageKernel, check_array, check_stages, index_of
from lgmpc.compile.native import Progress
from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

__all__ = ["CompiledFunction", "compile_function", "compile_map"]


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
    return CompiledFunction(StageKernel(function, progress))


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
    check_stages(stages, 1)
    if not isinstance(shared, Sequence):
        raise InputError("shared", f"{shared!r:.80}", "names of inputs")
    kernel = StageKernel(function, progress)
    for name in shared:
        index_of(f"shared input of '{kernel.signature.name}'", name, kernel.signature.input_names)
    return CompiledFunction(kernel, stages, shared)


class CompiledFunction:
    """A CasADi function with its own buffers for inputs and outputs.

    Write into :attr:`inputs`, call :meth:`run`, read :attr:`outputs`. One instance is for one thread at a time (the
    machine code runs without Python's global lock); another is made by :func:`compile_function` from the cache.

    Attributes:
        name: of the CasADi function.
        compiled: whether it is machine code; otherwise CasADi interprets it.
        inputs: one dense float64 array per input, zero at first: ``(n,)`` for a column, else ``(rows, columns)`` in
            Fortran order; for a horizon (:func:`compile_map`) with the stage as additional first index. Write into
            them; do not replace them.
        outputs: results of the last :meth:`run`, laid out in the same way; the next run overwrites them.
    """

    __slots__ = (
        "__weakref__", "_arguments", "_evaluate", "_kernel", "_memory", "compiled", "input_names", "inputs", "name",
        "output_names", "outputs",
    )  # fmt: skip

    def __init__(self, kernel: StageKernel, stages: int | None = None, shared: Sequence[str] = ()) -> None:
        signature = kernel.signature
        self._kernel = kernel
        self._arguments = stages, tuple(shared)
        self.name = signature.name
        self.compiled = kernel.compiled
        self.input_names = signature.input_names
        self.output_names = signature.output_names
        inputs = [_allocate(each, None if each.name in shared else stages) for each in signature.inputs]
        outputs = [_allocate(each, stages) for each in signature.outputs]
        self.inputs: tuple[Array, ...] = tuple(view for _, view in inputs)
        self.outputs: tuple[Array, ...] = tuple(view for _, view in outputs)
        self._memory = tuple(memory for memory, _ in inputs + outputs)
        self._evaluate = self.bind()

    def __reduce__(self) -> tuple[type[CompiledFunction], tuple[Any, ...]]:
        """Restore with buffers of zeros."""
        return CompiledFunction, (self._kernel, *self._arguments)

    def run(self) -> None:
        """Evaluate, without allocation. NaN in the inputs gives NaN in the outputs, not an error.

        Raises:
            SolverError: a solver inside the function failed; outputs are then undefined.
        """
        try:
            failed = self._evaluate()
        except RuntimeError:  # of CasADi's interpreter
            failed = 1
        if failed:
            remedy = "Its problem may be infeasible, or its initial point too far from a solution"
            raise SolverError(f"solver inside '{self.name}'", "no solution", remedy)

    def __call__(self, *args: object) -> tuple[Array, ...]:
        """Copy the arguments in, run, and return copies of the outputs.

        Args:
            args: one per input: an array of the input's size (a column may be ``(n,)`` or ``(n, 1)``) or a number,
                which fills it.

        Raises:
            InputError: wrong number of arguments, wrong shape, or entries that are not real numbers.
        """
        if len(args) != len(self.inputs):
            expected = f"{len(self.inputs)}: {', '.join(self.input_names)}"
            raise InputError(f"arguments of '{self.name}'", len(args), expected)
        for name, buffer, arg in zip(self.input_names, self.inputs, args, strict=True):
            value = np.asarray(arg)
            if value.dtype.kind not in "fiub":
                raise InputError(f"{self.name}: {name}", f"{value.dtype} entries", "real numbers")
            if value.shape == (*buffer.shape, 1):
                value = value[..., 0]
            if value.ndim > 0 and value.shape != buffer.shape:
                raise InputError(f"{self.name}: {name}", f"shape {value.shape}", f"shape {buffer.shape}")
            buffer[...] = value
        self.run()
        return tuple(output.copy(order="K") for output in self.outputs)

    def input(self, name: str) -> Array:
        """Return the buffer of the input with this name.

        Raises:
            InputError: no such input.
        """
        return self.inputs[index_of(f"input of '{self.name}'", name, self.input_names)]

    def output(self, name: str) -> Array:
        """Return the buffer of the output with this name.

        Raises:
            InputError: no such output.
        """
        return self.outputs[index_of(f"output of '{self.name}'", name, self.output_names)]

    def bind(self, **memory: Array) -> Callable[[], int]:
        """Return a call on the caller's memory; it returns 0, as plain arithmetic always does, and allocates nothing.

        Args:
            memory: an array for some of the inputs and outputs, by name; the others stay this function's own. Arrays
                are float64 and contiguous, and hold the numbers in the order of CasADi: stage after stage, column
                after column.

        Raises:
            InputError: an unknown name, an array that does not fit, or a read-only one for an output.
        """
        names = (*self.input_names, *self.output_names)
        arrays = list(self._memory)
        for name, array in memory.items():
            place = index_of(f"argument of '{self.name}'", name, names)
            check_array(name, array)
            size = arrays[place].size
            if array.dtype != np.float64 or array.size != size or not array.flags.c_contiguous:
                raise InputError(name, f"{array.dtype} of shape {array.shape}", f"float64, contiguous, {size} numbers")
            if place >= len(self.inputs) and not array.flags.writeable:
                raise InputError(name, "a read-only array", "memory that results can be written to")
            arrays[place] = array.reshape(arrays[place].shape)
        steps = [array.shape[1] if array.ndim == 2 else 0 for array in arrays]
        return self._kernel.evaluator(self._arguments[0] or 1, arrays, steps)

    def __repr__(self) -> str:
        given = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.input_names, self.inputs, strict=True))
        made = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.output_names, self.outputs, strict=True))
        return f"CompiledFunction({self.name}: ({given}) -> ({made}), {'compiled' if self.compiled else 'interpreted'})"


def _allocate(argument: Argument, stages: int | None) -> tuple[Array, Array]:
    """Return memory in CasADi's order (stage after stage, column after column), and the callers' view of it."""
    if stages is None:
        memory = np.zeros(argument.size)
        return memory, memory.reshape(argument.shape, order="F")
    memory = np.zeros((stages, argument.size))
    view = memory.reshape((stages, *reversed(argument.shape)))
    return memory, view.transpose(0, *range(len(argument.shape), 0, -1))
