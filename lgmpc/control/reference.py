"""The desired motion: limited commands, integrated; a circle while it stands; the way up from the belly."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from lgmpc.control.lying import LegRetraction, RiseMotion
from lgmpc.errors import InputError
from lgmpc.locomotion.command import CommandLimiter, MotionCommand
from lgmpc.locomotion.footholds import BaseMotion
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.reference import ReferenceBuilder
from lgmpc.locomotion.settings import LocomotionSettings
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot import Robot
from lgmpc.settings import NonNegative, Positive, Settings, key
from lgmpc.timegrid import TimeGrid, minimum_jerk
from lgmpc.typing import Array
from lgmpc.wbc import Task, WholeBodyTerms

_GRIP_SHARE = 0.5  # of what friction allows: the rest is for the balance


class ComReference(Protocol):
    """A trajectory of the centre of mass relative to its initial position."""

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset (n, 3) m, velocity (n, 3) m/s and acceleration (n, 3) m/s^2 at ``times`` (n,) s."""


class StandReference(Settings):
    """Stand still: the centre of mass is at its initial position."""

    kind: Literal["stand"] = key("stand", "Stand still.")

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return zeros."""
        zero = np.zeros((len(times), 3))
        return zero, zero, zero


class CircleReference(Settings):
    """Move the centre of mass along a horizontal circle about the start while all feet stay.

    It is entered along a spiral whose radius grows smoothly.
    """

    kind: Literal["com_circle"] = key("com_circle", "Move the centre of mass along a circle.")
    radius_m: Annotated[Positive, Field(le=10.0)] = key(0.03, "Radius of the circle, m, at most 10.")
    frequency_hz: Annotated[Positive, Field(le=100.0)] = key(0.5, "Turns per second, Hz, at most 100.")
    start_s: NonNegative = key(1.0, "Start of the motion, s.")
    ramp_s: Annotated[Positive, Field(ge=1e-3)] = key(1.0, "Time in which the radius grows from 0, s, at least 0.001.")

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset, velocity and acceleration; all three are continuous (the radius is a quintic in time)."""
        omega = 2.0 * np.pi * self.frequency_hz
        elapsed = np.maximum(np.asarray(times) - self.start_s, 0.0)
        s = np.minimum(elapsed / self.ramp_s, 1.0)
        r, dr, ddr = (self.radius_m * each / self.ramp_s**k for k, each in enumerate(minimum_jerk(s)))
        phase = omega * elapsed
        radial = np.column_stack([np.cos(phase), np.sin(phase), np.zeros_like(phase)])
        tangential = np.column_stack([-np.sin(phase), np.cos(phase), np.zeros_like(phase)])
        offset = r[:, None] * radial
        velocity = dr[:, None] * radial + (r * omega)[:, None] * tangential
        acceleration = (ddr - r * omega**2)[:, None] * radial + (2.0 * omega * dr)[:, None] * tangential
        return offset, velocity, acceleration


@dataclass(frozen=True)
class MotionTasks:
    """The tasks of the whole-body QP through which a legged robot is led; others of its own do not matter here.

    Attributes:
        com: centre of mass.
        base_position: origin of the base.
        base_orientation: attitude of the base.
        angular_momentum: about the centre of mass.
        posture: joint positions.
        swing: feet in the air.
    """

    com: Task
    base_position: Task
    base_orientation: Task
    angular_momentum: Task
    posture: Task
    swing: Task

    @classmethod
    def of(cls, tasks: Mapping[str, Task]) -> "MotionTasks":
        """Return those of a whole-body controller's tasks.

        Raises:
            InputError: one is missing.
        """
        names = [each.name for each in fields(cls)]
        for name in names:
            if name not in tasks:
                raise InputError("tasks", f"none called '{name}'", f"tasks called {', '.join(names)}, besides others")
        return cls(*(tasks[name] for name in names))


