"""Performance of planned motions by the controller that stands and walks.

A manoeuvre is the solution of an optimal control problem. Its motion is the reference of the MPC and of the whole-body
QP, its contacts are their schedule; its torques and the solver's gains are not used: those of the plan's model do not
stop what the plan's model does not have. Two things follow the robot:

- the clock. The robot takes off as soon as it rises as high as planned from there. In the air the clock runs to the
  touchdown that the centre of mass falls to; a foot that touches the ground in the second half of a flight ends it, and
  a flight that the plan has ended goes on until a foot touches the ground, or the manoeuvre has failed;
- the place. It begins where the feet stand, along the robot's heading, and goes on from where they land. A fall is not
  the plan's own: while it turns in the air, a plan that begins there follows the robot.

In the air the whole-body QP holds the planned joint motion, stiffly: momenta cannot be changed there.
"""

import logging
import math
from collections.abc import Sequence
from time import perf_counter

import numpy as np

from lgmpc.control.feet import Feet
from lgmpc.control.maneuver import Maneuver
from lgmpc.control.planner import Planner
from lgmpc.control.reference import MotionTasks
from lgmpc.control.uncommanded_steps import Place
from lgmpc.lie import attitude
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.robot import Robot
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array, BoolArray
from lgmpc.wbc import WholeBodyController

_LOG = logging.getLogger(__name__)

_SETTLING = 0.08  # s after a touchdown in which feet carry only once they touch the ground
_LOOK_AHEAD = 3  # ticks within which no joint may exceed its limits
_SURE = 2  # ticks of contact that end a flight
_FASTEST, _SLOWEST = 1.25, 0.8  # speed of the clock in the air

_FAR_RAD, _FAR_DEG = 0.5, 30.0
"""Distance of a joint and of the base's attitude from the beginning of a plan that is then not performed."""

_WEIGHTS = {"base_orientation": 10.0 / 3.0, "angular_momentum": 10.0}
"""Weights on the ground, in units of those while feet swing."""

_GAINS = {"stance": 400.0, "flight": 2500.0}
"""1/s2; stiffness of the joints, critically damped; that of the centre of mass is as on the ground."""

_POSTURE_WEIGHT = {"stance": 1.0, "flight": 10.0}
"""Weights of the joints' accelerations: in the air they are all that can be controlled."""


