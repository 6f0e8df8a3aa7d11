"""Kernels on arrays of their own."""

from __future__ import annotations

import casadi
import numpy as np

from lgmpc.compile import StageKernel


class OnOwnMemory:
    """A function over some stages: ``run`` reads ``given`` and writes ``found``, rows by name; a call does all."""

    def __init__(self, function: casadi.Function, stages: int = 1) -> None:
        kernel = StageKernel(function)
        self.compiled = kernel.compiled
        self.given = {name: np.zeros((stages, size)) for name, size in kernel.input_sizes.items()}
        self.found = {name: np.zeros((stages, size)) for name, size in kernel.output_sizes.items()}
        self.run = kernel.bind(stages, **self.given, **self.found)

    def __call__(self, *arguments: object) -> list[np.ndarray]:
        for array, argument in zip(self.given.values(), arguments, strict=True):
            array[...] = argument
        assert self.run() == 0
        return [array.copy() for array in self.found.values()]
