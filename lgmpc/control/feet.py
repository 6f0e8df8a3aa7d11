"""What the feet do at every tick: contacts, footholds and swings, and the contacts ahead of them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.contacts import ContactEvents, ContactState
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.gait import Gait, find_gait
from lgmpc.locomotion.horizon import ContactHorizon
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.settings import LocomotionSettings
from lgmpc.locomotion.swing import SwingTrajectory
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

__all__ = ["Feet"]

_SETTLED_S = 0.03
"""s after its touchdown from which a foot's sliding is evidence about the floor."""


class Feet:
    """Steps of all feet: gait clock, contact events, footholds and swing trajectories as one.

    Args:
        robot: the controller's model.
        settings: of locomotion.
        gaits: by name, as commands choose them.

    Attributes:
        legs: geometry of the legs.
        clock: the schedule.
        events: measured contacts compared with the schedule.
        stance: (nc,) which feet carry at this tick.
        position: (nc, 3) targets of the feet in the air, world, m.
        velocity: (nc, 3) m/s.
        acceleration: (nc, 3) m/s2.
        footholds: (nc, 3) where each foot stands or will touch down next, world, m.
        stepping: whether a foot swings or is to lift off; one that lost its contact does not step.
        standing: whether all feet are on the ground, and none is to lift off.
    """

    def __init__(self, robot: Robot, settings: LocomotionSettings, gaits: Mapping[str, Gait]) -> None:
        self.legs = LegGeometry.of(robot)
        self._settings, self._gaits = settings, gaits
        self._weight = -robot.mass * float(robot.gravity[2])
        self._planner = FootholdPlanner(self.legs, settings.footholds)
        self._swings = [SwingTrajectory(settings.swing) for _ in range(robot.nc)]
        self.position, self.velocity, self.acceleration = np.zeros((3, robot.nc, 3))
        self.footholds = np.zeros((robot.nc, 3))
        self._stood = np.ones(robot.nc, dtype=np.bool_)
        self.begin(0.0, np.zeros((robot.nc, 3)), None)

    def begin(self, time: float, points: Array, contacts: BoolArray | None) -> None:
        """Begin to stand at ``points`` (nc, 3); feet without contact are put down first."""
        self.clock = GaitClock(find_gait(self._gaits, "stand"), time, self._settings.clock, contacts)
        self.events = ContactEvents(self.clock, self._weight, self._settings.contacts)
        self.stance = self.events.stance
        self._stood[:] = True
        self.standing, self.stepping = True, False
        self.footholds[:] = points
        self.position[:] = points

    @property
    def settled(self) -> list[bool]:
        """(nc,) feet that have carried for long enough for their sliding to be evidence about the floor."""
        before = self.clock.time - _SETTLED_S
        return [
            stands and since < before for stands, since in zip(self.stance.tolist(), self.events.since, strict=True)
        ]

    def follow(self, time: float, command: MotionCommand) -> None:
        """Follow the gait of a command; without velocity, stand."""
        # A robot without gaits stands, whatever gait the command names by default.
        name = command.gait if command.moves or command.gait in self._gaits else "stand"
        self.clock.follow(time, find_gait(self._gaits, name), command.moves)

    def react(self, time: float, forces: Array) -> None:
        """Start to step against a push, the feet first that carry least.

        Args:
            time: s.
            forces: (nc,) normal forces of the feet, N.
        """
        settings = self._settings.reaction
        gait = self._gaits[settings.gait]
        # Feet that lift off together have the same offset.
        loads = {offset: 0.0 for offset in gait.offsets}
        for offset, force in zip(gait.offsets, forces.tolist(), strict=True):
            loads[offset] += force
        lightest = min(loads, key=loads.__getitem__)
        self.clock.start(time, gait, first=gait.offsets.index(lightest), cycles=settings.cycles)
        self.standing, self.stepping = False, True

    def update(
        self, time: float, points: Array, velocities: Array, contacts: BoolArray | None, motion: BaseMotion
    ) -> None:
        """Advance to ``time``: decide which feet carry, and where the others go.

        Args:
            time: s.
            points: (nc, 3) measured contact points, world, m.
            velocities: (nc, 3) of the feet, m/s.
            contacts: (nc,) measured contacts; None where nothing is measured.
            motion: of the robot in the plane.
        """
        stance = self.events.update(time, contacts)
        for foot, (carries, carried) in enumerate(zip(stance.tolist(), self._stood.tolist(), strict=True)):
            if carries:
                self.footholds[foot] = points[foot]
                self.position[foot] = points[foot]
                self.velocity[foot] = self.acceleration[foot] = 0.0
                continue
            if carried:
                self._lift(foot, time, points[foot], velocities[foot], motion)
            self._move(foot, time, motion)
        self._stood[:] = stance
        clock, feet = self.clock, range(len(stance))
        self.stepping = any(clock.swing(foot, time) or math.isfinite(clock.next_liftoff(foot, time)) for foot in feet)
        self.standing = not self.stepping and bool(stance.all())

    def _lift(self, foot: int, time: float, point: Array, velocity: Array, motion: BaseMotion) -> None:
        swing = self.clock.swing(foot, time)
        if swing is None or self.events.states[foot] is ContactState.LOST:
            self._swings[foot].search(time, point)
            return
        self._aim(foot, time, swing.touchdown, motion)
        self._swings[foot].lift_off(time, swing.touchdown, point, velocity, self.footholds[foot])

    def _move(self, foot: int, time: float, motion: BaseMotion) -> None:
        path = self._swings[foot]
        if not self.events.searching(foot):
            self._aim(foot, time, path.touchdown, motion)
            path.retarget(time, self.footholds[foot])
        path.sample(time, self.position[foot], self.velocity[foot], self.acceleration[foot])
        self.footholds[foot] = path.target

    def _aim(self, foot: int, time: float, touchdown: float, motion: BaseMotion) -> None:
        """Write the foothold of the present swing."""
        stance = self.clock.stance_duration(foot, time)
        others = [
            (float(self.footholds[other, 0]), float(self.footholds[other, 1]))
            for other in range(len(self.footholds))
            if other != foot
        ]
        self.footholds[foot, :2] = self._planner.place(foot, motion, max(touchdown - time, 0.0), stance, others)
        self.footholds[foot, 2] = 0.0

    def loading(self, time: float, shares: Array) -> None:
        """Write (nc,) the share of its largest force that each foot may carry now."""
        for foot in range(len(shares)):
            shares[foot] = self.events.loading(foot, time)

    def write_horizon(
        self, time: float, dt: float, motion: BaseMotion, friction: float, horizon: ContactHorizon
    ) -> None:
        """Write flags, contact points and friction of the intervals that begin at ``time``, each ``dt``, s."""
        self.clock.horizon(time, dt, horizon.flags)
        self.events.correct(horizon.flags, dt)
        self._planner.horizon(self.clock, motion, time, dt, self.footholds, horizon.points)
        horizon.friction[:] = friction
