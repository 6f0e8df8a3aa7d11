"""Bounds on the shift of a foothold from its nominal point: reach, own side of the base, clearance from other feet.

The admissible footholds of a foot are a convex polygon about the nominal one p, with sides towards m evenly spaced
directions n_j: ``n_j . d <= margin_j`` for the shift d. The disc of radius R that the leg reaches about its hip h
contains the polygon with ``margin_j = n_j . (h - p) + R cos(pi / m)``. A half-plane ``w . d <= a`` contains it if the
two sides next to w, with ``w = a_j n_j + a_k n_k`` and non-negative coefficients, have at most the margin
``a / (a_j + a_k)``. The polygon is therefore an inner approximation for bounds of any direction. Margins are not
negative: a nominal foothold on the edge of the disc is admissible too, and moves the sides next to it outward as far as
itself, so that a corner is at most ``R / cos(pi / m)`` from the hip.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.horizon import ContactHorizon
from lgmpc.robot.friction import facet_normals
from lgmpc.typing import Array, BoolArray

__all__ = ["FootholdMargins", "tighten"]


class FootholdMargins:
    """Computes the margins of every foothold of a horizon.

    Args:
        planner: planner of the nominal footholds, with the bounds to satisfy.
    """

    def __init__(self, planner: FootholdPlanner) -> None:
        self._planner = planner

    def write(
        self, horizon: ContactHorizon, clock: GaitClock, motion: BaseMotion, t: float, dt: float, fixed: BoolArray
    ) -> None:
        """Write ``horizon.margins`` from its flags and points: zero for feet that stand, and for those of planar legs.

        A planar leg reaches a line on the floor, within which a polygon of shifts has no interior. A nominal foothold
        that violates a bound has a margin of zero towards it.

        Args:
            horizon: contacts over intervals of ``dt``.
            clock: the schedule that they are of: a fast robot moves on by centimetres from a touchdown to the
                beginning of the next interval.
            motion: motion at the beginning of the horizon.
            t: beginning of the horizon, s.
            dt: duration of the intervals, s.
            fixed: (nc,) feet whose present swing has passed the time at which its target is frozen.
        """
        margins, flags = horizon.margins, horizon.flags
        margins[...] = 0.0
        normals = directions(margins.shape[2])
        for foot, column in enumerate(flags.T.tolist()):
            touchdowns = [swing.touchdown - t for swing in clock.swings(foot, t, t + dt * len(column))]
            begin = 0
            while begin < len(column):
                if column[begin]:
                    begin += 1
                    continue
                end = column.index(True, begin) if True in column[begin:] else len(column)
                planar = any(self._planner.normals[foot])
                if end < len(column) and not planar and not (begin == 0 and fixed[foot]):
                    scheduled = (each for each in touchdowns if dt * (end - 1) < each <= dt * end)
                    remaining = next(scheduled, dt * end)
                    margins[begin:end, foot] = self._at(foot, horizon, end, motion, remaining, begin == 0, normals)
                begin = end

    def _at(
        self,
        foot: int,
        horizon: ContactHorizon,
        touchdown: int,
        motion: BaseMotion,
        remaining: float,
        present: bool,
        normals: Array,
    ) -> Array:
        """Return (m,) the margins of the foothold of a touchdown at the beginning of interval ``touchdown``."""
        planner = self._planner
        com, yaw = planner.expected(motion, remaining, present), motion.yaw + motion.yaw_rate * remaining
        points = horizon.points[touchdown, :, :2].tolist()
        x, y = points[foot]
        c, s = math.cos(yaw), math.sin(yaw)
        ahead, left = planner.hips[foot]
        hip = (com[0] + c * ahead - s * left - x, com[1] + s * ahead + c * left - y)
        reach = planner.reach(foot, motion.height) * math.cos(math.pi / len(normals))
        margins: Array = normals @ np.array(hip) + reach
        beside = planner.feet[foot][1]
        if beside != 0.0:
            own = math.copysign(1.0, beside)
            across = own * (c * (y - com[1]) - s * (x - com[0]) - planner.sides[foot])
            tighten(margins, math.atan2(-own * c, own * s), across)
        landing = horizon.flags[touchdown - 1].tolist()
        for other, (ox, oy) in enumerate(points):
            if other != foot:
                dx, dy = ox - x, oy - y
                clear = math.hypot(dx, dy) - planner.spacing
                tighten(margins, math.atan2(dy, dx), clear if landing[other] else 0.5 * clear)
        np.maximum(margins, 0.0, out=margins)
        return margins


@functools.lru_cache(maxsize=8)
def directions(count: int) -> Array:
    """Return (m, 2) evenly spaced unit vectors, the first along x; read-only."""
    normals = facet_normals(count)
    normals.flags.writeable = False
    return normals


def tighten(margins: Array, angle: float, distance: float) -> None:
    """Reduce margins (m,) so that no shift goes further than ``distance``, m, towards ``angle``, rad; at least to 0."""
    count = len(margins)
    sector = 2.0 * math.pi / count
    first, past = divmod(angle % (2.0 * math.pi), sector)
    j = int(first) % count
    weights = math.sin(sector - past) / math.sin(sector), math.sin(past) / math.sin(sector)
    most = max(distance, 0.0) / (weights[0] + weights[1])
    for k, weight in zip((j, (j + 1) % count), weights, strict=True):
        if weight > 1e-9:
            margins[k] = min(margins[k], most)
