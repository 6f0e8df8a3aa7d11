"""Times at equal distances (nodes of a horizon, ticks, steps of a plant), and the course of a motion over its time."""

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

_SLACK = 1e-9
"""Of an interval, and of the ratio of two rates: more than rounding errors come to."""


@dataclass(frozen=True)
class TimeGrid:
    """Intervals of equal length: those of a horizon, the ticks of a run.

    Attributes:
        period: length of an interval, s.
        count: number of intervals, N; they begin and end at N + 1 nodes. 0 where only their length matters.
        start: time of the first node, s.
    """

    period: float
    count: int = 0
    start: float = 0.0

    @property
    def elapsed(self) -> Array:
        """(N+1,) times of the nodes since the first one, s; read-only."""
        return _multiples(self.period, self.count)

    @property
    def nodes(self) -> Array:
        """(N+1,) times of the nodes, s."""
        return self.start + self.elapsed

    @property
    def end(self) -> float:
        """Time of the last node, s."""
        return self.start + self.period * self.count

    def begun_at(self, time: float) -> "TimeGrid":
        """Return the same intervals from ``time``, s, on."""
        return TimeGrid(self.period, self.count, time)

    def nearest(self, time: float) -> int:
        """Return the number of the node nearest to ``time``, s; before the first and after the last they count on."""
        return round((time - self.start) / self.period)

    def first_from(self, time: float) -> int:
        """Return the number of the first node at or after ``time``, s; 0 before all of them, N after."""
        return min(max(math.ceil((time - self.start) / self.period - _SLACK), 0), self.count)

    def interval(self, time: float) -> int:
        """Return the number of the interval that ``time``, s, is in: of its end, the next one."""
        return math.floor((time - self.start) / self.period + _SLACK)


@functools.lru_cache(maxsize=64)
def _multiples(period: float, count: int) -> Array:
    found = period * np.arange(count + 1, dtype=np.float64)
    found.flags.writeable = False
    return found


def minimum_jerk(x: Any) -> tuple[Any, Any, Any]:
    """Return the way from rest to rest, 0 to 1, at the share ``x`` of its time, and its first two derivatives by it.

    Flash and Hogan, "The coordination of arm movements", J. Neuroscience 5, 1985.
    """
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2), 30.0 * x**2 * (1.0 - x) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


def periods_in(key: str, rate_hz: float, fast_key: str, fast_hz: float) -> int:
    """Return the number of periods of a rate, such as control ticks, in one of a slower rate, such as that of plans.

    Args:
        key: config key of the slower rate.
        rate_hz: the slower rate.
        fast_key: config key of the faster rate.
        fast_hz: the faster rate.

    Raises:
        InputError: it is no whole number.
    """
    ratio = fast_hz / rate_hz
    count = round(ratio)
    if count < 1 or abs(ratio - count) > _SLACK * ratio:
        raise InputError(key, rate_hz, f"{fast_key} ({fast_hz:g}) divided by a whole number")
    return count
