"""Equations of motion: accelerations, efforts and contact forces from state and control; loads."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import pinocchio as pin

from lgmpc.actions.implicit import Unknowns
from lgmpc.costs import Bounded, Parameter
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import StateMultibody
from lgmpc.typing import instance

__all__ = ["Dynamics", "ExternalWrench", "Load", "Motion", "actuated"]


@dataclass(frozen=True)
class Motion:
    """Accelerations, efforts and forces at one point.

    Attributes:
        a: (nv,) acceleration.
        tau: efforts of the actuated joints, None if the dynamics does not compute them.
        forces: contact forces (3,) or wrenches (6,) by frame, world axes, on the robot.
        path: constraint that makes control and motion consistent.
    """

    a: Any
    tau: Any
    forces: Mapping[int | str, Any] = field(default_factory=dict)
    path: Bounded = field(default_factory=Bounded.stack)


class Dynamics(ABC):
    """Equations of motion of a robot under a control.

    Args:
        model: the robot.
        nu: dimension of the control.
        parameters: quantities that may change between two solves.

    Attributes:
        model: the robot.
        robot: its symbolic algorithms.
        state: x = (q, v).
        nu: dimension of the control.
        parameters: quantities that may change between two solves.

    Raises:
        ModelError: unsupported joints.
    """

    def __init__(self, model: pin.Model, nu: int, parameters: tuple[Parameter, ...]) -> None:
        instance("model", model, pin.Model, "a pinocchio.Model")
        self.model = model
        self.robot = SymbolicModel(model)
        self.state = StateMultibody(model)
        self.nu = nu
        self.parameters = parameters

    @abstractmethod
    def motion(self, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns) -> Motion:
        """Return the motion at a point.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            u: (nu,) control.
            values: parameters by name.
            unknowns: collects the quantities that are defined by an equation.
        """


def actuated(model: pin.Model) -> slice:
    """Entries of the velocity that are actuated: all but the free-flyer's, if the model begins with one."""
    instance("model", model, pin.Model, "a pinocchio.Model")
    floating = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
    return slice(6 if floating else 0, int(model.nv))


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