class Performance:
    """A manoeuvre that is performed: its clock, its place, and the targets of each tick.

    Args:
        maneuver: the manoeuvre, in its own place.
        wbc: the whole-body controller, sensed at the present tick.
        tasks: its tasks.
        robot: the controller's model.

    Attributes:
        plan: the manoeuvre where it is performed.
        done: whether it is over.
        failure: reason why it cannot go on; empty if it can.
        stance: (nc,) which feet carry at this tick.
        landed: whether the last tick began a stance.
    """

    def __init__(self, maneuver: Maneuver, wbc: WholeBodyController, tasks: MotionTasks, robot: Robot) -> None:
        self.plan = maneuver.placed(wbc.terms.contact_points, wbc.terms.rotation, robot.up)
        self.done, self.landed, self.failure = False, False, ""
        self.stance = self.plan.stance[0].copy()
        self._wbc, self._tasks, self._robot = wbc, tasks, robot
        self._up, self._gravity = robot.up, float(np.linalg.norm(robot.gravity))
        self._heights = self.plan.com @ robot.up
        self._flights = self.plan.flights
        self._row, self._waited, self._since_landing = -1, 0, len(self.plan.q)
        self._rate, self._part = 1.0, 0.0  # of the clock in the air, and of the present tick
        self._shift = np.zeros(3)
        self._touching = np.zeros(len(self.stance), dtype=np.int_)
        self._flies = False
        changed = (tasks.com, tasks.base_orientation, tasks.angular_momentum, tasks.posture, tasks.swing)
        self._horizon = wbc.qp.joint_horizon.copy()
        # The plan keeps within the joints' limits: looking further ahead would brake the legs as they take off.
        wbc.qp.joint_horizon[0] = min(self._horizon[0], _LOOK_AHEAD * self.plan.period)
        self._before = [(task, task.weight.copy(), task.kp.copy(), task.kd.copy()) for task in changed]
        self._set_weights(flies=False)

    def check_beginning(self) -> None:
        """Fail where the plan begins far from the robot's posture or attitude; a landing begins anywhere."""
        terms = self._wbc.terms
        off = np.abs(terms.q - self.plan.q[0])[self._robot.joint_q].max()
        turned = attitude.angle_between(terms.rotation, self.plan.rotation[0])
        if off > _FAR_RAD or turned > math.radians(_FAR_DEG):
            self.failure = f"'{self.plan.name}' begins in another posture or attitude"

    @property
    def upright(self) -> float:
        """Cosine of the angle between the base's vertical axis and the planned one of this tick."""
        return float(self._wbc.terms.rotation[:, 2] @ self.plan.rotation[self._row, :, 2])

    @property
    def com(self) -> Array:
        """(3,) planned centre of mass of this tick, where the robot is, m."""
        return self.plan.com[self._row] + self._shift

    @property
    def base(self) -> Array:
        """(7,) planned base pose of this tick [position, quaternion x y z w]."""
        pose = self.plan.q[self._row, :7].copy()
        pose[:3] += self._shift
        return pose

    def advance(self, contacts: BoolArray | None) -> None:
        """Advance by one tick, and write the base's targets; ``contacts`` (nc,) are measured, None if they are not."""
        self.landed, self._rate = False, 1.0
        planned = (each for each in self._flights if each[0] <= self._row + 1 < each[1])
        flight = next(planned, None) or self._early_flight()
        if flight is None:
            self._row += 1
        else:
            self._fly(*flight, contacts)
        if self._row >= len(self.plan.q):
            self._row, self.done = len(self.plan.q) - 1, True
        self._since_landing += 1
        self.stance[:] = self.plan.stance[self._row]
        if self._since_landing * self.plan.period < _SETTLING and contacts is not None and contacts.any():
            self.stance &= contacts
        flies, row = not self.stance.any(), self._row
        if flies is not self._flies:
            self._flies = flies
            self._set_weights(flies)
        self._wbc.contacts.stance[:], base = self.stance, self._tasks.base_orientation.target
        base.rotation[:], base.angular_velocity[:] = self.plan.rotation[row], self.plan.v[row, 3:6]

    def end(self) -> None:
        """Return weights and gains to what they were before."""
        self._wbc.qp.joint_horizon[:] = self._horizon
        for task, weight, kp, kd in self._before:
            task.weight[:], task.kp[:], task.kd[:] = weight, kp, kd

    def write_horizon(self, grid: TimeGrid, friction: float, motion: MotionReference, contacts: ContactHorizon) -> None:
        """Write the planned motion and contacts over the MPC's horizon, which begins at this tick."""
        plan, rows, last = self.plan, TimeGrid(self.plan.period), len(self.plan.q) - 1
        nodes = np.minimum([self._row + rows.nearest(each) for each in grid.elapsed.tolist()], last)
        middles = np.minimum(nodes[:-1] + rows.nearest(0.5 * grid.period), last)
        motion.com[:] = plan.com[nodes] + self._shift
        motion.com_velocity[:] = plan.momentum[nodes, :3] / self._robot.mass
        motion.q[:] = plan.q[nodes]
        motion.q[:, :3] += self._shift
        motion.angular_velocity[:] = (plan.rotation[nodes] @ plan.v[nodes, 3:6, None])[..., 0]
        motion.catching = False
        contacts.flags[:] = plan.stance[middles]
        contacts.flags[0] = self.stance
        contacts.points[:] = plan.points[middles] + self._shift
        stays = np.logical_and.accumulate(contacts.flags, axis=0) & self.stance
        contacts.points[stays] = np.broadcast_to(self._wbc.terms.contact_points, contacts.points.shape)[stays]
        contacts.normals[:] = self._wbc.terms.normals
        contacts.friction[:] = friction

    def _fly(self, begin: int, end: int, contacts: BoolArray | None) -> None:
        """Advance in a flight: to its end if a foot touches early, no further than its end until one does."""
        if begin == 0:
            self._follow_feet()
        else:
            self._rate = self._flight_rate(end)
        self._part += self._rate
        self._row = min(max(self._row + int(self._part), begin), end - 1)
        self._part %= 1.0
        if contacts is None:
            return
        self._touching = np.where(contacts, self._touching + 1, 0)
        if self._row >= 0.5 * (begin + end) and self._touching.max() >= _SURE:
            self._row = end
            self._land()
        elif self._row == end - 1:
            self._waited += 1
            self._row, self._rate = self._row - 1, 0.0
            self._follow_feet()
            if self._waited * self.plan.period > self.plan.longest_wait_s:
                self.failure = f"no ground {self.plan.longest_wait_s:g} s after the planned touchdown"

    def _early_flight(self) -> tuple[int, int] | None:
        """Return the next flight if the robot, thrown from here, rises as high as in it."""
        terms, flight = self._wbc.terms, next((each for each in self._flights if each[0] > self._row), None)
        climb = float(terms.momentum[:3] @ self._up) / self._robot.mass
        if flight is None or climb <= 0.0:
            return None
        # Half of what the tick to come would add is lost, half too much.
        climb += 0.5 * self.plan.period * float(self.plan.momentum_rate[self._row, :3] @ self._up) / self._robot.mass
        apex = float(self._heights[slice(*flight)].max() + self._shift @ self._up)
        return flight if float(terms.com @ self._up) + 0.5 * climb**2 / self._gravity >= apex else None

    def _flight_rate(self, end: int) -> float:
        """Return the speed of the clock with which the centre of mass is at the end of a flight when it is."""
        terms, period = self._wbc.terms, self.plan.period
        climb = float(terms.momentum[:3] @ self._up) / self._robot.mass
        above = max(float((terms.com - self._shift) @ self._up - self._heights[end - 1]), 0.0)
        left = (climb + math.sqrt(climb**2 + 2.0 * self._gravity * above)) / self._gravity
        return min(max((end - self._row) * period / max(left, period), _SLOWEST), _FASTEST)

    def _follow_feet(self) -> None:
        """Move the plan to where the feet are."""
        middle = self._wbc.terms.contact_points.mean(axis=0)
        self._shift = middle - self.plan.points[self._row].mean(axis=0)

    def _land(self) -> None:
        """Go on from where the feet are."""
        self._follow_feet()
        self._touching[:], self._waited, self._since_landing, self.landed = 0, 0, 0, True

    def _set_weights(self, flies: bool) -> None:
        phase, tasks = "flight" if flies else "stance", self._tasks
        stepping, share = self._wbc.settings.scaled(self._robot).stepping_weights, 0.0 if flies else 1.0
        tasks.com.weight[:] = share * np.asarray(stepping.com)
        tasks.base_orientation.weight[:] = share * _WEIGHTS["base_orientation"] * stepping.base_orientation
        tasks.angular_momentum.weight[:] = share * _WEIGHTS["angular_momentum"] * stepping.angular_momentum
        tasks.posture.weight[:], tasks.swing.weight[:] = _POSTURE_WEIGHT[phase], 0.0
        for task, stiffness in ((tasks.posture, _GAINS[phase]), (tasks.com, _GAINS["stance"])):
            task.kp[:], task.kd[:] = stiffness, 2.0 * math.sqrt(stiffness)

    def joints(self) -> Array:
        """Return (3 nu,) planned positions, velocities and accelerations of the joints."""
        plan, row, of, rate = self.plan, self._row, self._robot.joint_v, self._rate
        joints = plan.q[row, self._robot.joint_q], rate * plan.v[row, of], rate**2 * plan.acceleration[row, of]
        return np.concatenate(joints)

    def write_balance(self) -> None:
        """Write the targets of forces, balance and joints: without a plan of the MPC to follow."""
        plan, row, tasks, mass = self.plan, self._row, self._tasks, self._robot.mass
        self._wbc.contacts.target_forces[:] = plan.forces[row] * self.stance[:, None]
        com, momentum = tasks.com.target, tasks.angular_momentum.target
        com.position[:] = plan.com[row] + self._shift
        com.velocity[:], com.acceleration[:] = plan.momentum[row, :3] / mass, plan.momentum_rate[row, :3] / mass
        momentum.momentum[:], momentum.rate[:] = plan.momentum[row, 3:], plan.momentum_rate[row, 3:]
        tasks.posture.targets_together[...] = self.joints()


