"""Intervals of ticks in which a flag is true, such as those of pushes."""

from dataclasses import dataclass

import numpy as np

from lgmpc.runs.log import RunLog
from lgmpc.typing import Array, BoolArray


def intervals(flags: BoolArray) -> list[tuple[int, int]]:
    """Return first tick and end (exclusive) of each interval of (n,) true flags, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def joined_intervals(time: Array, flags: BoolArray, gap_s: float) -> list[tuple[int, int]]:
    """Return the intervals of (n,) true flags at times (n,), s; a gap shorter than ``gap_s`` does not end one."""
    found: list[tuple[int, int]] = []
    for a, b in intervals(flags):
        if found and time[a] - time[found[-1][1] - 1] < gap_s:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    return found


@dataclass(frozen=True)
class PushInterval:
    """One push of a log.

    Attributes:
        start: time of its first tick, s.
        end: time of its end, s.
        impulse: (3,) integral of its force, N.s, world axes.
    """

    start: float
    end: float
    impulse: Array


def push_intervals(log: "RunLog") -> tuple[PushInterval, ...]:
    """Return the pushes of a run: the intervals in which the applied wrench is not zero."""
    if log.ticks < 2:
        return ()
    active = np.any(log.push != 0.0, axis=1)
    period = float(np.median(np.diff(log.time)))
    return tuple(
        PushInterval(float(log.time[a]), float(log.time[b - 1]) + period, log.push[a:b, :3].sum(axis=0) * period)
        for a, b in intervals(active)
    )
