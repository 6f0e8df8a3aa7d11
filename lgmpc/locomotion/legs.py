"""Geometry of the legs from the robot's model: hips, feet, lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot import Robot, leg_chain, leg_normals
from lgmpc.robot.feet import UP, touching
from lgmpc.typing import Array

__all__ = ["LegGeometry"]

_SWEEPS = 20


@dataclass(frozen=True)
class LegGeometry:
    """The legs in the reference posture, relative to the centre of mass, axes of the base.

    Attributes:
        feet: (nf, 3) contact points, of soles their centres, m.
        hips: (nf, 3) hips: positions of each leg's second joint (the first one is the abduction), or of the first one
            of a leg with two joints, m.
        knees: (nf, 3) positions of each leg's last joint, m.
        length: (nf,) largest distance from hip to foot within the range of the joints between, m.
        base: (3,) origin of the base, m.
        radius: radius of the spherical feet, m.
        sole: length and width of the largest sole along the axes of the base, m; 0 of point feet.
        normals: (nf, 3) unit vectors along which legs cannot move their feet (see :func:`~lgmpc.robot.leg_normals`).
    """

    feet: Array
    hips: Array
    knees: Array
    length: Array
    base: Array
    radius: float
    normals: Array
    sole: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def height(self) -> float:
        """Height of the centre of mass above the mean contact point, m."""
        return -float(self.feet[:, 2].mean())

    def above(self, points: Array, yaw: float) -> Array:
        """Return (3,) where the centre of mass of the reference posture is, its feet at ``points`` (n, 3), m.

        Args:
            points: contact points, world, m; those of the reference posture if they have moved with the base.
            yaw: heading of the base, rad.
        """
        x, y, _ = self.feet.mean(axis=0).tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        above: Array = points.mean(axis=0) + [s * y - c * x, -s * x - c * y, self.height]
        return above

    @classmethod
    def of(cls, robot: Robot) -> LegGeometry:
        """Return the geometry of a robot's legs.

        Raises:
            InputError: the base is fixed, there is no contact frame, or one that no joint moves.
        """
        if not (robot.floating_base and robot.nc):
            raise InputError("robot", robot.name, "a floating base and contact frames")
        model, data, q = robot.model, robot.create_data(), robot.q_reference
        com = pin.centerOfMass(model, data, q).copy()
        pin.framesForwardKinematics(model, data, q)
        base = pin.XYZQUATToSE3(q[:7])
        feet, hips, knees, lengths = [], [], [], []
        for name, frame in zip(robot.foot_names, robot.foot_ids, strict=True):
            joints = leg_chain(robot, frame)
            if not joints:
                raise InputError("contact_frames", name, "a frame that a joint of the leg moves")
            tip = data.oMf[frame].translation
            hip = joints[0]
            hips.append(data.oMi[hip].translation.copy())
            knees.append(data.oMi[joints[-1]].translation.copy())
            lengths.append(_longest(robot, hip, joints[1:], frame))
            feet.append(touching(tip, robot.contact_radius, np.array(UP)))
        turn = base.rotation
        return cls(
            (np.array(feet) - com) @ turn,
            (np.array(hips) - com) @ turn,
            (np.array(knees) - com) @ turn,
            np.array(lengths),
            (base.translation - com) @ turn,
            robot.contact_radius,
            leg_normals(robot),
            robot.foot_points.size,
        )


def _longest(robot: Robot, hip: int, joints: list[int], frame: int) -> float:
    """Return the largest distance from a joint to a contact frame within the range of the joints between, m.

    In the angle of one joint the squared distance is ``a + b cos + c sin``: largest at ``atan2(c, b)`` or, if that is
    out of range, at one of its ends. Several joints are maximised in turn.
    """
    model, data, q = robot.model, robot.create_data(), robot.q_reference.copy()

    def squared(at: int, angle: float) -> float:
        q[at] = angle
        pin.framesForwardKinematics(model, data, q)
        return float(np.sum((data.oMf[frame].translation - data.oMi[hip].translation) ** 2))

    for _ in range(_SWEEPS if len(joints) > 1 else 1):
        for at in (model.joints[joint].idx_q for joint in joints):
            ahead, aside, behind = (squared(at, angle) for angle in (0.0, 0.5 * math.pi, math.pi))
            best = math.atan2(aside - 0.5 * (ahead + behind), 0.5 * (ahead - behind))
            lowest, highest = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
            best += 2.0 * math.pi * math.ceil((lowest - best) / (2.0 * math.pi))
            if best > highest:
                best = lowest if squared(at, lowest) > squared(at, highest) else highest
            q[at] = best
    pin.framesForwardKinematics(model, data, q)
    return float(np.linalg.norm(data.oMf[frame].translation - data.oMi[hip].translation))
