"""Angles of attitudes, and rotations of the plane; rotations are world from body, (..., 3, 3), and not checked.

Sines and cosines of an angle are computed together by its arctangent: an arccosine loses half of the digits near zero.
"""

import math
from typing import Any

import numpy as np

from lgmpc.lie import so3
from lgmpc.lie.coefficients import Array

_UP = np.array([0.0, 0.0, 1.0])


def turn(angle: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Return a vector of the plane turned by an angle, rad: floats, or arrays that broadcast."""
    c, s = (math.cos(angle), math.sin(angle)) if isinstance(angle, float) else (np.cos(angle), np.sin(angle))
    return c * x - s * y, s * x + c * y


def yaw(rotation: Array) -> Array:
    """Return (...) the heading: the angle of the body's x axis in the plane, rad."""
    return np.asarray(np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return (..., 3) roll, pitch (within +-pi/2) and yaw of ``Rz(yaw) Ry(pitch) Rx(roll)``, rad."""
    roll = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch = np.arcsin(np.clip(-rotation[..., 2, 0], -1.0, 1.0))
    return np.stack([roll, pitch, yaw(rotation)], axis=-1)


def tilt(rotation: Array, upright: Array = _UP) -> Array:
    """Return (...) the angle between a body's axis (3,) and the vertical, 0 to pi, rad."""
    axis = rotation @ upright
    return np.asarray(np.arctan2(np.hypot(axis[..., 0], axis[..., 1]), axis[..., 2]))


def tilt_and_yaw(rotation: Array) -> tuple[Array, Array]:
    """Return (...) tilt, 0 to pi, and (...) yaw, -pi to pi, rad, of which the rotation is the tilt after the yaw."""
    sine, cosine = rotation[..., 1, 0] - rotation[..., 0, 1], rotation[..., 0, 0] + rotation[..., 1, 1]
    return tilt(rotation), np.asarray(np.arctan2(sine, cosine))


def angle_between(first: Array, second: Array) -> Array:
    """Return (...) the angle of the rotation from one to the other, 0 to pi, rad."""
    return np.asarray(np.linalg.norm(so3.log.unchecked(np.swapaxes(first, -1, -2) @ second), axis=-1))
