"""Geometry of the legs from the robot's model: hips, feet, lengths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot import Robot, leg_joints
from lgmpc.typing import Array

__all__ = ["LegGeometry"]


@dataclass(frozen=True)
class LegGeometry:
    """The legs in the reference posture, relative to the centre of mass, axes of the base.

    Attributes:
        feet: (nc, 3) contact points, m.
        hips: (nc, 3) hips: positions of each leg's second joint (the first one is the abduction), m.
        length: (nc,) from hip to contact frame along the links: no posture reaches further, m.
        base: (3,) origin of the base, m.
        radius: radius of the spherical feet, m.
    """

    feet: Array
    hips: Array
    length: Array
    base: Array
    radius: float

    @cached_property
    def height(self) -> float:
        """Height of the centre of mass above the mean contact point, m."""
        return -float(self.feet[:, 2].mean())

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
        feet, hips, lengths = [], [], []
        for name, frame in zip(robot.contact_frames, robot.contact_ids, strict=True):
            joints = leg_joints(robot, frame)
            if not joints:
                raise InputError("contact_frames", name, "a frame that a joint of the leg moves")
            tip = data.oMf[frame].translation
            path = [data.oMi[joint].translation for joint in joints[min(1, len(joints) - 1) :]] + [tip]
            hips.append(path[0].copy())
            lengths.append(sum(float(np.linalg.norm(b - a)) for a, b in zip(path, path[1:], strict=False)))
            feet.append(tip - np.array([0.0, 0.0, robot.contact_radius]))
        turn = base.rotation
        return cls(
            (np.array(feet) - com) @ turn,
            (np.array(hips) - com) @ turn,
            np.array(lengths),
            (base.translation - com) @ turn,
            robot.contact_radius,
        )
