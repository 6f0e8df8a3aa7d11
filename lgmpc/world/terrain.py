"""Queries of the ground, the same for the truth and for what a controller believes."""

from typing import Protocol

from lgmpc.typing import Array, BoolArray


class Terrain(Protocol):
    """The ground below points (n, 2) of the world's horizontal plane, m; every query is one call for all points."""

    def height(self, points: Array) -> Array:
        """Return (n,) heights, m."""

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals, upward."""

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) whether a foot of ``radius``, m, stands on one surface there, away from its edges."""

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height of the ground along each segment from ``begin`` to ``end``, (n, 2), m."""
