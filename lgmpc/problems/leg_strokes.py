"""Cyclic strokes of the legs, and the rotation that they cause without angular momentum.

The legs swing one way stretched and back folded: a cycle returns the joints to their initial positions, but not the
trunk. Its angular velocity is ``-A(q_j) q_j'`` with the mechanical connection A, which is larger for stretched legs;
the rotation of a small cycle is the integral of A's curvature over the area that the cycle encloses in joint space
(Montgomery, "Gauge theory of the falling cat", 1993).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.ocp import Trajectory
from lgmpc.robot import Robot
from lgmpc.robot.actuators import match_joints
from lgmpc.settings import Count, Finite, Positive, Settings
from lgmpc.typing import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["LegStrokes", "falling_motion"]

_SUBSTEPS = 8
"""Integration steps of the trunk's attitude in an interval."""


class LegStrokes(Settings):
    """Cycles of the joints between two postures, with a sweep a quarter of a cycle out of phase.

    At the phase phi the joints are at ``(stretched + folded) / 2 + (stretched - folded) / 2 cos(phi) + sweep
    sin(phi)``; the sweep's sign is that of the motion while they are stretched.
    """

    stretched_rad: dict[str, Finite] = Field(
        description="Posture in which the legs swing forth, {joint name or pattern: rad}; joints not named are at 0."
    )
    folded_rad: dict[str, Finite] = Field(
        description="Posture in which the legs swing back, {joint name or pattern: rad}."
    )
    sweep_rad: dict[str, Finite] = Field(
        description="Amplitude of the swing, {joint name or pattern: rad}; the robot turns against its sign."
    )
    count: Count = Field(default=5, description="Number of cycles.")
    ramp_s: Positive = Field(default=0.12, description="Time of the transitions from and to the reference posture, s.")

    def joints(self, robot: Robot, times: Array) -> CubicSpline:
        """Return the joints' path (nu,) over time, at rest in the reference posture at both ends.

        Args:
            robot: with joints of one angle each.
            times: (N+1,) of the nodes, s.

        Raises:
            InputError: an unknown joint name, or ramps longer than the motion.
        """
        from scipy.interpolate import CubicSpline  # here, because it takes longer to import than all problems

        duration = float(times[-1] - times[0])
        if not 0.0 < 2.0 * self.ramp_s <= duration:
            raise InputError("strokes.ramp_s", self.ramp_s, f"above 0, at most {duration / 2:g} s, half of the motion")
        stretched, folded, sweep = (
            _by_joint(robot, key, getattr(self, key)) for key in ("stretched_rad", "folded_rad", "sweep_rad")
        )
        phase = 2.0 * np.pi * self.count * (times - times[0]) / duration
        cosine, sine = np.cos(phase)[:, None], np.sin(phase)[:, None]
        strokes = (stretched + folded) / 2.0 + (stretched - folded) / 2.0 * cosine + sweep * sine
        share = np.minimum(_smooth((times - times[0]) / self.ramp_s), _smooth((times[-1] - times) / self.ramp_s))
        reference = robot.q_reference[robot.joint_q]
        return CubicSpline(times, reference + share[:, None] * (strokes - reference), bc_type="clamped")


def falling_motion(robot: Robot, x0: Array, joints: CubicSpline, times: Array) -> Trajectory:
    """Return the fall of a robot without angular momentum along a path of its joints, with its torques.

    The centre of mass follows its parabola; the base's velocity conserves the momentum; torques are those of the mean
    motion of each interval, clipped to the limits. Exact in the continuous limit.

    Args:
        robot: with a free base.
        x0: (nx,) first state: joints at rest at the beginning of the path, no rotation.
        joints: the path of the joints.
        times: (N+1,) of the nodes, s.
    """
    model, data, nq = robot.model, robot.create_data(), robot.nq
    rates = joints.derivative()
    rotation = np.asarray(pin.Quaternion(x0[3:7]).matrix())
    com = pin.centerOfMass(model, data, x0[:nq], x0[nq:]).copy()
    speed = np.array(data.vcom[0])
    xs = np.tile(x0, (len(times), 1))
    for k, (t, h) in enumerate(zip(times, np.diff(times, append=times[-1]), strict=True)):
        q = np.concatenate([np.zeros(3), pin.Quaternion(rotation).coeffs(), joints(t)])
        fallen = com + t * speed + 0.5 * t**2 * robot.gravity
        q[:3] = fallen - pin.centerOfMass(model, data, q)
        momentum = robot.mass * np.concatenate([speed + t * robot.gravity, np.zeros(3)])
        xs[k] = np.concatenate([q, _base_velocity(robot, data, q, rates(t), momentum), rates(t)])
        for middle in t + h / _SUBSTEPS * (np.arange(_SUBSTEPS) + 0.5):
            level = np.concatenate([np.zeros(6), [1.0], joints(middle)])
            turning = _base_velocity(robot, data, level, rates(middle), np.zeros(6))[3:]
            rotation = rotation @ so3.exp(h / _SUBSTEPS * turning)
    limit = robot.effort_limit
    us = [_torques(robot, data, x, after, h) for x, after, h in zip(xs, xs[1:], np.diff(times), strict=False)]
    return Trajectory(xs, np.clip(us, -limit, limit))


def _base_velocity(robot: Robot, data: pin.Data, q: Array, rates: Array, momentum: Array) -> Array:
    """Return (6,) the base's velocity with which the centroidal momentum is ``momentum``."""
    matrix = pin.computeCentroidalMap(robot.model, data, q)
    velocity: Array = np.linalg.solve(matrix[:, :6], momentum - matrix[:, 6:] @ rates)
    return velocity


def _torques(robot: Robot, data: pin.Data, x: Array, after: Array, h: float) -> Array:
    """Return (nu,) the torques of the mean motion of an interval, without external forces."""
    model, nq = robot.model, robot.nq
    q = pin.interpolate(model, x[:nq], after[:nq], 0.5)
    v, a = (x[nq:] + after[nq:]) / 2.0, (after[nq:] - x[nq:]) / h
    a[:6] = 0.0
    pushed = pin.rnea(model, data, q, v, a)[:6]
    a[:6] = np.linalg.solve(pin.crba(model, data, q, pin.Convention.WORLD)[:6, :6], -pushed)
    effort: Array = pin.rnea(model, data, q, v, a)[6:].copy()
    return effort


def _by_joint(robot: Robot, key: str, values: Mapping[str, float]) -> Array:
    given, problems = match_joints(values, robot.joint_names, key)
    if problems:
        raise InputError(f"strokes.{key}", ", ".join(values), "names or patterns of joints", robot.joint_names)
    return np.array([given.get(name, 0.0) for name in robot.joint_names])


def _smooth(s: Array) -> Array:
    """Return the smooth step from 0 to 1 whose first two derivatives are zero at both ends."""
    s = np.clip(s, 0.0, 1.0)
    risen: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return risen
