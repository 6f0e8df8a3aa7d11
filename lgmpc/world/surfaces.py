"""Planes, the queries that all surfaces of a world answer, and those of the ground, the true or the believed one."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.settings import NonNegative, Positive, Settings, key
from lgmpc.typing import Array, BoolArray, IntArray

_STEEPEST = 0.1
"""Least vertical component of a plane's normal: 84 degrees."""


class Softness(Settings):
    """Ground that gives way under a contact point as a spring with a damper beside it."""

    stiffness_n_m: Annotated[Positive, Field(ge=100.0, le=1e6)] = key(
        2000.0, "Force of one contact point, N, by its depth, m."
    )
    damping_ns_m: Annotated[NonNegative, Field(le=1e4)] = key(
        30.0, "Force of one contact point, N, by the speed at which it sinks in or comes out, m/s."
    )


class SurfaceContacts(NamedTuple):
    """Pairs of a sphere and a surface that are near each other, (k,) of them.

    Attributes:
        sphere: number of the sphere.
        distance: (k,) signed distances of the spheres' centres, m.
        normal: (k, 3) unit normals, from the surface to the centre.
        friction: (k,) Coulomb coefficients.
    """

    sphere: IntArray
    distance: Array
    normal: Array
    friction: Array


class Surface(Protocol):
    """One layer of the ground; -inf is the height where it has none."""

    def height(self, points: Array) -> Array:
        """Return (n,) heights below points (n, 2), m."""

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals, upward."""

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height along each segment from ``begin`` to ``end``, (n, 2), m."""

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3), negative below, m, and (n, 3) the normals there."""

    def contacts(self, points: Array, limit: Array) -> SurfaceContacts:
        """Return the contacts of points (n, 3) nearer than (n,) limits, of at most 15 cm."""


@dataclass(frozen=True)
class Plane:
    """An unbounded plane on which every point is steppable.

    Attributes:
        point: (3,) a point of it, world, m.
        normal_vector: (3,) unit normal, upward.
        coefficient: of Coulomb friction.

    Raises:
        InputError: the normal is not a finite vector of unit length that points upward.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal_vector: tuple[float, float, float] = (0.0, 0.0, 1.0)
    coefficient: float = 0.6

    def __post_init__(self) -> None:
        normal = np.array(self.normal_vector, dtype=np.float64)
        if normal.shape != (3,) or not abs(float(normal @ normal) - 1.0) < 1e-9 or not normal[2] > _STEEPEST:
            raise InputError("normal_vector", self.normal_vector, "a unit vector that points upward")

    @cached_property
    def slope(self) -> tuple[float, float]:
        """Rise of the plane per metre along the world's x and y."""
        x, y, z = self.normal_vector
        return -x / z, -y / z

    @property
    def level(self) -> bool:
        """Whether the plane is horizontal."""
        return self.normal_vector[0] == 0.0 and self.normal_vector[1] == 0.0

    def height(self, points: Array) -> Array:
        """Return (n,) heights below points (n, 2), m."""
        (x, y, z), (along_x, along_y) = self.point, self.slope
        return z + along_x * (points[:, 0] - x) + along_y * (points[:, 1] - y)

    def normal(self, points: Array) -> Array:
        """Return (n, 3) the normal."""
        normals = np.empty((len(points), 3))
        normals[:] = self.normal_vector  # faster than np.tile
        return normals

    def friction(self, points: Array) -> Array:
        """Return (n,) the coefficient."""
        return np.full(len(points), self.coefficient)

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) True."""
        return np.ones(len(points), dtype=np.bool_)

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the height at the higher end of each segment, m."""
        return np.maximum(self.height(begin), self.height(end))

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3), m, and (n, 3) the normal."""
        x, y, z = self.normal_vector
        at = self.point
        distance: Array = x * (points[:, 0] - at[0]) + y * (points[:, 1] - at[1]) + z * (points[:, 2] - at[2])
        return distance, self.normal(points)

    def contacts(self, points: Array, limit: Array) -> SurfaceContacts:
        """Return the contacts of points (n, 3) nearer than (n,) limits."""
        distance, normals = self.distance(points)
        near = np.flatnonzero(distance < limit)
        return SurfaceContacts(near, distance[near], normals[near], np.full(len(near), self.coefficient))


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
