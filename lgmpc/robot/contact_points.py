"""Contact points of a robot's spherical feet as expressions, on surfaces of given normals.

All functions take configuration and velocity where they need them, and the normals (3 nc,) of the surfaces; the
geometry is that of :mod:`lgmpc.robot.feet`.
"""

from typing import Any

import casadi as ca
import pinocchio as pin

from lgmpc.robot.feet import axes_of, lever, touching
from lgmpc.robot.model import Robot

_ALIGNED = pin.LOCAL_WORLD_ALIGNED


class ContactPoints:
    """The contact points of all feet at one state.

    Args:
        robot: the robot.
        q: (nq,) configuration.
        v: (nv,) velocity; None where only positions and Jacobians are read.
        normals: (3 nc,) unit normals of the surfaces under the feet, world axes.
    """

    def __init__(self, robot: Robot, q: Any, v: Any, normals: Any) -> None:
        self._robot, self._model, self._q, self._v = robot, robot.symbolic, q, v
        self._normals = [normals[3 * i : 3 * i + 3] for i in range(robot.nc)]

    def positions(self) -> Any:
        """Return (3 nc,) contact points, world, m."""
        radius, placement = self._robot.contact_radius, self._model.frame_placement
        frames = zip(self._robot.contact_ids, self._normals, strict=True)
        return ca.vertcat(*(touching(placement(self._q, f).translation, radius, n) for f, n in frames))

    def velocities(self) -> Any:
        """Return (3 nc,) velocities of the material points in contact, world axes, m/s."""
        return self._material(self._motions())

    def jacobian(self) -> Any:
        """Return (3 nc, nv) the derivative of :meth:`velocities` by v."""
        return self._material(self._jacobians())

    def drift(self) -> Any:
        """Return (3 nc,) the rate of :meth:`velocities` at zero joint-space acceleration, m/s2."""
        return self._material(self._drifts())

    def centre_velocities(self) -> Any:
        """Return (3 nc,) the rates of :meth:`positions`, world axes, m/s."""
        return ca.vertcat(*(motion[:3] for motion in self._motions()))

    def centre_jacobian(self) -> Any:
        """Return (3 nc, nv) the derivative of :meth:`centre_velocities` by v."""
        return ca.vertcat(*(motion[:3, :] for motion in self._jacobians()))

    def centre_drift(self) -> Any:
        """Return (3 nc,) the rate of :meth:`centre_velocities` at zero joint-space acceleration, m/s2."""
        return ca.vertcat(*(motion[:3] for motion in self._drifts()))

    def axes(self) -> Any:
        """Return (3 nc, 3 nc) the block-diagonal rotation from the surfaces' axes to the world's."""
        return ca.diagcat(*(axes_of(normal) for normal in self._normals))

    def _motions(self) -> list[Any]:
        return [self._model.frame_velocity(self._q, self._v, frame, _ALIGNED) for frame in self._robot.contact_ids]

    def _jacobians(self) -> list[Any]:
        return [self._model.frame_jacobian(self._q, frame, _ALIGNED) for frame in self._robot.contact_ids]

    def _drifts(self) -> list[Any]:
        return [self._model.frame_drift(self._q, self._v, frame, _ALIGNED) for frame in self._robot.contact_ids]

    def _material(self, motions: list[Any]) -> Any:
        """Return linear + angular x lever of the [linear; angular] motions of the feet's frames."""
        arms = [ca.skew(lever(self._robot.contact_radius, normal)) for normal in self._normals]
        return ca.vertcat(*(m[:3, :] - ca.mtimes(arm, m[3:, :]) for m, arm in zip(motions, arms, strict=True)))
