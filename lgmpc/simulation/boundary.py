"""What both plants accept from outside: states, torques, and wrenches on named bodies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

if TYPE_CHECKING:
    from lgmpc.robot import Robot

__all__ = ["BodyWrenches", "check_speed", "check_state", "check_torque"]

_LARGEST_SPEED = 1e6  # m/s, rad/s


def _vector(name: str, value: Array, size: int) -> Array:
    """Return ``value`` as (size,) floats, or say what is wrong with it."""
    try:
        vector = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(name, repr(value), f"{size} numbers") from None
    if vector.shape != (size,):
        raise InputError(name, f"an array of shape {vector.shape}", f"shape ({size},)")
    if not np.isfinite(vector).all():
        bad = np.flatnonzero(~np.isfinite(vector))
        raise InputError(name, f"{vector[bad[0]]} at index {bad[0]}", "finite numbers")
    return vector


def check_state(model: pin.Model, x: Array) -> tuple[Array, Array]:
    """Return ``x`` (nq + nv,) as ``(q, v)``.

    Raises:
        InputError: if ``x`` has the wrong shape, is not finite, or holds a quaternion or an angle's cosine and sine
            that are not of unit length.
    """
    x = _vector("x", x, model.nq + model.nv)
    q, v = x[: model.nq], x[model.nq :]
    if not pin.isNormalized(model, q, 1e-6):
        raise InputError("x", "a configuration off its group", "quaternions (and cosine-sine pairs) of unit length")
    return q, v


def check_torque(tau: Array, size: int) -> None:
    """Refuse torques that are not ``size`` finite numbers; cheap, because it runs at every step."""
    # The sum of finite torques is finite, unless they are absurd: then each is looked at.
    if not isinstance(tau, np.ndarray) or tau.shape != (size,) or not math.isfinite(sum(tau.tolist())):
        _vector("tau", tau, size)


class BodyWrenches:
    """The wrenches that act on the links of a robot.

    Links joined by fixed joints are one rigid body. Wrenches on several of its links add up, and each acts at the
    centre of mass of that whole body.

    Args:
        robot: whose links can be named.

    Attributes:
        joints: for each link, the joint that moves it.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.joints: dict[str, int] = {
            name: robot.model.frames[robot.body_frame(name)].parentJoint for name in robot.body_names
        }
        self._wrenches: dict[str, Array] = {}

    def joint(self, body: str) -> int:
        """Return the joint that moves link ``body``, or raise InputError with the nearest names."""
        if body not in self.joints:
            self._robot.body_frame(body)  # raises
        return self.joints[body]

    def set(self, body: str, wrench: Array) -> tuple[int, Array]:
        """Replace the wrench on link ``body``; return its joint and the sum over the links that this joint moves.

        Raises:
            InputError: if the body is unknown (names the nearest) or the wrench is not six finite numbers.
        """
        joint = self.joint(body)
        self._wrenches[body] = np.array(_vector("wrench", wrench, 6))
        total = np.zeros(6)
        for name, part in self._wrenches.items():
            if self.joints[name] == joint:
                total += part
        return joint, total

    def clear(self) -> None:
        """Forget every wrench."""
        self._wrenches.clear()


def check_speed(v: Array, plant: str, time: float) -> None:
    """Raise SolverError if a velocity (nv,) is not finite, or so large that it soon will not be."""
    if not v.dot(v) < _LARGEST_SPEED**2:  # also where it is NaN
        raise SolverError(plant, f"the state diverged before {time:.4g} s", "Use a smaller timestep or smaller gains.")
