"""Contact events: fusion of scheduled and measured contacts.

With a schedule alone, early feet are pressed into the ground and late ones end in the air; measurements alone are
noisy. Here the schedule is followed, and corrected by persistent measurements (after Bledt et al., "Contact model
fusion for event-based locomotion in unstructured terrains", ICRA 2018, with thresholds in place of probabilities).

Measurements are older than the decisions they enter: by the age of the state and the time until the command acts. So a
measurement is compared with the schedule of its own time. A foot whose touchdown is due carries as scheduled until the
measurement of that time arrives; waiting for it would delay every touchdown by its age.
"""

import math
from collections.abc import Callable
from enum import Enum

import numpy as np

from lgmpc.locomotion.clock import GaitClock
from lgmpc.settings import Fraction, NonNegative, Positive, Settings, key
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import GRAVITY, BoolArray

_SAME_TIME = 1e-9  # s
_SEARCH_SHARE = 0.55  # of sqrt(h / g)


class ContactEventSettings(Settings):
    """Conditions under which a measurement overrides the schedule."""

    early_share: Fraction = key(0.5, "Share of a swing before which a measured contact is the lift-off, no touchdown.")
    touch_time_s: NonNegative = key(0.003, "Time for which a contact must be measured to be accepted, s.")
    lost_time_s: NonNegative = key(0.03, "Time without measured contact after which a stance foot counts as lost, s.")
    touchdown_tolerance_s: NonNegative = key(
        0.005,
        "Where measurements are older than decisions: how long after a scheduled touchdown no contact is"
        " measured until the foot, which carries meanwhile, counts as late, s.",
    )
    lookahead_s: Positive = key(0.004, "Time from now at which a late foot is expected to touch down, s.")
    max_late_s: NonNegative = key(0.01, "Longest delay for a late foot; then the schedule continues without it, s.")
    max_search_s: NonNegative | None = key(
        None,
        "The same for a foot below the height at which it should have found the ground: a push makes feet"
        " late, but only a hole takes them there, s. null: 0.55 of sqrt(h / g), the time in which a pendulum of the"
        " robot's height falls.",
    )
    ramp_s: NonNegative = key(0.025, "Time in which the force bound of a foot opens after touchdown, s.")
    release_s: NonNegative = key(0.0, "Time in which the force bound of a foot closes before a scheduled lift-off, s.")


class ContactState(Enum):
    """State of a foot relative to the schedule."""

    STANCE = "on the ground, as scheduled"
    SWING = "in the air, as scheduled"
    EARLY = "on the ground since before the scheduled touchdown"
    LATE = "in the air beyond the scheduled touchdown, descending; the schedule waits"
    MISSING = "in the air for longer than the schedule waits"
    LOST = "in the air in the middle of a stance between swings, descending"

    __hash__ = object.__hash__  # members are unique: Enum's own hashes their names, in Python

    @property
    def carries(self) -> bool:
        """Whether the foot can carry a force."""
        return self is ContactState.STANCE or self is ContactState.EARLY


_SEARCHING = frozenset({ContactState.LATE, ContactState.MISSING, ContactState.LOST})


