"""The controller of a legged robot: commands and measured state in, joint command out."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from time import perf_counter

import numpy as np

from lgmpc.control.feet import Feet
from lgmpc.control.interface import Command, RobotState
from lgmpc.control.planner import Planner
from lgmpc.control.reference import ComReference
from lgmpc.estimation import FrictionMonitor
from lgmpc.locomotion.command import CommandLimiter, CommandSource, CommandTimeline, MotionCommand
from lgmpc.locomotion.footholds import BaseMotion
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.reaction import StepReaction
from lgmpc.locomotion.reference import ReferenceBuilder
from lgmpc.locomotion.settings import LocomotionSettings, gaits_of
from lgmpc.robot import Robot
from lgmpc.wbc import TickStatus, WholeBodyController

__all__ = ["LeggedController"]

_LOG = logging.getLogger(__name__)
_FALLEN_COSINE = 0.5  # of the tilt at which balancing ends


class LeggedController:
    """A :class:`lgmpc.control.interface.Controller` that stands, walks, and keeps its balance meanwhile.

    The first finite state is the place to stand. Standing is a gait without swings; a command with a velocity starts
    its gait, and without one the gait ends in standing. Without a planner, the whole-body QP alone regulates the centre
    of mass to the reference, which suffices to stand.

    Args:
        robot: the controller's model.
        wbc: the whole-body controller.
        floor: how much friction can be relied on.
        planner: the MPC with its disturbance observer, or None.
        commands: source of motion commands; without, the robot stands.
        offset: of the centre of mass from where the commands lead it; None for none.
        locomotion: settings of footholds, swings and contact events.
        gaits: that commands may name; :func:`~lgmpc.locomotion.settings.gaits_of` the robot unless given.
        period: time between two updates, s.

    Attributes:
        wbc: the whole-body controller; its forces, torques and status are those of the last update.
        feet: contacts, footholds and swings.
        floor: as given.
        planner: as given.
        command: the limited command at the last update.
        target: (3,) desired centre of mass at the last update, world, m.
        base_target: (7,) base pose that goes with it [position, quaternion x y z w].
        fallen: whether the base once tilted so far (60 degrees) that the controller gave up.
        wbc_ms: duration of the last update without the planner's, ms.
    """

    def __init__(
        self,
        robot: Robot,
        wbc: WholeBodyController,
        floor: FrictionMonitor,
        planner: Planner | None = None,
        *,
        commands: CommandSource | None = None,
        offset: ComReference | None = None,
        locomotion: LocomotionSettings | None = None,
        gaits: Mapping[str, Gait] | None = None,
        period: float = 1e-3,
    ) -> None:
        settings = LocomotionSettings() if locomotion is None else locomotion
        self.robot = robot
        self.wbc = wbc
        self.floor = floor
        self.planner = planner
        self.feet = Feet(robot, settings, gaits_of(robot, settings) if gaits is None else gaits)
        self.command = MotionCommand()
        self._commands: CommandSource = CommandTimeline(()) if commands is None else commands
        self._offset = offset
        self._limiter = CommandLimiter(settings.limits)
        self._reference = ReferenceBuilder(robot, self.feet.legs, settings.reference)
        self._posture = robot.q_reference[robot.joint_q]
        self._node_times = np.zeros(1)
        if planner is not None:
            s = planner.mpc.settings
            self._node_times = s.node_s * np.arange(s.nodes + 1, dtype=np.float64)
        self._period = period
        self._shares = np.ones(robot.nc)
        self._lowest, self._highest = wbc.contacts.lowest_normal.copy(), wbc.contacts.highest_normal.copy()
        self._motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        self._reaction = StepReaction(settings.reaction, self.feet.legs.height)
        self._begun = False
        self.target = np.zeros(3)
        self.base_target = robot.q_reference[:7].copy()
        self.wbc_ms = 0.0
        self.fallen = False

    def update(self, state: RobotState) -> Command:
        """Return the joint torques for the measured state; never raises for what the robot does."""
        started = perf_counter()
        terms = self.wbc.sense(state.q, state.v)
        if self.fallen or terms.rotation[2, 2] < _FALLEN_COSINE:
            return self._give_up(state)
        if not self._begun:
            if not (np.isfinite(state.q).all() and np.isfinite(state.v).all()):
                return self._wait(state)
            self._begin(state)
        if math.isfinite(float(state.q.sum()) + float(state.v.sum())):
            self._step(state)
            self._set_targets(state.time)
        planner = self.planner
        if planner is not None:
            self.wbc.external_wrench[:] = planner.observe(terms)
            if planner.due(state.time):
                self._write_horizon(state.time, planner)
                planner.plan_from(state.time, terms)
                self._react(state.time, planner)
            planner.follow(state.time, self.wbc)
        self.wbc.solve()
        if planner is not None:
            if self.wbc.status is TickStatus.SOLVED:
                planner.expect(terms, self.wbc.acceleration)
            else:
                planner.skip()
        joints = state.q[self.robot.joint_q]
        command = Command(self.wbc.tau.copy(), joints, np.zeros(self.robot.nu), 0.0, self.wbc.damping)
        self.wbc_ms = 1e3 * (perf_counter() - started - (0.0 if planner is None else planner.spent))
        return command

    def _step(self, state: RobotState) -> None:
        """Follow the command with reference and feet, and give the whole-body QP its contacts and swing targets."""
        time, terms, contacts = state.time, self.wbc.terms, self.wbc.contacts
        self.command = command = self._limiter.step(self._commands.at(time), self._period)
        yaw = math.atan2(terms.rotation[1, 0], terms.rotation[0, 0])
        self._reference.advance(self._period, command)
        if self.feet.stepping:
            self._reference.shorten(terms.com, yaw)
        wanted = self._reference.velocity(command)
        velocity = terms.momentum[:2] / self.robot.mass
        (x, y), (vx, vy) = terms.com[:2].tolist(), velocity.tolist()
        self._motion = motion = BaseMotion(x, y, vx, vy, yaw, command.yaw_rate, *wanted)
        feet = self.feet
        feet.follow(time, command)
        feet.update(time, terms.contact_points, terms.contact_velocities, state.contacts, motion)
        feet.loading(time, self._shares)
        contacts.stance[:] = feet.stance
        contacts.friction[:] = self.floor.update(terms.contact_velocities, feet.settled)
        np.multiply(self._shares, self._highest, out=contacts.highest_normal)
        np.minimum(self._lowest, contacts.highest_normal, out=contacts.lowest_normal)
        swing = self.wbc.tasks["swing"].target
        swing.position[:], swing.velocity[:], swing.acceleration[:] = feet.position, feet.velocity, feet.acceleration

    def _set_targets(self, time: float) -> None:
        """Write the reference into the tasks: what the whole-body QP tracks where no plan says otherwise."""
        pose, tasks = self._reference.pose(self.command, self._ground()), self.wbc.tasks
        com, base, origin = (tasks[name].target for name in ("com", "base_orientation", "base_position"))
        self.target[:], self.base_target[:3], self.base_target[3:] = pose.com, pose.base, pose.quaternion
        com.velocity[:], com.acceleration[:] = pose.velocity, 0.0
        if self._offset is not None:
            offset, velocity, acceleration = (rows[0] for rows in self._offset.sample(np.array([time])))
            self.target += offset
            self.base_target[:3] += offset
            com.velocity[:] += velocity
            com.acceleration[:] = acceleration
        com.position[:] = self.target
        origin.position[:], origin.velocity[:] = self.base_target[:3], com.velocity
        base.rotation[:] = pose.rotation
        np.multiply(pose.rotation[2], pose.yaw_rate, out=base.angular_velocity)  # the vertical, in the target's axes
        turning, joints = tasks["angular_momentum"].target, tasks["posture"].target
        turning.momentum[:] = turning.rate[:] = 0.0
        joints.position[:], joints.velocity[:] = self._posture, 0.0

    def _react(self, time: float, planner: Planner) -> None:
        """Step if the plan shows that the feet in place cannot hold the robot."""
        plan, settings = planner.plan, self._reaction.settings
        if not (settings.enabled and self.feet.standing and plan is not None and plan.status.fresh):
            return
        end = plan.xs[-1]
        if self._reaction.needed(end[:3], end[3:6] / self.robot.mass, self.wbc.terms.contact_points):
            _LOG.info("steps against a push at %.3f s", time)
            self.feet.react(time, self.wbc.forces[:, 2])

    def _write_horizon(self, time: float, planner: Planner) -> None:
        settings = planner.mpc.settings
        friction = min(settings.friction, float(self.wbc.contacts.friction[0]))
        self.feet.write_horizon(time, settings.node_s, self._motion, friction, planner.contacts)
        self._reference.write(planner.motion, self.command, settings.node_s, self._ground())
        if self._offset is not None:
            offset, velocity, _ = self._offset.sample(time + self._node_times)
            planner.motion.com += offset
            planner.motion.com_velocity += velocity

    def _ground(self) -> float:
        """Mean height of the feet that stand, m; of the lowest foot if none does."""
        heights: list[float] = self.feet.footholds[:, 2].tolist()
        standing = [height for height, stands in zip(heights, self.feet.stance.tolist(), strict=True) if stands]
        return sum(standing) / len(standing) if standing else min(heights)

    def _begin(self, state: RobotState) -> None:
        """Stand where the robot is now."""
        terms = self.wbc.terms
        self._begun = True
        self.wbc.stand()
        self.feet.begin(state.time, terms.contact_points, None)
        self._reference.begin(terms.com, math.atan2(terms.rotation[1, 0], terms.rotation[0, 0]))
        if self.planner is not None:
            self.planner.reset()

    def _give_up(self, state: RobotState) -> Command:
        """Return the command of a fallen robot: no torque, joints damped."""
        if not self.fallen:
            _LOG.warning("fallen at %.3f s: no torque from here on, joints damped", state.time)
        self.fallen = True
        self.wbc.tau[:] = 0.0
        self.wbc.forces[:] = 0.0
        if self.planner is not None:
            self.planner.planned = False
        return self._damp(state)

    def _wait(self, state: RobotState) -> Command:
        """Return the command before there is a state to stand in: no torque, joints damped."""
        _LOG.warning("no finite state yet at %.3f s: no torque, joints damped", state.time)
        return self._damp(state)

    def _damp(self, state: RobotState) -> Command:
        nothing = np.zeros(self.robot.nu)
        return Command.damping(nothing, state.q[self.robot.joint_q], self.wbc.settings.fallback_damping_nms)