class DesiredMotion:
    """The motion that the robot should make, now for the whole-body QP's tasks and over the horizon for the MPC.

    Args:
        robot: the controller's model.
        legs: its legs.
        settings: limits of commands, and of the distance to the desired position.
        offset: of the centre of mass from where the commands lead it; None for none.

    Attributes:
        builder: position and heading, as integrated from the commands.
        command: limited command that is followed.
        target: (3,) desired centre of mass now, world, m.
        base_target: (7,) base pose that goes with it [position, quaternion x y z w].
        joints: (3 nu,) positions, velocities and accelerations that go with it.
    """

    def __init__(
        self, robot: Robot, legs: LegGeometry, settings: LocomotionSettings, offset: ComReference | None
    ) -> None:
        self.builder = ReferenceBuilder(robot, legs, settings.reference)
        self.command = MotionCommand()
        self.target = np.zeros(3)
        self.base_target = robot.q_reference[:7].copy()
        self._limiter = CommandLimiter(settings.limits)
        self._offset = offset
        self._mass, self._height = robot.mass, legs.height
        self._turns = robot.short_support and settings.reaction.enabled
        self._planned: MotionReference | None = None  # over the last horizon
        self._grip = _GRIP_SHARE * float(np.linalg.norm(robot.gravity))
        self._centre, self._origin, self._attitude = np.zeros(9), np.zeros(9), np.zeros(12)  # as of DesiredPose
        self.joints = self._standing_joints = np.concatenate([robot.q_reference[robot.joint_q], np.zeros(2 * robot.nu)])

    def rest(self) -> None:
        """Forget the last command: the next one begins at rest."""
        self._limiter.command = MotionCommand()

    def follow(
        self, request: MotionCommand, elapsed: float, friction: float, terms: WholeBodyTerms, stepping: bool,
        load: tuple[float, float],
    ) -> BaseMotion:  # fmt: skip
        """Follow a command within the limits, and stay near the robot while it steps; return how the robot moves.

        Args:
            request: the command.
            elapsed: time since the last call, s.
            friction: coefficient of the floor.
            terms: sensed quantities.
            stepping: whether the robot steps.
            load: (x, y) external force that lasts, world axes, N.
        """
        builder, limiter = self.builder, self._limiter
        self.command = command = limiter.step(request, elapsed, self._grip * friction)
        builder.advance(elapsed, command)
        if stepping:
            builder.turn_about(terms.com, elapsed * command.yaw_rate)
            builder.shorten(terms.com, terms.yaw)
        x, y, mass, wanted = terms.x, terms.y, self._mass, builder.velocity(command)
        vx, vy = terms.px / mass, terms.py / mass
        if self._turns:
            swings = None if self._planned is None else self._planned.legs
            turning = terms.momentum[3:] if swings is None else terms.momentum[3:] - swings[0]
            vx, vy = vx + float(turning[1]) / (mass * self._height), vy - float(turning[0]) / (mass * self._height)
        return BaseMotion(
            x, y, vx, vy, terms.yaw, command.yaw_rate, wanted[0], wanted[1],
            x - builder.x, y - builder.y, limiter.ramp.turned(terms.yaw), command.height, friction,
            float(terms.rotation[2, 0]), float(terms.rotation[2, 1]), load[0] / mass, load[1] / mass,
        )  # fmt: skip

    def place(self, time: float, ground: TerrainBelief) -> None:
        """Compute where the robot should be now."""
        pose = self.builder.pose(self.command, ground)
        self.target[...], self.base_target[...] = pose.centre[:3], pose.base_pose
        self._centre, self._origin, self._attitude = pose.centre, pose.origin, pose.attitude
        self.joints = self._standing_joints
        if self._offset is not None:
            offset, velocity, acceleration = (rows[0] for rows in self._offset.sample(np.array([time])))
            self.target += offset
            self.base_target[:3] += offset
            self._origin = pose.origin + np.concatenate([offset, velocity, np.zeros(3)])
            self._centre = pose.centre + np.concatenate([offset, velocity, acceleration])

    def rise(self, rise: RiseMotion, retraction: LegRetraction) -> None:
        """Move where the robot should be by the rise's offset, and the joints towards the lying posture."""
        self.target += rise.offset
        self.base_target[:2] += rise.offset[:2]
        self.base_target[2] += retraction.base_share * rise.offset[2]
        self._centre = np.concatenate([self.target, rise.velocity, rise.acceleration])
        self._origin = np.concatenate([self.base_target[:3], rise.velocity, self._origin[6:]])
        positions, rest = np.split(self._standing_joints, [len(retraction.lying)])
        self.joints = np.concatenate([positions + rise.lying * (retraction.lying - positions), rest])

    def write_base(self, tasks: MotionTasks) -> None:
        """Write the desired motion into the tasks of the base."""
        tasks.base_position.targets_together[...] = self._origin
        tasks.base_orientation.targets_together[...] = self._attitude

    def write_balance(self, tasks: MotionTasks) -> None:
        """Write the desired motion into the tasks of balance and joints: without a plan to follow."""
        tasks.com.targets_together[...], tasks.angular_momentum.targets_together[...] = self._centre, 0.0
        tasks.posture.targets_together[...] = self.joints

    def write_horizon(self, motion: MotionReference, grid: TimeGrid, ground: TerrainBelief) -> None:
        """Write the desired motion at the nodes of a horizon that begins now."""
        self._planned = motion
        self.builder.write(motion, self.command, grid, ground, self._limiter.ramp)
        if self._offset is not None:
            offset, velocity, _ = self._offset.sample(grid.nodes)
            motion.com += offset
            motion.com_velocity += velocity
