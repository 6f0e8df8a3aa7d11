"""Tasks and costs of a user's own, which tests name in configs."""

from __future__ import annotations

from typing import Any

import lgmpc
from lgmpc.robot import Robot
from lgmpc.wbc import NumericTask, SymbolicTask
from lgmpc.wbc.terms import WholeBodyTerms


class Height(SymbolicTask):
    """Height of the base, m."""

    name, dim = "height", 1

    def __init__(self, gain: lgmpc.Gain, weight: float, at: float = 0.3) -> None:
        super().__init__(gain, weight)
        self.at = at

    def position(self, s: Any) -> Any:
        """Return the height."""
        return s.q[2]

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the height that the config gives."""
        self.hold([self.at])  # type: ignore[arg-type]


class Twice(SymbolicTask):
    """Takes the name of a standard task."""

    name, dim = "com", 3

    def position(self, s: Any) -> Any:
        """Return the centre of mass."""
        return s.com


class Short(SymbolicTask):
    """Declares fewer rows than its expression has."""

    dim = 2

    def position(self, s: Any) -> Any:
        """Return three rows."""
        return s.com


class Stiff(NumericTask):
    """Rows that demand nothing."""

    dim = 1

    def update(self, terms: WholeBodyTerms) -> None:
        """Leave the rows at zero."""


class Level(lgmpc.Residual):
    """Horizontal components of the base's vertical axis."""

    nr = 2

    def expression(self, s: Any) -> Any:
        """Return the two components."""
        frame = 2  # of the free joint
        return s.placement(s.robot.model.frames[frame].name).rotation[:2, 2]


def slow_joints(robot: Robot, scale: float = 1.0) -> lgmpc.CostItem:
    """Return the cost of the joints' speeds."""

    class Speeds(lgmpc.Residual):
        nr = robot.nu

        def expression(self, s: Any) -> Any:
            return s.v[6:]

    return lgmpc.CostItem("slow_joints", Speeds(), scale)


def nothing(*arguments: object) -> None:
    """Return neither a task nor a cost."""


def failing(*arguments: object) -> None:
    """Raise an exception."""
    raise RuntimeError("it has no battery")


class FailsWhenFast(NumericTask):
    """Has a fault that appears at speed."""

    dim = 1

    def update(self, terms: WholeBodyTerms) -> None:
        """Raise above half a metre a second."""
        if terms.px > 1.25:
            raise RuntimeError("too fast")
