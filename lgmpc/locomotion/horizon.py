"""Input of a predictive controller besides the state: contacts and desired motion over its horizon."""

from dataclasses import dataclass

import numpy as np

from lgmpc.robot import Robot
from lgmpc.robot.feet import UP
from lgmpc.typing import Array, BoolArray


@dataclass
class ContactHorizon:
    """Contacts of nc feet over the N intervals of a horizon; buffers that the caller overwrites.

    Attributes:
        flags: (N, nc) whether each foot is in contact during each interval.
        points: (N, nc, 3) contact points, world, m; of a foot in the air, where it will touch down next.
        normals: (N, nc, 3) unit normals of the surfaces at the points, world axes.
        friction: (N, nc) Coulomb coefficients to rely on.
    """

    flags: BoolArray
    points: Array
    normals: Array
    friction: Array

    @classmethod
    def allocate(cls, intervals: int, contacts: int) -> "ContactHorizon":
        """Return buffers with every foot in contact at the origin, on a level surface of friction 0.6."""
        return cls(
            np.ones((intervals, contacts), dtype=np.bool_),
            np.zeros((intervals, contacts, 3)),
            np.tile(np.array(UP), (intervals, contacts, 1)),
            np.full((intervals, contacts), 0.6),
        )

    def hold(self, points: Array, flags: BoolArray, friction: float) -> None:
        """Keep contact points (nc, 3), flags (nc,) and friction over all intervals: standing."""
        self.points[:] = points
        self.flags[:] = flags
        self.friction[:] = friction


@dataclass
class MotionReference:
    """Desired motion at the N + 1 nodes of a horizon; buffers that the caller overwrites.

    Attributes:
        com: (N+1, 3) centre of mass, world, m.
        com_velocity: (N+1, 3) m/s.
        q: (N+1, nq) configurations: the attitude of the base and the joint positions to stay near.
        angular_velocity: (N+1, 3) of the base, world axes, rad/s.
        catching: whether steps are to catch a push, and height counts more than otherwise.
        legs: (N+1, 3) angular momentum that the legs' own motion has beside that of the base, world axes, N.m.s.
    """

    com: Array
    com_velocity: Array
    q: Array
    angular_velocity: Array
    catching: bool = False
    legs: Array | None = None

    def copy(self) -> "MotionReference":
        """Return the motion in buffers of its own."""
        arrays = (self.com, self.com_velocity, self.q, self.angular_velocity)
        com, com_velocity, q, angular_velocity = (each.copy() for each in arrays)
        return MotionReference(com, com_velocity, q, angular_velocity, self.catching, self.legs)

    @classmethod
    def standing(cls, robot: Robot, intervals: int, com: Array) -> "MotionReference":
        """Return buffers that hold the reference posture at rest, the centre of mass (3,) at ``com``."""
        nodes = intervals + 1
        return cls(
            np.tile(com, (nodes, 1)), np.zeros((nodes, 3)), np.tile(robot.q_reference, (nodes, 1)), np.zeros((nodes, 3))
        )
