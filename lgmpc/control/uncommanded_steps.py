"""Uncommanded steps: against a push beyond the limits of the feet in place and back, to places of hands and motions."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lgmpc.control.feet import Feet
from lgmpc.control.modes import ModeSettings
from lgmpc.control.planner import Planner
from lgmpc.lie import attitude
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.footholds import BaseMotion, Point
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.locomotion.reaction import StepReaction, StepReactionSettings, StepSchedule, forecast_cost, least
from lgmpc.locomotion.reference import ReferenceBuilder
from lgmpc.mpc import MeasuredState
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array
from lgmpc.wbc import HandMotion, WholeBodyTerms

_LOG = logging.getLogger(__name__)
_REST = 0.05  # m/s
_RAISING = 5.0  # weight of the height of a foot that is bound to lag, in those of its way, while a push is caught
Place = tuple[float, float, float]
"""x and y of the centre of mass, world, m, and heading, rad."""


@dataclass(frozen=True)
class _Pushed:
    """Basis of a decision, the same for every schedule: a pushed robot is faster at every tick.

    Attributes:
        state: measured when the decision began.
        wrench: (N, 6) predicted then.
        motion: of the robot in the plane.
        desired: over the horizon, to catch the push.
        contacts: over the horizon, overwritten for each schedule.
        friction: to rely on.
        forces: (nf,) normal forces of the feet, N: of schedules that cost the same, the one that lifts the feet that
            carry least.
    """

    state: MeasuredState
    wrench: Array
    motion: BaseMotion
    desired: MotionReference
    contacts: ContactHorizon
    friction: float
    forces: Array


class UncommandedSteps:
    """Monitors the predicted motion of a standing robot, and starts steps against a push and back.

    The MPC's plan is the prediction; a robot on soles, which does not follow its plan while it stands, is judged by its
    measured motion. If the capture point leaves the support, the same MPC plans from the measured state with every
    schedule of steps, one update after each command, and the schedule of least cost is executed. After its first cycles
    the robot steps back to its initial position, and stands.

    Args:
        settings: see :class:`~lgmpc.locomotion.reaction.StepReactionSettings`.
        feet: whose clock is started.
        reference: of the robot; its place is the one to return to.
        mass: of the robot, kg.
        hands: of the whole-body controller.

    Attributes:
        active: whether the robot steps against a push, goes back after it, or to where its hands reach.
        deciding: whether schedules are being evaluated.
        costs: of the schedules evaluated so far; those of the last decision once it is made.
        place: where a planned motion is to begin; None for wherever the robot stands.
    """

    def __init__(
        self, settings: StepReactionSettings, feet: Feet, reference: ReferenceBuilder, mass: float,
        hands: Sequence[HandMotion] = (),
    ) -> None:  # fmt: skip
        self.settings, self.active, self.deciding = settings, False, False
        self.costs: list[float] = []
        self.place: Place | None = None
        self._feet, self._reference, self._mass, self._height = feet, reference, mass, feet.legs.height
        self._hands = hands
        self._reaction = StepReaction(settings, self._height)
        self._schedules = feet.step_schedules() if settings.enabled else ()
        self._home, self._captured, self._displaced_since = (0.0, 0.0, 0.0), math.inf, math.inf
        self._pushed: _Pushed | None = None
        self._updates = 0  # of the next schedule's forecast so far
        self._guess: Any = None  # of its next one
        self._guesses: list[Any] = []  # of the schedules evaluated

    @property
    def arrived(self) -> bool:
        """Whether the robot is to stand where it does, and steps to no place."""
        return not self.active and (self.place is None or self._near(self.place))

    @property
    def raising(self) -> float:
        """Factor of the weights of heights of feet that cannot be at their targets in time."""
        return _RAISING if self.active else 1.0

    def stop(self) -> None:
        """Discard the steps: another mode moves the feet."""
        self.active = self.deciding = False

    def way_back(self, request: MotionCommand) -> tuple[MotionCommand, tuple[Point, float] | None]:
        """Return the request, or the motion back to where the robot stood; and this place, m, rad, once it is there."""
        if request.moves:
            self.stop()
        self.active = self.active and self._feet.stepping
        if not self.active:
            return request, None
        s, at, (x, y, _) = self.settings, self._reference, self._home
        dx, dy, turn = self._way(self._home)
        if self._near(self._home):
            return replace(request, gait=s.gait), ((x, y), at.yaw + turn)  # of the velocity that is left
        rate = min(s.return_rate_hz, s.return_speed_m_s / max(math.hypot(dx, dy), abs(turn) * self._height))
        ahead, left = attitude.turn(-at.yaw, dx, dy)
        return replace(request, vx=rate * ahead, vy=rate * left, yaw_rate=rate * turn, gait=s.gait), None

    def follow(self, time: float, command: MotionCommand) -> None:
        """Follow the command with the feet, from the end of the first cycles on."""
        if not self.active or time >= self._captured:
            self._feet.follow(time, command)

    def watch(
        self, time: float, planner: Planner, terms: WholeBodyTerms, motion: BaseMotion, friction: float, forces: Array
    ) -> None:
        """Begin to decide if the plan just made shows that the feet in place cannot hold the robot.

        Args:
            time: s.
            planner: which planned.
            terms: sensed quantities.
            motion: of the robot in the plane.
            friction: to rely on.
            forces: (nc, 3) on the contact points, world axes, N.
        """
        plan = planner.plan
        if not self._schedules or self.deciding or plan is None or not (self._feet.standing and plan.status.usable):
            return
        com, velocity = plan.xs[-1, :3], plan.xs[-1, 3:6] / self._mass
        if not self._feet.points.single:
            com, velocity = terms.com, np.array([motion.vx, motion.vy, 0.0])
        if self._reaction.needed(com, velocity, terms.contact_points):
            self.deciding, self._updates, self._guess = True, 0, None
            self.costs, self._guesses = [], []
            state = planner.state(time, terms).copy()
            desired, (intervals, feet) = planner.motion.copy(), planner.contacts.flags.shape
            desired.catching = True
            contacts = ContactHorizon.allocate(intervals, feet)
            loads = self._feet.points.total(np.sum(forces * terms.normals, axis=1))
            self._pushed = _Pushed(state, planner.wrench, motion, desired, contacts, friction, loads)

    def evaluate(self, planner: Planner) -> bool:
        """Update the forecast of the next schedule, if a decision is under way; return whether one is."""
        pushed = self._pushed
        if not self.deciding or pushed is None or len(self.costs) == len(self._schedules):
            return False
        schedule = self._schedules[len(self.costs)]
        if self._updates == 0:
            self._write_horizon(schedule, pushed, planner.horizon)
        given = pushed.state, pushed.contacts, pushed.desired, pushed.wrench
        mpc, kept = planner.mpc, planner.mpc.state()
        if self._guess is not None:
            mpc.set_state(self._guess)
        plan = mpc.update(*given)
        self._guess = mpc.state()
        mpc.set_state(kept)
        self._updates += 1
        if self._updates == 2:  # the first one leads from the last schedule's solution to near this one's
            self._updates, fresh = 0, plan.status.usable
            self._guesses.append(self._guess)
            self.costs.append(forecast_cost(plan.xs, pushed.desired.com, self._mass) if fresh else math.inf)
        return True

    def decide(self, time: float, planner: Planner) -> bool:
        """Return whether steps begin at ``time``, s: those of least cost, once all schedules are evaluated."""
        pushed = self._pushed
        if not self.deciding or pushed is None or len(self.costs) < len(self._schedules):
            return False
        self.deciding = False
        chosen = least(self.costs, [each.load(pushed.forces) for each in self._schedules])
        best = self._schedules[chosen]
        planner.mpc.set_state(self._guesses[chosen])  # which the next plan is near
        _LOG.info("steps against a push at %.3f s: %s", time, best)
        if not self.active:
            self._home = self._reference.x, self._reference.y, self._reference.yaw
        self._captured = time + self.settings.cycles * best.gait.period_s
        self._feet.start(time, best)
        self.active = True
        return True

    def return_feet(self, time: float, motion: BaseMotion, moves: bool, settings: ModeSettings) -> bool:
        """Step to a place, or in place if a foot of a robot at rest has long been far from where it belongs.

        Args:
            time: s.
            motion: of the robot in the plane.
            moves: whether a velocity is commanded.
            settings: how far and how long.

        Returns:
            Whether it begins to step.
        """
        reference, feet = self._reference, self._feet
        if self.place is not None or (self._hands and not moves and feet.standing):
            if self._approach(time):
                return True
        displaced = (
            feet.standing
            and not moves
            and math.hypot(motion.vx, motion.vy) < _REST
            and feet.displacement(reference.x, reference.y, reference.yaw) > settings.displaced_m
        )
        self._displaced_since = min(self._displaced_since, time) if displaced else math.inf
        if time - self._displaced_since < settings.displaced_s:
            return False
        self._displaced_since = math.inf
        return feet.step_in_place(time)

    def _approach(self, time: float) -> bool:
        """Begin to go to a place, or to where the hands reach the ends of their motions, unless the robot is there."""
        at, x, y = self._reference, self._reference.x, self._reference.y
        for hand in self._hands:
            x, y = hand.reached_from(x, y)
        place = (x, y, at.yaw) if self.place is None else self.place
        stays = self.active or self.deciding or self._near(place)
        if stays or not (self._feet.stepping or self._feet.step_in_place(time)):
            return False
        self._home, self._captured, self.active = place, time, True
        return True

    def _way(self, place: Place) -> Place:
        """Return the way to a place: x and y, world, m, and the turn, rad."""
        (x, y, yaw), at = place, self._reference
        return x - at.x, y - at.y, math.remainder(yaw - at.yaw, 2.0 * math.pi)

    def _near(self, place: Place) -> bool:
        """Return whether a place is where the robot should be now."""
        dx, dy, turn = self._way(place)
        most = self.settings.place_tolerance_m
        return math.hypot(dx, dy) < most and abs(turn) < most / self._height

    def _write_horizon(self, schedule: StepSchedule, pushed: _Pushed, horizon: TimeGrid) -> None:
        """Write the contacts that a schedule would lead to."""
        time, clock = pushed.state.time, self._feet.clock.copy()
        clock.start(time, schedule.gait, first=schedule.first)
        self._feet.write_horizon(horizon.begun_at(time), pushed.motion, pushed.friction, pushed.contacts, clock)
