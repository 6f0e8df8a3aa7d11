"""Calls of Python from CasADi's functions, and the exceptions of these calls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError

__all__ = ["Watch", "python_function"]


class Watch:
    """Exceptions of an action's calls from CasADi, through which none propagates.

    Attributes:
        calls: number of calls since :meth:`begin`.
        error: the first exception since then.
        failed: number of calls before it.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Reset counts and exception."""
        self.calls, self.failed = 0, 0
        self.error: Exception | None = None

    def note(self, error: Exception) -> None:
        """Store an exception of the current call, if it is the first."""
        if self.error is None:
            self.error, self.failed = error, self.calls

    def raise_at(self, action: str, first: int) -> None:
        """Raise the stored exception, with its node; ``first`` is the node of the first call."""
        if self.error is None:
            return
        error, node = self.error, first + self.failed
        self.begin()
        if isinstance(error, InputError):
            raise InputError(f"{error.argument}, node {node}", error.got, error.expected) from error
        expected = "results for all states and controls near the guess, NaN where there are none"
        raise InputError(f"action '{action}', node {node}", f"{type(error).__name__}: {error}", expected) from error


class _Callback(ca.Callback):
    """A function of columns that calls Python; its results are NaN where Python raises, as ``watch`` reports.

    They are NaN without a call where a state or control is not finite, and where Python's numbers overflow.
    """

    def __init__(
        self, name: str, inputs: dict[str, int], outputs: dict[str, tuple[int, int]], function: Any, watch: Watch
    ) -> None:
        super().__init__()
        self._inputs, self._outputs, self._function = list(inputs.items()), list(outputs.items()), function
        self._watch = watch
        self.construct(name, {"enable_fd": True, "fd_method": "central"})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return self._inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self._outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._inputs[i][1], 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._outputs[i][1])

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        columns = [argument.full()[:, 0] for argument in arguments]
        found = [np.full(shape, np.nan) for _, shape in self._outputs]
        # A trial roll-out that diverges has no results (parameters, such as bounds, may be infinite).
        if all(
            np.isfinite(column).all() for (name, _), column in zip(self._inputs, columns, strict=True) if name != "p"
        ):
            try:
                found = self._function(*columns)
            except OverflowError:
                pass
            except Exception as error:  # of any kind: it is the user's code
                self._watch.note(error)
        self._watch.calls += 1
        return [
            ca.DM(np.asarray(value, dtype=np.float64).reshape(shape))
            for value, (_, shape) in zip(found, self._outputs, strict=True)
        ]


def python_function(
    name: str, inputs: dict[str, int], outputs: dict[str, tuple[int, int]], function: Any, watch: Watch
) -> ca.Function:
    """Return a CasADi function of columns that calls Python.

    Args:
        name: of the function.
        inputs: length of each column.
        outputs: shape of each result.
        function: returns the results for the columns.
        watch: receives its exceptions.
    """
    return _Callback(name, inputs, outputs, function, watch)
