"""Contact schedules: phases of feet on the ground, sampled at any times."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.typing import Array, BoolArray, IntArray

__all__ = ["ContactPhase", "ContactSchedule", "Swing"]

_SLACK = 1e-9
"""A time less than this before a switch, s, counts as after it: node times are sums of rounded steps."""


@dataclass(frozen=True)
class ContactPhase:
    """An interval of time with the same feet on the ground.

    Attributes:
        duration: s; infinite in the last phase of a schedule that does not repeat, if it never ends.
        stance: contact frames on the ground; none in flight.
    """

    duration: float
    stance: frozenset[str]

    def __init__(self, duration: float, stance: Iterable[str]) -> None:
        object.__setattr__(self, "duration", float(duration))
        object.__setattr__(self, "stance", frozenset([stance] if isinstance(stance, str) else stance))
        if not self.duration > 0:
            raise InputError("duration", duration, "a contact phase longer than 0 s")


@dataclass(frozen=True)
class Swing:
    """The interval of time in which a foot is in the air.

    Attributes:
        liftoff: time, s; -inf if it was never on the ground.
        touchdown: time, s; inf if there is none.
    """

    liftoff: float
    touchdown: float


@dataclass(frozen=True)
class ContactSchedule:
    """A sequence of contact phases.

    A phase is active from its start up to, but not at, its end. Unless the schedule repeats, the first phase is active
    before ``start`` and the last one after its end.

    Attributes:
        contact_frames: (nc,) all contact frames, in the order of the flags' columns.
        phases: in order of time.
        start: of the first phase, s.
        cyclic: whether the phases repeat, in both directions of time.

    Raises:
        InputError: no phases, a stance frame that is not among ``contact_frames`` (the nearest are named), or an
            infinite duration other than the last of a schedule that does not repeat.
    """

    contact_frames: tuple[str, ...]
    phases: tuple[ContactPhase, ...]
    start: float = 0.0
    cyclic: bool = False
    _switches: Array = field(init=False, repr=False, compare=False)
    _stances: BoolArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.phases:
            raise InputError("phases", "none", "at least one contact phase")
        if not math.isfinite(self.start):
            raise InputError("start", self.start, "a finite time in s")
        for i, phase in enumerate(self.phases):
            for name in sorted(phase.stance - set(self.contact_frames)):
                raise InputError(f"phases[{i}].stance", name, "one of the contact frames", self.contact_frames)
            if math.isinf(phase.duration) and (self.cyclic or i < len(self.phases) - 1):
                raise InputError(f"phases[{i}].duration", phase.duration, "a finite time, because a phase follows it")
        object.__setattr__(self, "_switches", np.cumsum([phase.duration for phase in self.phases]))
        stances = [[name in phase.stance for name in self.contact_frames] for phase in self.phases]
        shape = (len(self.phases), len(self.contact_frames))
        object.__setattr__(self, "_stances", np.array(stances, dtype=np.bool_).reshape(shape))

    @classmethod
    def standing(cls, contact_frames: Iterable[str]) -> ContactSchedule:
        """Return the schedule with every foot on the ground at all times."""
        frames = tuple(contact_frames)
        return cls(frames, (ContactPhase(math.inf, frames),))

    @property
    def duration(self) -> float:
        """Sum of the phases' durations, s: the period of a schedule that repeats."""
        return float(self._switches[-1])

    def flags(self, times: ArrayLike) -> BoolArray:
        """Return (..., nc) whether each foot is on the ground at ``times`` (...), s.

        Raises:
            InputError: a time is not finite.
        """
        flags: BoolArray = self._stances[self._locate(times)[1]]
        return flags

    def phase(self, time: float) -> ContactPhase:
        """Return the phase that is active at ``time``, s."""
        return self.phases[int(self._locate(time)[1])]

    def swing(self, frame: str, time: float) -> Swing | None:
        """Return the swing of the foot at ``time``, s; None if it is on the ground.

        Raises:
            InputError: ``frame`` is not a contact frame, or the time is not finite.
        """
        if frame not in self.contact_frames:
            raise InputError("frame", frame, "one of the contact frames", self.contact_frames)
        cycles, indices = self._locate(time)
        down, index = self._stances[:, self.contact_frames.index(frame)], int(indices)
        if down[index]:
            return None
        here = self.start + (float(cycles) * self.duration if self.cyclic else 0.0)
        if not down.any():
            return Swing(-math.inf, math.inf)
        return Swing(here + self._last_stance_end(down, index), here + self._next_stance_start(down, index))

    def _last_stance_end(self, down: BoolArray, index: int) -> float:
        """Return the end of the last stance phase before phase ``index``, from the start of the cycle."""
        before = np.flatnonzero(down[:index])
        if before.size:
            return float(self._switches[before[-1]])
        return float(self._switches[np.flatnonzero(down)[-1]]) - self.duration if self.cyclic else -math.inf

    def _next_stance_start(self, down: BoolArray, index: int) -> float:
        """Return the start of the next stance phase after phase ``index``, from the start of the cycle."""
        after = np.flatnonzero(down[index + 1 :])
        if after.size:
            return float(self._switches[index + after[0]])
        first = int(np.flatnonzero(down)[0])
        return self.duration + (float(self._switches[first - 1]) if first else 0.0) if self.cyclic else math.inf

    def _locate(self, times: ArrayLike) -> tuple[Array, IntArray]:
        """Return the number of whole cycles passed, and the index of the phase, at each time."""
        times = np.asarray(times, dtype=np.float64)
        if not np.isfinite(times).all():
            raise InputError("times", times[~np.isfinite(times)].flat[0], "finite times in s")
        passed = times - self.start + _SLACK
        cycles = np.floor(passed / self.duration) if self.cyclic else np.zeros_like(passed)
        if self.cyclic:
            passed = passed - cycles * self.duration
        return cycles, np.searchsorted(self._switches[:-1], passed, side="right")
