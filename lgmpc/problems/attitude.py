"""Angles of attitudes, for figures and messages; no cost uses them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.typing import Array

__all__ = ["angle_between", "rotation_of", "rpy_of", "tilt"]


def rotation_of(x: Array) -> Array:
    """Return (3, 3) the rotation of a state's free base, world from base."""
    return np.array(pin.Quaternion(x[3:7]).toRotationMatrix(), dtype=np.float64)


def tilt(x: Array) -> float:
    """Return the angle between the base's z axis and the world's, 0 to pi, rad."""
    up = rotation_of(x)[:, 2]
    return float(np.arctan2(np.hypot(up[0], up[1]), up[2]))


def angle_between(first: Array, second: Array) -> float:
    """Return the angle of ``first^T second`` for two rotations (3, 3), 0 to pi, rad."""
    return float(pin.Quaternion(first).angularDistance(pin.Quaternion(second)))


def rpy_of(rotation: Array) -> Array:
    """Return (3,) roll, pitch (within +-pi/2) and yaw of a rotation ``Rz(yaw) Ry(pitch) Rx(roll)``, rad."""
    return np.array(pin.rpy.matrixToRpy(rotation), dtype=np.float64)
