"""The contact points of spherical feet as expressions.

The contact point is the lowest point of the sphere, ``p = p_frame - r e_z``. Rolling without slipping holds the
velocity of that material point at zero, ``v_frame + omega x (-r e_z) = 0``; as ``-r e_z`` does not move, its derivative
is ``a_frame + alpha x (-r e_z) = 0``. The point p itself moves as the sphere's centre does.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import pinocchio as pin

from lgmpc.costs import StageSymbols
from lgmpc.robot import Robot

__all__ = [
    "centre_drift",
    "centre_jacobian",
    "centre_velocities",
    "contact_drift",
    "contact_jacobian",
    "contact_points",
    "contact_velocities",
]

_ALIGNED = pin.LOCAL_WORLD_ALIGNED


def contact_points(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc,) the lowest points, world, m."""
    down = _down(robot)
    return ca.vertcat(*(s.robot.frame_placement(s.q, frame).translation + down for frame in robot.contact_ids))


def contact_velocities(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc,) the velocities of the material points in contact, world axes, m/s."""
    return _of_spheres([s.robot.frame_velocity(s.q, s.v, frame, _ALIGNED) for frame in robot.contact_ids], robot)


def contact_jacobian(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc, nv) the derivative of :func:`contact_velocities` by v."""
    return _of_spheres([s.robot.frame_jacobian(s.q, frame, _ALIGNED) for frame in robot.contact_ids], robot)


def contact_drift(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc,) the rate of :func:`contact_velocities` at zero joint-space acceleration, m/s2."""
    return _of_spheres([s.robot.frame_drift(s.q, s.v, frame, _ALIGNED) for frame in robot.contact_ids], robot)


def centre_velocities(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc,) the rates of :func:`contact_points`, world axes, m/s."""
    return ca.vertcat(*(s.robot.frame_velocity(s.q, s.v, frame, _ALIGNED)[:3] for frame in robot.contact_ids))


def centre_jacobian(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc, nv) the derivative of :func:`centre_velocities` by v."""
    return ca.vertcat(*(s.robot.frame_jacobian(s.q, frame, _ALIGNED)[:3, :] for frame in robot.contact_ids))


def centre_drift(s: StageSymbols, robot: Robot) -> Any:
    """Return (3 nc,) the rate of :func:`centre_velocities` at zero joint-space acceleration, m/s2."""
    return ca.vertcat(*(s.robot.frame_drift(s.q, s.v, frame, _ALIGNED)[:3] for frame in robot.contact_ids))


def _of_spheres(motions: list[Any], robot: Robot) -> Any:
    """Return linear + angular x (-r e_z) of the [linear; angular] motions of the feet's frames."""
    lever = ca.skew(_down(robot))
    return ca.vertcat(*(motion[:3, :] - ca.mtimes(lever, motion[3:, :]) for motion in motions))


def _down(robot: Robot) -> Any:
    return ca.SX([0.0, 0.0, -robot.contact_radius])
