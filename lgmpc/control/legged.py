"""The controller of a legged robot: commands and measured state in, joint command out."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from lgmpc.control.drives import DriveSettings, JointReferences
from lgmpc.control.faults import JointFaults
from lgmpc.control.feet import Feet
from lgmpc.control.interface import Command, RobotState
from lgmpc.control.lying import LegRetraction, RiseMotion
from lgmpc.control.maneuver import Maneuver
from lgmpc.control.modes import FallMonitor, Mode, ModeMachine, ModeSettings, RestMonitor, Transition, TransitionInputs
from lgmpc.control.performance import Performance, Performer
from lgmpc.control.planner import Planner
from lgmpc.control.reference import ComReference, DesiredMotion, MotionTasks
from lgmpc.control.report import TickReport
from lgmpc.control.uncommanded_steps import UncommandedSteps
from lgmpc.estimation import DelaySettings, FrictionMonitor, JointFaultMonitor, JointFrictionEstimator, StatePredictor
from lgmpc.locomotion.command import CommandSource, CommandTimeline, MotionCommand
from lgmpc.locomotion.footholds import BaseMotion
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.settings import LocomotionSettings, gaits_of
from lgmpc.robot import Robot
from lgmpc.status import Status
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyController, WholeBodyTerms

_LOG = logging.getLogger(__name__)
_REST = 0.05  # m/s
_LEVEL_SHARE = 0.02  # of the height: feet that differ by less are in one plane


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
        joint_faults: finds motors that have lost torque; None to rely on all of them.
        drives: gains of the drives' own loop; none unless given.
        maneuvers: planned motions that commands may name.
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
        uncommanded_steps: steps that no command asks for.
        joint_friction: as given.
        faults: motors that have lost torque.
        report: of the last update.
        finishes: whether an update calls :meth:`finish`; unset by loops that do so once the command is sent.
    """

    def __init__(
        self, robot: Robot, wbc: WholeBodyController, floor: FrictionMonitor, planner: Planner | None = None, *,
        commands: CommandSource | None = None, offset: ComReference | None = None,
        locomotion: LocomotionSettings | None = None, gaits: Mapping[str, Gait] | None = None,
        modes: ModeSettings | None = None, delays: DelaySettings | None = None,
        joint_friction: JointFrictionEstimator | None = None, joint_faults: JointFaultMonitor | None = None,
        drives: DriveSettings | None = None, maneuvers: Sequence[Maneuver] = (), period: float = 1e-3,
    ) -> None:  # fmt: skip
        settings = LocomotionSettings() if locomotion is None else locomotion
        self.robot, self.wbc, self.floor, self.planner = robot, wbc, floor, planner
        self._tasks = MotionTasks.of(wbc.tasks)
        named = gaits_of(robot, settings) if gaits is None else gaits
        self.feet = Feet(robot, settings, named, wbc.contacts, 0.0 if delays is None else delays.total_s, period)
        self.commands: CommandSource = CommandTimeline(()) if commands is None else commands
        self._desired = DesiredMotion(robot, self.feet.legs, settings, offset)
        self.target, self.base_target = self._desired.target, self._desired.base_target
        self._predictor = StatePredictor(robot, period, delays) if delays is not None and delays.total_s > 0.0 else None
        self._measured = wbc.terms if self._predictor is None else WholeBodyTerms(robot)
        self.command, self.joint_friction = MotionCommand(), joint_friction
        self._references = JointReferences(robot, DriveSettings() if drives is None else drives, period)
        self.faults = JointFaults(joint_faults, robot, wbc, self.feet, self._references, period)
        found = floor, self._predictor, joint_friction, self.faults, planner and planner.observer
        self._estimators: list[Any] = [each for each in found if each is not None]
        self._period, self._time, self._elapsed = period, math.nan, period
        self._motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        self.uncommanded_steps = UncommandedSteps(
            settings.reaction, self.feet, self._desired.builder, robot.mass, wbc.hands
        )
        self._mode_settings = ModeSettings() if modes is None else modes
        self.modes, self._inputs = ModeMachine(), TransitionInputs()
        self._fall = FallMonitor(self._mode_settings.fall, self.feet.legs.height)
        self._rest = RestMonitor(self._mode_settings.lie_still_s, self._mode_settings.rearm == "automatic")
        self._performer = Performer(robot, maneuvers, wbc, self._tasks, self.feet, period)
        self._leg_retraction = LegRetraction(robot, self._mode_settings.lying)
        self._rise_motion = RiseMotion(self._mode_settings.lying)
        self._weight = -robot.mass * robot.gravity
        self._standing_forces = np.tile(self._weight / robot.nc, (robot.nc, 1))
        self._begun, self._waits, self.finishes = False, False, True
        self._planned, self._plan_s = False, 0.0
        self.report = self._report(math.nan, 0.0)._replace(tick_ms=0.0)

    @property
    def fallen(self) -> bool:
        """Whether the controller gave up, or was stopped, and has not begun again."""
        return self._begun and self.modes.mode is Mode.DAMP

    def reset(self) -> None:
        """Begin anew with the next finite state, whatever was before."""
        self._begun, self._waits, self._time = False, False, math.nan
        self._performer.reset()
        self.modes.begin(Mode.DAMP)
        self.uncommanded_steps.stop()
        self.wbc.reset()
        for each in self._estimators:
            each.reset()

    def take_estimates(self, other: "LeggedController") -> None:
        """Continue with another controller's estimates of what its commands, which acted, did to the robot."""
        theirs = {type(each): each for each in other._estimators}
        for mine in self._estimators:
            if type(mine) in theirs:
                mine.set_state(theirs[type(mine)].state())

    def update(self, state: RobotState) -> Command:
        """Return the joint command for the measured state; never raises for what the robot does."""
        started = perf_counter()
        self._planned, self._plan_s = False, 0.0
        command = self._decide(state)
        self.report = self._report(state.time, started)
        if self.finishes:
            self.finish()
        return command

    def finish(self) -> None:
        """Make a deferred plan, or the next forecast of steps: what the command of this tick does not need."""
        started, planner, report = perf_counter(), self.planner, self.report
        if planner is None:
            return
        if planner.finish(self.wbc.terms):
            report = report._replace(plan=planner.plan, plan_ms=report.plan_ms + 1e3 * (perf_counter() - started))
        elif self.uncommanded_steps.evaluate(planner):
            report = report._replace(forecast_ms=1e3 * (perf_counter() - started))
        self.report = report

    def _report(self, time: float, started: float) -> TickReport:
        """Return the report of the tick that began at ``started`` on the clock, s."""
        wbc, feet, terms = self.wbc, self.feet, self.wbc.terms
        return TickReport(
            time, terms.finite, self.modes.mode, self.command, feet.clock.gait, feet.stance,
            feet.events.states, terms.contact_points, terms.com, terms.momentum, self.target,
            self.base_target, feet.targets, feet.point_footholds, wbc.forces, wbc.external_wrench, feet.ground,
            self.faults.shares, wbc.joint_friction, wbc.status, None if self.planner is None else self.planner.plan,
            self._planned, 1e3 * (perf_counter() - started - self._plan_s), 1e3 * self._plan_s, 0.0,
        )  # fmt: skip

    def _decide(self, state: RobotState) -> Command:
        """Advance everything by one tick, and return its command."""
        measured, state = state, self._at_effect(state)
        finite = self.wbc.sense(state.q, state.v).finite
        request = self.faults.limited(self.commands.at(state.time))
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
        if self._performer.present is not None:
            return self._perform(state, self._performer.present, missed)
        if finite:
            self._step(state, request)
            if mode.upright:
                self.faults.watch(measured, missed)
            if self.joint_friction is not None:
                stance = self.feet.points.spread(self.feet.stance)
                self.wbc.joint_friction[:] = self.joint_friction.update(measured, stance, missed)
        planner = self.planner if mode.upright else None
        if planner is not None:
            self._plan(state.time, planner, missed)
        status = self.wbc.solve()
        self._expect(planner, status is Status.CONVERGED, self.wbc.external_wrench)
        return self._command(state)

    def _perform(self, state: RobotState, present: Performance, missed: int) -> Command:
        """Advance a manoeuvre by one tick, and return its command."""
        if self.planner is not None:
            self.planner.observe(self._measured.momentum, missed)
        self._plan_s = self._performer.advance(state.time, state.contacts, self.planner)
        self._planned = self._plan_s > 0.0
        self.target[:], self.base_target[:] = present.com, present.base
        self._expect(self.planner, self.wbc.solve() is Status.CONVERGED)
        return self._command(state)

    def _at_effect(self, state: RobotState) -> RobotState:
        """Return the state in which the command will act: the measured one, unless there are delays."""
        if self._predictor is None:
            return state
        self._measured.update(state.q, state.v)
        return self._predictor.predict(state)

    def _plan(self, time: float, planner: Planner, missed: int) -> None:
        """Estimate the external wrench, plan if it is time to, and write the plan's targets of this tick."""
        wbc, terms, steps, started = self.wbc, self.wbc.terms, self.uncommanded_steps, perf_counter()
        wbc.external_wrench[...] = planner.observe(self._measured.momentum, missed)
        follows = not (self.robot.short_support and self.feet.standing)
        if not follows:
            # The centroidal model has no trunk and arms: its plans ask them for more angular momentum than they have,
            # and a wrench observed at feet that tip over adds to it. Alone, the whole-body QP holds twice the push.
            wbc.external_wrench[...] = 0.0
            wbc.contacts.target_forces[...] = self._standing_forces
        # Feet that have just touched down would carry nothing until a plan includes them.
        if planner.due(time) or self.feet.changed:
            friction = min(planner.mpc.settings.friction, float(wbc.contacts.friction[0]))
            self._write_horizon(time, planner, friction)
            planner.plan_from(time, terms)
            steps.watch(time, planner, terms, self._motion, friction, wbc.forces)
            self._inputs.reacting |= steps.return_feet(time, self._motion, self.command.moves, self._mode_settings)
            self._planned, self._plan_s = True, perf_counter() - started
        elif steps.decide(time, planner):
            self._inputs.reacting = True
            planner.expire()
        if not (follows and planner.follow(time, self._tasks, wbc.contacts, self._desired.joints)):
            self._desired.write_balance(self._tasks)

    def _expect(self, planner: Planner | None, solved: bool, wrench: Array | None = None) -> None:
        """Give the estimators what the new command should lead to."""
        acceleration = self.wbc.acceleration if solved else None
        if acceleration is not None and self._predictor is not None:
            self._predictor.expect(acceleration)
        if planner is not None:
            planner.expect(self.wbc.terms, acceleration, wrench)
        self.faults.expect(self.wbc.tau)

    def _advance_clock(self, time: float) -> int:
        """Measure the time since the last update, in whole periods; return how many ticks were missed."""
        elapsed = (time - self._time) / self._period
        periods = round(elapsed) if elapsed > 1.0 else 1  # also at the first update, where it is NaN
        self._time, self._elapsed = time, periods * self._period
        return periods - 1

    def _choose_mode(self, state: RobotState, request: MotionCommand) -> Mode:
        """Measure what transitions depend on, make the one that is due, and return the mode."""
        machine, inputs, time = self.modes, self._inputs, state.time
        mode, terms, feet = machine.mode, self.wbc.terms, self.feet
        steps, ground, performance = self.uncommanded_steps, feet.ground, self._performer.present
        moving = self.command.moves and not steps.active
        upright = terms.upright if ground.level else float(terms.rotation[:, 2] @ ground.normal)
        upright = (upright if performance is None else performance.upright) if terms.finite else math.nan
        inputs.request, inputs.moving, inputs.stepping = request.mode, moving, feet.stepping
        inputs.maneuver, inputs.dropped, steps.place = self._performer.wanted(request)
        speed = math.hypot(terms.px, terms.py) / self.robot.mass
        inputs.settled = inputs.maneuver and steps.arrived and speed < _REST and all(feet.settled)
        inputs.performed = performance is not None and performance.done
        inputs.reacting = inputs.reacting and feet.stepping and not moving
        inputs.lame, inputs.failure = self.faults.lame, ""
        if mode is Mode.DAMP:
            inputs.rearmed = self._rest.update(time, upright, state.v, request.mode)
            inputs.dropped &= self._fall.drops(time, float(terms.momentum[:3] @ self.robot.up) / self.robot.mass)
        elif mode is Mode.LIE:
            inputs.failure, inputs.folded = self._fall.tilted(upright), self._leg_retraction.done(time)
        else:
            solved, above = self.wbc.status is Status.CONVERGED, feet.ground.plane_at(terms.x, terms.y)
            height = terms.z if terms.finite else math.nan
            inputs.failure = self._fall.update(time, upright, float(self.target[2]) - height, solved)
            if mode.upright and not inputs.failure:
                touching = state.contacts is None or True in state.contacts.tolist()
                inputs.failure = self._fall.update_support(time, height - above, touching)
            inputs.falling = self._fall.falls(time, upright, terms.z - above, speed)
            if performance is not None:
                inputs.failure = inputs.failure or performance.failure
        if (transition := machine.update(inputs)) is not None:
            self._enter(transition, state)
        return machine.mode

    def _enter(self, transition: Transition, state: RobotState) -> None:
        """Prepare the mode that a transition leads to."""
        mode, inputs = transition.target, self._inputs
        why = f" ({inputs.failure})" if transition.name == "give up" else ""
        level = logging.WARNING if mode is Mode.DAMP else logging.INFO
        _LOG.log(level, "%s at %.3f s%s: the robot %s", transition.name, state.time, why, mode.value)
        inputs.lifted = False
        self._fall.reset()
        ended = self._performer.present is not None
        if ended:  # it stands where the feet are
            self._performer.end()
            self._begin_at_feet(state.time)
        if mode is Mode.DAMP:
            self.wbc.reset()
            self._rest.begin(inputs.request)
        elif mode is Mode.LIE:
            self._leg_retraction.begin(state.time, state.q[self.robot.joint_q], self.wbc.tau)
            self.wbc.reset()
        elif mode is Mode.RISE:
            self._begin_rising(state.time)
        elif mode is Mode.SIT:
            lying = np.array([0.0, 0.0, self._leg_retraction.crouch - self.feet.legs.height])
            if inputs.lame:  # the feet in the air are put down on the way
                self.feet.begin(state.time, self.wbc.terms.contact_points, self.feet.stance.copy())
                self._desired.rest()
            self._rise_motion.begin(state.time, np.zeros(3), lying, self.faults.sinking_s if inputs.lame else None)
        elif mode is Mode.MANEUVER:
            self._performer.begin(None if inputs.falling else self.commands.at(state.time).maneuver)
        elif transition.name == "halt":
            # It was to move, not to reach a place: it stands above its feet, wherever they came down.
            heading = self._desired.builder.yaw
            self._desired.builder.begin(self.feet.legs.above(self.wbc.terms.contact_points, heading), heading)
        if (ended or transition.name in ("risen", "turn over")) and self.planner is not None:
            self.planner.reset()
        if not mode.upright:
            self.uncommanded_steps.stop()
            self.faults.reset()
            self.wbc.external_wrench[:] = 0.0

    def _begin_rising(self, time: float) -> None:
        """Stand where the feet are, and begin the way there from the belly."""
        self.wbc.stand()
        self.wbc.contacts.target_forces[:] = self._standing_forces
        self.floor.reset()
        self._rise_motion.begin(time, self.wbc.terms.com - self._begin_at_feet(time), np.zeros(3))

    def _begin_at_feet(self, time: float) -> Array:
        """Begin to stand on the feet where they are, above which the centre of mass (3,) then belongs; return it."""
        terms = self.wbc.terms
        self.feet.begin(time, terms.contact_points, None)
        self._desired.rest()
        standing = self.feet.legs.above(terms.contact_points, terms.yaw)
        self._desired.builder.begin(standing, terms.yaw)
        return standing

    def _step(self, state: RobotState, request: MotionCommand) -> None:
        """Advance command, desired motion and feet, and write what the whole-body QP takes of them."""
        time, wbc, terms, feet, steps = state.time, self.wbc, self.wbc.terms, self.feet, self.uncommanded_steps
        lifting = self.modes.mode in (Mode.RISE, Mode.SIT)
        if lifting or request.mode != "stand" or self._inputs.maneuver:
            request = MotionCommand(gait=request.gait, mode=request.mode)  # comes to rest
        elif request.moves and feet.gait(request).stands:
            request = replace(request, vx=0.0, vy=0.0, yaw_rate=0.0)  # whatever velocity is left from another gait
        load, friction = (0.0, 0.0) if self.planner is None else self.planner.load.force, self.floor.coefficient
        request, place = steps.way_back(request)
        if place is not None:
            self._desired.builder.begin(*place)
        request = feet.within_reach(request)
        self._motion = motion = self._desired.follow(request, self._elapsed, friction, terms, feet.stepping, load)
        command = self._desired.command
        self.command = replace(command, vx=0.0, vy=0.0, yaw_rate=0.0) if steps.active else command
        (steps if steps.active else feet).follow(time, command)
        feet.update(time, terms.contact_points, terms.contact_velocities, state.contacts, motion)
        self._desired.builder.draw(self._elapsed, feet.drawn)
        feet.write_contacts(time, self._tasks.swing, steps.raising)
        wbc.contacts.friction[...] = self.floor.update(
            terms.contact_velocities, feet.settled, wbc.forces, terms.normals, feet.points.spread(feet.stance)
        )
        wbc.use_stepping_weights(feet.stepping)
        for hand in wbc.hands:
            hand.update(time, self._elapsed, terms.q)
        self._desired.place(time, feet.ground)
        if lifting:
            self._inputs.lifted = self._rise_motion.update(time)
            wbc.external_wrench[:3] = self._rise_motion.support * self._weight
            self._desired.rise(self._rise_motion, self._leg_retraction)
        self._desired.write_base(self._tasks)
        if lifting or self.planner is None:
            self._desired.write_balance(self._tasks)

    def _write_horizon(self, time: float, planner: Planner, friction: float) -> None:
        grid = planner.horizon.begun_at(time)
        self.feet.write_horizon(grid, self._motion, friction, planner.contacts)
        self._desired.write_horizon(planner.motion, grid, self.feet.ground)
        planner.motion.catching = self.uncommanded_steps.active
        self.feet.write_leg_momentum(grid, planner.motion, planner.contacts)

    def _begin(self, state: RobotState) -> None:
        """Stand where the robot is now; lie if it lies, and do nothing if it is tilted too far."""
        terms, legs, ground = self.wbc.terms, self.feet.legs, self.feet.ground
        self._begun = True
        ground.begin(terms.contact_points)
        contacts = ground.carried(_LEVEL_SHARE * legs.height)
        floor = ground.height_at(terms.x, terms.y) if contacts.all() else float(terms.contact_points[:, 2].min())
        if self._fall.tilted(terms.upright):
            self.modes.begin(Mode.DAMP)
            self._rest.begin(self.commands.at(state.time).mode)
            return
        if terms.z - floor < 0.5 * (self._leg_retraction.height + legs.height):
            self.modes.begin(Mode.LIE)
            self._leg_retraction.begin(state.time, state.q[self.robot.joint_q], self.wbc.tau)
            return
        self.modes.begin(Mode.STAND)
        self.wbc.stand()
        if state.contacts is not None:
            contacts |= state.contacts
        self._inputs.reacting = not bool(contacts.all())
        self.feet.begin(state.time, terms.contact_points, contacts)
        self._desired.builder.begin(terms.com, terms.yaw)
        if self.planner is not None:
            self.planner.reset()

    def _command(self, state: RobotState) -> Command:
        """Return the command of the whole-body QP's torques; those of the last solution, with damping, if it failed."""
        if self.wbc.status is Status.CONVERGED:
            return self._references.command(self.wbc.tau.copy(), state.q, state.v, self.wbc.acceleration)
        return Command.damping(self.wbc.tau.copy(), state.q[self.robot.joint_q], self.wbc.damping)

    def _lie(self, state: RobotState) -> Command:
        """Return the command that folds the legs under the trunk and holds them."""
        joints, rates = state.q[self.robot.joint_q], state.v[self.robot.joint_v]
        self.target[:], self.base_target[:] = self.wbc.terms.com, state.q[:7]
        self.wbc.tau[:] = self._leg_retraction.torques(state.time, joints, rates)
        return Command.feed_forward(self.wbc.tau.copy(), joints)

    def _wait(self, state: RobotState) -> Command:
        """Return the command before there is a state to stand in: no torque, joints damped."""
        if not self._waits:
            self._waits = True
            _LOG.warning("no finite state yet at %.3f s: no torque, joints damped", state.time)
        return self._damp(state)

    def _damp(self, state: RobotState) -> Command:
        damping = self.wbc.settings.fallback_damping_nms
        return Command.damping(np.zeros(self.robot.nu), state.q[self.robot.joint_q], damping)
