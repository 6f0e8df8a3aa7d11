"""Quantities defined by an equation, such as contact forces, and their derivatives.

The algorithm that computes them is not differentiated: where ``g(w, z) = 0`` defines z as a function of w,
``dz/dw = -(dg/dz)^-1 dg/dw``. The derivatives of a contact dynamics thus cost those of its equations of motion and one
solve, instead of those of a factorisation.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.robot.symbolic import Factored


@dataclass(frozen=True)
class LinearUnknown:
    """An unknown whose equation ``A z = right`` is linear in it.

    Attributes:
        symbol: (n,) the unknown.
        residual: (n,) ``A z - right``, in whatever form is cheapest to differentiate.
        system: A, factorised.
        right: (n,) right-hand side.
    """

    symbol: Any
    residual: Any
    system: Factored
    right: Any


@dataclass(frozen=True)
class _Unknown:
    symbol: Any
    value: Any
    residual: Any
    solve: Callable[[Any], Any]


class Unknowns:
    """The unknowns of a stage, in order of dependence.

    Args:
        keep: whether unknowns stay symbols, to be differentiated implicitly; otherwise :meth:`define` returns their
            value.
    """

    def __init__(self, keep: bool = False) -> None:
        self._keep = keep
        self._found: list[_Unknown] = []
        self._linear: list[LinearUnknown] = []
        self._slopes: list[Any] = []

    def define(self, value: Any, residual: Callable[[Any], Any], solve: Callable[[Any], Any]) -> Any:
        """Return the column that represents an unknown in all further expressions.

        Args:
            value: the unknown's value.
            residual: the column g(z) whose root it is.
            solve: ``right -> (dg/dz)^-1 right`` for (n, m) right-hand sides.
        """
        if not self._keep:
            return value
        symbol = ca.SX.sym(f"z{len(self._found)}", value.shape[0])
        self._found.append(_Unknown(symbol, value, residual(symbol), solve))
        return symbol

    def define_linear(self, system: Factored, right: Any, residual: Callable[[Any], Any]) -> Any:
        """Return the column that represents the solution of a linear equation; see :class:`LinearUnknown`."""
        z = self.define(system.solve(right), residual, system.solve)
        if self._keep:
            self._linear.append(LinearUnknown(z, self._found[-1].residual, system, right))
        return z

    @property
    def only_linear(self) -> LinearUnknown | None:
        """The unknown, if there is one and its equation is linear in it; None otherwise."""
        return self._linear[0] if len(self._found) == len(self._linear) == 1 else None

    def jacobians(self, expression: Any, *variables: Any) -> tuple[Any, ...]:
        """Return the derivatives of an expression with respect to each variable; all calls have the same variables."""
        if self._found and not self._slopes:
            self._solve(variables)
        total = [ca.jacobian(expression, variable) for variable in variables]
        for unknown, slopes in zip(self._found, self._slopes, strict=True):
            through = ca.jacobian(expression, unknown.symbol)
            used = sorted(set(through.sparsity().get_triplet()[1]))
            if used:
                total = [one + through[:, used] @ slope[used, :] for one, slope in zip(total, slopes, strict=True)]
        return tuple(total)

    def square(self, residual: Any, weight: Any, gradient: Any, *variables: Any) -> tuple[list[list[Any]], list[Any]]:
        """Return ``J^T diag(weight) J`` in blocks, and ``J^T gradient``, for the residual's total Jacobian J."""
        total = self.jacobians(residual, *variables)
        scaled = [ca.diag(weight) @ one for one in total]
        blocks = [[one.T @ other for other in scaled] for one in total]
        for i, row in enumerate(blocks):
            row[i] = ca.triu2symm(ca.triu(row[i]))  # the lower triangle is not computed again
        return blocks, [one.T @ gradient for one in total]

    def resolve(self, inputs: list[Any], outputs: list[Any]) -> list[Any]:
        """Return the outputs, functions of the inputs and the unknowns, with the unknowns' values substituted."""
        for unknown in reversed(self._found):
            function = ca.Function("resolve", [*inputs, *(u.symbol for u in self._found)], outputs)
            others = [u.value if u is unknown else u.symbol for u in self._found]
            outputs = function.call([*inputs, *others])
        return outputs

    def _solve(self, variables: tuple[Any, ...]) -> None:
        sizes = [variable.shape[0] for variable in variables]
        edges = [0, *(sum(sizes[: i + 1]) for i in range(len(sizes)))]
        for unknown in self._found:
            right = ca.horzcat(*(ca.jacobian(unknown.residual, variable) for variable in variables))
            for earlier, slopes in zip(self._found, self._slopes, strict=False):
                right += ca.jacobian(unknown.residual, earlier.symbol) @ ca.horzcat(*slopes)
            slope = -unknown.solve(right)
            self._slopes.append([slope[:, a:b] for a, b in zip(edges, edges[1:], strict=False)])
