"""Estimate of the friction coefficient: lower while a stance foot slides."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["FrictionMonitor"]


class FrictionMonitor:
    """Lowers the assumed friction coefficient while stance feet slide, and raises it again slowly.

    A controller that assumes more friction than there is commands forces that the floor cannot supply, estimates the
    difference as a push, and commands even more. Sliding shows it: while any stance foot's contact point moves
    sideways faster than ``sliding_speed``, the coefficient falls with time constant ``fall_time``; otherwise it rises
    towards ``nominal`` with ``rise_time``.

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
        rise_time: float = 5.0,
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
            if not (math.isfinite(value) and value > 0):
                raise InputError(name, value, "a positive number")
        self._nominal, self._least = nominal, min(least, nominal)
        self._sliding_speed_squared = sliding_speed**2
        self._fall = math.exp(-period / fall_time)
        self._rise = 1.0 - math.exp(-period / rise_time)
        self.coefficient = nominal

    def reset(self) -> None:
        """Return to the nominal coefficient."""
        self.coefficient = self._nominal

    def update(self, contact_velocities: Array, stance: Sequence[bool]) -> float:
        """Take the contact points' velocities (nc, 3), world axes, and return the new coefficient."""
        # Plain numbers: for a handful of feet they are faster than NumPy's calls.
        feet = zip(contact_velocities.tolist(), stance, strict=True)
        if any(stands and x * x + y * y > self._sliding_speed_squared for (x, y, _), stands in feet):
            self.coefficient = max(self._least, self._fall * self.coefficient)
        elif self.coefficient < self._nominal:
            self.coefficient += self._rise * (self._nominal - self.coefficient)
        return self.coefficient
