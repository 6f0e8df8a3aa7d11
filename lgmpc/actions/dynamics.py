"""Equations of motion: accelerations, efforts and contact forces from state and control; loads."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.actions.contacts import Contact, ContactSet
from lgmpc.actions.implicit import Unknowns
from lgmpc.costs import Parameter
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import StateMultibody
from lgmpc.typing import instance, numbers


@dataclass(frozen=True)
class DynamicsSolution:
    """Accelerations, efforts and forces at one point.

    Attributes:
        a: (nv,) acceleration.
        tau: efforts of the actuated joints, None if the dynamics does not compute them.
        forces: contact forces (3,) or wrenches (6,) by frame, world axes, on the robot.
    """

    a: Any
    tau: Any
    forces: Mapping[int | str, Any] = field(default_factory=dict)


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
        self.nu, self.parameters = nu, parameters

    @abstractmethod
    def motion(self, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns) -> DynamicsSolution:
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


class ContactForwardDynamics(Dynamics):
    """u = efforts, ``B u`` on the robot; accelerations and contact forces from the constrained equations of motion.

        M a + nle = B u + J^T f + loads,        J a + dJ/dt v + Baumgarte = -damping f

    for the contacts whose flag is 1; the others have no force. Udwadia and Kalaba (1992); with point contacts it is
    Crocoddyl's contact forward dynamics with LOCAL_WORLD_ALIGNED contacts.

    Parameters: contact_flags, contact_damping, contact_points, contact_gains (and contact_orientations if there are
    surfaces), and those of the loads.

    Args:
        model: the robot; its base, if free, is not actuated.
        contacts: names of frames (points) or contacts.
        loads: further forces on the robot.
        actuation: (nv, nu) B, with zero rows for passive joints and columns for thrusters (see
            :func:`lgmpc.actions.thrusters`); unless given, the identity on all joints but the free base.

    Raises:
        InputError: a contact frame that is unknown or named twice, or a matrix of the wrong shape.
        ModelError: unsupported joints.
    """

    def __init__(
        self,
        model: pin.Model,
        contacts: Sequence[str | Contact],
        loads: Sequence[Load] = (),
        actuation: ArrayLike | None = None,
    ) -> None:
        self.contacts = ContactSet(model, contacts)
        instance("loads", loads, (tuple, list), "a list of loads")
        for i, load in enumerate(loads):
            instance(f"loads[{i}]", load, Load, "a Load, such as ExternalWrench(model)")
        self.loads = tuple(loads)
        self.actuation = _actuation(model, actuation)
        parameters = [*self.contacts.parameters, *self.contacts.anchors]
        parameters += [parameter for load in loads for parameter in load.parameters]
        super().__init__(model, self.actuation.shape[1], tuple(parameters))

    def motion(self, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns) -> DynamicsSolution:
        """Return accelerations and contact forces."""
        robot, contacts, nv = self.robot, self.contacts, self.robot.nv
        solver, flags = contacts.solver(robot, q, values), contacts.flags(values)
        effort = self.actuation @ u
        tau = effort[actuated(self.model)]
        for load in self.loads:
            effort += load.generalized(robot, q, values)

        def residual(z: Any) -> Any:
            a, f = z[:nv], z[nv:]
            external = contacts.by_frame(flags * f, robot, q)
            held = flags * contacts.acceleration(robot, q, v, a, values)
            loose = (1 - flags + values["contact_damping"]) * f
            return ca.vertcat(robot.rnea(q, v, a, external) - effort, held + loose)

        still = flags * contacts.acceleration(robot, q, v, None, values)
        z = unknowns.define_linear(solver, ca.vertcat(effort - robot.nle(q, v), -still), residual)
        return DynamicsSolution(z[:nv], tau, contacts.by_frame(z[nv:], robot, q))


class FreeForwardDynamics(Dynamics):
    """No contacts; generalised forces ``B u - linear drag v - quadratic drag |v| v``, entry by entry.

    For an arm (B = identity) and a quadrotor (B from the thrusters, see :func:`lgmpc.actions.thrusters`).

    Parameters: ``drag_linear``, ``drag_quadratic`` (nv,).

    Args:
        model: the robot.
        actuation: (nv, nu) B; unless given, the identity on the actuated joints.

    Raises:
        InputError: a matrix of the wrong shape.
        ModelError: unsupported joints.
    """

    def __init__(self, model: pin.Model, actuation: ArrayLike | None = None) -> None:
        self.actuation = _actuation(model, actuation)
        nv, nu = self.actuation.shape
        parameters = (
            Parameter("drag_linear", nv, "generalised drag force per velocity"),
            Parameter("drag_quadratic", nv, "generalised drag force per squared velocity"),
        )
        super().__init__(model, nu, parameters)

    def motion(self, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns) -> DynamicsSolution:
        """Return the accelerations."""
        robot, effort = self.robot, self.forces(v, u, values)

        def residual(a: Any) -> Any:
            return robot.rnea(q, v, a) - effort

        a = unknowns.define_linear(robot.mass_factor(q), effort - robot.nle(q, v), residual)
        return DynamicsSolution(a, (self.actuation @ u)[actuated(self.model)])

    def forces(self, v: Any, u: Any, values: Mapping[str, Any]) -> Any:
        """Return (nv,) the generalised forces other than gravity and inertial forces."""
        return self.actuation @ u - values["drag_linear"] * v - values["drag_quadratic"] * ca.fabs(v) * v


def _actuation(model: pin.Model, actuation: ArrayLike | None) -> ca.DM:
    """Return (nv, nu) B; the identity on the actuated joints unless given."""
    joints, nv = actuated(model), int(model.nv)
    matrix = np.eye(nv)[:, joints] if actuation is None else numbers("actuation", actuation)
    if matrix.ndim != 2 or matrix.shape[0] != nv or not np.isfinite(matrix).all():
        raise InputError("actuation", f"shape {matrix.shape}", f"a finite matrix of shape ({nv}, nu)")
    return ca.sparsify(ca.DM(matrix))
