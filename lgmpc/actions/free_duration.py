"""Intervals whose length is optimised: the state has one more entry, the phase's stretch.

The stretch sigma multiplies the length of every interval of a phase. It is chosen, once a phase, by the control of an
interval of no length (:class:`ChooseStretch`) and constant from there on (:class:`Stretched`), so that the problem
keeps the structure of optimal control, for any solver. :class:`lgmpc.ocp.FreeDurations` makes such a problem.
"""

from functools import cached_property
from typing import Any

import casadi as ca

from lgmpc.actions.base import Action, Stage
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.linearisation import ExpansionSteps, expand_in_steps
from lgmpc.actions.multibody import ItemAction
from lgmpc.costs import Bounded, Cost, CostTerm, LeastSquares, Parameter, ParameterLayout, Quadratic, QuadraticBarrier
from lgmpc.errors import InputError
from lgmpc.state import ProductState, State, StateVector
from lgmpc.typing import instance

_BAUMGARTE = "contact_gains"  # stiffness and damping, whose units are those of 1 / length^2 and 1 / length


class Stretched(ItemAction):
    """An action on (x, sigma) whose interval has the length sigma times the parameter ``duration``.

    Contacts keep Baumgarte's gains relative to the length. An action without duration (an impact) leaves sigma
    unchanged. Parameters are those of the action.

    Args:
        action: made of items.

    Raises:
        InputError: a running cost of an activation that is not quadratic, piecewise or not.
    """

    def __init__(self, action: ItemAction) -> None:
        instance("action", action, ItemAction, "an action made of items, as a MultibodyAction")
        self.base = action
        self.name = f"{action.name}_stretched"
        self.robot, self.nu = action.robot, action.nu
        self.state: State = ProductState(action.state, StateVector(1))
        self.costs, self.constraints = action.costs, action.constraints
        self.parameters, self.own_parameters = action.parameters, action.own_parameters
        self._timed = "duration" in tuple(self.parameters)
        quadratic = (Quadratic, QuadraticBarrier)
        for item in self.costs:
            if self._timed and not isinstance(item.activation, quadratic):
                names = ", ".join(kind.__name__ for kind in quadratic)
                raise InputError(f"activation of '{item.name}'", type(item.activation).__name__, f"one of {names}")

    @cached_property
    def expansion(self) -> ExpansionSteps | None:
        """The expansion in steps, if the action has one."""
        return None if self.base.expansion is None else expand_in_steps(self)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the interval."""
        nx = self.base.state.nx
        sigma = x[nx]
        stage = self.base.stage(x[:nx], u, self._scaled(p, sigma), unknowns)
        cost = Cost(tuple(_of_length(term, sigma) for term in stage.cost.terms)) if self._timed else stage.cost
        return Stage(ca.vertcat(stage.x_next, sigma), cost, stage.path)

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the action's own."""
        return self.base.terminal_cost(x[: self.base.state.nx], p)

    def _scaled(self, p: Any, sigma: Any) -> Any:
        if not self._timed:
            return p
        values = dict(self.parameters.split(p))
        values["duration"] = sigma * values["duration"]
        if _BAUMGARTE in values:
            contacts = values[_BAUMGARTE].shape[0] // 2
            values[_BAUMGARTE] = values[_BAUMGARTE] / ca.repmat(ca.vertcat(sigma**2, sigma), contacts, 1)
        return ca.vertcat(*values.values())


def _of_length(term: CostTerm, sigma: Any) -> CostTerm:
    """Return a term whose weight has the factor sigma, as a factor of the residual, with its derivative."""
    root, weight = ca.sqrt(sigma), term.weight / sigma
    if isinstance(term.activation, QuadraticBarrier):
        return CostTerm(root * term.activation.gradient(term.residual), Quadratic(), weight)
    return CostTerm(root * term.residual, term.activation, weight)


class ChooseStretch(Action):
    """An interval of no length whose control is the stretch of the intervals behind it.

    Parameters: ``stretch_lower`` and ``stretch_upper``, its bounds, and ``stretch_reference`` and ``stretch_weight`` of
    the cost ``weight / 2 (sigma - reference)^2``.

    Args:
        name: a C identifier.
        state: of the stretched actions.
    """

    def __init__(self, name: str, state: State) -> None:
        self.name, self.state, self.nu = name, state, 1
        self.parameters = ParameterLayout(
            Parameter("stretch_lower", 1, "least stretch of the phase", 0.5, "positive"),
            Parameter("stretch_upper", 1, "largest stretch of the phase", 2.0, "positive"),
            Parameter("stretch_reference", 1, "reference of the stretch", 1.0, "positive"),
            Parameter("stretch_weight", 1, "weight of the stretch's deviation", 1e-3, "not negative"),
        )

    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return the state with the control as its stretch."""
        return ca.vertcat(x[: self.state.nx - 1], u)

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the cost of the stretch."""
        values = self.parameters.split(p)
        return LeastSquares(u - values["stretch_reference"], values["stretch_weight"])

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the bounds of the stretch."""
        values = self.parameters.split(p)
        return Bounded(u, values["stretch_lower"], values["stretch_upper"])