class Performer:
    """Begins, advances and ends the manoeuvres that commands name.

    Args:
        robot: the controller's model.
        maneuvers: planned motions that commands may name.
        wbc: the whole-body controller.
        tasks: its tasks.
        feet: which carry.
        period: between two ticks, s.

    Attributes:
        present: the manoeuvre that is performed; None if there is none.
    """

    def __init__(
        self, robot: Robot, maneuvers: Sequence[Maneuver], wbc: WholeBodyController, tasks: MotionTasks, feet: Feet,
        period: float,
    ) -> None:  # fmt: skip
        self.present: Performance | None = None
        self._known = {each.name: each for each in maneuvers}
        self._landing = Maneuver.landing(robot, period)
        self._begun: tuple[str, float] | None = None  # as commanded
        self._robot, self._wbc, self._tasks, self._feet = robot, wbc, tasks, feet

    def reset(self) -> None:
        """End what is performed; every command may begin a manoeuvre again."""
        self.end()
        self._begun = None

    def wanted(self, request: MotionCommand) -> tuple[bool, bool, Place | None]:
        """Return whether a command names a manoeuvre that it has not begun yet, from the ground or in the air.

        And the place where it begins; None for wherever the robot is.
        """
        if request.maneuver is None or request.maneuver == self._begun:
            return False, False, None
        plan = self._known.get(request.maneuver[0])
        if plan is None or request.mode != "stand":
            why = "there is none of this name" if plan is None else f"there is none in mode {request.mode}"
            _LOG.warning("manoeuvre '%s': %s; the command is ignored", request.maneuver[0], why)
            self._begun = request.maneuver
            return False, False, None
        place, in_the_air = None, plan.begins_in_the_air
        if plan.anchored and not in_the_air:
            yaw = math.atan2(plan.rotation[0, 1, 0], plan.rotation[0, 0, 0])
            place = (*self._feet.legs.above(plan.points[0], yaw).tolist()[:2], yaw)
        return not in_the_air, in_the_air, place

    def begin(self, maneuver: tuple[str, float] | None) -> None:
        """Begin the manoeuvre of a command, name and time, from the sensed state; None lands a robot that falls."""
        chosen = self._landing
        if maneuver is not None:
            chosen, self._begun = self._known[maneuver[0]], maneuver
            if chosen.begins_in_the_air:
                self._wbc.stand()
        self.present = Performance(chosen, self._wbc, self._tasks, self._robot)
        if maneuver is not None:
            self.present.check_beginning()

    def end(self) -> None:
        """Return weights and gains to what they were before."""
        if self.present is not None:
            self.present.end()
        self.present = None

    def advance(self, time: float, contacts: BoolArray | None, planner: Planner | None) -> float:
        """Advance by one tick, and write the targets; return the time that planning took, s, 0 without."""
        present, feet, wbc, started = self.present, self._feet, self._wbc, perf_counter()
        assert present is not None
        if wbc.terms.finite:
            present.advance(contacts)
        feet.stance[:] = present.stance
        feet.footholds[:] = feet.position[:] = wbc.terms.contact_points
        planned = followed = False
        if planner is not None:
            planned = planner.due(time) or present.landed
            if planned:
                friction = min(planner.mpc.settings.friction, float(wbc.contacts.friction[0]))
                present.write_horizon(planner.horizon, friction, planner.motion, planner.contacts)
                planner.plan_from(time, wbc.terms)
            followed = bool(feet.stance.any()) and planner.follow(time, self._tasks, wbc.contacts, present.joints())
        if not followed:
            present.write_balance()
        return perf_counter() - started if planned else 0.0
