"""Costs and constraints of a contact action as interpreted functions of (x, u, z, p), expanded over several stages.

z are accelerations and forces. With the derivatives D of residuals by d = [dx; u] and T by z, their weights W and the
slopes S of z, the Hessian is ``D^T W D + X + X^T`` with ``X = S^T (T^T W D + 1/2 T^T W T S)``. CasADi evaluates what
does not depend on S.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from lgmpc.actions.contacts import ContactSet
from lgmpc.actions.linearisation import at_zero
from lgmpc.actions.multibody import MultibodyAction
from lgmpc.costs import StageSymbols, constraint_of, cost_of
from lgmpc.typing import Array

__all__ = ["ItemExpansion", "NumericItems"]


@dataclass(frozen=True, eq=False)
class ItemExpansion:
    """Expansions of n stages.

    Attributes:
        hessian: (n, ndx + nu, ndx + nu).
        gradient: (n, ndx + nu).
        rows: (n, ng, ndx + nu) [C D].
        lower: (n, ng) bounds minus the constraint's value.
        upper: (n, ng).
        cost: (n,).
    """

    hessian: Array
    gradient: Array
    rows: Array
    lower: Array
    upper: Array
    cost: Array


class NumericItems:
    """The items of an action, whose dynamics have nz accelerations and forces.

    Args:
        action: the action, with contacts.
        contacts: splits forces by frame.
    """

    def __init__(self, action: MultibodyAction, contacts: ContactSet) -> None:
        robot, state = action.robot, action.state
        x, dx = ca.SX.sym("x", state.nx), ca.SX.sym("dx", state.ndx)
        u, p = ca.SX.sym("u", action.nu), ca.SX.sym("p", action.parameters.size)
        z = ca.SX.sym("z", robot.nv + contacts.nf)
        d, inputs = ca.vertcat(dx, u), [x, u, z, p]
        values = action.parameters.split(p)

        def items(x: Any) -> tuple[Any, Any]:
            forces = contacts.by_frame(z[robot.nv :], robot, x[: robot.nq])
            s = StageSymbols(robot, x, values, u=u, a=z[: robot.nv], tau=u, forces=forces)
            return cost_of(action.costs, s, scale=values["duration"]), constraint_of(action.constraints, s)

        cost, path = items(x)
        name = action.name
        self._values = _Columns(f"{name}_items", inputs, {
            "cost": cost.value, "value": path.value, "lower": path.lower, "upper": path.upper,
        })  # fmt: skip
        cost, path = items(state.integrate_symbolic(x, dx))
        by_d, by_z = ca.jacobian(cost.residual, d), ca.jacobian(cost.residual, z)
        rows, rows_by_z = ca.jacobian(path.value, d), ca.jacobian(path.value, z)
        self._used, self._used_rows = _columns_of(by_z), _columns_of(rows_by_z)
        by_z, rows_by_z = by_z[:, self._used], rows_by_z[:, self._used_rows]
        weight = cost.weight * cost.curvature
        gradient, scaled = cost.weight * cost.gradient, ca.diag(weight) @ by_d
        expansion = {
            "hessian": by_d.T @ scaled,
            "mixed": by_z.T @ scaled,
            "inner": 0.5 * by_z.T @ (ca.diag(weight) @ by_z),
            "gradient": by_d.T @ gradient,
            "pulled": by_z.T @ gradient,
            "rows": rows,
            "rows_by_z": rows_by_z,
            "lower": path.lower - path.value,
            "upper": path.upper - path.value,
            "cost": cost.value,
        }
        still = dict(zip(expansion, at_zero(list(expansion.values()), dx), strict=True))
        self._expansion = _Columns(f"{name}_items_expansion", inputs, still)

    def values(self, x: Array, u: Array, z: Array, p: Array) -> dict[str, Array]:
        """Return ``cost`` (n, 1, 1), and of the constraint ``value``, ``lower`` and ``upper``, each (n, ng, 1).

        Args:
            x: (n, nx) states.
            u: (n, nu) controls.
            z: (n, nz) accelerations and forces.
            p: (n, np) parameters.
        """
        return self._values(x, u, z, p)

    def expand(self, x: Array, u: Array, z: Array, p: Array, slopes: Array) -> ItemExpansion:
        """Expand costs and constraints by state and control.

        Args:
            x: (n, nx) states.
            u: (n, nu) controls.
            z: (n, nz) accelerations and forces.
            p: (n, np) parameters.
            slopes: (n, nz, ndx + nu) their derivatives.
        """
        m = self._expansion(x, u, z, p)
        hessian, gradient, rows = m["hessian"], m["gradient"], m["rows"]
        if self._used:
            through = slopes[:, self._used]
            back = np.swapaxes(through, 1, 2)
            half = back @ (m["mixed"] + m["inner"] @ through)
            hessian += half
            hessian += np.swapaxes(half, 1, 2)
            gradient += back @ m["pulled"]
        if self._used_rows:
            rows += m["rows_by_z"] @ slopes[:, self._used_rows]
        return ItemExpansion(
            hessian, gradient[..., 0], rows, m["lower"][..., 0], m["upper"][..., 0], m["cost"][:, 0, 0]
        )


class _Columns:
    """Matrices of a CasADi function at several points, evaluated by one call in numpy arrays.

    Only entries that are not structurally zero are copied.
    """

    def __init__(self, name: str, inputs: list[Any], outputs: Mapping[str, Any]) -> None:
        matrices = {key: ca.SX(value) for key, value in outputs.items()}
        self._column = ca.Function(name, inputs, [ca.vertcat(*(ca.vec(m).nz[:] for m in matrices.values()))])
        self._sizes = [value.numel() for value in inputs]
        self._places: list[tuple[str, slice, tuple[int, int], NDArray[np.int64]]] = []
        start = 0
        for key, matrix in matrices.items():
            rows, columns = (np.array(index, dtype=np.int64) for index in matrix.sparsity().get_triplet())
            place = slice(start, start + rows.size)
            self._places.append((key, place, matrix.shape, rows * matrix.shape[1] + columns))
            start += rows.size
        self._calls: dict[int, tuple[list[Array], Array, Any, Any]] = {}

    def __call__(self, *arguments: Array) -> dict[str, Array]:
        """Return the matrices (n, rows, columns) at n points."""
        n = len(arguments[0])
        given, found, _, evaluate = self._calls.get(n) or self._bind(n)
        for array, argument in zip(given, arguments, strict=True):
            array[...] = argument
        evaluate()
        results = {}
        for key, place, shape, where in self._places:
            dense = np.zeros((n, shape[0] * shape[1]))
            dense[:, where] = found[:, place]
            results[key] = dense.reshape(n, *shape)
        return results

    def _bind(self, n: int) -> tuple[list[Array], Array, Any, Any]:
        given = [np.zeros((n, size)) for size in self._sizes]
        found = np.zeros((n, self._column.numel_out(0)))
        buffer: Any
        buffer, evaluate = self._column.map(n).buffer()
        for i, array in enumerate(given):
            buffer.set_arg(i, array.data)
        buffer.set_res(0, found.data)
        self._calls[n] = given, found, buffer, evaluate  # the call refers to the buffer
        return self._calls[n]


def _columns_of(matrix: Any) -> list[int]:
    """Return the columns that are not structurally zero."""
    return sorted(set(matrix.sparsity().get_triplet()[1]))
