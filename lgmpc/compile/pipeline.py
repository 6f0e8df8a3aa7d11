"""Functions of a stage in sequence, each compiled and cached on its own, several stages at once.

What one function computes, others read, without leaving the lanes. A function may be repeated, for every column of a
matrix: a solve with many right-hand sides is then the code of one, and takes a fraction of the time to compile. As
libraries are those of the single functions, a change of one compiles no other.
"""

import ctypes
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import casadi
import numpy as np

from lgmpc.compile.compiler import Compiler
from lgmpc.compile.native import address_of, aligned_zeros, compile_source, frame_of, load_library
from lgmpc.compile.simd import SQUARES
from lgmpc.typing import Array

_MOST_LANES = 8  # of any processor: an image of the memory serves other ones too

Entries = tuple[tuple[str, int], ...]
"""Column and index of each entry of a result."""


@dataclass(frozen=True)
class PipelineStep:
    """A function, and the names of the columns that it reads and writes.

    Each argument is read from the beginning of its column. With repetitions, an argument whose column is as long as all
    of them is read piece by piece; others are the same every time. Results are written piece by piece.

    Attributes:
        function: of scalar operations, dense.
        arguments: names of columns.
        results: names of columns that no other step writes.
        repeats: how many times.
    """

    function: casadi.Function
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    repeats: int = 1


@dataclass(frozen=True)
class Pipeline:
    """Steps in order, on columns of numbers; those that no output depends on are left out.

    Attributes:
        name: in messages.
        inputs: name and size of each column that is given.
        steps: in order.
        outputs: for each result its column, or column and index of each of its entries.
    """

    name: str
    inputs: Mapping[str, int]
    steps: tuple[PipelineStep, ...]
    outputs: Mapping[str, str | Entries]

    def __post_init__(self) -> None:
        """Leave out the steps that no output depends on."""
        needed = {
            name
            for output in self.outputs.values()
            for name in ([output] if isinstance(output, str) else [column for column, _ in output])
        }
        steps = []
        for step in reversed(self.steps):
            if needed.intersection(step.results):
                needed.update(step.arguments)
                steps.append(step)
        object.__setattr__(self, "steps", tuple(reversed(steps)))

    @classmethod
    def of(cls, function: casadi.Function) -> "Pipeline":
        """Return the pipeline of one function, with the names of its arguments and results."""
        given, results = function.name_in(), function.name_out()
        names = tuple(f"result_{name}" for name in results)
        step = PipelineStep(function, tuple(given), names)
        sizes = {name: function.numel_in(i) for i, name in enumerate(given)}
        return cls(function.name(), sizes, (step,), dict(zip(results, names, strict=True)))

    @property
    def sizes(self) -> dict[str, int]:
        """Size of every column."""
        sizes = dict(self.inputs)
        for step in self.steps:
            for i, name in enumerate(step.results):
                sizes[name] = step.repeats * step.function.numel_out(i)
        return sizes

    @property
    def places(self) -> dict[str, int]:
        """Start of each column in a memory that holds all of them."""
        sizes = self.sizes
        return dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))

    def entries(self, output: str) -> list[int]:
        """Return the places of an output's entries in that memory."""
        places, chosen = self.places, self.outputs[output]
        if isinstance(chosen, str):
            return list(range(places[chosen], places[chosen] + self.sizes[chosen]))
        return [places[column] + index for column, index in chosen]

    def advances(self, step: PipelineStep) -> list[int]:
        """Return the distance from one repetition to the next, for all arguments of a step."""
        sizes, lengths = self.sizes, [step.function.numel_in(i) for i in range(step.function.n_in())]
        return [
            length if step.repeats > 1 and sizes[name] == step.repeats * length else 0
            for name, length in zip(step.arguments, lengths, strict=True)
        ]

    def expression(self) -> casadi.Function:
        """Return the whole as one CasADi function, to be interpreted."""
        columns = {name: casadi.MX.sym(name, size) for name, size in self.inputs.items()}
        given = list(columns.values())
        for step in self.steps:
            f, advances = step.function, self.advances(step)
            arguments = []
            for i, (name, advance) in enumerate(zip(step.arguments, advances, strict=True)):
                rows, width = f.size_in(i)
                length = step.repeats * rows * width if advance else rows * width
                part = columns[name][:length]
                arguments.append(casadi.reshape(part, rows, width * step.repeats if advance else width))
            if step.repeats > 1:
                shared = [i for i, advance in enumerate(advances) if not advance]
                f = f.map(f"{f.name()}_map{step.repeats}", "serial", step.repeats, shared, [])
            results = f.call(arguments)
            columns.update({n: casadi.vec(r) for n, r in zip(step.results, results, strict=True)})
        memory = casadi.vertcat(*columns.values())
        outputs = [memory[self.entries(name)] for name in self.outputs]
        return casadi.Function(self.name, given, outputs, list(self.inputs), list(self.outputs))


