"""The world of a run: its surfaces as one terrain, and where the robot starts on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError
from lgmpc.typing import Array, BoolArray
from lgmpc.world.surfaces import Plane, Surface

__all__ = ["World"]

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class World:
    """Surfaces with friction; the ground at a point is the highest surface there.

    Attributes:
        surfaces: at least one.
        start: (x, y) where the robot starts, m.
        start_yaw: its heading there, rad.

    Raises:
        InputError: there is no surface.
    """

    surfaces: tuple[Surface, ...] = (Plane(),)
    start: tuple[float, float] = (0.0, 0.0)
    start_yaw: float = 0.0

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise InputError("surfaces", "none", "at least one surface")

    def height(self, points: Array) -> Array:
        """Return (n,) heights of the ground below points (n, 2), m."""
        top: Array = self._heights(points).max(axis=0)
        return top

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals, upward."""
        return self._of_highest(points, [surface.normal(points) for surface in self.surfaces])

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""
        return self._of_highest(points, [surface.friction(points) for surface in self.surfaces])

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) whether a foot of ``radius``, m, stands on one surface there, away from its edges."""
        return self._of_highest(points, [surface.steppable(points, radius) for surface in self.surfaces])

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height of the ground along each segment from ``begin`` to ``end``, (n, 2), m."""
        top: Array = np.array([surface.highest(begin, end) for surface in self.surfaces]).max(axis=0)
        return top

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3) to the nearest surface, m, and (n, 3) its normals there."""
        found = [surface.distance(points) for surface in self.surfaces]
        if len(found) == 1:
            return found[0]
        distances, normals = np.array([each[0] for each in found]), np.array([each[1] for each in found])
        nearest, column = distances.argmin(axis=0), np.arange(len(points))
        return distances[nearest, column], normals[nearest, column]

    @property
    def start_pose(self) -> tuple[Array, Array]:
        """(3, 3) axes and (3,) point of the ground where the robot starts.

        The third axis is the ground's normal there, the first one lies above the start's heading.
        """
        at = np.array([self.start])
        point, normal = np.array([*self.start, float(self.height(at)[0])]), self.normal(at)[0]
        ahead = np.array([math.cos(self.start_yaw), math.sin(self.start_yaw), 0.0])
        ahead[2] = -(normal @ ahead) / normal[2]
        ahead /= np.linalg.norm(ahead)
        return np.column_stack([ahead, np.cross(normal, ahead), normal]), point

    def _heights(self, points: Array) -> Array:
        return np.array([surface.height(points) for surface in self.surfaces])

    def _of_highest(self, points: Array, values: list[NDArray[T]]) -> NDArray[T]:
        """Return of each point the value of the surface that is highest there."""
        if len(values) == 1:
            return values[0]
        chosen: NDArray[T] = np.array(values)[self._heights(points).argmax(axis=0), np.arange(len(points))]
        return chosen
