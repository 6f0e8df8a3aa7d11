"""Quantities defined by an equation, such as contact forces, and their derivatives.

The algorithm that computes them is not differentiated: where ``g(w, z) = 0`` defines z as a function of w,
``dz/dw = -(dg/dz)^-1 dg/dw``. The derivatives of a contact dynamics thus cost those of its equations of motion and one
solve, instead of those of a factorisation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.robot.symbolic import Factored

__all__ = ["LinearUnknown", "Unknowns"]


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
        direct = [ca.jacobian(expression, variable) for variable in variables]
        through, slopes = self._active(expression, variables)
        if through.shape[1] == 0:
            return tuple(direct)
        return tuple(one + through @ slope for one, slope in zip(direct, slopes, strict=True))

    def square(self, residual: Any, weight: Any, gradient: Any, *variables: Any) -> tuple[list[list[Any]], list[Any]]:
        """Return ``J^T diag(weight) J`` in blocks, and ``J^T gradient``, for the residual's total Jacobian J.

        For a residual with more rows than unknowns that it depends on, the product in the unknowns is formed first: it
        is sparse.
        """
        direct = [ca.jacobian(residual, variable) for variable in variables]
        through, slopes = self._active(residual, variables)
        rows = set(through.sparsity().get_triplet()[0])
        if len(rows) <= through.shape[1]:
            total = [one + through @ slope for one, slope in zip(direct, slopes, strict=True)] if rows else direct
            scaled = [ca.diag(weight) @ one for one in total]
            blocks = [[one.T @ other for other in scaled] for one in total]
            return _mirrored(blocks), [one.T @ gradient for one in total]
        scaled = [ca.diag(weight) @ one for one in direct]
        inner = through.T @ (ca.diag(weight) @ through)
        mixed = [through.T @ one for one in scaled]
        half = [inner @ slope + one for slope, one in zip(slopes, mixed, strict=True)]
        n = range(len(variables))
        blocks = [[direct[i].T @ scaled[j] + mixed[i].T @ slopes[j] + slopes[i].T @ half[j] for j in n] for i in n]
        pulled = through.T @ gradient
        return _mirrored(blocks), [direct[i].T @ gradient + slopes[i].T @ pulled for i in n]

    def resolve(self, inputs: list[Any], outputs: list[Any]) -> list[Any]:
        """Return the outputs, functions of the inputs and the unknowns, with the unknowns' values substituted."""
        for unknown in reversed(self._found):
            function = ca.Function("resolve", [*inputs, *(u.symbol for u in self._found)], outputs)
            others = [u.value if u is unknown else u.symbol for u in self._found]
            outputs = function.call([*inputs, *others])
        return outputs

    def _active(self, expression: Any, variables: tuple[Any, ...]) -> tuple[Any, list[Any]]:
        """Return the derivative by the unknowns that the expression depends on, and these unknowns' derivatives."""
        if self._found and not self._slopes:
            self._solve(variables)
        through: list[Any] = [ca.SX(expression.shape[0], 0)]
        slopes: list[list[Any]] = [[ca.SX(0, variable.shape[0])] for variable in variables]
        for unknown, mine in zip(self._found, self._slopes, strict=True):
            derivative = ca.jacobian(expression, unknown.symbol)
            columns = sorted(set(derivative.sparsity().get_triplet()[1]))
            through.append(derivative[:, columns])
            for known, slope in zip(slopes, mine, strict=True):
                known.append(slope[columns, :])
        return ca.horzcat(*through), [ca.vertcat(*known) for known in slopes]

    def _solve(self, variables: tuple[Any, ...]) -> None:
        sizes = [variable.shape[0] for variable in variables]
        edges = [0, *(sum(sizes[: i + 1]) for i in range(len(sizes)))]
        for unknown in self._found:
            right = ca.horzcat(*(ca.jacobian(unknown.residual, variable) for variable in variables))
            for earlier, slopes in zip(self._found, self._slopes, strict=False):
                right += ca.jacobian(unknown.residual, earlier.symbol) @ ca.horzcat(*slopes)
            slope = -unknown.solve(right)
            self._slopes.append([slope[:, a:b] for a, b in zip(edges, edges[1:], strict=False)])


def _mirrored(blocks: list[list[Any]]) -> list[list[Any]]:
    """Copy the upper triangles of the diagonal blocks to the lower ones, so that they are computed once."""
    for i, row in enumerate(blocks):
        row[i] = ca.triu2symm(ca.triu(row[i]))
    return blocks
