"""An action whose path constraint is a term of its cost: the augmented Lagrangian of one interval.

With multipliers mu and a penalty rho, both parameters, the constraint ``lower <= g <= upper`` becomes the cost

    rho / 2 dist(g + mu / rho, [lower, upper])^2,

whose gradient is that of ``mu^T g`` at the solution's multipliers (Hestenes, J. Optim. Theory Appl. 4, 1969; for
inequalities Rockafellar, J. Optim. Theory Appl. 12, 1973). A solver without constraints minimises it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from lgmpc.actions.base import Action, Stage
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.linearisation import Expansion, expand_in_steps
from lgmpc.actions.multibody import ItemAction
from lgmpc.costs import Bounded, Cost, CostTerm, Parameter, ParameterLayout, QuadraticBarrier
from lgmpc.typing import instance

__all__ = ["PenalizedAction", "penalize"]


class PenalizedAction(ItemAction):
    """An action with the same dynamics and the constraint as a cost (see the module).

    Parameters: those of the action, then ``constraint_multipliers`` (ng,) and ``constraint_penalty``, positive.

    Args:
        action: the action.

    Attributes:
        base: the action.
        ng: rows of its path constraint.
    """

    def __init__(self, action: Action) -> None:
        instance("action", action, Action, "an action")
        self.base = action
        self.ng = action.path_rows
        self.name = f"{action.name}_penalized"
        self.state, self.nu = action.state, action.nu
        self.parameters = ParameterLayout(
            *action.parameters.parameters,
            Parameter("constraint_multipliers", action.path_rows, "estimates of the constraint's multipliers"),
            Parameter("constraint_penalty", 1, "weight of the constraint's violation", 1.0, "positive"),
        )
        if isinstance(action, ItemAction):
            self.robot, self.own_parameters = action.robot, action.own_parameters

    @cached_property
    def expansion(self) -> Expansion | None:
        """The expansion in steps, if the action has one: its dynamics are the same functions."""
        return None if self.base.expansion is None else expand_in_steps(self)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return the action's expressions, with the constraint as the last term of the cost."""
        stage = self.base.stage(x, u, p[: self.base.parameters.size], unknowns)
        values, path = self.parameters.split(p), stage.path
        rho = values["constraint_penalty"]
        shift = values["constraint_multipliers"] / rho
        term = CostTerm(path.value, _SquaredDistance(path.lower - shift, path.upper - shift), rho)
        return Stage(stage.x_next, Cost((*stage.cost.terms, term)), Bounded.stack(), stage.move)

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the action's own."""
        return self.base.terminal_cost(x, p[: self.base.parameters.size])


class _PenalizedPython(PenalizedAction):
    """The same of an action written in Python, whose functions are numerical."""

    smooth = False

    @cached_property
    def value_function(self) -> ca.Function:
        """As that of :class:`Action`."""
        function = self.base.value_function
        symbols, m, rho, shift = self._of_base(function)
        distance = _SquaredDistance(m["lower"] - shift, m["upper"] - shift)
        m["cost"] += rho * ca.sum1(distance.value(m["constraint"]))
        return self._written(function, symbols, m | dict.fromkeys(("constraint", "lower", "upper"), ca.MX(0, 1)))

    @cached_property
    def quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`."""
        function = self.base.quadratic_function
        symbols, m, rho, shift = self._of_base(function)
        # Bounds of the expansion are relative to the constraint's value.
        distance, here = _SquaredDistance(m["lower"] - shift, m["upper"] - shift), ca.MX.zeros(self.ng)
        c, d, weight = m["C"], m["D"], ca.diag(rho * distance.curvature(here))
        slope = rho * distance.gradient(here)
        more = {
            "Q": c.T @ weight @ c, "S": d.T @ weight @ c, "R": d.T @ weight @ d, "q": c.T @ slope, "r": d.T @ slope,
            "cost": rho * ca.sum1(distance.value(here)),
        }  # fmt: skip
        m |= {name: m[name] + value for name, value in more.items()}
        m |= {"C": c[:0, :], "D": d[:0, :], "lower": ca.MX(0, 1), "upper": ca.MX(0, 1)}
        return self._written(function, symbols, m)

    @cached_property
    def terminal_value_function(self) -> ca.Function:
        """As that of :class:`Action`."""
        function = self.base.terminal_value_function
        return self._written(function, *self._of_base(function)[:2])

    @cached_property
    def terminal_quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`."""
        function = self.base.terminal_quadratic_function
        return self._written(function, *self._of_base(function)[:2])

    def guarded(self, call: Callable[[], int], first: int) -> Callable[[], int]:
        """Return a call that raises an exception of Python with its node."""
        return self.base.guarded(call, first)

    def _of_base(self, function: ca.Function) -> tuple[list[Any], dict[str, Any], Any, Any]:
        """Return symbols, the results of the action's own function, the penalty, and the multipliers over it."""
        symbols = [*function.mx_in()[:-1], ca.MX.sym("p", self.parameters.size)]
        found = function.call([*symbols[:-1], symbols[-1][: self.base.parameters.size]])
        values = self.parameters.split(symbols[-1])
        rho = values["constraint_penalty"]
        return symbols, dict(zip(function.name_out(), found, strict=True)), rho, values["constraint_multipliers"] / rho

    def _written(self, function: ca.Function, symbols: list[Any], m: dict[str, Any]) -> ca.Function:
        return ca.Function(f"{function.name()}_penalized", symbols, list(m.values()), function.name_in(), list(m))


def penalize(action: Action) -> Action:
    """Return an action with the constraint as a cost."""
    return PenalizedAction(action) if action.smooth else _PenalizedPython(action)


@dataclass(frozen=True, eq=False)
class _SquaredDistance(QuadraticBarrier):
    """The barrier with curvature at the ends of the interval too: the only points of an equality."""

    def curvature(self, r: Any) -> Any:
        return 1 - ca.logic_and(r > self.lower, r < self.upper)