class ContactEvents:
    """Advances the schedule of a clock, and corrects it where measured contacts differ.

    Args:
        clock: the schedule; :meth:`update` corrects it for early and late feet.
        settings: see :class:`ContactEventSettings`.
        age: of the contacts measured at each update, s.
        height: of the centre of mass above the feet, m: the scale of the longest delay.

    Attributes:
        states: (nc,) of the last update.
        stance: (nc,) which feet carry: the flags for the whole-body QP and for the first interval of a horizon.
        since: (nc,) when each foot entered its state, s.
        resting: whether all feet stand and none is to lift off, at the last update.
        brief: (nc,) which feet are in the air after a contact that was too short to be accepted.
        pushed: (nc,) legs that something pushes, whose feet do not stand without contact; to be written to.
    """

    def __init__(
        self, clock: GaitClock, settings: ContactEventSettings | None = None, age: float = 0.0, height: float = 0.21
    ) -> None:
        self.clock = clock
        self.settings = s = ContactEventSettings() if settings is None else settings
        self._max_search = _SEARCH_SHARE * math.sqrt(height / GRAVITY) if s.max_search_s is None else s.max_search_s
        self._age = age
        self._touchdown_tolerance = s.touchdown_tolerance_s if age > 0.0 else 0.0  # what is measured at once needs none
        nc = clock.nc
        flags = clock.flags(clock.time)
        self.states = [ContactState.STANCE if stands else ContactState.SWING for stands in flags]
        self.stance: BoolArray = flags
        self.since = [-np.inf if stands else clock.time for stands in flags]
        self.resting, self.brief = False, [False] * nc
        self._full, self._none = [1.0] * nc, [False] * nc
        self.pushed = self._none
        self._below: Callable[[int], bool] = lambda foot: False
        self._touching = [bool(stands) for stands in flags]
        self._changed = [clock.time] * nc  # when the measurement last changed
        self._due = [math.inf] * nc  # a touchdown that was scheduled and is not measured yet, s

    def update(
        self, t: float, contacts: BoolArray | None = None, below: Callable[[int], bool] | None = None
    ) -> BoolArray:
        """Compare schedule and measurement at time ``t``, and advance the clock.

        Args:
            t: time, s, not before that of the last update.
            contacts: (nc,) measured at ``t - age``; None where nothing is: then the schedule is followed.
            below: returns whether a foot is below the height at which it should have found the ground; called, until
                the next update, for feet that search for it. None is unless given.

        Returns:
            :attr:`stance`.
        """
        measured = None if contacts is None else contacts.tolist()
        if measured is not None and measured != self._touching:
            for foot, touching in enumerate(measured):
                if touching != self._touching[foot]:
                    self.brief[foot] = not touching and t - self._changed[foot] < self.settings.touch_time_s
                    self._touching[foot], self._changed[foot] = touching, t
        carries = self.stance.tolist()
        self.resting = self._rests(t, carries)
        if self.resting and measured is not None and True not in self.pushed:
            self.clock.advance(t)  # all stand, whatever they measure
            return self.stance
        self._below = (lambda foot: False) if below is None else below
        # Feet in the air first: one that is late delays the lift-offs of this tick before they take place.
        feet = range(self.clock.nc)
        landed = [carried and due == math.inf for carried, due in zip(carries, self._due, strict=True)]
        for foot in [*(f for f in feet if not landed[f]), *(f for f in feet if landed[f])]:
            state = self._next_state(foot, t, None if measured is None else measured[foot])
            if state is not self.states[foot]:
                self.states[foot], self.since[foot] = state, t
                carries[foot] = state.carries
        self.stance[:] = carries
        self.clock.advance(t)
        self.resting = self._rests(t, carries)
        return self.stance

    def _rests(self, t: float, carries: list[bool]) -> bool:
        return False not in carries and min(self._due) == math.inf and self.clock.rests(t)

    def _next_state(self, foot: int, t: float, touching: bool | None) -> ContactState:
        s, clock, before = self.settings, self.clock, self.states[foot]
        swing = clock.swing(foot, t)
        if touching is None:
            return ContactState.STANCE if swing is None else ContactState.SWING
        measured_at = t - self._age
        persists = t - self._changed[foot]
        touched = touching and persists >= s.touch_time_s
        if swing is not None:
            self._due[foot] = math.inf
            if before is ContactState.LATE:
                # It is due: the first touch counts.
                if touching:
                    clock.touch_down(foot, t)
                    return ContactState.STANCE
                return self._wait(foot, t)
            if touched and swing.progress(measured_at) >= s.early_share:
                clock.touch_down(foot, t)
                return ContactState.EARLY
            return ContactState.SWING
        if before is ContactState.SWING:
            self._due[foot] = t
        if self._due[foot] < math.inf:
            if measured_at < self._due[foot] + (0.0 if touching else self._touchdown_tolerance) - _SAME_TIME:
                return ContactState.STANCE
            self._due[foot] = math.inf
            return ContactState.STANCE if touching else self._wait(foot, t)
        if before is ContactState.LATE:
            return ContactState.STANCE if touching else self._wait(foot, t)
        if before is ContactState.MISSING or before is ContactState.LOST:
            if not touched and self._below(foot) and t - self.since[foot] < self._max_search:
                clock.hold(foot, t + self._expected(foot, t))
            return ContactState.STANCE if touched else before
        if self.pushed[foot] and not touching and persists >= s.touch_time_s - _SAME_TIME:
            return ContactState.LOST
        if touching or persists < s.lost_time_s or t - self.since[foot] < s.lost_time_s:
            return before
        # A foot that stands for good is held in place while a push unloads it: it has nowhere else to go.
        return ContactState.LOST if math.isfinite(clock.next_liftoff(foot, t)) else before

    def _wait(self, foot: int, t: float) -> ContactState:
        """Delay the schedule for a foot whose touchdown is due, up to the longest wait."""
        begin = self.since[foot] if self.states[foot] is ContactState.LATE else t
        if t - begin >= (self._max_search if self._below(foot) else self.settings.max_late_s):
            self.clock.touch_down(foot, t)
            return ContactState.MISSING
        self.clock.extend(foot, t, t + self._expected(foot, t))
        return ContactState.LATE

    def _expected(self, foot: int, t: float) -> float:
        """Return the time in which a foot that searches is expected to find the ground, s.

        One that is below it is expected to search for as long again as it has.
        """
        again = t - self.since[foot] if self.below(foot) else 0.0
        return max(self.settings.lookahead_s, again)

    def below(self, foot: int) -> bool:
        """Return whether a foot searches below the height at which it should have found the ground."""
        return self.searching(foot) and self._below(foot)

    def searching(self, foot: int) -> bool:
        """Return whether a foot descends in search of the ground beyond its schedule."""
        return self.states[foot] in _SEARCHING

    def steady(self, since: float) -> list[bool]:
        """Return (nc,) which feet have carried since before ``since``, s, and touch the ground now.

        While the robot steps, a contact just measured does not count yet: a foot that hops lands with the velocity
        that it had in the air.
        """
        if self.resting and max(self.since) < since:
            return self._touching
        counts = self.clock.time - self.settings.touch_time_s
        feet = zip(self.stance.tolist(), self._touching, self.since, self._changed, strict=True)
        return [
            carries and touching and begin < since and changed < counts for carries, touching, begin, changed in feet
        ]

    def correct(self, flags: BoolArray, grid: TimeGrid) -> None:
        """Overwrite the beginning of a horizon's flags (N, nc) with the actual contacts.

        The first interval takes :attr:`stance`; a foot that searches for the ground is expected to find it after
        the lookahead.
        """
        flags[0] = self.stance
        for foot in range(self.clock.nc):
            if self.searching(foot):
                flags[: 1 + grid.interval(grid.start + self._expected(foot, self.clock.time)), foot] = False

    def loading(self, t: float) -> list[float]:
        """Return (nc,) the shares of their largest forces that feet may carry: ramps at touchdown, before lift-off."""
        s = self.settings
        if self.resting and t - max(self.since) >= s.ramp_s:
            return self._full
        shares = [1.0 if carries else 0.0 for carries in self.stance.tolist()]
        if s.ramp_s > 0.0:
            shares = [min(share, (t - since) / s.ramp_s) for share, since in zip(shares, self.since, strict=True)]
        if s.release_s > 0.0 and not self.resting:
            left = [self.clock.next_liftoff(foot, t) - t for foot in range(len(shares))]
            shares = [min(share, time / s.release_s) for share, time in zip(shares, left, strict=True)]
        return [max(share, 0.0) for share in shares]

    def airborne(self, t: float) -> list[bool]:
        """Return (nc,) which feet carry as decided, but have measured no contact for some time; none at rest."""
        if self.resting or False not in self._touching:
            return self._none
        since = t - self.settings.touch_time_s
        feet = zip(self.stance.tolist(), self._touching, self.since, self._changed, strict=True)
        return [
            not touching and carries and max(begin + self._age, changed) <= since
            for carries, touching, begin, changed in feet
        ]
