"""The legs of a robot: their joints, and the distances between them."""

from itertools import combinations

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


def leg_clearances(robot: Robot, q: Array) -> Array:
    """Return the least distance between two legs, negative where they overlap.

    A leg is a chain of capsules from its hip over its other joints to its contact frame, all of the feet's radius.

    Args:
        robot: with a floating base and at least two contact frames.
        q: (n, nq) configurations.

    Returns:
        (n,) distances, m.
    """
    model, data = robot.model, robot.create_data()
    chains = []
    for frame in robot.foot_ids:
        chains.append((leg_chain(robot, frame), frame))
    paths = [np.empty((len(q), len(joints) + 1, 3)) for joints, _ in chains]
    for k, configuration in enumerate(q):
        pin.framesForwardKinematics(model, data, configuration)
        for (joints, frame), path in zip(chains, paths, strict=True):
            for i, joint in enumerate(joints):
                path[k, i] = data.oMi[joint].translation
            path[k, -1] = data.oMf[frame].translation
    least = np.full(len(q), np.inf)
    for one, other in combinations(paths, 2):
        for i in range(one.shape[1] - 1):
            for j in range(other.shape[1] - 1):
                np.minimum(least, _distance(one[:, i], one[:, i + 1], other[:, j], other[:, j + 1]), out=least)
    return least - 2.0 * robot.contact_radius


def _distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return (n,) the distances of the segments ``ab`` and ``cd``, points (n, 3) (Ericson 2005, 5.1.9)."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    tiny = np.finfo(np.float64).tiny
    uu, vv = np.maximum(uu, tiny), np.maximum(vv, tiny)
    area = uu * vv - uv**2
    s = np.clip(np.where(area > 1e-12 * uu * vv, (uv * vw - vv * uw) / np.maximum(area, tiny), 0.0), 0.0, 1.0)
    t = (uv * s + vw) / vv
    s = np.where(t < 0.0, np.clip(-uw / uu, 0.0, 1.0), np.where(t > 1.0, np.clip((uv - uw) / uu, 0.0, 1.0), s))
    gap = w + s[:, None] * u - np.clip(t, 0.0, 1.0)[:, None] * v
    return np.linalg.norm(gap, axis=1)
