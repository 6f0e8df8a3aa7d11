"""Stage functions on the caller's memory: a loop in C, whose stages may read the results of previous ones."""

import ctypes
from collections.abc import Callable
from typing import Any, TypeVar

import casadi
import numpy as np

from lgmpc.compile.compiler import compiler_for_functions
from lgmpc.compile.index import cached
from lgmpc.compile.native import bind_library, load_library
from lgmpc.compile.pipeline import Pipeline, PipelineLayout, bind_pipeline, load_pipeline
from lgmpc.compile.simd import is_scalar_code
from lgmpc.errors import InputError
from lgmpc.typing import Array

K = TypeVar("K", bound="StageKernel")


class StageKernel:
    """A function of one stage, compiled once and bound to any memory, over any number of stages.

    The stages are evaluated in order. A roll-out is a kernel whose result ``x_next`` is bound to the same array as
    its argument ``x``, offset by one row.

    Args:
        function: of one stage.

    Attributes:
        name: of the function.
        input_sizes: number of entries of every input, by name, in order.
        output_sizes: of every output.
        compiled: whether it is machine code; otherwise, and where it is not a list of scalar operations (an MX
            function, or one that calls Python), CasADi interprets it.

    Raises:
        CompileError: the compiler failed on it.
        InputError: the environment (cache folder, ``CC``) cannot be used.
    """

    def __init__(self, function: casadi.Function) -> None:
        function = densify_function(function)
        self.name = function.name()
        self.input_sizes = {name: function.numel_in(i) for i, name in enumerate(function.name_in())}
        self.output_sizes = {name: function.numel_out(i) for i, name in enumerate(function.name_out())}
        compiler = compiler_for_functions() if is_scalar_code(function) else None
        self._code = function if compiler is None else load_library(function, compiler)
        self.compiled = compiler is not None

    @classmethod
    def of(cls: type[K], write: Callable[..., casadi.Function | Pipeline], *arguments: Any) -> K:
        """Return the kernel of ``write(*arguments)``, from the cache if it was written before; see :func:`cached`."""
        return cached(_write, cls, write, *arguments)

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Return the call that evaluates all stages on this memory; it returns 0 and allocates nothing.

        Args:
            stages: their number.
            memory: an array for every input and output, by name: ``(stages, size)`` or more columns with contiguous
                rows, or ``(size,)``, which all stages share. Matrices are stored column after column.

        Raises:
            InputError: a name is missing or unknown, or an array does not fit.
        """
        if not isinstance(stages, (int, np.integer)) or stages < 0:
            raise InputError("stages", f"{stages!r:.80}", "a whole number, at least 0")
        sizes = (*self.input_sizes.items(), *self.output_sizes.items())
        for name, array in memory.items():
            if name not in dict(sizes):
                raise InputError(f"argument of '{self.name}'", repr(name), "one of its names", tuple(dict(sizes)))
            if not isinstance(array, np.ndarray):
                raise InputError(name, f"{array!r:.80}", "a float64 array, which the call reads or writes")
        arrays, steps = [], []
        for index, (name, size) in enumerate(sizes):
            if name not in memory:
                raise InputError(f"memory for '{self.name}'", "none", f"an array for '{name}'")
            array = memory[name]
            shared = array.ndim == 1 and array.size == size
            rows = array.ndim == 2 and array.shape[0] >= stages and array.shape[1] >= size
            contiguous = size < 2 or array.strides[-1] == array.itemsize
            if array.dtype != np.float64 or not contiguous or not (shared or rows):
                got = f"{array.dtype} of shape {array.shape}"
                raise InputError(name, got, f"float64 of shape ({stages}, {size}), contiguous rows")
            if index >= len(self.input_sizes) and not array.flags.writeable:
                raise InputError(name, "a read-only array", "memory that results can be written to")
            arrays.append(array)
            steps.append(0 if shared else array.strides[0] // array.itemsize)
        return self.evaluator(stages, arrays, steps)

    def evaluator(self, stages: int, arrays: list[Array], steps: list[int]) -> Callable[[], int]:
        """Return the call on arrays that fit; ``steps`` are their numbers from one stage to the next."""
        if isinstance(self._code, ctypes.CDLL):
            return bind_library(self._code, self.name, arrays, stages, steps)
        sizes = (*self.input_sizes.values(), *self.output_sizes.values())
        rows = [
            [(array[k] if step else array)[:size] for k in range(stages)]
            for array, step, size in zip(arrays, steps, sizes, strict=True)
        ]
        return _interpret(self._code, len(self.input_sizes), stages, rows)


class BatchKernel(StageKernel):
    """A :class:`StageKernel` of stages that do not read each other's results: several at a time, one in each lane.

    The results are those of a :class:`StageKernel`, bit for bit.

    Args:
        function: of one stage, or a pipeline of several.
    """

    def __init__(self, function: casadi.Function | Pipeline) -> None:
        pipeline = function if isinstance(function, Pipeline) else _pipeline_of(densify_function(function))
        compiler = compiler_for_functions()
        self._libraries: list[ctypes.CDLL] = []
        if pipeline is None or compiler is None:
            super().__init__(function.expression() if isinstance(function, Pipeline) else function)
            return
        self._layout = PipelineLayout.of(pipeline)
        self.name = pipeline.name
        self.input_sizes = {name: size for name, (size, _) in self._layout.inputs.items()}
        self.output_sizes = {name: len(entries) for name, entries in self._layout.outputs.items()}
        self._libraries = load_pipeline(pipeline, compiler)
        self.compiled = True

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Return the call, as :meth:`StageKernel.bind` does.

        Raises:
            InputError: a name is missing or unknown, an array does not fit, or one that is written is also read.
        """
        for result in self.output_sizes:
            for given in self.input_sizes:
                if given in memory and result in memory and np.may_share_memory(memory[given], memory[result]):
                    raise InputError(result, f"memory of '{given}'", "memory of its own (a StageKernel shares memory)")
        return super().bind(stages, **memory)

    def evaluator(self, stages: int, arrays: list[Array], steps: list[int]) -> Callable[[], int]:
        """Return the call, as :meth:`StageKernel.evaluator` does."""
        if not self._libraries:
            return super().evaluator(stages, arrays, steps)
        return bind_pipeline(self._layout, self._libraries, stages, arrays, steps)


def _write(kind: type[K], write: Callable[..., Any], *arguments: Any) -> K:
    return kind(write(*arguments))


def _pipeline_of(function: casadi.Function) -> Pipeline | None:
    return Pipeline.of(function) if is_scalar_code(function) else None


def _interpret(function: casadi.Function, n_in: int, stages: int, rows: list[list[Array]]) -> Callable[[], int]:
    calls: list[Any] = []
    for k in range(stages):
        buffer: Any
        buffer, evaluate = function.buffer()
        for i, column in enumerate(rows):
            row = column[k]
            if row.size == 0:
                continue
            if i < n_in:
                buffer.set_arg(i, row.data)
            else:
                buffer.set_res(i - n_in, row.data)
        # The buffer contains addresses only: the call keeps the arrays alive.
        calls.append((evaluate, buffer, [column[k] for column in rows]))

    def call() -> int:
        for evaluate, *_ in calls:
            evaluate()
        return 0

    return call


def densify_function(function: casadi.Function) -> casadi.Function:
    """Return the function with dense inputs and outputs (itself if they are dense)."""
    if not isinstance(function, casadi.Function):
        raise InputError("function", f"{function!r:.80}", "a casadi.Function")
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
