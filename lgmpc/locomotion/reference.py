"""From a command to the desired motion over a horizon."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.lie import attitude, quaternion
from lgmpc.lie.components import quaternion_product, quaternion_rows
from lgmpc.locomotion.command import MotionCommand, VelocityRamp
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot import Robot
from lgmpc.settings import Positive, Settings, key
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array

_LEAD_SHARE = 0.1
_DRAWN_S = 0.5  # about a step
_CONSTANT = VelocityRamp()


class ReferenceSettings(Settings):
    """Largest distances between desired and measured motion."""

    max_reference_lead_m: Positive | None = key(
        None,
        "Longest horizontal distance from the measured to the desired centre of mass, m. null: a tenth of its height.",
    )
    max_yaw_lead_rad: Positive = key(0.3, "Largest yaw from the measured to the desired one, rad.")


@dataclass
class DesiredPose:
    """The desired pose and motion at one time, world axes.

    Attributes:
        centre: (9,) position, velocity and acceleration of the centre of mass, m.
        origin: (9,) the same of the base's origin, which turns with the command no faster than is negligible.
        attitude: (12,) orientation of the base, body to world and row by row, and its angular velocity, base axes.
        base_pose: (7,) position and quaternion x y z w of the base.
    """

    centre: Array
    origin: Array
    attitude: Array
    base_pose: Array


class ReferenceBuilder:
    """Integrates commands to a desired position and heading, and writes the motion from there on.

    A push moves the robot away from its desired position; beyond the largest distance the desired position follows, so
    that position errors do not wind up.

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
        lead = self.settings.max_reference_lead_m
        self._max_lead = _LEAD_SHARE * legs.height if lead is None else lead
        self._joints = robot.q_reference[robot.joint_q].copy()
        self._bound: MotionReference | None = None  # what _run writes to
        self._now = np.zeros(19)
        self._pose = DesiredPose(np.zeros(9), np.zeros(9), np.zeros(12), np.zeros(7))
        self._attitude = (math.nan, 0.0, 0.0, 0.0)
        self._base = (0.0, 0.0, 0.0)

    def begin(self, com: Sequence[float] | Array, yaw: float) -> None:
        """Start at a centre of mass, of which x and y are read, and a heading."""
        self.x, self.y, self.yaw = float(com[0]), float(com[1]), yaw

    def advance(self, dt: float, command: MotionCommand) -> None:
        """Integrate the limited command over ``dt``, s."""
        vx, vy, rate = command.vx, command.vy, command.yaw_rate
        if vx or vy or rate:
            x, y = attitude.turn(self.yaw + 0.5 * dt * rate, vx, vy)
            self.x += dt * x
            self.y += dt * y
            self.yaw += dt * rate

    def draw(self, dt: float, by: tuple[float, float]) -> None:
        """Move the desired position for ``dt``, s, towards one that is off ``by`` (x, y), world, m."""
        self.x, self.y = self.x + dt / _DRAWN_S * by[0], self.y + dt / _DRAWN_S * by[1]

    def turn_about(self, com: Array, angle: float) -> None:
        """Turn the desired position about the measured centre of mass (3,) by an angle, rad.

        A command is a motion relative to the robot: the displacement from the desired position turns with it. A
        displacement that did not would add its product with the yaw rate to the velocity.
        """
        if angle:
            c, n = math.cos(angle), math.sin(angle)
            dx, dy = self.x - float(com[0]), self.y - float(com[1])
            self.x, self.y = float(com[0]) + c * dx - n * dy, float(com[1]) + n * dx + c * dy

    def shorten(self, com: Array, yaw: float) -> None:
        """Limit the distances of desired position and heading from measured centre of mass (3,) and yaw."""
        s = self.settings
        dx, dy = self.x - float(com[0]), self.y - float(com[1])
        distance = math.hypot(dx, dy)
        if distance > self._max_lead:
            self.x = float(com[0]) + dx * self._max_lead / distance
            self.y = float(com[1]) + dy * self._max_lead / distance
        ahead = math.remainder(self.yaw - yaw, 2.0 * math.pi)
        if abs(ahead) > s.max_yaw_lead_rad:
            self.yaw += math.copysign(s.max_yaw_lead_rad, ahead) - ahead

    def velocity(self, command: MotionCommand) -> tuple[float, float]:
        """Return the commanded velocity in world axes, m/s."""
        vx, vy = command.vx, command.vy
        return attitude.turn(self.yaw, vx, vy) if vx or vy else (0.0, 0.0)

    def pose(self, command: MotionCommand, ground: TerrainBelief) -> DesiredPose:
        """Return where the robot should be now; arguments as of :meth:`write`. The result is overwritten next time."""
        pose, yaw = self._pose, self.yaw
        pitch, roll = self._along(ground, command)
        angles = yaw, pitch, roll, command.yaw_rate
        if angles != self._attitude:
            self._attitude = angles
            tilt = _tilt(pitch, roll)
            q = quaternion_product((0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)), tilt)
            rotation = quaternion_rows(q)
            turning = [command.yaw_rate * each for each in rotation[6:]]  # the vertical, in the base's axes
            pose.base_pose[3:] = q
            pose.attitude[:] = [*rotation, *turning]
            bx, by, bz = quaternion.act.unchecked(np.array(tilt), self._legs.base).tolist()
            self._base = (*attitude.turn(yaw, bx, by), bz)
        x, y = self.x, self.y
        z = ground.plane_at(x, y) + self._legs.height + command.height
        (bx, by, bz), (vx, vy), (along_x, along_y) = self._base, self.velocity(command), ground.slope
        vz = along_x * vx + along_y * vy
        centre, origin, base = pose.centre, pose.origin, pose.base_pose
        centre[0], centre[1], centre[2], centre[3], centre[4], centre[5] = x, y, z, vx, vy, vz
        base[0], base[1], base[2] = x + bx, y + by, z + bz
        origin[0], origin[1], origin[2], origin[3], origin[4], origin[5] = x + bx, y + by, z + bz, vx, vy, vz
        return pose

    def _along(self, ground: TerrainBelief, command: MotionCommand) -> tuple[float, float]:
        """Return pitch and roll of a base parallel to the ground, or upright, and as commanded besides, rad."""
        if ground.level or ground.upright:
            return command.pitch, command.roll
        ahead, left = attitude.turn(-self.yaw, *ground.slope)
        return command.pitch - math.atan(ahead), command.roll + math.atan2(left, math.sqrt(1.0 + ahead * ahead))

    def write(
        self,
        reference: MotionReference,
        command: MotionCommand,
        grid: TimeGrid,
        ground: TerrainBelief,
        ramp: VelocityRamp | None = None,
    ) -> None:
        """Write the motion at the nodes of a horizon that begins now.

        Args:
            reference: overwritten.
            command: limited command.
            grid: its intervals.
            ground: the surface to stand on, parallel to it.
            ramp: how the velocity changes from now on; None for a constant one.
        """
        if reference is not self._bound:
            self._bind(reference)
        self._times[:, 0] = grid.elapsed
        if ramp is None:
            ramp = _CONSTANT
        tilt = _tilt(*self._along(ground, command))
        z = ground.plane_at(self.x, self.y) + self._legs.height + command.height
        self._now[:] = (
            self.x, self.y, z, self.yaw, command.vx, command.vy, command.yaw_rate, ramp.ax, ramp.ay, ramp.duration,
            *tilt, *quaternion.act.unchecked(np.array(tilt), self._legs.base), *ground.slope,
        )  # fmt: skip
        self._run()

    def _bind(self, reference: MotionReference) -> None:
        """Make the call that writes to these buffers."""
        nodes = len(reference.com)
        self._bound, self._times = reference, np.zeros((nodes, 1))
        self._run = _motion_kernel(len(self._joints)).bind(
            nodes, time=self._times, now=self._now, joints=self._joints, com=reference.com,
            com_velocity=reference.com_velocity, q=reference.q, angular_velocity=reference.angular_velocity,
        )  # fmt: skip


