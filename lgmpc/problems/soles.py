"""What soles do to a robot, from its motion: by Pinocchio's inverse dynamics, not by any action's expressions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["center_of_pressure", "sole_corners", "sole_wrenches"]


def sole_wrenches(robot: Robot, x: Array, a: Array, u: Array | None) -> tuple[Array, Array]:
    """Return (nc, 6) the wrenches at the contact frames that explain a motion, and (nu,) the efforts that go with them.

    They solve ``M a + nle = [0; u] + J^T f`` in the sense of least squares: exactly, if the motion obeys it. World axes
    at the frames' origins, [force; moment], on the robot. With unknown efforts the smallest wrenches that hold the free
    base are meant, and efforts are what is then left; with known ones they are given back.

    Args:
        robot: with contact frames.
        x: (nq + nv,) state.
        a: (nv,) acceleration.
        u: (nu,) efforts of the actuated joints, N.m, if known.
    """
    model, data = robot.model, robot.create_data()
    q, v = x[: robot.nq], x[robot.nq : robot.nq + robot.nv]
    needed = np.array(pin.rnea(model, data, q, v, a))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    jacobian = np.vstack([pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED) for i in robot.contact_ids])
    joints = robot.joint_v
    if u is None:
        base = slice(0, joints.start)
        wrench = np.linalg.lstsq(jacobian[:, base].T, needed[base], rcond=None)[0]
        return wrench.reshape(-1, 6), (needed - jacobian.T @ wrench)[joints]
    needed[joints] -= u
    return np.linalg.lstsq(jacobian.T, needed, rcond=None)[0].reshape(-1, 6), np.array(u)


def center_of_pressure(wrench: Array) -> Array:
    """Return (2,) where, in the plane z = 0 of a wrench's axes, its horizontal moment vanishes; m.

    ``[-m_y, m_x] / f_z`` (Sardain and Bessonnet, "Forces acting on a biped robot. Center of pressure - zero moment
    point", IEEE Trans. SMC A 34, 2004).
    """
    point: Array = np.array([-wrench[4], wrench[3]]) / wrench[2]
    return point


def sole_corners(placement: pin.SE3, half_size: tuple[float, float]) -> Array:
    """Return (4, 3) the corners of a rectangular sole about a frame's origin, world axes, m."""
    length, width = half_size
    local = np.array([[i * length, j * width, 0.0] for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    corners: Array = local @ placement.rotation.T + placement.translation
    return corners
