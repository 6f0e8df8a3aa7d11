"""A function on preallocated buffers, evaluated by machine code or CasADi's interpreter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi
import numpy as np

from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

__all__ = ["Argument", "Bind", "CompiledFunction", "Signature", "index_of"]


@dataclass(frozen=True)
class Argument:
    """Name, shape and batch of one input or output; ``stages`` is None where there is one value for all stages."""

    name: str
    shape: tuple[int, ...]
    stages: int | None

    @property
    def size(self) -> int:
        """Number of entries of one stage."""
        return math.prod(self.shape)

    def allocate(self) -> tuple[Array, Array]:
        """Return memory in CasADi's order (stage after stage, column after column), and the callers' view of it."""
        memory = np.zeros(self.size * (self.stages or 1))
        if self.stages is None:
            return memory, memory.reshape(self.shape, order="F")
        view = memory.reshape((self.stages, *reversed(self.shape)))
        return memory, view.transpose(0, *range(len(self.shape), 0, -1))


@dataclass(frozen=True)
class Signature:
    """Inputs and outputs of a compiled function, for a whole horizon if ``stages`` is above 1."""

    name: str
    stages: int
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]

    @classmethod
    def of(cls, function: casadi.Function, stages: int | None = None, shared: Sequence[str] = ()) -> Signature:
        """Return the signature of a CasADi function; the inputs in ``shared`` have no stage index."""

        def describe(name: str, size: tuple[int, int]) -> Argument:
            shape = (size[0],) if size[1] == 1 else size
            return Argument(name, shape, None if name in shared else stages)

        return cls(
            function.name(),
            stages or 1,
            tuple(describe(name, function.size_in(i)) for i, name in enumerate(function.name_in())),
            tuple(describe(name, function.size_out(i)) for i, name in enumerate(function.name_out())),
        )

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(argument.name for argument in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return tuple(argument.name for argument in self.outputs)


# From the memory of all inputs and outputs to a call without arguments that returns CasADi's code (0: success).
Bind = Callable[[Signature, Sequence[Array]], Callable[[], int]]


class CompiledFunction:
    """A CasADi function with its own buffers for inputs and outputs.

    Write into :attr:`inputs`, call :meth:`run`, read :attr:`outputs`. One instance is for one thread at a time (the
    machine code runs without Python's global lock): use a :meth:`clone` in every other thread. Created by
    :func:`compile_function`.

    Attributes:
        name: of the CasADi function.
        compiled: whether it is machine code; otherwise CasADi interprets it.
        inputs: one dense float64 array per input, zero at first: ``(n,)`` for a column, else ``(rows, columns)`` in
            Fortran order; for a horizon (:func:`compile_map`) with the stage as additional first index. Write into
            them; do not replace them.
        outputs: results of the last :meth:`run`, laid out in the same way; the next run overwrites them.
    """

    __slots__ = ("__weakref__", "_bind", "_evaluate", "_memory", "_signature", "compiled", "inputs", "name", "outputs")

    def __init__(self, signature: Signature, bind: Bind, compiled: bool) -> None:
        self.name = signature.name
        self.compiled = compiled
        inputs = [argument.allocate() for argument in signature.inputs]
        outputs = [argument.allocate() for argument in signature.outputs]
        self.inputs: tuple[Array, ...] = tuple(view for _, view in inputs)
        self.outputs: tuple[Array, ...] = tuple(view for _, view in outputs)
        self._signature = signature
        self._bind = bind
        self._memory = tuple(memory for memory, _ in inputs + outputs)
        self._evaluate = bind(signature, self._memory)

    def __reduce__(self) -> tuple[type[CompiledFunction], tuple[Signature, Bind, bool]]:
        """Restore with buffers of zeros."""
        return CompiledFunction, (self._signature, self._bind, self.compiled)

    def run(self) -> None:
        """Evaluate, without allocation. NaN in the inputs gives NaN in the outputs, not an error.

        Raises:
            SolverError: a solver inside the function failed; outputs are then undefined.
        """
        if self._evaluate():
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

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return self._signature.input_names

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return self._signature.output_names

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
            size = arrays[place].size
            if array.dtype != np.float64 or array.size != size or not array.flags.c_contiguous:
                raise InputError(name, f"{array.dtype} of shape {array.shape}", f"float64, contiguous, {size} numbers")
            if place >= len(self.inputs) and not array.flags.writeable:
                raise InputError(name, "a read-only array", "memory that results can be written to")
            arrays[place] = array.reshape(-1)
        return self._bind(self._signature, arrays)

    def clone(self) -> CompiledFunction:
        """Return a copy on the same machine code with its own buffers, the inputs' values copied."""
        twin = CompiledFunction(self._signature, self._bind, self.compiled)
        for mine, theirs in zip(self.inputs, twin.inputs, strict=True):
            theirs[...] = mine
        return twin

    def __repr__(self) -> str:
        given = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.input_names, self.inputs, strict=True))
        made = ", ".join(f"{n}{list(b.shape)}" for n, b in zip(self.output_names, self.outputs, strict=True))
        return f"CompiledFunction({self.name}: ({given}) -> ({made}), {'compiled' if self.compiled else 'interpreted'})"


def index_of(what: str, name: str, names: tuple[str, ...]) -> int:
    """Return the index of a name among names; an InputError lists them if it is none of them."""
    try:
        return names.index(name)
    except ValueError:
        raise InputError(what, repr(name), "one of its names", names) from None
