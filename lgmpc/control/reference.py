"""Where the centre of mass should be, as a function of time: standing, and a circle while standing."""

from __future__ import annotations

from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from lgmpc.settings import NonNegative, Positive, Settings
from lgmpc.typing import Array

__all__ = ["CircleReference", "ComReference", "StandReference"]


class ComReference(Protocol):
    """A trajectory of the centre of mass relative to where it stood at the start."""

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset (n, 3) m, velocity (n, 3) m/s and acceleration (n, 3) m/s^2 at ``times`` (n,) s."""


class StandReference(Settings):
    """Stand still: the centre of mass stays where it was."""

    kind: Literal["stand"] = Field(default="stand", description="Stand still.")

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return zeros."""
        zero = np.zeros((len(times), 3))
        return zero, zero, zero


class CircleReference(Settings):
    """Move the centre of mass along a horizontal circle about the start while all feet stay.

    It is entered along a spiral whose radius grows smoothly.
    """

    kind: Literal["com_circle"] = Field(default="com_circle", description="Move the centre of mass along a circle.")
    radius_m: Annotated[Positive, Field(le=10.0)] = Field(
        default=0.03, description="Radius of the circle, m, at most 10: the feet stay."
    )
    frequency_hz: Annotated[Positive, Field(le=100.0)] = Field(
        default=0.5, description="Turns per second, Hz, at most 100."
    )
    start_s: NonNegative = Field(default=1.0, description="When the movement begins, s.")
    ramp_s: Annotated[Positive, Field(ge=1e-3)] = Field(
        default=1.0, description="Time over which the radius grows from 0, s, at least 0.001."
    )

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return offset, velocity and acceleration; all three are continuous (the radius is a quintic in time)."""
        omega = 2.0 * np.pi * self.frequency_hz
        elapsed = np.maximum(np.asarray(times) - self.start_s, 0.0)
        s = np.minimum(elapsed / self.ramp_s, 1.0)
        r = self.radius_m * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        dr = self.radius_m * 30.0 * s**2 * (1.0 - s) ** 2 / self.ramp_s
        ddr = self.radius_m * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / self.ramp_s**2
        phase = omega * elapsed
        radial = np.column_stack([np.cos(phase), np.sin(phase), np.zeros_like(phase)])
        tangential = np.column_stack([-np.sin(phase), np.cos(phase), np.zeros_like(phase)])
        offset = r[:, None] * radial
        velocity = dr[:, None] * radial + (r * omega)[:, None] * tangential
        acceleration = (ddr - r * omega**2)[:, None] * radial + (2.0 * omega * dr)[:, None] * tangential
        return offset, velocity, acceleration
