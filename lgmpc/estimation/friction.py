"""Estimate of the friction coefficient, from the forces under which stance feet slide."""

import math
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.estimation.checks import number
from lgmpc.robot.soles import FootPoints
from lgmpc.typing import Array

_LEAST_SHARE = 0.5
"""Share of the coefficient that one update leaves at least."""
_SMOOTHING = 0.002
"""Time constant, s, of the contact points' velocities: noise must not look like a slide."""

_FAST = 0.5
"""Speed, m/s, beyond which the slide of feet that have just landed is evidence too."""
_LOAD_SHARE = 0.65
"""Share of the load that these feet must carry together."""
_SINKING = 0.2
"""Square of the least ratio of speeds along the normal and along the surface of a foot that rolls off an edge."""
_LEAST_LOAD = 0.05
"""Share of all feet's load that a foot must carry: a force of little more than nothing has no direction."""


class FrictionMonitor:
    """Lowers the assumed friction coefficient where stance feet slide ever faster, and raises it again slowly.

    A controller that assumes more friction than there is commands forces that the floor cannot supply, estimates the
    difference as a push, and commands even more. Sliding shows it. A stance foot whose contact point moves along the
    surface faster than ``sliding_speed`` (smoothed over 2 ms), and ever faster, has been given a force outside the
    floor's cone: that force's slope bounds the coefficient from above, which is lowered to it at once (no further than
    by half, because a foot may also slide for other reasons), and falls with time constant ``fall_time`` besides. A
    foot that was faster before in the same slide proves nothing (one that bounces meets the ground fast, and comes to
    rest), nor does one that hardly carries, nor one of which the force is outside the cone on the ground along which
    it slides, but not on that believed. Feet that have just landed, or that bounce, count from 0.5 m/s on, and only if
    they carry most of the load: on ice they fly from under a trotting robot within 30 ms, one of two may have met an
    edge. While none slides, the coefficient rises towards ``nominal`` with ``rise_time``.

    Args:
        nominal: coefficient while no foot slides.
        period: time between two updates, s.
        sliding_speed: m/s.
        fall_time: s.
        rise_time: s.
        least: the coefficient never falls below this, nor below ``nominal`` if that is smaller.
        points: of the feet; None for feet of one point.

    Attributes:
        coefficient: the present estimate.

    Raises:
        InputError: an argument that is not positive.
    """

    def __init__(
        self, nominal: float, period: float, sliding_speed: float = 0.1, fall_time: float = 0.05,
        rise_time: float = 20.0, least: float = 0.1, points: FootPoints | None = None,
    ) -> None:  # fmt: skip
        names, values = ("nominal", "period"), (nominal, period, sliding_speed, fall_time, rise_time, least)
        for name, value in zip((*names, "sliding_speed", "fall_time", "rise_time", "least"), values, strict=True):
            number(name, value, "a positive number", above=0.0)
        self._nominal, self._least = nominal, min(least, nominal)
        self._points = None if points is None or points.single else points
        self._sliding_speed_squared = sliding_speed**2
        self._fall = math.exp(-period / fall_time)
        self._rise = 1.0 - math.exp(-period / rise_time)
        self._smoothing = np.array([1.0 - math.exp(-period / _SMOOTHING)])
        self._before: list[float] = []  # squared speeds: the largest of a slide so far
        self._allocate(1)
        self.coefficient = nominal

    def _allocate(self, contacts: int) -> None:
        """Make the buffers of so many contact points, and the call that smooths their velocities."""
        self._smoothed, self._measured, self._normals = np.zeros((3, contacts, 3))
        self._speeds = np.zeros((contacts, 2))
        self._run: Callable[[], int] = StageKernel.of(_slide).bind(
            contacts, smoothed=self._smoothed, measured=self._measured, normal=self._normals, share=self._smoothing,
            smoothed_next=self._smoothed, speeds=self._speeds,
        )  # fmt: skip

    def reset(self) -> None:
        """Return to the nominal coefficient."""
        self.coefficient, self._before = self._nominal, []

    def state(self) -> tuple[float, list[float], Array]:
        """Return a copy of the state: coefficient, squared speeds so far and velocities of the contact points."""
        return self.coefficient, self._before, self._smoothed.copy()

    def set_state(self, state: tuple[float, list[float], Array]) -> None:
        """Continue from another monitor's state."""
        self.coefficient, self._before, smoothed = state
        self._allocate(len(smoothed))
        self._smoothed[...] = smoothed

    def update(
        self, contact_velocities: Array, settled: Sequence[bool], forces: Array, normals: Array,
        stance: Sequence[bool] | None = None,
    ) -> float:  # fmt: skip
        """Return the new coefficient.

        Args:
            contact_velocities: (nc, 3) of the contact points, world axes, m/s.
            settled: (nc,) feet that have carried for a while.
            forces: (nc, 3) commanded since the last update, world axes, N.
            normals: (nc, 3) unit normals of the surfaces under the feet, world axes.
            stance: (nc,) feet that carry; those that are settled unless given.
        """
        before = self._before
        if not before or not math.isfinite(sum(before)):
            if len(contact_velocities) != len(self._smoothed):
                self._allocate(len(contact_velocities))
            self._smoothed[...] = 0.0
        self._measured[...] = contact_velocities
        self._normals[...] = normals
        self._run()
        patches, velocities, least = self._points, self._smoothed, self._sliding_speed_squared
        found = self._speeds if patches is None else np.minimum.reduceat(self._speeds, patches.starts)
        speeds, slides = found.T.tolist()
        if max(speeds) <= least:
            self._before = speeds
            if self.coefficient == self._nominal:
                return self.coefficient
        given, firsts = forces, list(range(len(forces)))
        carries = settled if stance is None else stance
        if patches is not None:
            firsts = patches.starts.tolist()
            forces, normals = patches.total(forces), normals[firsts]
            settled, velocities = [settled[i] for i in firsts], patches.mean(velocities)
            carries = [carries[i] for i in firsts]
        feet = zip(speeds, before or speeds, carries, strict=True)
        self._before = before = [max(now, last) if now > least and on else now for now, last, on in feet]
        sliding = [i for i, speed in enumerate(slides) if speed > least and settled[i]]
        landed = [i for i, speed in enumerate(slides) if speed > _FAST**2 and carries[i] and not settled[i]]
        faster: list[int] = []
        if sliding or landed:
            loads = np.einsum("ij,ij->i", forces, normals)
            total = loads.sum()
            sliding += landed if loads[landed].sum() > _LOAD_SHARE * total else []
            faster = [i for i in sliding if speeds[i] >= before[i] and loads[i] >= _LEAST_LOAD * total]
        if faster:
            parts = np.split(given, firsts[1:])
            slopes = [_slopes(*(rows[foot].tolist() for rows in (parts, normals, velocities))) for foot in faster]
            proven = [max(each) for each in slopes if not each[0] < self.coefficient <= each[1]]
            if proven:
                bound = max(min(proven), _LEAST_SHARE * self.coefficient)
                self.coefficient = max(self._least, self._fall * min(self.coefficient, bound))
        elif not sliding and self.coefficient < self._nominal:
            self.coefficient += self._rise * (self._nominal - self.coefficient)
        return self.coefficient