def load_pipeline(pipeline: Pipeline, compiler: Compiler) -> list[ctypes.CDLL]:
    """Load the libraries of the driver and of each step, built first where they are not cached.

    Raises:
        CompileError: the compiler failed, or a function is not a list of scalar operations.
        InputError: the cache folder cannot be used.
    """
    source = SQUARES + files("lgmpc.compile").joinpath("pipeline.c").read_text(encoding="utf-8")
    driver = compile_source("lgmpc_pipeline", source)
    assert driver is not None  # there is a compiler
    known: dict[int, ctypes.CDLL] = {}
    for step in pipeline.steps:
        if id(step.function) not in known:
            known[id(step.function)] = load_library(step.function, compiler, lanes=True)
    return [driver, *(known[id(step.function)] for step in pipeline.steps)]


@dataclass(frozen=True)
class PipelineLayout:
    """Places and sizes of a pipeline's columns, for calls of its libraries without its expressions.

    Attributes:
        inputs: size and place of each column that is given.
        outputs: places of each result's entries.
        functions: name of each step's function.
        plan: of the steps, as ``pipeline.c`` reads it.
        arguments: most arguments and results of a step.
        work: numbers of all columns.
    """

    inputs: Mapping[str, tuple[int, int]]
    outputs: Mapping[str, tuple[int, ...]]
    functions: tuple[str, ...]
    plan: tuple[int, ...]
    arguments: int
    work: int

    @classmethod
    def of(cls, pipeline: Pipeline) -> "PipelineLayout":
        """Return the layout of a pipeline."""
        sizes, places = pipeline.sizes, pipeline.places
        plan: list[int] = []
        for step in pipeline.steps:
            f = step.function
            plan += [f.n_in(), f.n_out(), step.repeats]
            for name, advance in zip(step.arguments, pipeline.advances(step), strict=True):
                plan += [places[name], advance]
            for i, name in enumerate(step.results):
                plan += [places[name], f.numel_out(i)]
        return cls(
            {name: (size, places[name]) for name, size in pipeline.inputs.items()},
            {name: tuple(pipeline.entries(name)) for name in pipeline.outputs},
            tuple(step.function.name() for step in pipeline.steps),
            tuple(plan),
            max((step.function.n_in() + step.function.n_out() for step in pipeline.steps), default=0),
            sum(sizes.values()),
        )


def bind_pipeline(
    layout: PipelineLayout,
    libraries: Sequence[ctypes.CDLL],
    stages: int,
    arrays: Sequence[Array],
    strides: Sequence[int],
) -> Callable[[], int]:
    """Return the call that evaluates all stages on this memory, with work memory of its own.

    Args:
        layout: of the pipeline.
        libraries: the driver's and of each step.
        stages: their number.
        arrays: of inputs, then outputs, which the call keeps.
        strides: of the arrays.
    """
    driver, *steps = libraries
    plan = [stages, len(layout.inputs), len(layout.outputs), len(steps), layout.work]
    for (size, place), stride in zip(layout.inputs.values(), strides, strict=False):
        plan += [size, stride, place]
    entries: list[int] = []
    for chosen, stride in zip(layout.outputs.values(), strides[len(layout.inputs) :], strict=True):
        plan += [len(chosen), stride, len(entries)]
        entries += chosen
    functions, scratch = [], 0
    for name, library in zip(layout.functions, steps, strict=True):
        measure = library[f"{name}_lanes_work"]
        measure.restype = ctypes.c_longlong
        scratch = max(scratch, measure())
        functions.append(address_of(library, f"{name}_lanes"))
    base = np.array([array.ctypes.data for array in arrays], dtype=np.uintp)
    address_of(driver, "lgmpc_pipeline")
    memory = aligned_zeros(_MOST_LANES * (layout.work + scratch))
    given = np.zeros(layout.arguments, dtype=np.uintp)
    whole_plan, addresses = np.array([*plan, *layout.plan], dtype=np.int64), np.array(functions, dtype=np.uintp)
    chosen_entries = np.array(entries, dtype=np.int64)
    frame = frame_of(base, whole_plan, addresses, memory, given, chosen_entries, keep=(*arrays, *libraries))
    return functools.partial(driver.lgmpc_pipeline, ctypes.byref(frame))
