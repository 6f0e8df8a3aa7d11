"""The gait clock: when each foot swings, from now on, through gait changes and contacts out of schedule."""

import copy
import math
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.locomotion.gait import Gait
from lgmpc.settings import NonNegative, Settings, key
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import BoolArray

_SLACK = 1e-9  # s


class GaitClockSettings(Settings):
    """Constraints on gait transitions."""

    min_stance_s: NonNegative = key(0.04, "Shortest stance before a lift-off that a transition or delay schedules, s.")


@dataclass(slots=True)
class SwingInterval:
    """One swing of one foot.

    Attributes:
        liftoff: s.
        touchdown: s; the foot is in the air at ``liftoff <= t < touchdown``.
    """

    liftoff: float
    touchdown: float

    def progress(self, t: float) -> float:
        """Return the share of the swing that is over at time ``t``; outside of the swing below 0 or above 1."""
        return (t - self.liftoff) / (self.touchdown - self.liftoff)


class GaitClock:
    """The swings of every foot: the last one, the present one, and as many of the future as a query needs.

    The schedule changes only by :meth:`start` and :meth:`stop` (the gait), by :meth:`touch_down` and :meth:`extend`
    (contacts that come early or late), and by :meth:`stretch` (long steps). What it predicts is what it does, unless
    one of them is called.

    Transitions: swings that are under way end as scheduled, then the new gait begins; so at no time are fewer feet on
    the ground than in either gait.

    Args:
        gait: the gait to begin with.
        time: when it begins, s.
        settings: see :class:`GaitClockSettings`.
        contacts: (nc,) which feet are on the ground; the others begin with a swing. All, if omitted.

    Attributes:
        gait: the gait that the clock follows; after :meth:`stop` still the one that ends.
        time: of the last :meth:`advance`, s.
    """

    def __init__(
        self,
        gait: Gait,
        time: float = 0.0,
        settings: GaitClockSettings | None = None,
        contacts: BoolArray | None = None,
    ) -> None:
        self.settings = GaitClockSettings() if settings is None else settings
        self.gait, self.time = gait, time
        self._swings: list[list[SwingInterval]] = [[] for _ in gait.offsets]
        self._next = [math.inf] * gait.nc  # first lift-off that is not in _swings
        self._end = math.inf  # no lift-off at or after it
        self._rests_from = math.inf  # as far as it is known; it lasts until the schedule changes
        if contacts is not None:
            length = max(gait.swing_s, 2.0 * self.settings.min_stance_s)
            for foot in np.flatnonzero(~np.asarray(contacts)):
                self._swings[foot].append(SwingInterval(time, time + length))
        self.start(time, gait)

    def copy(self) -> "GaitClock":
        """Return a clock with the same schedule, to see where a change of it would lead."""
        result = copy.copy(self)
        result._swings = [[SwingInterval(each.liftoff, each.touchdown) for each in swings] for swings in self._swings]
        result._next = list(self._next)
        return result

    @property
    def nc(self) -> int:
        """Number of feet."""
        return len(self._swings)

    @property
    def stopping(self) -> bool:
        """Whether the gait ends, or has ended, in standing."""
        return self._end < math.inf or self.gait.stands

    def rests(self, t: float) -> bool:
        """Return whether no foot swings at time ``t``, and none is to lift off, unless the gait changes."""
        if t >= self._rests_from:
            return True
        for foot, swings in enumerate(self._swings):
            if self._next[foot] < math.inf:
                self._fill(foot, t)
            if swings and swings[-1].touchdown > t:
                return False
        self._rests_from = t
        return True

    # Gait changes

    def follow(self, t: float, gait: Gait, moving: bool, lead: float = 0.0) -> None:
        """Start, switch or stop as a command requires; has no effect while the command stays as it is.

        Args:
            t: time, s.
            gait: the commanded gait.
            moving: whether the command is to move; without, any gait ends in standing.
            lead: time for which a robot at rest shifts its weight before the first lift-off, s.
        """
        if gait.stands or not moving:
            self.stop(t)
        elif self.stopping or (gait is not self.gait and gait != self.gait):
            self.start(t + lead if self.rests(t) else t, gait)

    def start(self, t: float, gait: Gait, first: int | None = None, cycles: int | None = None) -> None:
        """Follow ``gait`` from now on, as soon as the swings that are under way have ended.

        The cycle begins where the feet's waiting times are shortest, or with the lift-off of the foot ``first``.

        Args:
            t: time, s.
            gait: the new gait.
            first: the foot to lift off first, such as that of the diagonal that can catch a push.
            cycles: stand after so many cycles; None to go on.

        Raises:
            InputError: another number of feet, no such foot, or less than one cycle.
        """
        if gait.nc != self.nc:
            raise InputError("gait", f"{gait.nc} feet in '{gait.name}'", f"offsets for {self.nc} feet")
        if first is not None and not 0 <= first < self.nc:
            raise InputError("first", first, f"a foot from 0 to {self.nc - 1}")
        if cycles is not None and cycles < 1:
            raise InputError("cycles", cycles, "at least 1")
        for foot, swings in enumerate(self._swings):
            self._fill(foot, t)
            swings[:] = [swing for swing in swings if swing.liftoff <= t]
        landed = [swings[-1].touchdown if swings else -math.inf for swings in self._swings]
        self.gait = gait
        self._end = self._rests_from = math.inf
        if gait.stands:
            self._next = [math.inf] * self.nc
            return
        ready = max(t, *landed)
        earliest = [max(ready, time + self._min_stance) for time in landed]
        feet = sorted(range(self.nc), key=gait.offsets.__getitem__) if first is None else [first]
        options = [self._liftoffs(foot, earliest) for foot in feet]
        self._next = min(options, key=lambda liftoffs: round(sum(liftoffs), 6))  # of equals, the cycle's own beginning
        if cycles is not None:
            self._end = min(self._next) + cycles * gait.period_s - _SLACK

    def stop(self, t: float) -> None:
        """Stand after one more cycle, in which every foot can come to where it belongs; again without effect."""
        if not self.stopping:
            self._end = t + self.gait.period_s
            for foot, swings in enumerate(self._swings):
                swings[:] = [swing for swing in swings if swing.liftoff < self._end]
                if self._next[foot] >= self._end:
                    self._next[foot] = math.inf

    def _liftoffs(self, first: int, earliest: list[float]) -> list[float]:
        """Return each foot's first lift-off if foot ``first`` lifts off as early as it may."""
        period, offsets = self.gait.period_s, self.gait.offsets
        start = earliest[first] - offsets[first] * period
        liftoffs = []
        for offset, bound in zip(offsets, earliest, strict=True):
            liftoff = start + offset * period
            liftoffs.append(liftoff + period * math.ceil((bound - liftoff - _SLACK) / period))
        return liftoffs

    @property
    def _min_stance(self) -> float:
        return min(self.settings.min_stance_s, self.gait.stance_s)

    # Contacts out of schedule

    def touch_down(self, foot: int, t: float) -> None:
        """End the present swing of a foot now: it touched down early. The schedule goes on."""
        swing = self.swing(foot, t)
        if swing is not None:
            swing.touchdown = t

    def latest_touchdown(self, foot: int, t: float) -> float:
        """Return how long the present swing of a foot may last for it to stand before it lifts off again, s."""
        return self._peek(foot, t) - self._min_stance

    def stretch(self, foot: int, t: float, until: float) -> None:
        """Extend the present swing of a foot to ``until``, if that is later than scheduled: its step is long.

        Lift-offs stay as they are: the foot stands for less long, and in a gait that has no time to spare the robot
        is in the air meanwhile.
        """
        swing = self.swing(foot, t)
        if swing is not None and until > swing.touchdown:
            swing.touchdown = until

    def extend(self, foot: int, t: float, until: float) -> None:
        """Extend the present swing of a foot until ``until``: it found no ground yet.

        Lift-offs after the last :meth:`advance` that would leave fewer feet on the ground than the gait has at any
        time, or that would follow too soon on the foot's own touchdown, delay the whole schedule.

        Args:
            foot: whose scheduled touchdown has come.
            t: time, s.
            until: when to expect the touchdown now, s.
        """
        last = self._last(foot, t)
        if last is None or last.touchdown >= until:
            return
        last.touchdown = until
        self._rests_from = math.inf
        self._wait(foot, until, max(0.0, until + self._min_stance - self._peek(foot, last.liftoff)), 0)

    def hold(self, foot: int, until: float) -> None:
        """Delay the whole schedule where lift-offs until ``until``, s, need a foot that lost its contact."""
        self._wait(foot, until, max(0.0, until + self._min_stance - self._peek(foot, self.time)), 1)

    def _wait(self, foot: int, until: float, delay: float, lost: int) -> None:
        """Delay the schedule by ``delay``, s, or until enough feet stand at each lift-off before ``until``, s.

        Args:
            foot: without ground.
            until: when it is expected to stand, s.
            delay: least delay, s.
            lost: how many feet that are scheduled to stand do not.
        """
        for other in range(self.nc):
            for swing in self.swings(other, self.time, until) if other != foot else ():
                if swing.liftoff > self.time and self.flags(swing.liftoff).sum() - lost < self.gait.min_support:
                    delay = max(delay, until - swing.liftoff)
        if delay > 0.0:
            self._delay(delay)

    def _delay(self, delay: float) -> None:
        """Shift every lift-off after the last tick."""
        for foot, swings in enumerate(self._swings):
            for swing in swings:
                if swing.liftoff > self.time:
                    swing.liftoff += delay
                    swing.touchdown += delay
            self._next[foot] += delay
        self._end += delay

    def _peek(self, foot: int, t: float) -> float:
        """Return the first lift-off of a foot after ``t``; inf if none is to come."""
        self._fill(foot, t)
        for swing in self._swings[foot]:  # a loop takes a third of a generator's time
            if swing.liftoff > t:
                return swing.liftoff
        return math.inf

    # Queries

    def advance(self, t: float) -> None:
        """Move on to the time ``t`` of a tick: swings before the last one are discarded."""
        self.time = t
        if t > self._rests_from:
            return  # nothing has begun since
        for foot, swings in enumerate(self._swings):
            self._fill(foot, t)
            while len(swings) > 1 and swings[1].liftoff <= t:
                del swings[0]

    def swing(self, foot: int, t: float) -> SwingInterval | None:
        """Return the swing that a foot is in at time ``t``, None if it stands."""
        self._fill(foot, t)
        for swing in self._swings[foot]:
            if swing.liftoff <= t < swing.touchdown:
                return swing
        return None

    def swings(self, foot: int, begin: float, end: float) -> list[SwingInterval]:
        """Return the swings of a foot of which a part lies between the times ``begin`` and ``end``."""
        self._fill(foot, end)
        return [swing for swing in self._swings[foot] if swing.touchdown > begin and swing.liftoff < end]

    def flags(self, t: float) -> BoolArray:
        """Return (nc,) which feet are scheduled to be on the ground at time ``t``."""
        return np.array([self.swing(foot, t) is None for foot in range(self.nc)])

    def horizon(self, grid: TimeGrid, flags: BoolArray) -> None:
        """Write flags (N, nc): which feet are scheduled to be on the ground at the beginning of each interval."""
        flags[:] = True
        for foot in range(self.nc):
            for swing in self.swings(foot, grid.start, grid.end):
                flags[grid.first_from(swing.liftoff) : grid.first_from(swing.touchdown), foot] = False

    def last_touchdown(self, foot: int, t: float) -> float:
        """Return when the present stance of a foot began, s; -inf if it always stood."""
        swing = self._last(foot, t)
        return -math.inf if swing is None else swing.touchdown

    def next_liftoff(self, foot: int, t: float) -> float:
        """Return when a foot lifts off next, s; inf if it is to stand."""
        return self._peek(foot, t)

    def stance_duration(self, foot: int, t: float) -> float:
        """Return the duration of a foot's present stance or, in a swing, of the coming one, s; inf without an end."""
        swing = self.swing(foot, t)
        touchdown = self.last_touchdown(foot, t) if swing is None else swing.touchdown
        return self._peek(foot, max(touchdown, t)) - touchdown

    def _last(self, foot: int, t: float) -> SwingInterval | None:
        """Return the last swing that began until ``t``."""
        self._fill(foot, t)
        return next((swing for swing in reversed(self._swings[foot]) if swing.liftoff <= t), None)

    def _fill(self, foot: int, t: float) -> None:
        """Schedule the swings of a foot up to the first one that begins after ``t``."""
        swings = self._swings[foot]
        while (not swings or swings[-1].liftoff <= t) and self._next[foot] < math.inf:
            liftoff = self._next[foot]
            self._next[foot] = liftoff + self.gait.period_s
            if liftoff >= self._end:
                self._next[foot] = math.inf
            else:
                swings.append(SwingInterval(liftoff, liftoff + self.gait.swing_s))
