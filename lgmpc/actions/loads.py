"""Forces on a robot other than those of its motors, its contacts and gravity."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import casadi as ca
import pinocchio as pin

from lgmpc.actions.dynamics import actuated
from lgmpc.costs import Parameter
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel

__all__ = ["ExternalWrench", "Load"]


class Load(ABC):
    """A generalised force that depends on parameters.

    Attributes:
        parameters: quantities that may change between two solves.
    """

    parameters: tuple[Parameter, ...]

    @abstractmethod
    def generalized(self, robot: SymbolicModel, q: Any, values: Mapping[str, Any]) -> Any:
        """Return the (nv,) generalised force at a configuration.

        Args:
            robot: the symbolic algorithms.
            q: (nq,) configuration.
            values: parameters by name.
        """


class ExternalWrench(Load):
    """A wrench on the free base, such as a push that an observer estimates.

    Parameter ``external_wrench`` (6,): [force; moment about the robot's centre of mass], world axes, N and N.m. It
    changes the centroidal momentum at exactly this rate: with R the base's orientation, p its origin and c the centre
    of mass, the generalised force is ``[R^T f; R^T (tau + (c - p) x f); 0]``.

    Args:
        model: the robot; its first joint is a free-flyer.

    Raises:
        InputError: no free base.
    """

    def __init__(self, model: pin.Model) -> None:
        if actuated(model).start == 0:
            raise InputError("model", f"{model.name}, whose base is fixed", "a model whose first joint is a free-flyer")
        meaning = "[force; moment about the centre of mass] on the base, world axes, N, N.m"
        self.parameters = (Parameter("external_wrench", 6, meaning),)

    def generalized(self, robot: SymbolicModel, q: Any, values: Mapping[str, Any]) -> Any:
        """Return the generalised force."""
        force, moment = values["external_wrench"][:3], values["external_wrench"][3:]
        base = robot.joint_placement(q, 1)
        moment += ca.cross(robot.com(q) - base.translation, force)
        back = base.rotation.T
        return ca.vertcat(back @ force, back @ moment, ca.SX(robot.nv - 6, 1))
