"""The quantities of one node as CasADi expressions, of which residuals are written."""

from collections.abc import Mapping
from copy import copy
from typing import Any

import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot.symbolic import Placement, SymbolicModel


class MissingQuantityError(InputError):
    """A residual uses a quantity that its node does not have, such as the control at the end of the horizon."""


class StageSymbols:
    """The quantities of one node of a robot's trajectory.

    Kinematic quantities that several residuals share are computed once. ``s["name"]`` is the residual's own parameter
    or, where it has none of that name, the action's.

    Args:
        robot: the symbolic algorithms.
        x: state whose first nq entries are the configuration, the others the velocity.
        parameters: columns by name.
        u: (nu,) control.
        a: (nv,) acceleration.
        tau: (nu,) efforts of the actuated joints, N.m (N).
        forces: contact forces (3,) or wrenches (6,) by frame name, world axes at the frame's origin, on the robot.
    """

    def __init__(
        self,
        robot: SymbolicModel,
        x: Any,
        parameters: Mapping[str, Any],
        *,
        u: Any = None,
        a: Any = None,
        tau: Any = None,
        forces: Mapping[int | str, Any] | None = None,
    ) -> None:
        self.robot, self.x = robot, x
        self.q = x[: robot.nq]
        self.v = x[robot.nq :]
        self._parameters = parameters
        self._prefix = ""
        self._u, self._a, self._tau, self._forces = u, a, tau, forces

    @property
    def u(self) -> Any:
        """(nu,) control."""
        return self._have("u", self._u)

    @property
    def a(self) -> Any:
        """(nv,) acceleration."""
        return self._have("a", self._a)

    @property
    def tau(self) -> Any:
        """(nu,) efforts of the actuated joints, N.m (N for prismatic joints)."""
        return self._have("tau", self._tau)

    @property
    def forces(self) -> Mapping[int | str, Any]:
        """Contact forces (3,) or wrenches (6,) by frame name, world axes at the frame's origin, on the robot."""
        return self._have("forces", self._forces)

    def force(self, frame: str) -> Any:
        """Return the contact force (3,) or wrench (6,) at a frame.

        Raises:
            InputError: the frame is no contact of the action; names the nearest.
        """
        try:
            return self.forces[frame]
        except KeyError:
            raise InputError("frame", frame, "a contact of the action", tuple(map(str, self.forces))) from None

    def placement(self, frame: str) -> Placement:
        """Return the placement of a frame in the world: ``.rotation`` (3, 3) and ``.translation`` (3,)."""
        return self.robot.frame_placement(self.q, frame)

    def velocity(self, frame: str, reference: Any = pin.LOCAL) -> Any:
        """Return the (6,) velocity [linear; angular] of a frame."""
        return self.robot.frame_velocity(self.q, self.v, frame, reference)

    @property
    def com(self) -> Any:
        """(3,) centre of mass, world axes, m."""
        return self.robot.com(self.q)

    @property
    def momentum(self) -> Any:
        """(6,) centroidal momentum [linear; angular], world axes."""
        return self.robot.momentum(self.q, self.v)

    def __getitem__(self, name: str) -> Any:
        """Return a parameter.

        Raises:
            InputError: there is none of this name; names the nearest.
        """
        own = f"{self._prefix}_{name}"
        for key in (own, name):
            if key in self._parameters:
                return self._parameters[key]
        choices = tuple(key.removeprefix(f"{self._prefix}_") for key in self._parameters)
        raise InputError("parameter", name, "a parameter of the residual or the action", choices)

    def within(self, prefix: str) -> "StageSymbols":
        """Return the same quantities for a residual whose parameters are called ``<prefix>_<name>``."""
        result = copy(self)
        result._prefix = prefix
        return result

    def _have(self, name: str, quantity: Any) -> Any:
        if quantity is None:
            raise MissingQuantityError(
                name, "a node without it", "a running cost or constraint of an action that has it"
            )
        return quantity
