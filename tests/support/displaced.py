"""Rigid displacements of a whole experiment: world, robot and gravity. Nothing may depend on them but the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot
from lgmpc.runs import RunLog
from lgmpc.typing import Array
from lgmpc.world import Plane, World


@dataclass(frozen=True)
class Displacement:
    """The motion ``p -> R p + t`` of everything, gravity included.

    Attributes:
        rotation: R, (3, 3).
        translation: t, (3,), m.
    """

    rotation: Array
    translation: Array

    @classmethod
    def of(cls, shift: tuple[float, float, float], turn: float = 0.0, tilt: tuple[float, float] = (0.0, 0.0)):
        """Shift, after a turn about z and before it a tilt about the horizontal x and y axes; m and degrees."""
        tilted = so3.exp(np.radians([*tilt, 0.0]))
        return cls(so3.exp(np.radians([0.0, 0.0, turn])) @ tilted, np.array(shift))

    @property
    def tilts(self) -> bool:
        """Whether it tilts gravity."""
        return self.rotation[2, 2] != 1.0

    def points(self, points: Array) -> Array:
        """Return displaced points (..., 3)."""
        return points @ self.rotation.T + self.translation

    def vectors(self, vectors: Array) -> Array:
        """Return displaced vectors (..., 3), or wrenches (..., 6) of two."""
        shape = np.shape(vectors)
        return (np.reshape(vectors, (*shape[:-1], -1, 3)) @ self.rotation.T).reshape(shape)

    def poses(self, q: Array) -> Array:
        """Return displaced configurations (..., nq) of a floating base; quaternions with the sign nearest to q's."""
        turned = quaternion.compose(quaternion.from_matrix(self.rotation), q[..., 3:7])
        return np.concatenate([self.points(q[..., :3]), turned, q[..., 7:]], axis=-1)

    def world(self, world: World) -> World:
        """Return the displaced world of planes, and start on it."""
        planes = [plane for plane in world.surfaces if isinstance(plane, Plane)]
        assert len(planes) == len(world.surfaces)
        moved = [
            replace(
                plane,
                point=tuple(self.points(np.array(plane.point)).tolist()),
                normal_vector=tuple(self.vectors(np.array(plane.normal_vector)).tolist()),
            )
            for plane in planes
        ]
        axes, point = world.start_pose
        ahead, start = self.rotation @ axes[:, 0], self.points(point)
        return World(tuple(moved), (float(start[0]), float(start[1])), math.atan2(ahead[1], ahead[0]))

    def robot(self, robot: Robot) -> Robot:
        """Return the robot under displaced gravity."""
        model = robot.model.copy()
        model.gravity.linear = self.rotation @ robot.model.gravity.linear
        return replace(robot, model=model)

    def log(self, log: RunLog, world: World) -> RunLog:
        """Return the displaced log of a run in a world, which is displaced too."""
        moved = {name: self.points(getattr(log, name)) for name in _POINTS if getattr(log, name) is not None}
        moved |= {name: self.vectors(getattr(log, name)) for name in _VECTORS}
        moved |= {name: self.poses(getattr(log, name)) for name in _POSES if getattr(log, name) is not None}
        moved["push_point"] = np.where(log.push_point.any(axis=1, keepdims=True), moved["push_point"], 0.0)
        moved["ground_height"] = self.world(world).height(moved["q"][:, :2])
        return replace(log, **moved)


_POINTS = ("contact_points", "com", "com_reference", "push_point", "mpc_horizon_com", "swing_targets", "footholds")
_VECTORS = (
    "contact_forces", "contact_forces_desired", "contact_normals", "ground_normal", "momentum", "push", "mpc_forces",
)  # fmt: skip
_POSES = ("q", "base_reference", "estimate_q")

DISPLACEMENTS = {
    "shifted": Displacement.of((3.0, -2.0, -0.7)),
    "turned": Displacement.of((0.0, 0.0, 0.0), 70.0),
    "tilted": Displacement.of((1.0, 2.0, 0.3), -40.0, (12.0, 7.0)),
}
"""Displacements that a test compares with no displacement."""
