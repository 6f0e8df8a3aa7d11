"""What both plants accept from outside: states, torques, and wrenches on named bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

__all__ = ["body_index", "check_state", "check_torque", "check_wrench", "diverged", "pushable_bodies"]


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
    # The sum of squares is finite only where every element is; a torque whose square overflows is refused as well.
    if np.shape(tau) != (size,) or not math.isfinite(np.dot(tau, tau)):
        _vector("tau", tau, size)
        raise InputError("tau", "numbers beyond 1e150", "torques in N.m")


def check_wrench(wrench: Array) -> Array:
    """Return ``wrench`` as six finite floats, or raise InputError."""
    return _vector("wrench", wrench, 6)


def pushable_bodies(model: pin.Model) -> dict[str, int]:
    """Return, for every moving link of the model, the joint that moves it, in the model's order."""
    return {f.name: f.parentJoint for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0}


def body_index(bodies: Mapping[str, int], body: str) -> int:
    """Return the joint that moves ``body``, or raise InputError with the nearest names."""
    try:
        return bodies[body]
    except (KeyError, TypeError):
        raise InputError("body", repr(body), "a body of the robot", tuple(bodies), word=str(body)) from None


def diverged(plant: str, time: float) -> SolverError:
    """Make the error for a state that is no longer finite."""
    return SolverError(plant, f"the state diverged before {time:.4g} s", "Use a smaller timestep or smaller gains.")
