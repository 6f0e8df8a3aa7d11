"""Kinematics along a trajectory by Pinocchio, independent of the optimised expressions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["com_positions", "com_speed", "contact_positions", "frame_placements", "joint_limit_violation"]


def com_positions(robot: Robot, xs: Array) -> Array:
    """Return (n, 3) the centre of mass at states (n, nx), world axes, m."""
    data = robot.create_data()
    return np.array([pin.centerOfMass(robot.model, data, x[: robot.nq]).copy() for x in xs]).reshape(-1, 3)


def com_speed(robot: Robot, x: Array) -> float:
    """Return the speed of the centre of mass in a state (nx,), m/s."""
    data = robot.create_data()
    pin.centerOfMass(robot.model, data, x[: robot.nq], x[robot.nq : robot.nq + robot.nv])
    return float(np.linalg.norm(data.vcom[0]))


def joint_limit_violation(robot: Robot, xs: Array) -> float:
    """Return the largest violation of position limits by joints of one coordinate, rad or m; 0 if there is none."""
    joints = xs[:, robot.joint_q]
    return float(np.maximum(robot.joint_lower - joints, joints - robot.joint_upper).max(initial=0.0))


def contact_positions(robot: Robot, xs: Array) -> Array:
    """Return (n, nc, 3) the origins of the contact frames at states (n, nx), world axes, m."""
    data, found = robot.create_data(), np.empty((len(xs), robot.nc, 3))
    for points, x in zip(found, xs, strict=True):
        pin.forwardKinematics(robot.model, data, x[: robot.nq])
        for point, index in zip(points, robot.contact_ids, strict=True):
            point[:] = pin.updateFramePlacement(robot.model, data, index).translation
    return found


def frame_placements(robot: Robot, frame: str, xs: Array) -> list[pin.SE3]:
    """Return the placement of a frame in the world at each of the states (n, nx).

    Raises:
        InputError: no such frame.
    """
    data, index, placements = robot.create_data(), robot.frame(frame), []
    for x in xs:
        pin.forwardKinematics(robot.model, data, x[: robot.nq])
        placements.append(pin.SE3(pin.updateFramePlacement(robot.model, data, index)))
    return placements
