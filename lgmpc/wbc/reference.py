"""What the whole-body QP is asked to follow at one tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

__all__ = ["WholeBodyReference"]


@dataclass
class WholeBodyReference:
    """Targets of every task, held in buffers that the caller overwrites each tick (world axes unless said otherwise).

    Attributes:
        com: (3,) centre of mass, m.
        com_velocity: (3,) m/s.
        com_acceleration: (3,) feed-forward, m/s^2.
        base_position: (3,) origin of the base, m (used by the base placement task only).
        base_velocity: (3,) m/s.
        base_rotation: (3, 3) orientation of the base, body to world.
        base_angular_velocity: (3,) in the axes of the target base frame, rad/s.
        angular_momentum: (3,) about the centre of mass, N.m.s.
        angular_momentum_rate: (3,) feed-forward, N.m.
        joint_position: (nu,) rad.
        joint_velocity: (nu,) rad/s.
        contact_forces: (nc, 3) forces to stay near, on the robot, N.
        external_wrench: (6,) known or estimated [force; moment about the centre of mass] on the base, N and N.m.
        stance: (nc,) whether each foot is in contact.
        foot_position: (nc, 3) contact point targets of swing feet, m.
        foot_velocity: (nc, 3) m/s.
        foot_acceleration: (nc, 3) m/s^2.
        friction: coefficient to rely on now; None for that of the controller's limits.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    base_position: Array
    base_velocity: Array
    base_rotation: Array
    base_angular_velocity: Array
    angular_momentum: Array
    angular_momentum_rate: Array
    joint_position: Array
    joint_velocity: Array
    contact_forces: Array
    external_wrench: Array
    stance: BoolArray
    foot_position: Array
    foot_velocity: Array
    foot_acceleration: Array
    friction: float | None = None

    @classmethod
    def standing(cls, robot: Robot, com: Array, contact_points: Array) -> WholeBodyReference:
        """Stand still in the robot's reference posture, all feet on the ground, the weight shared equally.

        Args:
            robot: the robot.
            com: (3,) centre of mass to hold.
            contact_points: (nc, 3) where the feet stand.
        """
        nc = len(robot.contact_ids)
        forces = np.zeros((nc, 3))
        forces[:, 2] = robot.mass * -robot.gravity[2] / nc
        return cls(
            com=com.copy(),
            com_velocity=np.zeros(3),
            com_acceleration=np.zeros(3),
            base_position=robot.q_reference[:3].copy(),
            base_velocity=np.zeros(3),
            base_rotation=pin.Quaternion(robot.q_reference[3:7]).matrix(),
            base_angular_velocity=np.zeros(3),
            angular_momentum=np.zeros(3),
            angular_momentum_rate=np.zeros(3),
            joint_position=robot.q_reference[robot.joint_q].copy(),
            joint_velocity=np.zeros(robot.nu),
            contact_forces=forces,
            external_wrench=np.zeros(6),
            stance=np.ones(nc, dtype=np.bool_),
            foot_position=contact_points.copy(),
            foot_velocity=np.zeros((nc, 3)),
            foot_acceleration=np.zeros((nc, 3)),
        )
