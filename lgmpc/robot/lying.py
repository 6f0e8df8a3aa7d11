"""The posture of a legged robot on its belly: feet in their places, trunk on the floor, legs folded."""

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot.model import Robot
from lgmpc.typing import Array

_DESCENT = 0.01  # m between two postures on the way down; each begins from the one before
_REACHED = 1e-4  # m
_ITERATIONS = 50
_LARGEST_STEP = 0.2  # rad in one iteration
_REGULARIZATION = 1e-6  # m2: near a stretched leg the steps stay finite
_LIMIT_MARGIN = 1e-3  # rad from the joints' limits
_CROUCH_MARGIN = 0.05  # rad, for the motion of the joints when the feet are unloaded


def lying_posture(robot: Robot) -> Array:
    """Return (nq,) the reference posture lowered, the feet in place, until the trunk is on the floor.

    A robot whose legs do not fold that far is lowered as far as its joints and the floor under its knees allow.

    Raises:
        InputError: the base does not float, or there is no contact frame.
        ModelError: a mesh of the collision geometry cannot be read.
    """
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", robot.name, "a floating base and contact frames")
    data, q = robot.create_data(), robot.q_reference.copy()
    pin.framesForwardKinematics(robot.model, data, q)
    feet = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
    height = float(q[2])
    # Without a shape on the trunk, its origin is taken for its underside.
    belly = height - lowest_point(robot, q, trunk=True)
    while height > belly:
        height = max(height - _DESCENT, belly)
        lowered = place_feet(robot, q, np.array([*q[:2], height]), feet)
        if lowered is None or lowest_point(robot, lowered) < -_REACHED:
            break
        q = lowered
    return q


def crouching_posture(robot: Robot, lowest: float) -> Array:
    """Return (nq,) the reference posture lowered on its feet as far as its joints allow.

    Spherical feet roll under folding legs: on the way down Solo12's contact points move 7 mm inwards, and its hips
    reach their limits before its belly reaches the floor. :func:`lying_posture` therefore places the feet anew.

    Args:
        robot: the robot.
        lowest: height of the base below which it is not lowered, m.
    """
    data, q = robot.create_data(), robot.q_reference.copy()
    pin.framesForwardKinematics(robot.model, data, q)
    feet, turns = _frames(robot, data)
    while q[2] > lowest:
        base = np.array([*q[:2], max(float(q[2]) - _DESCENT, lowest)])
        lowered = place_feet(robot, q, base, feet, _CROUCH_MARGIN)
        if lowered is None:
            break
        q = lowered
        pin.framesForwardKinematics(robot.model, data, q)
        _, turned = _frames(robot, data)
        rolled = [pin.log3(after @ before.T) for before, after in zip(turns, turned, strict=True)]
        feet = feet + np.cross(rolled, [0.0, 0.0, robot.contact_radius])
        turns = turned
    return q


def _frames(robot: Robot, data: pin.Data) -> tuple[Array, list[Array]]:
    """Return the positions (nc, 3) and orientations (3, 3) of the contact frames."""
    frames = [data.oMf[frame] for frame in robot.contact_ids]
    return np.array([frame.translation for frame in frames]), [frame.rotation.copy() for frame in frames]


def place_feet(robot: Robot, q: Array, base: Array, feet: Array, margin: float = _LIMIT_MARGIN) -> Array | None:
    """Return (nq,) the posture with the base at ``base`` (3,) and the contact frames at ``feet`` (nc, 3), world, m.

    Damped Gauss-Newton steps within the joints' limits (Nakamura and Hanafusa, "Inverse kinematic solutions with
    singularity robustness", 1986); the base keeps its orientation.

    Args:
        robot: the robot.
        q: (nq,) initial iterate.
        base: (3,) position of the base's origin.
        feet: (nc, 3) positions of the contact frames' origins.
        margin: distance that joints keep from their limits, rad.

    Returns:
        None if they are not all within reach.
    """
    model, data, q = robot.model, robot.create_data(), q.copy()
    q[:3] = base
    joints, columns = robot.joint_q, robot.joint_v
    lower, upper = robot.joint_lower + margin, robot.joint_upper - margin
    for _ in range(_ITERATIONS):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        error = feet - np.array([data.oMf[frame].translation for frame in robot.contact_ids])
        if np.abs(error).max() < 0.1 * _REACHED:
            return q
        jacobian = np.vstack(
            [
                pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3, columns]
                for frame in robot.contact_ids
            ]
        )
        damped = jacobian @ jacobian.T + _REGULARIZATION * np.eye(len(jacobian))
        step = jacobian.T @ np.linalg.solve(damped, error.ravel())
        q[joints] = np.clip(q[joints] + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP), lower, upper)
    return None


def lowest_point(robot: Robot, q: Array, *, trunk: bool = False) -> float:
    """Return the height of the lowest point of the collision shapes at configuration ``q`` (nq,), m.

    Args:
        robot: the robot.
        q: configuration.
        trunk: whether to consider only shapes fixed to the base.

    Returns:
        The height; that of the base if there is no such shape.
    """
    data = robot.create_data()
    pin.forwardKinematics(robot.model, data, q)
    heights = [
        float((data.oMi[shape.joint] * placement).translation[2]) - radius
        for shape in robot.collision_shapes
        if shape.joint == 1 or not trunk
        for placement, radius in shape.corners
    ]
    return min(heights, default=float(q[2]))