def _slide() -> ca.Function:
    """Return a contact point's smoothed velocity, and the squares of its part along the surface and of its slide."""
    smoothed, measured, normal, share = (ca.SX.sym(name, n) for name, n in zip("vmns", (3, 3, 3, 1), strict=True))
    velocity = smoothed + share * (measured - smoothed)
    (x, y, z), (a, b, c) = ca.vertsplit(velocity), ca.vertsplit(normal)
    out = a * x + b * y + c * z
    u, v, w = x - out * a, y - out * b, z - out * c
    along = u * u + v * v + w * w
    # A foot that rolls off an edge sinks as it slides, which is no evidence of friction.
    speeds = ca.vertcat(along, ca.if_else(out * out < _SINKING * along, along, 0.0))
    names = ["smoothed", "measured", "normal", "share"]
    return ca.Function(
        "foot_slide", [smoothed, measured, normal, share], [velocity, speeds], names, ["smoothed_next", "speeds"]
    )


def _slopes(
    forces: Sequence[Sequence[float]], normal: Sequence[float], velocity: Sequence[float]
) -> tuple[float, float]:
    """Return tangential over normal force of a foot that slides, infinite for forces that do not press.

    On the believed surface, and on the one nearest to it along which the foot moves.
    """
    out, square = (sum(a * b for a, b in zip(velocity, each, strict=True)) for each in (normal, velocity))
    along = [square * n - out * v for n, v in zip(normal, velocity, strict=True)]
    size = math.hypot(*along)
    return _slope(forces, normal), _slope(forces, [each / size for each in along])


def _slope(forces: Sequence[Sequence[float]], normal: Sequence[float]) -> float:
    """Return the sum of the tangential over that of the normal forces; infinite for forces that do not press."""
    (a, b, c), tangential, pressing = normal, 0.0, 0.0
    for x, y, z in forces:
        out = a * x + b * y + c * z
        tangential += math.hypot(x - out * a, y - out * b, z - out * c)
        pressing += out
    return tangential / pressing if pressing > 0.0 else math.inf
