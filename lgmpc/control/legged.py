"""The controller of a legged robot: commands and measured state in, joint command out."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np

from lgmpc.control.fall_monitor import FallMonitor, RestMonitor
from lgmpc.control.feet import Feet
from lgmpc.control.interface import Command, RobotState
from lgmpc.control.lying import Folding, Lift
from lgmpc.control.modes import Mode, ModeMachine, Situation, Transition
from lgmpc.control.planner import Planner
from lgmpc.control.push_steps import PushSteps
from lgmpc.control.reference import ComReference
from lgmpc.control.settings import ModeSettings
from lgmpc.estimation import DelaySettings, FrictionMonitor, JointFrictionEstimator, StatePredictor
from lgmpc.locomotion.command import CommandLimiter, CommandSource, CommandTimeline, MotionCommand
from lgmpc.locomotion.footholds import BaseMotion
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.reference import ReferenceBuilder
from lgmpc.locomotion.settings import LocomotionSettings, gaits_of
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc import TickStatus, WholeBodyController, WholeBodyTerms
from lgmpc.wbc.tasks import Target

__all__ = ["LeggedController"]

_LOG = logging.getLogger(__name__)
_LIFTING = (Mode.RISE, Mode.SIT)
_REST = 0.05  # m/s
_GRIP_SHARE = 0.5  # of what friction allows: the rest is for the balance
_LEVEL_SHARE = 0.02  # of the height: feet that differ by less are level


class LeggedController:
    """A :class:`lgmpc.control.interface.Controller` that stands, walks, and keeps its balance meanwhile.

    The first finite state is the place to stand or, of a robot on its belly, to lie; :class:`~lgmpc.control.modes.Mode`
    says what it does from there on. Standing is a gait without swings; a command with a velocity starts its gait, and
    without one the gait ends in standing. Without a planner, the whole-body QP alone regulates the centre of mass to
    the reference, which suffices to stand, to rise and to lie down.

    Args:
        robot: the controller's model.
        wbc: the whole-body controller.
        floor: how much friction can be relied on.
        planner: the MPC with its disturbance observer, or None.
        commands: source of motion commands; without, the robot stands.
        offset: of the centre of mass from where the commands lead it; None for none.
        locomotion: settings of footholds, swings and contact events.
        gaits: that commands may name; :func:`~lgmpc.locomotion.settings.gaits_of` the robot unless given.
        modes: settings of lying, rising and giving up.
        delays: that are compensated: all that the controller decides is for the state in which its command will act.
        joint_friction: estimates what the torques overcome; None for what is known of the robot.
        period: time between two updates, s.

    Attributes:
        wbc: the whole-body controller; its forces, torques and status are those of the last update.
        feet: contacts, footholds and swings.
        floor: as given.
        planner: as given.
        commands: source of motion commands; another one may take its place between two updates.
        command: the limited command at the last update.
        target: (3,) desired centre of mass at the last update, world, m.
        base_target: (7,) base pose that goes with it [position, quaternion x y z w].
        modes: the present mode.
        push_steps: steps that no command asks for.
        joint_friction: as given.
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
        modes: ModeSettings | None = None,
        delays: DelaySettings | None = None,
        joint_friction: JointFrictionEstimator | None = None,
        period: float = 1e-3,
    ) -> None:
        settings = LocomotionSettings() if locomotion is None else locomotion
        self.robot = robot
        self.wbc = wbc
        self.floor = floor
        self.planner = planner
        self.feet = Feet(robot, settings, gaits_of(robot, settings) if gaits is None else gaits)
        self.command = MotionCommand()
        self.commands: CommandSource = CommandTimeline(()) if commands is None else commands
        self._offset = offset
        self._limiter = CommandLimiter(settings.limits)
        self._reference = ReferenceBuilder(robot, self.feet.legs, settings.reference)
        self._posture = robot.q_reference[robot.joint_q]
        self._node_times = np.zeros(1)
        if planner is not None:
            s = planner.mpc.settings
            self._node_times = s.node_s * np.arange(s.nodes + 1, dtype=np.float64)
        delayed = delays is not None and delays.total_s > 0.0
        self._predictor = StatePredictor(robot, period, delays) if delays is not None and delayed else None
        self._measured = WholeBodyTerms(robot) if delayed else wbc.terms
        self.joint_friction = joint_friction
        self._period = period
        self._time, self._elapsed = math.nan, period
        self._shares = np.ones(robot.nc)
        self._lowest, self._highest = wbc.contacts.lowest_normal.copy(), wbc.contacts.highest_normal.copy()
        self._motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        self._followed = self.command
        self.push_steps = PushSteps(settings.reaction, self.feet, self._reference, robot.mass)
        self._mode_settings = ModeSettings() if modes is None else modes
        self.modes = ModeMachine()
        self._situation = Situation()
        self._fall = FallMonitor(self._mode_settings.fall, self.feet.legs.height)
        self._rest = RestMonitor(self._mode_settings.rest_s, self._mode_settings.rearm == "automatic")
        self._folding = Folding(robot, self._mode_settings.lying)
        self._lift = Lift(self._mode_settings.lying)
        self._displaced_since = math.inf
        self._mass = robot.mass
        self._weight = -robot.mass * float(robot.gravity[2])
        self._grip = _GRIP_SHARE * self._weight / robot.mass
        self._begun = False
        self._at_rest = np.zeros(robot.nu)
        self._at_rest.flags.writeable = False
        self.target = np.zeros(3)
        self.base_target = robot.q_reference[:7].copy()
        self.wbc_ms = 0.0

    @property
    def fallen(self) -> bool:
        """Whether the controller gave up, or was stopped, and has not begun again."""
        return self._begun and self.modes.mode is Mode.DAMP

    def reset(self) -> None:
        """Begin anew with the next finite state, whatever was before."""
        self._begun, self._time = False, math.nan
        self.modes.begin(Mode.DAMP)
        self.wbc.reset()
        self.floor.reset()
        if self._predictor is not None:
            self._predictor.reset()
        if self.joint_friction is not None:
            self.joint_friction.reset()

    def update(self, state: RobotState) -> Command:
        """Return the joint torques for the measured state; never raises for what the robot does."""
        started = perf_counter()
        measured = state
        if self._predictor is not None:
            self._measured.update(state.q, state.v)
            state = self._predictor.predict(state)
        terms = self.wbc.sense(state.q, state.v)
        finite = math.isfinite(sum(state.q.tolist()) + sum(state.v.tolist()))
        request = self.commands.at(state.time)
        if not self._begun:
            if not finite:
                return self._wait(state)
            self._begin(state)
        mode = self._choose_mode(state, request)
        if mode is Mode.DAMP or (mode is Mode.LIE and not finite):
            return self._damp(state)
        if mode is Mode.LIE:
            return self._lie(state)
        missed = self._advance_clock(state.time)
        if finite:
            self._step(state, request)
            self._set_targets(state.time)
            if self.joint_friction is not None:
                self.wbc.joint_friction[:] = self.joint_friction.update(measured, self.feet.stance, missed)
        planner = self.planner if mode.upright else None
        if planner is not None:
            if missed:
                planner.observer.miss(missed)
            self.wbc.external_wrench[:] = planner.observe(self._measured.momentum)
            # Feet that have just touched down would carry nothing until a plan includes them.
            if planner.due(state.time) or self.feet.changed:
                self._write_horizon(state.time, planner)
                plan = planner.plan_from(state.time, terms)
                self.feet.decide(plan, planner.contacts.flags)
                self.push_steps.watch(state.time, plan, terms.contact_points)
                self._return_feet(state.time)
            else:
                self._decide(state.time, planner)
            planner.follow(state.time, self.wbc)
        self.wbc.solve()
        solved = self.wbc.status is TickStatus.SOLVED
        if solved and self._predictor is not None:
            self._predictor.expect(self.wbc.acceleration)
        if planner is not None:
            if solved:
                planner.expect(terms, self.wbc.acceleration)
            else:
                planner.skip()
        if self.joint_friction is not None:
            self.joint_friction.expect(self.wbc.tau)
        joints = state.q[self.robot.joint_q]
        command = Command(self.wbc.tau.copy(), joints, self._at_rest, 0.0, self.wbc.damping)
        self.wbc_ms = 1e3 * (perf_counter() - started - (0.0 if planner is None else planner.spent))
        return command

    def _advance_clock(self, time: float) -> int:
        """Measure the time since the last update, in whole periods; return how many ticks were missed."""
        periods = 1 if math.isnan(self._time) else max(1, round((time - self._time) / self._period))
        self._time, self._elapsed = time, periods * self._period
        return periods - 1

    def _choose_mode(self, state: RobotState, request: MotionCommand) -> Mode:
        """Measure what transitions depend on, make the one that is due, and return the mode."""
        machine, situation, time = self.modes, self._situation, state.time
        mode, terms, feet = machine.mode, self.wbc.terms, self.feet
        upright = float(terms.rotation[2, 2])
        situation.request, situation.moving, situation.stepping = request.mode, self.command.moves, feet.stepping
        situation.reacting = situation.reacting and feet.stepping and not self.command.moves
        situation.failure = ""
        if mode is Mode.DAMP:
            situation.rearmed = self._rest.update(time, upright, state.v, request.mode)
        elif mode is Mode.LIE:
            situation.failure, situation.folded = self._fall.tilted(upright), self._folding.done(time)
        else:
            height, solved = float(terms.com[2]), self.wbc.status is TickStatus.SOLVED
            situation.failure = self._fall.update(time, upright, float(self.target[2]) - height, solved)
            if mode.upright and not situation.failure:
                touching = state.contacts is None or any(state.contacts.tolist())
                situation.failure = self._fall.update_support(time, height - self.feet.ground, touching)
        transition = machine.update(situation)
        if transition is not None:
            self._enter(transition, state)
        return machine.mode

    def _enter(self, transition: Transition, state: RobotState) -> None:
        """Prepare the mode that a transition leads to."""
        mode, situation = transition.target, self._situation
        why = f" ({situation.failure})" if transition.name == "give up" else ""
        level = logging.WARNING if mode is Mode.DAMP else logging.INFO
        _LOG.log(level, "%s at %.3f s%s: the robot %s", transition.name, state.time, why, mode.value)
        situation.lifted = False
        self._fall.reset()
        if mode is Mode.DAMP:
            self.wbc.reset()
            self._rest.begin(situation.request)
        elif mode is Mode.LIE:
            self._folding.begin(state.time, state.q[self.robot.joint_q], self.wbc.tau)
            self.wbc.reset()
        elif mode is Mode.RISE:
            self._begin_rising(state.time)
        elif mode is Mode.SIT:
            lying = np.array([0.0, 0.0, self._folding.crouch - self.feet.legs.height])
            self._lift.begin(state.time, np.zeros(3), lying)
        elif transition.name == "risen" and self.planner is not None:
            self.planner.reset()
        elif transition.name == "halt":
            # It was to move, not to reach a place: it stands above its feet, wherever they came down.
            self._reference.begin(self._above_feet(self._reference.yaw), self._reference.yaw)
        if not mode.upright:
            self.push_steps.stop()
            self.wbc.external_wrench[:] = 0.0
            if self.planner is not None:
                self.planner.planned = False

    def _begin_rising(self, time: float) -> None:
        """Stand where the feet are, and begin the way there from the belly."""
        terms = self.wbc.terms
        yaw = math.atan2(terms.rotation[1, 0], terms.rotation[0, 0])
        self.wbc.stand()
        self.wbc.contacts.target_forces[:] = 0.0
        self.wbc.contacts.target_forces[:, 2] = self._weight / self.robot.nc
        self.floor.reset()
        self.feet.begin(time, terms.contact_points, None)
        self._limiter.command = MotionCommand()
        standing = self._above_feet(yaw)
        self._reference.begin(standing, yaw)
        self._lift.begin(time, terms.com - standing, np.zeros(3))

    def _above_feet(self, yaw: float) -> Array:
        """Return (3,) where the centre of mass of the reference posture is, the feet where they are, m."""
        middle, legs = self.wbc.terms.contact_points.mean(axis=0), self.feet.legs
        x, y, _ = legs.feet.mean(axis=0).tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        above: Array = middle + [s * y - c * x, -s * x - c * y, legs.height]
        return above

    def _step(self, state: RobotState, request: MotionCommand) -> None:
        """Follow the command with reference and feet, and give the whole-body QP its contacts and swing targets."""
        time, terms, contacts = state.time, self.wbc.terms, self.wbc.contacts
        lifting = self.modes.mode in _LIFTING
        if lifting or request.mode != "stand":
            request = MotionCommand(gait=request.gait, mode=request.mode)  # comes to rest
        followed = self.push_steps.way_back(request)
        self._followed = command = self._limiter.step(followed, self._elapsed, self._grip * self.floor.coefficient)
        going_back = self.push_steps.active
        self.command = replace(command, vx=0.0, vy=0.0, yaw_rate=0.0) if going_back else command
        yaw = math.atan2(terms.rotation[1, 0], terms.rotation[0, 0])
        self._reference.advance(self._elapsed, command)
        if self.feet.stepping:
            self._reference.shorten(terms.com, yaw)
        wanted = self._reference.velocity(command)
        (x, y), (px, py), mass = terms.com[:2].tolist(), terms.momentum[:2].tolist(), self._mass
        astray = (x - self._reference.x, y - self._reference.y)
        ramp = self._limiter.ramp.turned(yaw)
        self._motion = motion = BaseMotion(x, y, px / mass, py / mass, yaw, command.yaw_rate, *wanted, *astray, ramp)
        feet = self.feet
        self.push_steps.follow(time, command)
        feet.update(time, terms.contact_points, terms.contact_velocities, state.contacts, motion)
        self.wbc.weigh(feet.stepping)
        feet.loading(time, self._shares)
        if lifting:
            self._situation.lifted = self._lift.update(time)
            self.wbc.external_wrench[2] = self._lift.support * self._weight
        contacts.stance[:] = feet.stance
        contacts.friction[:] = self.floor.update(terms.contact_velocities, feet.settled, self.wbc.forces)
        np.multiply(self._shares, self._highest, out=contacts.highest_normal)
        np.minimum(self._lowest, contacts.highest_normal, out=contacts.lowest_normal)
        if not feet.standing:
            swing = self.wbc.tasks["swing"].target
            swing.position[:], swing.velocity[:] = feet.position, feet.velocity
            swing.acceleration[:] = feet.acceleration

    def _set_targets(self, time: float) -> None:
        """Write the reference into the tasks: what the whole-body QP tracks where no plan says otherwise."""
        pose, tasks = self._reference.pose(self._followed, self.feet.ground), self.wbc.tasks
        com, base, origin = tasks["com"].target, tasks["base_orientation"].target, tasks["base_position"].target
        self.target[:], self.base_target[:] = pose.com, pose.base_pose
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
        if self.modes.mode in _LIFTING:
            self._set_lift(com, origin, joints)

    def _set_lift(self, com: Target, origin: Target, joints: Target) -> None:
        """Move the targets of standing by the lift's offset, and the joints towards the lying posture."""
        lift = self._lift
        self.target += lift.offset
        self.base_target[:2] += lift.offset[:2]
        self.base_target[2] += self._folding.base_share * lift.offset[2]
        com.position[:], com.velocity[:], com.acceleration[:] = self.target, lift.velocity, lift.acceleration
        origin.position[:], origin.velocity[:] = self.base_target[:3], lift.velocity
        joints.position[:] = self._posture + lift.lying * (self._folding.lying - self._posture)

    def _decide(self, time: float, planner: Planner) -> None:
        """Take part of the decision to step, if there is one to be made, and plan anew once it is."""
        if self.push_steps.decide(
            time, planner, self.wbc.terms, self._motion, self._friction(planner), self.wbc.forces[:, 2]
        ):
            self._situation.reacting = True
            planner.expire()

    def _return_feet(self, time: float) -> None:
        """Step in place if a foot of a robot at rest is far from where it belongs."""
        settings, motion, reference = self._mode_settings, self._motion, self._reference
        displaced = (
            self.feet.standing
            and not self.command.moves
            and math.hypot(motion.vx, motion.vy) < _REST
            and self.feet.displacement(reference.x, reference.y, reference.yaw) > settings.displaced_m
        )
        self._displaced_since = min(self._displaced_since, time) if displaced else math.inf
        if time - self._displaced_since >= settings.displaced_s:
            self._displaced_since = math.inf
            self._situation.reacting = self.feet.step_in_place(time)

    def _write_horizon(self, time: float, planner: Planner) -> None:
        settings = planner.mpc.settings
        self.feet.write_horizon(time, settings.node_s, self._motion, self._friction(planner), planner.contacts)
        self._reference.write(planner.motion, self._followed, settings.node_s, self.feet.ground, self._limiter.ramp)
        if self._offset is not None:
            offset, velocity, _ = self._offset.sample(time + self._node_times)
            planner.motion.com += offset
            planner.motion.com_velocity += velocity

    def _friction(self, planner: Planner) -> float:
        """Friction coefficient to rely on over the horizon."""
        return min(planner.mpc.settings.friction, float(self.wbc.contacts.friction[0]))

    def _begin(self, state: RobotState) -> None:
        """Stand where the robot is now; lie if it lies, and do nothing if it is tilted too far."""
        terms, legs = self.wbc.terms, self.feet.legs
        self._begun = True
        heights = terms.contact_points[:, 2]
        low = float(terms.com[2] - heights.min()) < 0.5 * (self._folding.height + legs.height)
        if self._fall.tilted(float(terms.rotation[2, 2])):
            self.modes.begin(Mode.DAMP)
            self._rest.begin(self.commands.at(state.time).mode)
            return
        if low:
            self.modes.begin(Mode.LIE)
            self._folding.begin(state.time, state.q[self.robot.joint_q], self.wbc.tau)
            return
        self.modes.begin(Mode.STAND)
        self.wbc.stand()
        # What has no contact yet, but is level with the lowest foot, has it as soon as the robot is let down.
        contacts = heights - heights.min() < _LEVEL_SHARE * legs.height
        if state.contacts is not None:
            contacts |= state.contacts
        self._situation.reacting = not bool(contacts.all())
        self.feet.begin(state.time, terms.contact_points, contacts)
        self._reference.begin(terms.com, math.atan2(terms.rotation[1, 0], terms.rotation[0, 0]))
        if self.planner is not None:
            self.planner.reset()

    def _lie(self, state: RobotState) -> Command:
        """Return the command that folds the legs under the trunk and holds them."""
        joints, rates = state.q[self.robot.joint_q], state.v[self.robot.joint_v]
        self.target[:], self.base_target[:] = self.wbc.terms.com, state.q[:7]
        self.wbc.tau[:] = self._folding.torques(state.time, joints, rates)
        return Command(self.wbc.tau.copy(), joints, np.zeros(self.robot.nu))

    def _wait(self, state: RobotState) -> Command:
        """Return the command before there is a state to stand in: no torque, joints damped."""
        _LOG.warning("no finite state yet at %.3f s: no torque, joints damped", state.time)
        return self._damp(state)

    def _damp(self, state: RobotState) -> Command:
        nothing = np.zeros(self.robot.nu)
        return Command.damping(nothing, state.q[self.robot.joint_q], self.wbc.settings.fallback_damping_nms)
