"""The world of a run: its surfaces as one terrain, and where the robot starts on it."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError
from lgmpc.typing import Array, BoolArray, IntArray, instance
from lgmpc.world.boxes import REACH, Box, Boxes
from lgmpc.world.heights import HeightField
from lgmpc.world.surfaces import Plane, Softness, Surface, SurfaceContacts

T = TypeVar("T", bound=np.generic)

_UNEVEN = 0.2
"""Deviation from a plane, as a fraction of the foot's radius, up to which ground is flat enough to step on."""
_LEAST_UPWARD = 0.7
"""Vertical component of the normal below which ground is too steep to step on: 45 degrees."""
_DIRECTIONS = np.arange(16) * (2.0 * math.pi / 16)
_RINGS = np.concatenate([r * np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)]) for r in (0.5, 1.0)])
"""(k, 2) points of a disc of radius 1 where its ground is examined."""
_SHARP = 1e-3
"""Radius below which a sphere is a point, m."""
_FOLD = 1e-3
"""Share of their distance by which two contacts of a sphere differ at least, unless they are one: 2.6 degrees."""


@dataclass(frozen=True)
class World:
    """Surfaces with friction; the ground at a point is the highest surface there.

    Attributes:
        surfaces: at least one.
        start: (x, y) where the robot starts, m.
        start_yaw: its heading there, rad.
        soft: how it gives way, or None for hard ground.
        largest_step: height of the largest step that a robot has to climb or descend, m, and the key that sets it.

    Raises:
        InputError: there is no surface, or something else than one.
    """

    surfaces: tuple[Plane | Box | HeightField, ...] = (Plane(),)
    start: tuple[float, float] = (0.0, 0.0)
    start_yaw: float = 0.0
    soft: Softness | None = None
    largest_step: tuple[float, str] = (0.0, "")

    def __post_init__(self) -> None:
        instance("surfaces", self.surfaces, (tuple, list), "a Plane, Box or HeightField, or several")
        for each in self.surfaces:
            instance("surfaces", each, (Plane, Box, HeightField), "a Plane, Box or HeightField")
        if not self.surfaces:
            raise InputError("surfaces", "none", "at least one surface")

    @cached_property
    def layers(self) -> tuple[Surface, ...]:
        """The surfaces, all boxes as one."""
        boxes = [each for each in self.surfaces if isinstance(each, Box)]
        others = [each for each in self.surfaces if not isinstance(each, Box)]
        return (*others, Boxes(boxes)) if boxes else tuple(others)

    @property
    def planar(self) -> bool:
        """Whether the ground is a single plane."""
        return len(self.surfaces) == 1 and isinstance(self.surfaces[0], Plane)

    @property
    def level(self) -> bool:
        """Whether the ground is a single level plane."""
        return self.planar and isinstance(floor := self.surfaces[0], Plane) and floor.normal_vector[2] == 1.0

    def height(self, points: Array) -> Array:
        """Return (n,) heights of the ground below points (n, 2), m; -inf where there is none."""
        return self._heights(points).max(axis=0)

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals, upward."""
        return self._of_highest(points, [layer.normal(points) for layer in self.layers])

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""
        return self._of_highest(points, [layer.friction(points) for layer in self.layers])

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) whether a foot of ``radius``, m, stands there on flat ground, away from edges.

        The ground below the foot deviates by less than a fifth of the radius from its tangent plane, which is less
        steep than 45 degrees. It is examined at 32 points, so a corner may reach into the radius by 2 % of it.
        """
        if self.planar:
            return np.ones(len(points), dtype=np.bool_)
        height, normal = self.height(points), self.normal(points)
        around = radius * _RINGS
        found = self.height((points[:, None] + around).reshape(-1, 2)).reshape(len(points), -1)
        plane = height[:, None] - normal[:, :2] @ around.T / normal[:, 2:]
        with np.errstate(invalid="ignore"):  # where there is no ground
            flat = (np.abs(found - plane) < _UNEVEN * radius).all(axis=1)
        return flat & (normal[:, 2] > _LEAST_UPWARD)

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height of the ground along each segment from ``begin`` to ``end``, (n, 2), m."""
        return np.array([layer.highest(begin, end) for layer in self.layers]).max(axis=0)

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3) to the nearest surface, m, and (n, 3) its normals there.

        Distances from boxes are exact up to 15 cm; farther away the height above the ground is an upper bound.
        """
        found = [layer.distance(points) for layer in self.layers]
        if self.planar:
            return found[0]
        distances, normals = np.array([each[0] for each in found]), np.array([each[1] for each in found])
        nearest, column = distances.argmin(axis=0), np.arange(len(points))
        distance, normal = distances[nearest, column], normals[nearest, column]
        far = np.flatnonzero(distance > REACH)
        if far.size:
            below = points[far, 2] - self.height(points[far, :2])
            far, below = far[below < distance[far]], below[below < distance[far]]
            distance[far], normal[far] = below, self.normal(points[far, :2])
        return distance, normal

    def contacts(self, points: Array, radii: Array, margin: float) -> SurfaceContacts:
        """Return the contacts of spheres with all surfaces; of a seam between two only the nearer one.

        Args:
            points: (n, 3) centres, m.
            radii: (n,) m.
            margin: distance between sphere and surface below which there is a contact, m; with a radius at most 15 cm.
        """
        if self.planar:
            return self.layers[0].contacts(points, radii + margin)
        # A point that has sunk in is below the edges of seams: their sides are told from walls a little above it.
        lift, limit = np.zeros_like(points), radii + margin + np.where(radii < _SHARP, _SHARP, 0.0)
        found = [layer.contacts(points, limit) for layer in self.layers]
        near = np.unique(np.concatenate([each.sphere for each in found]))
        sharp = near[radii[near] < _SHARP]
        if sharp.size:
            lift[sharp] = _SHARP * self.distance(points[sharp])[1]
            found = [layer.contacts(points + lift, limit) for layer in self.layers]
        sphere = np.concatenate([each.sphere for each in found])
        order = np.argsort(sphere, kind="stable")
        columns = (np.concatenate(column)[order] for column in zip(*found, strict=True))
        sphere, distance, normal, friction = columns
        kept = ~_seams(sphere, distance, normal)
        sphere, distance, normal, friction = sphere[kept], distance[kept], normal[kept], friction[kept]
        return SurfaceContacts(sphere, distance - np.sum(lift[sphere] * normal, axis=1), normal, friction)

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
        return np.array([layer.height(points) for layer in self.layers])

    def _of_highest(self, points: Array, values: list[NDArray[T]]) -> NDArray[T]:
        """Return of each point the value of the layer that is highest there."""
        if len(values) == 1:
            return values[0]
        return np.array(values)[self._heights(points).argmax(axis=0), np.arange(len(points))]


def _seams(sphere: IntArray, distance: Array, normal: Array) -> BoolArray:
    """Return (k,) whether the point of a contact is on, or behind, the tangent plane of a nearer one of its sphere.

    Such a point is no corner of the ground: two boxes flush with each other have one face there. Contacts of a sphere
    follow each other.
    """
    behind = np.zeros(len(sphere), dtype=np.bool_)
    if not len(sphere):
        return behind
    for shift in range(1, int(np.bincount(sphere).max())):
        first, second = np.arange(len(sphere) - shift), np.arange(shift, len(sphere))
        same = sphere[first] == sphere[second]
        first, second = first[same], second[same]
        nearer = np.where(distance[first] <= distance[second], first, second)
        farther = first + second - nearer
        along = distance[farther] * np.sum(normal[first] * normal[second], axis=1)
        behind[farther[along >= (1.0 - _FOLD) * distance[nearer]]] = True
    return behind