@functools.lru_cache(maxsize=8)
def _motion_kernel(joints: int) -> StageKernel:
    return StageKernel.of(_motion_ahead, joints)


def _motion_ahead(joints: int) -> ca.Function:
    """The desired motion at one node, from where the robot should be now and its limited command."""
    time, now, posture = ca.SX.sym("time"), ca.SX.sym("now", 19), ca.SX.sym("joints", joints)
    x, y, z, heading, vx, vy, rate, ax, ay, duration = ca.vertsplit(now[:10])
    turned = rate * time
    yaw, half = heading + turned, heading + 0.5 * turned
    # Along the chord of the arc: half the turn, shortened by sin(turn / 2) / (turn / 2).
    straight = turned == 0.0
    chord = time * ca.if_else(straight, 1.0, ca.sin(0.5 * turned) / ca.if_else(straight, 1.0, 0.5 * turned))
    change = ca.fmin(time, duration)
    # The ramp's way at the present heading: what it turns within the horizon is of second order.
    way = change * (time - 0.5 * change)
    velocity = _turned(yaw, vx + change * ax, vy + change * ay)
    com = ca.vertcat(x, y) + chord * _turned(half, vx, vy) + way * _turned(heading, ax, ay)
    # Rz(yaw) Ry(pitch) Rx(roll), and the base where the centre of mass of the reference posture requires it.
    tilt, base, slope = ca.vertsplit(now[10:14]), now[14:17], now[17:]
    attitude = quaternion_product((0.0, 0.0, ca.sin(0.5 * yaw), ca.cos(0.5 * yaw)), tilt)
    height = z + ca.dot(slope, com - ca.vertcat(x, y))
    origin = ca.vertcat(com + _turned(yaw, base[0], base[1]), height + base[2])
    outputs = {
        "com": ca.vertcat(com, height),
        "com_velocity": ca.vertcat(velocity, ca.dot(slope, velocity)),
        "q": ca.vertcat(origin, *attitude, posture),
        "angular_velocity": ca.vertcat(0.0, 0.0, rate),
    }
    inputs = {"time": time, "now": now, "joints": posture}
    name = f"motion_ahead_{joints}"
    return ca.Function(name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs))


def _turned(angle: Any, x: Any, y: Any) -> Any:
    """Return the (2,) expression of a plane vector turned by an angle."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * x - s * y, s * x + c * y)


def _tilt(pitch: float, roll: float) -> tuple[float, float, float, float]:
    """Return the quaternion x y z w of Ry(pitch) Rx(roll)."""
    about_y = 0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch)
    return quaternion_product(about_y, (math.sin(0.5 * roll), 0.0, 0.0, math.cos(0.5 * roll)))
