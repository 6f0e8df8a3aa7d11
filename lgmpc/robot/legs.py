"""The legs of a robot: their joints, and the distances between them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin

from lgmpc.robot.model import Robot
from lgmpc.typing import Array

__all__ = ["leg_clearances", "leg_joints"]


def leg_joints(robot: Robot, frame: int) -> list[int]:
    """Return the joints between the base, whose free-flyer is joint 1, and a contact frame."""
    model = robot.model
    return [joint for joint in model.supports[model.frames[frame].parentJoint] if joint > 1]


def leg_clearances(robot: Robot, q: Array) -> Array:
    """Return the least distance between two legs, negative where they overlap.

    A leg is a chain of capsules from its second joint, the hip, over its other joints to its contact frame, all of the
    feet's radius.

    Args:
        robot: with a floating base and at least two contact frames.
        q: (n, nq) configurations.

    Returns:
        (n,) distances, m.
    """
    model, data = robot.model, robot.create_data()
    chains = []
    for frame in robot.contact_ids:
        joints = leg_joints(robot, frame)
        chains.append((joints[min(1, len(joints) - 1) :], frame))
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
    clearances: Array = least - 2.0 * robot.contact_radius
    return clearances


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
    distance: Array = np.linalg.norm(gap, axis=1)
    return distance
