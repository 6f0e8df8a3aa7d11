"""Residuals of state, control, joints, momentum, and of frames fixed to the robot's bodies."""

import math
from abc import abstractmethod
from typing import Any, ClassVar

import casadi as ca
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.costs.parameters import Parameter
from lgmpc.costs.residual import Residual
from lgmpc.costs.symbols import StageSymbols
from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.state.base import State
from lgmpc.typing import instance


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
    """A quantity minus its reference, the default of the parameter ``reference``."""

    meaning: ClassVar[str]
    """Description of the parameter."""

    def __init__(self, reference: ArrayLike = 0.0) -> None:
        self.parameters = (Parameter("reference", self.nr, self.meaning, reference),)

    @abstractmethod
    def _quantity(self, s: StageSymbols) -> Any:
        """Return the column from which the reference is subtracted."""

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return self._quantity(s) - s["reference"]


class _OfEach(_Difference):
    """One number for each of nu joints."""

    def __init__(self, nu: int, reference: ArrayLike = 0.0) -> None:
        self.nr = nu
        super().__init__(reference)


class Control(_OfEach):
    """``u - reference`` (nu,).

    Args:
        nu: dimension of the control.
        reference: default of the parameter ``reference``.
    """

    meaning = "reference of the control"

    def _quantity(self, s: StageSymbols) -> Any:
        return s.u


class JointPosition(_OfEach):
    """Positions of the actuated joints minus ``reference`` (nu,), rad (m); of joints of one number each.

    Args:
        nu: number of actuated joints, the last of the configuration.
        reference: default of the parameter ``reference``.
    """

    meaning = "reference of the joint positions, rad"

    def _quantity(self, s: StageSymbols) -> Any:
        return s.q[s.robot.nq - self.nr :]


class JointAcceleration(_OfEach):
    """Accelerations of the actuated joints minus ``reference`` (nu,), rad/s2 (m/s2).

    Args:
        nu: number of actuated joints, the last of the velocity.
        reference: default of the parameter ``reference``.
    """

    meaning = "reference of the joint accelerations, rad/s2"

    def _quantity(self, s: StageSymbols) -> Any:
        return s.a[s.robot.nv - self.nr :]


class ContactControlGravity(Residual):
    """Efforts of the actuated joints minus those that balance gravity and the contact forces, if any, at rest (nu,).

    Args:
        nu: number of actuated joints.
    """

    def __init__(self, nu: int) -> None:
        self.nr = nu

    def expression(self, s: StageSymbols) -> Any:
        """Return ``tau - (g(q) - sum of J^T f)``, N.m (N)."""
        held = s.robot.rnea(s.q, ca.SX.zeros(s.robot.nv), None, s.forces)
        return s.tau - held[s.robot.nv - self.nr :]


class CoMPosition(_Difference):
    """Centre of mass minus ``reference`` (3,), world axes, m.

    Args:
        reference: default of the parameter ``reference``.
    """

    nr = 3
    meaning = "reference of the centre of mass, world, m"

    def _quantity(self, s: StageSymbols) -> Any:
        return s.com


class CentroidalMomentum(_Difference):
    """Centroidal momentum [linear; angular] minus ``reference`` (6,), world axes, N.s and N.m.s.

    Args:
        reference: default of the parameter ``reference``.
    """

    nr = 6
    meaning = "reference of the centroidal momentum, world axes"

    def _quantity(self, s: StageSymbols) -> Any:
        return s.momentum


_IDENTITY = (0.0, 0.0, 0.0, 1.0)


class FramePlacement(Residual):
    """``log(Md^-1 M)`` (6,), [linear; angular] in the reference's axes: m and rad.

    Args:
        frame: name of the frame.
        reference: (7,) default of the parameter ``reference``: position and quaternion x y z w of Md.
    """

    nr = 6

    def __init__(self, frame: str, reference: ArrayLike = (0.0, 0.0, 0.0, *_IDENTITY)) -> None:
        self.frame = frame
        meaning = "position and quaternion x y z w to reach, world"
        self.parameters = (Parameter("reference", 7, meaning, reference),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the logarithm."""
        here, there = s.placement(self.frame), s["reference"]
        back = quaternion.to_matrix(there[3:]).T
        phi = so3.log(back @ here.rotation)
        return ca.vertcat(so3.left_jacobian_inverse_product(phi, back @ (here.translation - there[:3])), phi)


class _Rotation(Residual):
    def __init__(self, frame: str, reference: ArrayLike = _IDENTITY) -> None:
        self.frame = frame
        self.parameters = (Parameter("reference", 4, "orientation to reach, quaternion x y z w", reference),)

    def _matrices(self, s: StageSymbols) -> tuple[Any, Any]:
        return s.placement(self.frame).rotation, quaternion.to_matrix(s["reference"])


class FrameRotation(_Rotation):
    """``log(Rd^T R)`` (3,), rad.

    Args:
        frame: name of the frame.
        reference: (4,) default of the parameter ``reference``: quaternion x y z w of Rd.
    """

    nr = 3

    def expression(self, s: StageSymbols) -> Any:
        """Return the logarithm."""
        rotation, desired = self._matrices(s)
        return so3.log(desired.T @ rotation)


class FrameRotationMatrix(_Rotation):
    """``vec(R - Rd) / sqrt 2`` (9,): half its square is ``Psi = 1/2 tr(I - Rd^T R)``; smooth everywhere.

    Psi is ``1 - cos`` of the angle between them. Bullo and Lewis, Geometric Control of Mechanical Systems (2005).

    Args:
        frame: name of the frame.
        reference: (4,) default of the parameter ``reference``: quaternion x y z w of Rd.
    """

    nr = 9

    def expression(self, s: StageSymbols) -> Any:
        """Return the entries' differences."""
        rotation, desired = self._matrices(s)
        return ca.vec(rotation - desired) / math.sqrt(2.0)


class FrameTranslation(_Difference):
    """Position of a frame's origin minus ``reference`` (3,), world axes, m.

    Args:
        frame: name of the frame.
        reference: default of the parameter ``reference``.
    """

    nr = 3
    meaning = "position to reach, world, m"

    def __init__(self, frame: str, reference: ArrayLike = 0.0) -> None:
        self.frame = frame
        super().__init__(reference)

    def _quantity(self, s: StageSymbols) -> Any:
        return s.placement(self.frame).translation


class FrameVelocity(Residual):
    """Velocity [linear; angular] of a frame minus ``reference`` (6,), m/s and rad/s.

    Args:
        frame: name of the frame.
        axes: ``pin.LOCAL``, ``pin.LOCAL_WORLD_ALIGNED`` or ``pin.WORLD``.
        reference: default of the parameter ``reference``, in the same axes.
    """

    nr = 6

    def __init__(self, frame: str, axes: Any = pin.LOCAL, reference: ArrayLike = 0.0) -> None:
        self.frame, self.axes = frame, axes
        self.parameters = (Parameter("reference", 6, f"velocity to reach, {axes} axes, m/s and rad/s", reference),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.velocity(self.frame, self.axes) - s["reference"]


def root_of(square: Any) -> Any:
    """Return the square root of a scalar, with a derivative of zero at zero."""
    apart = square > 0
    return ca.if_else(apart, ca.sqrt(ca.if_else(apart, square, 1.0)), 0.0)
