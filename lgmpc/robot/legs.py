"""The legs of a robot: their joints, and the directions in which they move."""

import numpy as np
import pinocchio as pin

from lgmpc.robot.model import Robot
from lgmpc.typing import Array

_SWUNG = (-0.4, 0.0, 0.4)
"""rad from the reference posture: no leg is stretched in all three."""

_PLANAR = 1e-6
"""Motion out of the plane, as a share of that within it, below which a leg is planar."""


def leg_joints(robot: Robot, frame: int) -> list[int]:
    """Return the joints between the base, whose free-flyer is joint 1, and a contact frame."""
    model = robot.model
    return [joint for joint in model.supports[model.frames[frame].parentJoint] if joint > 1]


def leg_chain(robot: Robot, frame: int) -> list[int]:
    """Return the joints of a leg from its hip, the joint that lifts the foot together with those after it.

    That is the second joint, after the abduction; the first one of a leg with two joints, which has none.
    """
    joints = leg_joints(robot, frame)
    return joints[1:] if len(joints) > 2 else joints


def upper_body_joints(robot: Robot) -> list[int]:
    """Return the joints that move no foot, such as those of an arm on the base."""
    legs = {joint for frame in robot.foot_ids for joint in leg_joints(robot, frame)}
    return [joint for joint in range(2 if robot.floating_base else 1, robot.model.njoints) if joint not in legs]


def leg_normals(robot: Robot) -> Array:
    """Return the directions in which legs cannot move their feet, because all of their axes are parallel to them.

    Args:
        robot: with a floating base.

    Returns:
        (nf, 3) unit vectors, axes of the base; zeros for a leg that moves its foot in all directions, or in one only.
    """
    model, data = robot.model, robot.create_data()
    normals = np.zeros((robot.nf, 3))
    for foot, frame in enumerate(robot.foot_ids):
        joints = leg_joints(robot, frame)
        columns = [model.joints[joint].idx_v + i for joint in joints for i in range(model.joints[joint].nv)]
        motions = []
        for angle in _SWUNG:
            v = np.zeros(model.nv)
            v[columns] = angle
            q = pin.integrate(model, robot.q_reference, v)
            jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            motions.append(data.oMi[1].rotation.T @ jacobian[:3, columns])
        axes, sizes, _ = np.linalg.svd(np.hstack(motions))
        if sizes[2] < _PLANAR * sizes[0] < sizes[1]:
            normals[foot] = axes[:, 2]
    return normals
