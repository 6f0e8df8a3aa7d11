"""Intervals of ticks in which a flag is true."""

from __future__ import annotations

import numpy as np

from lgmpc.typing import Array, BoolArray

__all__ = ["intervals", "joined_intervals"]


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
