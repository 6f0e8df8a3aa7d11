"""The end of a horizon: constraints on its last state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pinocchio as pin

from lgmpc.actions.base import Stage
from lgmpc.actions.dynamics import actuated
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.multibody import ItemAction
from lgmpc.costs import ConstraintItem, Cost, CostItem, StageSymbols, constraint_of
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import StateMultibody

__all__ = ["HoldAction"]


class HoldAction(ItemAction):
    """An interval of zero length without control: the state stays the same and satisfies constraints.

    Behind the last interval it makes them terminal constraints; the horizon then ends with the same state twice:

        arrive = HoldAction("arrive", model, costs, [ConstraintItem("hand", FramePlacement("hand", goal))])
        problem = ShootingProblem([move] * 50 + [arrive])

    Between two others it is a waypoint. SQP and nonlinear programmes satisfy it; FDDP supports no constraints.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        model: the robot.
        costs: of the last state, where this is the last action (counted once).
        constraints: on the state: configuration and velocity.

    Raises:
        InputError: a name that is no identifier, or two items of one name.
        ModelError: unsupported joints.
    """

    def __init__(
        self,
        name: str,
        model: pin.Model,
        costs: Sequence[CostItem] = (),
        constraints: Sequence[ConstraintItem] = (),
    ) -> None:
        actuated(model)  # checks its type
        super().__init__(name, SymbolicModel(model), StateMultibody(model), 0, (), costs, constraints)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return the state itself, no cost, and the constraints."""
        symbols = StageSymbols(self.robot, x, self.parameters.split(p))
        return Stage(x, Cost(), constraint_of(self.constraints, symbols))
