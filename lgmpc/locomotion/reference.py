"""From a command to the desired motion over a horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from lgmpc.locomotion.command import MotionCommand, Ramp
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.robot import Robot
from lgmpc.settings import Positive, Settings
from lgmpc.typing import Array

__all__ = ["DesiredPose", "ReferenceBuilder", "ReferenceSettings"]

_LEASH_SHARE = 0.1


class ReferenceSettings(Settings):
    """How far the desired motion may be from the measured one."""

    leash_m: Positive | None = Field(
        default=None,
        description="Longest horizontal distance from the measured to the desired centre of mass, m. null: a tenth of"
        " its height.",
    )
    yaw_leash_rad: Positive = Field(default=0.3, description="Largest yaw from the measured to the desired one, rad.")


@dataclass
class DesiredPose:
    """Where the robot should be at one time, world axes.

    Attributes:
        com: (3,) centre of mass, m.
        velocity: (3,) of the centre of mass, m/s.
        base: (3,) origin of the base, m.
        quaternion: (4,) orientation of the base, x y z w.
        rotation: (3, 3) the same, body to world.
        yaw_rate: about the vertical, rad/s.
    """

    com: Array
    velocity: Array
    base: Array
    quaternion: Array
    rotation: Array
    yaw_rate: float


class ReferenceBuilder:
    """Integrates commands to a desired position and heading, and writes the motion from there on.

    A push moves the robot away from what it was to do; beyond the leash the desired position follows, so nothing winds
    up, and no way back is commanded that the robot was never to go.

    Args:
        robot: the controller's model.
        legs: its legs.
        settings: see :class:`ReferenceSettings`.

    Attributes:
        x: desired centre of mass now, world, m.
        y: world, m.
        yaw: desired heading now, rad; counts turns.
    """

    def __init__(self, robot: Robot, legs: LegGeometry, settings: ReferenceSettings | None = None) -> None:
        self.settings = ReferenceSettings() if settings is None else settings
        self.x = self.y = self.yaw = 0.0
        self._legs = legs
        leash = self.settings.leash_m
        self._leash = _LEASH_SHARE * legs.height if leash is None else leash
        self._joints = robot.q_reference[robot.joint_q].copy()
        self._intervals = np.zeros(0)
        self._pose = DesiredPose(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(4), np.eye(3), 0.0)
        self._attitude = (math.nan, 0.0, 0.0)
        self._base = (0.0, 0.0, 0.0)

    def begin(self, com: Array, yaw: float) -> None:
        """Begin where the robot is: centre of mass (3,) and heading."""
        self.x, self.y, self.yaw = float(com[0]), float(com[1]), yaw

    def advance(self, dt: float, command: MotionCommand) -> None:
        """Move on by ``dt``, s, with the limited command."""
        middle = self.yaw + 0.5 * dt * command.yaw_rate
        c, n = math.cos(middle), math.sin(middle)
        self.x += dt * (c * command.vx - n * command.vy)
        self.y += dt * (n * command.vx + c * command.vy)
        self.yaw += dt * command.yaw_rate

    def shorten(self, com: Array, yaw: float) -> None:
        """Move the desired position and heading to within the leash of the measured centre of mass (3,) and yaw."""
        s = self.settings
        dx, dy = self.x - float(com[0]), self.y - float(com[1])
        distance = math.hypot(dx, dy)
        if distance > self._leash:
            self.x = float(com[0]) + dx * self._leash / distance
            self.y = float(com[1]) + dy * self._leash / distance
        ahead = math.remainder(self.yaw - yaw, 2.0 * math.pi)
        if abs(ahead) > s.yaw_leash_rad:
            self.yaw += math.copysign(s.yaw_leash_rad, ahead) - ahead

    def velocity(self, command: MotionCommand) -> tuple[float, float]:
        """Return the commanded velocity in world axes, m/s."""
        c, n = math.cos(self.yaw), math.sin(self.yaw)
        return c * command.vx - n * command.vy, n * command.vx + c * command.vy

    def pose(self, command: MotionCommand, ground: float) -> DesiredPose:
        """Return where the robot should be now; arguments as of :meth:`write`. The result is overwritten next time."""
        pose = self._pose
        if (self.yaw, command.pitch, command.roll) != self._attitude:
            self._attitude = (self.yaw, command.pitch, command.roll)
            tilt, c, s = _pitch_roll(command.pitch, command.roll), math.cos(self.yaw), math.sin(self.yaw)
            pose.quaternion[:] = _yawed(tilt, self.yaw)
            pose.rotation[:] = _rotation(*pose.quaternion.tolist())
            bx, by, bz = _rotate(tilt, self._legs.base)
            self._base = (c * bx - s * by, s * bx + c * by, bz)
        x, y, z = self.x, self.y, ground + self._legs.height + command.height
        bx, by, bz = self._base
        pose.com[:] = x, y, z
        pose.base[:] = x + bx, y + by, z + bz
        pose.velocity[:2] = self.velocity(command)
        pose.yaw_rate = command.yaw_rate
        return pose

    def write(
        self, reference: MotionReference, command: MotionCommand, dt: float, ground: float, ramp: Ramp | None = None
    ) -> None:
        """Write the motion at the nodes of a horizon that begins now.

        Args:
            reference: overwritten.
            command: limited command.
            dt: duration of the intervals, s.
            ground: mean height of the feet that stand, m.
            ramp: how the velocity changes from now on; None for a constant one.
        """
        nodes = len(reference.com)
        if len(self._intervals) != nodes:
            self._intervals = np.arange(nodes, dtype=np.float64)
        time = dt * self._intervals
        turned = command.yaw_rate * time
        yaw = self.yaw + turned
        c, s = np.cos(yaw), np.sin(yaw)
        vx, vy = c * command.vx - s * command.vy, s * command.vx + c * command.vy
        # Along the chord of the arc: half the turn, shortened by sin(turn / 2) / (turn / 2).
        chord = time * np.sinc(turned / (2.0 * math.pi))
        half = self.yaw + 0.5 * turned
        ch, sh = np.cos(half), np.sin(half)
        com, velocity = reference.com, reference.com_velocity
        com[:, 0] = self.x + chord * (ch * command.vx - sh * command.vy)
        com[:, 1] = self.y + chord * (sh * command.vx + ch * command.vy)
        com[:, 2] = ground + self._legs.height + command.height
        velocity[:, 0], velocity[:, 1], velocity[:, 2] = vx, vy, 0.0
        if ramp is not None and ramp.duration > 0.0:
            change = np.minimum(time, ramp.duration)
            velocity[:, 0] += change * (c * ramp.ax - s * ramp.ay)
            velocity[:, 1] += change * (s * ramp.ax + c * ramp.ay)
            # Its integral at the present heading: what it turns within the horizon is of second order.
            way = change * (time - 0.5 * change)
            com[:, 0] += way * (c[0] * ramp.ax - s[0] * ramp.ay)
            com[:, 1] += way * (s[0] * ramp.ax + c[0] * ramp.ay)
        reference.angular_velocity[:, :2] = 0.0
        reference.angular_velocity[:, 2] = command.yaw_rate
        self._write_pose(reference, command, yaw)

    def _write_pose(self, reference: MotionReference, command: MotionCommand, yaw: Array) -> None:
        """Rz(yaw) Ry(pitch) Rx(roll), and the base where the centre of mass of the reference posture requires it."""
        q = reference.q
        tilt = _pitch_roll(command.pitch, command.roll)
        cz, sz = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
        x, y, z, w = tilt
        q[:, 3], q[:, 4] = cz * x - sz * y, cz * y + sz * x
        q[:, 5], q[:, 6] = cz * z + sz * w, cz * w - sz * z
        bx, by, bz = _rotate(tilt, self._legs.base)
        c, s = np.cos(yaw), np.sin(yaw)
        q[:, 0] = reference.com[:, 0] + c * bx - s * by
        q[:, 1] = reference.com[:, 1] + s * bx + c * by
        q[:, 2] = reference.com[:, 2] + bz
        q[:, 7:] = self._joints


def _pitch_roll(pitch: float, roll: float) -> tuple[float, float, float, float]:
    """Return the quaternion x y z w of Ry(pitch) Rx(roll)."""
    cp, sp, cr, sr = math.cos(0.5 * pitch), math.sin(0.5 * pitch), math.cos(0.5 * roll), math.sin(0.5 * roll)
    return cp * sr, sp * cr, -sp * sr, cp * cr


def _yawed(tilt: tuple[float, float, float, float], yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of Rz(yaw) times ``tilt``."""
    c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    x, y, z, w = tilt
    return c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z


def _rotation(x: float, y: float, z: float, w: float) -> list[list[float]]:
    """Return the matrix of a unit quaternion."""
    return [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]


def _rotate(quaternion: tuple[float, float, float, float], point: Array) -> tuple[float, float, float]:
    x, y, z, w = quaternion
    a, b, c = float(point[0]), float(point[1]), float(point[2])
    u, v, s = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * s - z * v, b + w * v + z * u - x * s, c + w * s + x * v - y * u
