"""Residuals of frames fixed to the robot's bodies."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.costs.parameters import Parameter
from lgmpc.costs.residual import Residual
from lgmpc.costs.symbols import StageSymbols
from lgmpc.lie.symbolic import quaternion, so3

__all__ = [
    "FramePlacement",
    "FrameRotation",
    "FrameRotationMatrix",
    "FrameTranslation",
    "FrameVelocity",
    "root_of",
]

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


class FrameTranslation(Residual):
    """Position of a frame's origin minus ``reference`` (3,), world axes, m.

    Args:
        frame: name of the frame.
        reference: default of the parameter ``reference``.
    """

    nr = 3

    def __init__(self, frame: str, reference: ArrayLike = 0.0) -> None:
        self.frame = frame
        self.parameters = (Parameter("reference", 3, "position to reach, world, m", reference),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.placement(self.frame).translation - s["reference"]


class FrameVelocity(Residual):
    """Velocity [linear; angular] of a frame minus ``reference`` (6,), m/s and rad/s.

    Args:
        frame: name of the frame.
        axes: ``pin.LOCAL``, ``pin.LOCAL_WORLD_ALIGNED`` or ``pin.WORLD``.
        reference: default of the parameter ``reference``, in the same axes.
    """

    nr = 6

    def __init__(self, frame: str, axes: Any = pin.LOCAL, reference: ArrayLike = 0.0) -> None:
        self.frame = frame
        self.axes = axes
        self.parameters = (Parameter("reference", 6, f"velocity to reach, {axes} axes, m/s and rad/s", reference),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.velocity(self.frame, self.axes) - s["reference"]


def root_of(square: Any) -> Any:
    """Return the square root of a scalar, with a derivative of zero at zero."""
    apart = square > 0
    return ca.if_else(apart, ca.sqrt(ca.if_else(apart, square, 1.0)), 0.0)
