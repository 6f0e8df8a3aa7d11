"""Gaits as sequences of phases with feet in the air, and node grids aligned with their switches.

The usual gaits of quadrupeds have names (:meth:`GaitSequence.walk`, :meth:`GaitSequence.trot`, ...), any other is a
list of :class:`GaitPhase`; sequences are joined by ``+`` and repeated by ``*``:

    still = GaitSequence.stand(feet, 0.2)
    still + 2 * GaitSequence.trot(feet, legs, swing=0.25, stance=0.05, height=0.06) + still
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.settings import NonNegative, Positive, Settings, key
from lgmpc.typing import Array, BoolArray

MOST_INTERVALS = 10_000
"""Intervals of the finest grid."""


@dataclass(frozen=True)
class QuadrupedFeet:
    """Assignment of contact frames to the feet of a quadruped.

    Attributes:
        front_left: name of its contact frame.
        front_right: name of its contact frame.
        hind_left: name of its contact frame.
        hind_right: name of its contact frame.
    """

    front_left: str
    front_right: str
    hind_left: str
    hind_right: str

    @classmethod
    def of(cls, robot: Robot) -> QuadrupedFeet:
        """Assign a robot's feet by their positions about their mean in the reference posture (x ahead, y left).

        Raises:
            InputError: not four contact frames, or not one in each quadrant.
        """
        model, data = robot.model, robot.create_data()
        pin.framesForwardKinematics(model, data, robot.q_reference)
        base = pin.XYZQUATToSE3(robot.q_reference[:7]) if robot.floating_base else pin.SE3.Identity()
        points = np.array([base.actInv(data.oMf[i].translation) for i in robot.contact_ids]).reshape(-1, 3)
        places = [(bool(x > 0), bool(y > 0)) for x, y, _ in points - points.mean(axis=0)] if robot.nc else []
        quadrants = [(True, True), (True, False), (False, True), (False, False)]
        if sorted(places) != sorted(quadrants):
            expected = "four feet: front left, front right, hind left, hind right"
            raise InputError("robot.contact_frames", ", ".join(robot.contact_frames) or "none", expected)
        return cls(*(robot.contact_frames[places.index(quadrant)] for quadrant in quadrants))


class GaitPhase(Settings):
    """An interval of time with the same feet in the air."""

    duration_s: Positive = Field(description="Duration, s.")
    air: tuple[str, ...] = key((), "Contact frames in the air; none: all are on the ground.")
    height_m: NonNegative = key(0.0, "Apex of their swings above the straight line, m.")


@dataclass(frozen=True)
class FootSwing:
    """A swing of one foot.

    Attributes:
        foot: contact frame of the foot.
        liftoff: time of lift-off, s; -inf if the gait begins with the foot in the air.
        touchdown: time of touchdown, s; inf if the gait ends before.
        height: height of the apex above the straight line, m.
    """

    foot: str
    liftoff: float
    touchdown: float
    height: float


@dataclass(frozen=True)
class GaitSequence:
    """A sequence of phases from time 0, for motions that are planned as a whole.

    Attributes:
        feet: (nc,) all contact frames, in the order of the flags' columns.
        phases: in order of time.

    Raises:
        InputError: no phases, or a frame in the air that is not a contact frame (the nearest are named).
    """

    feet: tuple[str, ...]
    phases: tuple[GaitPhase, ...]

    def __post_init__(self) -> None:
        if not self.phases:
            raise InputError("phases", "none", "at least one phase")
        for i, phase in enumerate(self.phases):
            for name in sorted(set(phase.air) - set(self.feet)):
                raise InputError(f"phases.{i}.air", name, "one of the contact frames", self.feet)

    @classmethod
    def stand(cls, feet: Sequence[str], duration: float) -> GaitSequence:
        """Return a phase with all feet on the ground for ``duration``, s."""
        return cls(tuple(feet), (GaitPhase(duration_s=duration),))

    @classmethod
    def alternate(
        cls, feet: Sequence[str], groups: Iterable[Iterable[str]], swing: float, stance: float, height: float
    ) -> GaitSequence:
        """Return one cycle in which groups of feet swing in turn.

        Args:
            feet: all contact frames.
            groups: groups of feet that swing together, in order.
            swing: duration of each swing, s.
            stance: time with all feet on the ground after each swing, s; may be 0.
            height: height of the swings, m.
        """
        pause = (GaitPhase(duration_s=stance),) if stance != 0 else ()
        phases = [
            phase for group in groups for phase in (GaitPhase(duration_s=swing, air=group, height_m=height), *pause)
        ]
        return cls(tuple(feet), tuple(phases))

    @classmethod
    def walk(cls, feet: Sequence[str], legs: QuadrupedFeet, swing: float, stance: float, height: float) -> GaitSequence:
        """Return one cycle of the lateral-sequence walk: hind left, front left, hind right, front right, one at a time.

        Source: Hildebrand, "Symmetrical gaits of horses", Science 150, 1965. Arguments as in :meth:`alternate`.
        """
        order = (legs.hind_left, legs.front_left, legs.hind_right, legs.front_right)
        return cls.alternate(feet, ([foot] for foot in order), swing, stance, height)

    @classmethod
    def trot(cls, feet: Sequence[str], legs: QuadrupedFeet, swing: float, stance: float, height: float) -> GaitSequence:
        """Return one cycle of the trot: the diagonal pairs in turn. Arguments as in :meth:`alternate`."""
        pairs = (legs.front_left, legs.hind_right), (legs.front_right, legs.hind_left)
        return cls.alternate(feet, pairs, swing, stance, height)

    @classmethod
    def pace(cls, feet: Sequence[str], legs: QuadrupedFeet, swing: float, stance: float, height: float) -> GaitSequence:
        """Return one cycle of the pace: left and right pair in turn. Arguments as in :meth:`alternate`."""
        pairs = (legs.front_left, legs.hind_left), (legs.front_right, legs.hind_right)
        return cls.alternate(feet, pairs, swing, stance, height)

    @classmethod
    def bound(
        cls, feet: Sequence[str], legs: QuadrupedFeet, swing: float, stance: float, height: float
    ) -> GaitSequence:
        """Return one cycle of the bound: front and hind pair in turn. Arguments as in :meth:`alternate`."""
        pairs = (legs.front_left, legs.front_right), (legs.hind_left, legs.hind_right)
        return cls.alternate(feet, pairs, swing, stance, height)

    @classmethod
    def jump(cls, feet: Sequence[str], takeoff: float, flight: float, landing: float, height: float) -> GaitSequence:
        """Return a jump: stance of all feet for ``takeoff``, flight (apex ``height``, m), stance for ``landing``, s."""
        return cls(
            tuple(feet),
            (
                GaitPhase(duration_s=takeoff),
                GaitPhase(duration_s=flight, air=feet, height_m=height),
                GaitPhase(duration_s=landing),
            ),
        )

    def __add__(self, other: GaitSequence) -> GaitSequence:
        """Return this gait followed by another one.

        Raises:
            InputError: other feet.
        """
        if other.feet != self.feet:
            raise InputError("feet", ", ".join(other.feet), f"the same feet ({', '.join(self.feet)})")
        return GaitSequence(self.feet, self.phases + other.phases)

    def __mul__(self, cycles: int) -> GaitSequence:
        """Return this gait repeated ``cycles`` times.

        Raises:
            InputError: less than once.
        """
        if cycles < 1:
            raise InputError("cycles", cycles, "at least 1")
        return GaitSequence(self.feet, self.phases * cycles)

    __rmul__ = __mul__

    @cached_property
    def switches(self) -> Array:
        """(phases + 1,) start times of the phases, and end time of the last one, s."""
        return np.concatenate([[0.0], np.cumsum([phase.duration_s for phase in self.phases])])

    @property
    def duration(self) -> float:
        """Duration of all phases, s."""
        return float(self.switches[-1])

    def swings(self, foot: str) -> tuple[FootSwing, ...]:
        """Return the swings of a foot in order of time; one that spans several phases is as high as the highest.

        Raises:
            InputError: no such foot.
        """
        if foot not in self.feet:
            raise InputError("foot", foot, "one of the contact frames", self.feet)
        found: list[FootSwing] = []
        for i, phase in enumerate(self.phases):
            if foot not in phase.air:
                continue
            liftoff = -math.inf if i == 0 else float(self.switches[i])
            touchdown = math.inf if i == len(self.phases) - 1 else float(self.switches[i + 1])
            height = phase.height_m
            if i > 0 and foot in self.phases[i - 1].air:
                before = found.pop()
                liftoff, height = before.liftoff, max(height, before.height)
            found.append(FootSwing(foot, liftoff, touchdown, height))
        return tuple(found)

    def grid(self, step: float) -> GaitGrid:
        """Return intervals of about ``step``, s, that end at every switch, with an impact wherever feet touch down.

        Raises:
            InputError: a step that is not above 0, or that makes more than :data:`MOST_INTERVALS`.
        """
        if not (step > 0 and math.isfinite(step)):
            raise InputError("step", step, "a finite time above 0 s")
        whole = float(sum(phase.duration_s for phase in self.phases))
        if whole > MOST_INTERVALS * step:
            shortest = whole / MOST_INTERVALS
            raise InputError("step", step, f"at least {shortest:.3g} s: {MOST_INTERVALS} intervals for {whole:.3g} s")
        durations, phases, landing = [], [], []
        for i, phase in enumerate(self.phases):
            touching = set(self.phases[i - 1].air).difference(phase.air) if i else frozenset()
            if touching:
                durations.append(0.0)
                phases.append(i)
                landing.append(touching)
            count = max(1, round(phase.duration_s / step))
            durations += [phase.duration_s / count] * count
            phases += [i] * count
            landing += [frozenset()] * count
        down = np.array([[foot not in self.phases[i].air for foot in self.feet] for i in phases], dtype=np.bool_)
        touches = np.array([[foot in feet for foot in self.feet] for feet in landing], dtype=np.bool_)
        return GaitGrid(np.array(durations), down, touches)


@dataclass(frozen=True, eq=False)
class GaitGrid:
    """The intervals of a gait.

    Attributes:
        durations: (N,) durations, s; 0 for an impact, which is between a swing's last interval and the stance's first.
        flags: (N, nc) feet on the ground; at an impact, those after it.
        touchdowns: (N, nc) feet that touch down in the impact.
    """

    durations: Array
    flags: BoolArray
    touchdowns: BoolArray

    @property
    def times(self) -> Array:
        """(N+1,) of the nodes, s, from 0; an impact's two nodes have the same."""
        return np.concatenate([[0.0], np.cumsum(self.durations)])

    @property
    def flight(self) -> BoolArray:
        """(N,) flags of the intervals without a foot on the ground."""
        return np.asarray(~self.flags.any(axis=1), dtype=np.bool_)

    @property
    def impacts(self) -> BoolArray:
        """(N,) flags of the impacts."""
        return np.asarray(self.touchdowns.any(axis=1), dtype=np.bool_)
