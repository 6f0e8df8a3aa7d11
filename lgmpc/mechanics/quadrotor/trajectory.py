"""Trajectories of a quadrotor's flat outputs: position and heading with derivatives (chapter 4.12.3).

Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.checks import check_number, check_vector
from lgmpc.typing import Array

__all__ = ["FlatOutput", "Hover", "Lissajous", "FlatTrajectory"]


@dataclass(frozen=True)
class FlatOutput:
    """Position and heading at one time, with the derivatives that determine state and control.

    Attributes:
        position: (5, 3) position and its first four time derivatives, world axes, m/s^k.
        heading: (3, 3) direction onto which the body's x axis is projected, and two derivatives.
    """

    position: Array
    heading: Array


class FlatTrajectory(Protocol):
    """A reference trajectory."""

    def at(self, time: float) -> FlatOutput:
        """Return position and heading at a time, s."""


@dataclass(frozen=True)
class Hover:
    """A constant reference point.

    Attributes:
        point: (3,) m.
        heading: (3,) direction of the body's x axis.

    Raises:
        InputError: a vector of another shape or not finite, or no direction.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_vector("point", self.point, 3)
        if not check_vector("heading", self.heading, 3).any():
            raise InputError("heading", self.heading, "a direction")

    def at(self, time: float) -> FlatOutput:
        """Return the point at any time."""
        position, heading = np.zeros((5, 3)), np.zeros((3, 3))
        position[0], heading[0] = self.point, self.heading
        return FlatOutput(position, heading)


@dataclass(frozen=True)
class Lissajous:
    """Sinusoids along the axes, and a heading that turns at a constant rate.

    Attributes:
        amplitude: (3,) m.
        frequency: (3,) rad/s.
        phase: (3,) rad.
        yaw_rate: of the heading, rad/s.

    Raises:
        InputError: vectors of another shape, or a number that is not finite.
    """

    amplitude: tuple[float, float, float] = (1.0, 0.8, 0.4)
    frequency: tuple[float, float, float] = (1.5, 3.0, 2.0)
    phase: tuple[float, float, float] = (0.0, 0.5, 0.0)
    yaw_rate: float = 0.7

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency", "phase"):
            check_vector(name, getattr(self, name), 3)
        check_number("yaw_rate", self.yaw_rate, "rad/s")

    def at(self, time: float) -> FlatOutput:
        """Return position and heading; the k-th derivative of a sine leads it by k quarter turns."""
        size, rate = np.array(self.amplitude), np.array(self.frequency)
        orders = np.arange(5)[:, None]
        position = size * rate**orders * np.sin(rate * time + np.array(self.phase) + 0.5 * np.pi * orders)
        yaw = self.yaw_rate * time + 0.5 * np.pi * np.arange(3)
        heading = (self.yaw_rate ** np.arange(3))[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(3)])
        return FlatOutput(position, heading)
