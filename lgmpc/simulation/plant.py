"""The interface of plants to the loop: reset, step, sense, and a wrench on a body."""

import math
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, SolverError
from lgmpc.robot import Robot
from lgmpc.typing import Array

_LARGEST_SPEED = 1e6  # m/s, rad/s


class PlantSample(NamedTuple):
    """State of a plant after a step, all in Pinocchio's conventions.

    Attributes:
        time: seconds since reset.
        q: (nq,) configuration.
        v: (nv,) velocity.
        tau: (nu,) joint torque applied during the last step, after clipping, N.m.
        contact_forces: (nc, 3) force on each contact frame during the last step, world axes, acting on the robot, N.
    """

    time: float
    q: Array
    v: Array
    tau: Array
    contact_forces: Array


class Plant(Protocol):
    """A robot in a physics engine. Its parameters (mass, friction, ...) may differ from the controller's model."""

    @property
    def dt(self) -> float:
        """Duration of one step, s."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that a wrench can act on."""

    def reset(self, x: Array) -> None:
        """Put the robot into state ``x = (q, v)``, clear wrenches and set the time to zero."""

    def resume(self, sample: PlantSample) -> None:
        """Continue, without wrenches, from a sample of another plant of the same robot and engine."""

    def step(self, tau: Array) -> None:
        """Advance by ``dt`` under joint torques ``tau`` (nu,), N.m, clipped at the actuators' limits."""

    def sense(self) -> PlantSample:
        """Return the state reached by the last step."""

    def set_wrench(self, body: str, wrench: Array) -> None:
        """Apply ``wrench`` (6,) = [force; torque] in world axes at the centre of mass of ``body`` until it is changed.

        Raises:
            InputError: if the body is unknown (names the nearest) or the wrench is not six finite numbers.
        """

    def body_point(self, body: str) -> Array:
        """Return the (3,) world position of the centre of mass of ``body``."""


def _vector(name: str, value: Array, size: int) -> Array:
    """Return ``value`` as (size,) finite floats; InputError otherwise."""
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
        InputError: if ``x`` has the wrong shape, is not finite, or has a quaternion or an angle's cosine and sine
            that are not of unit length.
    """
    x = _vector("x", x, model.nq + model.nv)
    q, v = x[: model.nq], x[model.nq :]
    if not pin.isNormalized(model, q, 1e-6):
        raise InputError("x", "a configuration off its group", "quaternions (and cosine-sine pairs) of unit length")
    return q, v


def check_torque(tau: Array, size: int) -> float:
    """Return the length of the vector of torques; fast, because it is called at every step.

    Raises:
        InputError: they are not ``size`` finite numbers.
    """
    if isinstance(tau, np.ndarray) and tau.shape == (size,):
        length = math.hypot(*tau.tolist())  # of a dozen numbers, Python's is faster than NumPy's
        if length < math.inf:
            return length
    return math.hypot(*_vector("tau", tau, size).tolist())


class BodyWrenches:
    """The wrenches that act on the links of a robot.

    Links joined by fixed joints are one rigid body. Wrenches on several of its links add up, and each acts at the
    centre of mass of that whole body.

    Args:
        robot: robot with these links.

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
        """Remove all wrenches."""
        self._wrenches.clear()


def check_speed(v: Array, plant: str, time: float) -> None:
    """Raise SolverError if a velocity (nv,) is not finite, or so large that it soon would not be."""
    if not math.hypot(*v.tolist()) < _LARGEST_SPEED:  # also where it is NaN
        raise SolverError(plant, f"the state diverged before {time:.4g} s", "Use a smaller timestep or smaller gains.")
