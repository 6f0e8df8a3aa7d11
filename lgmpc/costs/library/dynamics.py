"""Residuals of state, control, joints and momentum."""

from __future__ import annotations

from typing import Any

import casadi as ca
from numpy.typing import ArrayLike

from lgmpc.costs.parameters import Parameter
from lgmpc.costs.residual import Residual
from lgmpc.costs.symbols import StageSymbols
from lgmpc.state.base import State
from lgmpc.typing import instance

__all__ = [
    "CentroidalMomentum",
    "CoMPosition",
    "CoMVelocity",
    "ContactControlGravity",
    "Control",
    "ControlGravity",
    "JointAcceleration",
    "JointPosition",
    "StateError",
]


class StateError(Residual):
    """``x (-) reference``, in tangent coordinates (ndx,).

    Args:
        state: the space of x.
        reference: (nx,) default of the parameter ``reference``; the neutral state unless given.
    """

    def __init__(self, state: State, reference: ArrayLike | None = None) -> None:
        instance("state", state, State, "a State, as of a dynamics")
        self.nr = state.ndx
        self._state = state
        default = state.neutral() if reference is None else reference
        self.parameters = (Parameter("reference", state.nx, "reference of the state", default),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return self._state.diff_symbolic(s["reference"], s.x)


class _Difference(Residual):
    """A quantity minus its reference."""

    def __init__(self, size: int, meaning: str, reference: ArrayLike) -> None:
        self.nr = size
        self.parameters = (Parameter("reference", size, meaning, reference),)


class Control(_Difference):
    """``u - reference`` (nu,).

    Args:
        nu: dimension of the control.
        reference: default of the parameter ``reference``.
    """

    def __init__(self, nu: int, reference: ArrayLike = 0.0) -> None:
        super().__init__(nu, "reference of the control", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.u - s["reference"]


class JointPosition(_Difference):
    """Positions of the actuated joints minus ``reference`` (nu,), rad (m); of joints of one number each.

    Args:
        nu: number of actuated joints, the last of the configuration.
        reference: default of the parameter ``reference``.
    """

    def __init__(self, nu: int, reference: ArrayLike = 0.0) -> None:
        super().__init__(nu, "reference of the joint positions, rad", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.q[s.robot.nq - self.nr :] - s["reference"]


class JointAcceleration(_Difference):
    """Accelerations of the actuated joints minus ``reference`` (nu,), rad/s2 (m/s2).

    Args:
        nu: number of actuated joints, the last of the velocity.
        reference: default of the parameter ``reference``.
    """

    def __init__(self, nu: int, reference: ArrayLike = 0.0) -> None:
        super().__init__(nu, "reference of the joint accelerations, rad/s2", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.a[s.robot.nv - self.nr :] - s["reference"]


class ControlGravity(Residual):
    """Efforts of the actuated joints minus those that balance gravity without contacts (nu,), N.m (N).

    Args:
        nu: number of actuated joints.
    """

    def __init__(self, nu: int) -> None:
        self.nr = nu

    def expression(self, s: StageSymbols) -> Any:
        """Return ``tau - g(q)``."""
        return s.tau - s.robot.gravity(s.q)[s.robot.nv - self.nr :]


class ContactControlGravity(Residual):
    """Efforts of the actuated joints minus those that balance gravity and the contact forces at rest (nu,).

    Args:
        nu: number of actuated joints.
    """

    def __init__(self, nu: int) -> None:
        self.nr = nu

    def expression(self, s: StageSymbols) -> Any:
        """Return ``tau - (g(q) - sum of J^T f)``."""
        held = s.robot.rnea(s.q, ca.SX.zeros(s.robot.nv), None, s.forces)
        return s.tau - held[s.robot.nv - self.nr :]


class CoMPosition(_Difference):
    """Centre of mass minus ``reference`` (3,), world axes, m.

    Args:
        reference: default of the parameter ``reference``.
    """

    def __init__(self, reference: ArrayLike = 0.0) -> None:
        super().__init__(3, "reference of the centre of mass, world, m", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.com - s["reference"]


class CoMVelocity(_Difference):
    """Velocity of the centre of mass minus ``reference`` (3,), world axes, m/s.

    Args:
        reference: default of the parameter ``reference``.
    """

    def __init__(self, reference: ArrayLike = 0.0) -> None:
        super().__init__(3, "reference of the velocity of the centre of mass, world, m/s", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.robot.vcom(s.q, s.v) - s["reference"]


class CentroidalMomentum(_Difference):
    """Centroidal momentum [linear; angular] minus ``reference`` (6,), world axes, N.s and N.m.s.

    Args:
        reference: default of the parameter ``reference``.
    """

    def __init__(self, reference: ArrayLike = 0.0) -> None:
        super().__init__(6, "reference of the centroidal momentum, world axes", reference)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.momentum - s["reference"]
