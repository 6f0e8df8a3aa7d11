"""The first bitwise difference between two logs, for checks that a run is repeatable."""

from dataclasses import dataclass

import numpy as np

from lgmpc.runs.channels import channels_of
from lgmpc.runs.log import RunLog
from lgmpc.typing import Array, BoolArray

_DURATIONS = ("wbc_ms", "mpc_ms", "estimate_ms", "forecast_ms")
"""Measured durations, which differ between any two runs."""


@dataclass(frozen=True)
class LogDifference:
    """The first entry in which two logs differ.

    Attributes:
        tick: row of the log; for the channels of MPC updates the number of the update.
        time_s: time of the first log there, s.
        channel: the channel and its element: ``q[7]``.
        first: value in the first log; NaN after its end.
        second: value in the second log; NaN after its end.
    """

    tick: int
    time_s: float
    channel: str
    first: float
    second: float

    def __str__(self) -> str:
        where = f"at {self.time_s:.3f} s (tick {self.tick} of the log)"
        return f"{where} in {self.channel}: {self.first!r} became {self.second!r}"


def first_difference(first: RunLog, second: RunLog, *, until_s: float = np.inf) -> LogDifference | None:
    """Return the earliest difference of two logs of one robot; ``None`` if all channels except durations are equal.

    Of several channels that differ at one time, the first in the order of :class:`~lgmpc.runs.log.RunLog` is returned.
    ``wbc_status`` is not compared at the last tick, where it may include ticks that only one of the logs has.

    Args:
        first: first log.
        second: second log, decimated as the first.
        until_s: end of the comparison, s.
    """
    found = []
    for table, times in (("tick", "time"), ("estimate", "time"), ("update", "mpc_time")):
        a, b = (int(np.searchsorted(getattr(log, times), until_s - 1e-9)) for log in (first, second))
        time: Array = getattr(first if a >= b else second, times)
        for name in channels_of(RunLog, table):
            one, other = getattr(first, name), getattr(second, name)
            if name not in _DURATIONS and one is not None and other is not None:
                count = max(min(a, b) - (name == "wbc_status"), 0)
                found += _in_channel(name, one[:count], other[:count], time)
        if a != b:
            last = float(time[min(a, b)])
            found.append(LogDifference(min(a, b), last, times, *((last, np.nan) if a > b else (np.nan, last))))
    return min(found, key=lambda each: each.time_s, default=None)


def _in_channel(name: str, a: Array, b: Array, time: Array) -> list[LogDifference]:
    """Return the first difference of two (n, ...) arrays: NaN equals itself, zeros of two signs differ."""
    if a.shape != b.shape:
        return [LogDifference(0, float(time[0]), f"{name} (shape)", float(a[0].size), float(b[0].size))]
    bits = [np.ascontiguousarray(each).view(np.int64) if each.dtype == np.float64 else each for each in (a, b)]
    different: BoolArray = bits[0] != bits[1]
    if not different.any():
        return []
    at = tuple(int(each) for each in np.unravel_index(int(np.argmax(different)), different.shape))
    element = "".join(f"[{each}]" for each in at[1:])
    return [LogDifference(at[0], float(time[at[0]]), f"{name}{element}", float(a[at]), float(b[at]))]
