"""Contact events: which feet carry, from the schedule and from what is measured.

A schedule alone stamps early feet into the ground and leaves late ones hovering; a measurement alone flickers. Here
the schedule leads, and a measurement that persists corrects it (after Bledt et al., "Contact model fusion for
event-based locomotion in unstructured terrains", ICRA 2018, with thresholds in place of probabilities).
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np
from pydantic import Field

from lgmpc.locomotion.clock import GaitClock
from lgmpc.settings import Fraction, NonNegative, Positive, Settings
from lgmpc.typing import Array, BoolArray

__all__ = ["ContactEvents", "ContactEventSettings", "ContactState"]


class ContactEventSettings(Settings):
    """When a measurement overrides the schedule."""

    early_share: Fraction = Field(
        default=0.5, description="Share of a swing before which a measured contact is no touchdown: the foot leaves."
    )
    touch_time_s: NonNegative = Field(default=0.003, description="How long a contact is measured until it counts, s.")
    lost_time_s: NonNegative = Field(
        default=0.03, description="How long a stance foot measures no contact until it counts as lost, s."
    )
    lookahead_s: Positive = Field(
        default=0.004, description="How much later than now a foot that is late is expected to touch down, s."
    )
    max_late_s: NonNegative = Field(
        default=0.01, description="How long the schedule waits for a late foot; then it goes on without it, s."
    )
    force_share: Fraction = Field(
        default=0.004,
        description="Normal force that counts as contact, as a share of the robot's weight; more than the noise of what"
        " measures it, less than the smallest force of a stance foot.",
    )
    ramp_s: NonNegative = Field(
        default=0.025, description="Time in which the force bound of a foot opens after touchdown, s."
    )
    release_s: NonNegative = Field(
        default=0.0, description="Time in which the force bound of a foot closes before the scheduled lift-off, s."
    )


class ContactState(Enum):
    """What a foot does, compared with the schedule."""

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


class ContactEvents:
    """Follows the schedule of a clock, corrects it where measured contacts differ, and advances it.

    Args:
        clock: the schedule; :meth:`update` corrects it for early and late feet.
        weight: of the robot, N: the unit of the force threshold.
        settings: see :class:`ContactEventSettings`.

    Attributes:
        states: (nc,) of the last update.
        stance: (nc,) which feet carry: the flags for the whole-body QP and for the first interval of a horizon.
        since: (nc,) when each foot entered its state, s.
        resting: whether all feet stand and none is to lift off, at the last update.
    """

    def __init__(self, clock: GaitClock, weight: float, settings: ContactEventSettings | None = None) -> None:
        self.clock = clock
        self.settings = ContactEventSettings() if settings is None else settings
        self._threshold = self.settings.force_share * weight
        nc = clock.nc
        flags = clock.flags(clock.time)
        self.states = [ContactState.STANCE if stands else ContactState.SWING for stands in flags]
        self.stance: BoolArray = flags
        self.since = [-np.inf if stands else clock.time for stands in flags]
        self.resting = False
        self._touching = [bool(stands) for stands in flags]
        self._changed = [clock.time] * nc  # when the measurement last changed

    def measure(self, forces: Array) -> BoolArray:
        """Return (nc,) which feet are in contact by their normal forces (nc,), N; released at half the threshold."""
        threshold = np.where(self._touching, 0.5 * self._threshold, self._threshold)
        contacts: BoolArray = forces > threshold
        return contacts

    def update(self, t: float, contacts: BoolArray | None = None) -> BoolArray:
        """Compare schedule and measurement at time ``t``, and move the clock on to it.

        Args:
            t: time, s, not before that of the last update.
            contacts: (nc,) measured; None where nothing is: then the schedule is followed.

        Returns:
            :attr:`stance`.
        """
        measured = None if contacts is None else contacts.tolist()
        if measured is not None and measured != self._touching:
            for foot, touching in enumerate(measured):
                if touching != self._touching[foot]:
                    self._touching[foot], self._changed[foot] = touching, t
        carries = self.stance.tolist()
        self.resting = False not in carries and self.clock.rests(t)
        if self.resting and measured is not None:
            self.clock.advance(t)  # all stand, whatever they measure
            return self.stance
        # Feet in the air first: one that is late delays the lift-offs of this tick before they take place.
        feet = range(self.clock.nc)
        for foot in [*(f for f in feet if not carries[f]), *(f for f in feet if carries[f])]:
            state = self._next_state(foot, t, None if measured is None else measured[foot])
            if state is not self.states[foot]:
                self.states[foot], self.since[foot] = state, t
                carries[foot] = state.carries
        self.stance[:] = carries
        self.clock.advance(t)
        self.resting = False not in carries and self.clock.rests(t)
        return self.stance

    def _next_state(self, foot: int, t: float, touching: bool | None) -> ContactState:
        s, clock, before = self.settings, self.clock, self.states[foot]
        swinging = clock.swing(foot, t) is not None
        if touching is None:
            return ContactState.SWING if swinging else ContactState.STANCE
        persists = t - self._changed[foot]
        touched = touching and persists >= s.touch_time_s
        if swinging:
            if before is ContactState.LATE:
                # It is due: the first touch counts.
                if touching:
                    clock.touch_down(foot, t)
                    return ContactState.STANCE
                return self._wait(foot, t)
            if touched and clock.progress(foot, t) >= s.early_share:
                clock.touch_down(foot, t)
                return ContactState.EARLY
            return ContactState.SWING
        if before is ContactState.SWING or before is ContactState.LATE:
            # The scheduled touchdown is now.
            return ContactState.STANCE if touching else self._wait(foot, t)
        if before is ContactState.MISSING or before is ContactState.LOST:
            return ContactState.STANCE if touched else before
        # A foot that stands for good is held in place while a push unloads it: it has nowhere else to go.
        ends = math.isfinite(clock.next_liftoff(foot, t))
        lost = ends and not touching and persists >= s.lost_time_s and t - self.since[foot] >= s.lost_time_s
        return ContactState.LOST if lost else before

    def _wait(self, foot: int, t: float) -> ContactState:
        """Make the schedule wait for a foot whose touchdown is due, up to the longest wait."""
        begin = t if self.states[foot] is ContactState.SWING else self.since[foot]
        if t - begin >= self.settings.max_late_s:
            self.clock.touch_down(foot, t)
            return ContactState.MISSING
        self.clock.extend(foot, t, t + self.settings.lookahead_s)
        return ContactState.LATE

    def searching(self, foot: int) -> bool:
        """Return whether a foot descends in search of the ground beyond its schedule."""
        return self.states[foot] in (ContactState.LATE, ContactState.MISSING, ContactState.LOST)

    def steady(self, since: float) -> list[bool]:
        """Return (nc,) which feet have carried since before ``since``, s, and touch the ground now."""
        feet = zip(self.stance.tolist(), self.since, self._touching, strict=True)
        return [carries and begin < since and touching for carries, begin, touching in feet]

    def correct(self, flags: BoolArray, dt: float) -> None:
        """Overwrite the beginning of a horizon's flags (N, nc), intervals of ``dt``, s, with what the feet really do.

        The first interval takes :attr:`stance`; a foot that searches for the ground is expected to find it after
        the lookahead.
        """
        flags[0] = self.stance
        searched = 1 + int(self.settings.lookahead_s / dt)
        for foot in range(self.clock.nc):
            if self.searching(foot):
                flags[:searched, foot] = False

    def loading(self, t: float) -> list[float]:
        """Return (nc,) the shares of their largest forces that feet may carry: ramps at touchdown, before lift-off."""
        s = self.settings
        shares = [1.0 if carries else 0.0 for carries in self.stance.tolist()]
        if s.ramp_s > 0.0:
            shares = [min(share, (t - since) / s.ramp_s) for share, since in zip(shares, self.since, strict=True)]
        if s.release_s > 0.0 and not self.resting:
            left = [self.clock.next_liftoff(foot, t) - t for foot in range(len(shares))]
            shares = [min(share, time / s.release_s) for share, time in zip(shares, left, strict=True)]
        return [max(share, 0.0) for share in shares]
