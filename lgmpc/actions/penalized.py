"""An action whose path constraint is a term of its cost: the augmented Lagrangian of one interval.

With multipliers mu and a penalty rho, both parameters, the constraint ``lower <= g <= upper`` becomes the cost

    rho / 2 dist(g + mu / rho, [lower, upper])^2,

whose gradient is that of ``mu^T g`` at the solution's multipliers (Hestenes, J. Optim. Theory Appl. 4, 1969; for
inequalities Rockafellar, J. Optim. Theory Appl. 12, 1973). A solver without constraints minimises it.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.base import Action, Stage
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.linearisation import ExpansionSteps, expand_in_steps
from lgmpc.actions.multibody import ItemAction
from lgmpc.actions.python_action import PythonAction, StageDerivatives
from lgmpc.costs import Bounded, Cost, CostTerm, Parameter, ParameterLayout, QuadraticBarrier
from lgmpc.typing import Array, instance


class PenalizedAction(ItemAction):
    """An action with the same dynamics and the constraint as a cost (see the module).

    Parameters: those of the action, then ``constraint_multipliers`` (ng,) and ``constraint_penalty``, positive.

    Args:
        action: the action.

    Attributes:
        base: the action.
    """

    def __init__(self, action: Action) -> None:
        instance("action", action, Action, "an action")
        self.base = action
        self.name = f"{action.name}_penalized"
        self.state, self.nu = action.state, action.nu
        self.parameters = _with_penalty(action)
        if isinstance(action, ItemAction):
            self.robot, self.own_parameters = action.robot, action.own_parameters

    @cached_property
    def expansion(self) -> ExpansionSteps | None:
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


class _PenalizedPython(PythonAction):
    """The same of an action written in Python: rows of the residual, which is half squared."""

    def __init__(self, base: PythonAction) -> None:
        self.base = base
        self.name, self.state, self.nu = f"{base.name}_penalized", base.state, base.nu
        self.parameters = _with_penalty(base)

    def step(self, x: Array, u: Array, p: Array) -> Array:
        return self.base.step(x, u, self._own(p))

    def residual(self, x: Array, u: Array, p: Array) -> Array:
        distance, root = self._outside(x, u, p)
        return np.concatenate([self.base.residual(x, u, self._own(p)), root * distance])

    def terminal_residual(self, x: Array, p: Array) -> Array:
        return self.base.terminal_residual(x, self._own(p))

    def derivatives(self, x: Array, u: Array, p: Array) -> StageDerivatives:
        d, (distance, root) = self.base.slopes(x, u, self._own(p)), self._outside(x, u, p)
        active = root * (distance != 0.0)[:, None]
        return StageDerivatives(
            d.step_x, d.step_u, np.vstack([d.residual_x, active * d.limits_x]),
            np.vstack([d.residual_u, active * d.limits_u]), d.limits_x[:0], d.limits_u[:0],
        )  # fmt: skip

    def terminal_derivatives(self, x: Array, p: Array) -> Array:
        return self.base.terminal_derivatives(x, self._own(p))

    def _own(self, p: Array) -> Array:
        return p[: self.base.parameters.size]

    def _outside(self, x: Array, u: Array, p: Array) -> tuple[Array, float]:
        """Return the signed distance (ng,) of the shifted rows from their bounds, and the root of the penalty."""
        values, (_, _, g, lower, upper) = self.parameters.split(p), self.base.values(x, u, self._own(p))
        rho = float(values["constraint_penalty"][0])
        shifted = g + values["constraint_multipliers"] / rho
        return shifted - np.clip(shifted, lower, upper), math.sqrt(rho)


def penalize(action: Action) -> Action:
    """Return an action with the constraint as a cost."""
    return _PenalizedPython(action) if isinstance(action, PythonAction) else PenalizedAction(action)


def _with_penalty(action: Action) -> ParameterLayout:
    """Return an action's parameters, then multipliers and penalty."""
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
