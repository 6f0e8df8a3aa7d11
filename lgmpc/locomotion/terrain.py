"""The controller's model of the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lgmpc.typing import Array, BoolArray

__all__ = ["FlatGround", "Terrain"]


class Terrain(Protocol):
    """The ground at points (n, 2) of the world's horizontal plane."""

    def height(self, points: Array) -> Array:
        """Return (n,) heights, m."""

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals, upward."""

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""

    def steppable(self, points: Array) -> BoolArray:
        """Return (n,) flags of admissible footholds."""


@dataclass(frozen=True)
class FlatGround:
    """A horizontal plane on which every point is steppable.

    Attributes:
        level: its height, m.
        coefficient: of Coulomb friction.
    """

    level: float = 0.0
    coefficient: float = 0.6

    def height(self, points: Array) -> Array:
        """Return (n,) the level."""
        return np.full(len(points), self.level)

    def normal(self, points: Array) -> Array:
        """Return (n, 3) the vertical."""
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))

    def friction(self, points: Array) -> Array:
        """Return (n,) the coefficient."""
        return np.full(len(points), self.coefficient)

    def steppable(self, points: Array) -> BoolArray:
        """Return (n,) True."""
        return np.ones(len(points), dtype=np.bool_)
