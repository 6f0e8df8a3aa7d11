"""Where the centre of mass should be, as a function of time: standing, and a circle while standing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["CircleReference", "ComReference", "StandReference"]


class ComReference(Protocol):
    """A trajectory of the centre of mass relative to where it stood at the start."""

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset (n, 3) m, velocity (n, 3) m/s and acceleration (n, 3) m/s^2 at ``times`` (n,) s."""


@dataclass(frozen=True)
class StandReference:
    """The centre of mass stays where it was."""

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return zeros."""
        zero = np.zeros((len(times), 3))
        return zero, zero, zero


@dataclass(frozen=True)
class CircleReference:
    """A horizontal circle about the start, entered along a spiral whose radius grows smoothly.

    Attributes:
        radius: m.
        frequency: turns per second, Hz.
        start: when the motion begins, s.
        ramp: how long the radius takes to grow from zero, s.
    """

    radius: float
    frequency: float
    start: float = 0.5
    ramp: float = 2.0

    def __post_init__(self) -> None:
        """Refuse a circle that is none."""
        for name in ("radius", "frequency", "ramp"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(name, value, "a positive number")
        if not np.isfinite(self.start):
            raise InputError("start", self.start, "a finite number of seconds")

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset, velocity and acceleration; all three are continuous (the radius is a quintic in time)."""
        omega = 2.0 * np.pi * self.frequency
        elapsed = np.maximum(np.asarray(times) - self.start, 0.0)
        s = np.minimum(elapsed / self.ramp, 1.0)
        r = self.radius * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        dr = self.radius * 30.0 * s**2 * (1.0 - s) ** 2 / self.ramp
        ddr = self.radius * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / self.ramp**2
        phase = omega * elapsed
        radial = np.column_stack([np.cos(phase), np.sin(phase), np.zeros_like(phase)])
        tangential = np.column_stack([-np.sin(phase), np.cos(phase), np.zeros_like(phase)])
        offset = r[:, None] * radial
        velocity = dr[:, None] * radial + (r * omega)[:, None] * tangential
        acceleration = (ddr - r * omega**2)[:, None] * radial + (2.0 * omega * dr)[:, None] * tangential
        return offset, velocity, acceleration
