"""Estimate of the friction coefficient, from the forces under which stance feet slide."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lgmpc.estimation.checks import number
from lgmpc.typing import Array

__all__ = ["FrictionMonitor"]

_LEAST_SHARE = 0.5
"""Share of the coefficient that one update leaves at least."""
_SMOOTHING = 0.002
"""Time constant, s, of the contact points' velocities: noise must not look like a slide."""

_SINKING = 0.2
"""Square of the least ratio of speeds along the normal and along the surface of a foot that rolls off an edge."""


class FrictionMonitor:
    """Lowers the assumed friction coefficient where stance feet slide ever faster, and raises it again slowly.

    A controller that assumes more friction than there is commands forces that the floor cannot supply, estimates the
    difference as a push, and commands even more. Sliding shows it. A stance foot whose contact point moves along the
    surface faster than ``sliding_speed`` (smoothed over 2 ms), and ever faster, has been given a force outside the
    floor's cone: that force's slope bounds the coefficient from above, which is lowered to it at once (no further than
    by half, because a foot may also slide for other reasons), and falls with time constant ``fall_time`` besides. A
    foot that slows down proves nothing. While none slides, the coefficient rises towards ``nominal`` with
    ``rise_time``.

    Args:
        nominal: coefficient while no foot slides.
        period: time between two updates, s.
        sliding_speed: m/s.
        fall_time: s.
        rise_time: s.
        least: the coefficient never falls below this, nor below ``nominal`` if that is smaller.

    Attributes:
        coefficient: the present estimate.

    Raises:
        InputError: an argument that is not positive.
    """

    def __init__(
        self,
        nominal: float,
        period: float,
        sliding_speed: float = 0.1,
        fall_time: float = 0.05,
        rise_time: float = 20.0,
        least: float = 0.1,
    ) -> None:
        numbers = {
            "nominal": nominal,
            "period": period,
            "sliding_speed": sliding_speed,
            "fall_time": fall_time,
            "rise_time": rise_time,
            "least": least,
        }
        for name, value in numbers.items():
            number(name, value, "a positive number", above=0.0)
        self._nominal, self._least = nominal, min(least, nominal)
        self._sliding_speed_squared = sliding_speed**2
        self._fall = math.exp(-period / fall_time)
        self._rise = 1.0 - math.exp(-period / rise_time)
        self._speeds_squared: list[float] = []
        self._smoothing = 1.0 - math.exp(-period / _SMOOTHING)
        self._velocities: list[tuple[float, float, float]] = []
        self.coefficient = nominal

    def reset(self) -> None:
        """Return to the nominal coefficient."""
        self.coefficient = self._nominal
        self._speeds_squared.clear()
        self._velocities.clear()

    def state(self) -> tuple[float, list[float], list[tuple[float, float, float]]]:
        """Return a copy of the state: coefficient, squared speeds and velocities of the contact points."""
        return self.coefficient, list(self._speeds_squared), list(self._velocities)

    def set_state(self, state: tuple[float, list[float], list[tuple[float, float, float]]]) -> None:
        """Continue from another monitor's state."""
        self.coefficient, self._speeds_squared, self._velocities = state

    def update(self, contact_velocities: Array, stance: Sequence[bool], forces: Array, normals: Array) -> float:
        """Return the new coefficient.

        Args:
            contact_velocities: (nc, 3) of the contact points, world axes, m/s.
            stance: (nc,) feet whose sliding is evidence.
            forces: (nc, 3) commanded since the last update, world axes, N.
            normals: (nc, 3) unit normals of the surfaces under the feet, world axes.
        """
        # Plain numbers: for a handful of feet they are faster than NumPy's calls.
        measured: list[list[float]] = contact_velocities.tolist()
        velocities, share = self._velocities, self._smoothing
        if not (velocities and math.isfinite(sum(self._speeds_squared))):
            velocities = [(0.0, 0.0, 0.0)] * len(measured)
        smoothed, speeds = [], []
        for (x, y, z), (vx, vy, vz), (a, b, c) in zip(velocities, measured, normals.tolist(), strict=True):
            x, y, z = x + share * (vx - x), y + share * (vy - y), z + share * (vz - z)
            smoothed.append((x, y, z))
            out = a * x + b * y + c * z
            u, v, w = x - out * a, y - out * b, z - out * c
            along = u * u + v * v + w * w
            # A foot that rolls off an edge sinks as it slides, which is no evidence of friction.
            speeds.append(along if out * out < _SINKING * along else 0.0)
        before, least = self._speeds_squared or speeds, self._sliding_speed_squared
        self._velocities, self._speeds_squared = smoothed, speeds
        sliding = [foot for foot, speed in enumerate(speeds) if speed > least and stance[foot]]
        faster = [foot for foot in sliding if speeds[foot] >= before[foot]]
        if faster:
            slopes = [_slope(*pair) for pair in zip(forces[faster].tolist(), normals[faster].tolist(), strict=True)]
            bound = max(min(slopes), _LEAST_SHARE * self.coefficient)
            self.coefficient = max(self._least, self._fall * min(self.coefficient, bound))
        elif not sliding and self.coefficient < self._nominal:
            self.coefficient += self._rise * (self._nominal - self.coefficient)
        return self.coefficient


def _slope(force: Sequence[float], normal: Sequence[float]) -> float:
    """Return tangential over normal force; infinite for a force that does not press."""
    (x, y, z), (a, b, c) = force, normal
    out = a * x + b * y + c * z
    return math.hypot(x - out * a, y - out * b, z - out * c) / out if out > 0.0 else math.inf
