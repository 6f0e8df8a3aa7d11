"""An action whose path constraint is a term of its cost: the augmented Lagrangian of one interval.

With multipliers mu and a penalty rho, both parameters, the constraint ``lower <= g <= upper`` becomes the cost

    rho / 2 dist(g + mu / rho, [lower, upper])^2,

whose gradient is that of ``mu^T g`` at the solution's multipliers (Hestenes, J. Optim. Theory Appl. 4, 1969; for
inequalities Rockafellar, J. Optim. Theory Appl. 12, 1973). A solver without constraints minimises it.
"""

from __future__ import annotations

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

__all__ = ["PenalizedAction", "penalize", "penalty_parameters"]


class PenalizedAction(ItemAction):
    """An action with the same dynamics and the constraint as a cost (see the module).

    Parameters: those of the action, then ``constraint_multipliers`` (ng,) and ``constraint_penalty``, positive.

    Args:
        action: an action made of expressions.

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
        self.parameters = penalty_parameters(action)
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


def penalize(action: Action) -> Action:
    """Return an action with the constraint as a cost, and the :func:`penalty_parameters`."""
    own = action.penalized()
    return PenalizedAction(action) if own is None else own


def penalty_parameters(action: Action) -> ParameterLayout:
    """Return an action's parameters, followed by the multipliers and the penalty of its path constraint."""
    return ParameterLayout(
        *action.parameters.parameters,
        Parameter("constraint_multipliers", action.path_rows, "estimates of the constraint's multipliers"),
        Parameter("constraint_penalty", 1, "weight of the constraint's violation", 1.0, "positive"),
    )


@dataclass(frozen=True, eq=False)
class _SquaredDistance(QuadraticBarrier):
    """The barrier with curvature at the ends of the interval too: the only points of an equality."""

    def curvature(self, r: Any) -> Any:
        return 1 - ca.logic_and(r > self.lower, r < self.upper)
