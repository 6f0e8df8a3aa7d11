"""Boxes as ground: tens to hundreds of them behind one grid, so that a query looks at a few."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array, IntArray
from lgmpc.world.surfaces import SurfaceContacts

_STEEPEST = 0.1
"""Least vertical component of the normal of a box's top: 84 degrees."""
REACH = 0.15
"""Distances up to this one are exact, m; the grid of distances is made for it."""
_CELLS = 40_000
"""Most cells of a grid."""


@dataclass(frozen=True)
class Box:
    """A cuboid to stand on; its top is the face whose normal is its own z axis.

    Attributes:
        center: (3,) world, m.
        half_size: (3,) along its axes, m.
        rpy: roll, pitch, yaw of its axes in the world's, rad; its top points upward.
        coefficient: of Coulomb friction.

    Raises:
        InputError: a size is not positive and finite, or the top does not point upward.
    """

    center: tuple[float, float, float]
    half_size: tuple[float, float, float]
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    coefficient: float = 0.6

    def __post_init__(self) -> None:
        if not all(0.0 < each < math.inf for each in self.half_size):
            raise InputError("half_size", self.half_size, "three positive numbers, m")
        if not all(math.isfinite(each) for each in self.center):
            raise InputError("center", self.center, "three finite numbers, m")
        if not self.rotation[2, 2] > _STEEPEST:
            raise InputError("rpy", self.rpy, "angles, rad, with which the box's top points upward")

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) its axes as columns, world."""
        (sr, sp, sy), (cr, cp, cy) = ([f(angle) for angle in self.rpy] for f in (math.sin, math.cos))
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    @property
    def corners(self) -> Array:
        """(8, 3) world, m; the last four are those of its top."""
        signs = np.array([(x, y, z) for z in (-1.0, 1.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        return self.center + signs * self.half_size @ self.rotation.T


class Boxes:
    """The ground that boxes make together: of each point the highest top. Where there is none its height is -inf.

    Args:
        boxes: at least one.
    """

    def __init__(self, boxes: Sequence[Box]) -> None:
        self._center, self._half = np.array([each.center for each in boxes]), np.array([b.half_size for b in boxes])
        self._axes = np.array([each.rotation for each in boxes])
        self._normal = np.ascontiguousarray(self._axes[:, :, 2])
        self._coefficient = np.array([each.coefficient for each in boxes])
        self._top = self._center + self._half[:, 2:] * self._normal
        self._slope = -self._normal[:, :2] / self._normal[:, 2:]
        # A point of the plane in units of the top's half sides: it is on it where both are within [-1, 1].
        self._within = np.linalg.inv(self._axes[:, :2, :2]) / self._half[:, :2, None]
        corners = np.array([each.corners[:, :2] for each in boxes])
        self._low, self._high = corners.min(axis=1), corners.max(axis=1)
        tops = np.append(np.array([each.corners[:, 2].max() for each in boxes]), -np.inf)  # of no box, -1
        self._near_top, self._near = _Grid(self._low, self._high, 0.0), _Grid(self._low, self._high, REACH)

        self._ceiling = tops[self._near.table].max(axis=1)

    def height(self, points: Array) -> Array:
        """Return (n,) heights below points (n, 2), m."""
        return self._highest_box(points)[0]

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals of the tops, upward."""
        return self._normal[self._highest_box(points)[1]]

    def friction(self, points: Array) -> Array:
        """Return (n,) Coulomb coefficients."""
        return self._coefficient[self._highest_box(points)[1]]

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height of their tops along each segment between points (n, 2), m."""
        low, high = np.minimum(begin, end)[:, None], np.maximum(begin, end)[:, None]
        segment, box = np.nonzero(((low <= self._high) & (high >= self._low)).all(axis=2))
        start, along = begin[segment] - self._top[box, :2], (end - begin)[segment]
        first, rate = (np.einsum("kij,kj->ki", self._within[box], each) for each in (start, along))
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings = np.sort(np.stack([(-1.0 - first) / rate, (1.0 - first) / rate]), axis=0)
        parallel, inside = rate == 0.0, np.abs(first) <= 1.0
        enters = np.where(parallel, np.where(inside, 0.0, 2.0), crossings[0]).max(axis=1, initial=0.0)
        leaves = np.where(parallel, np.where(inside, 1.0, -1.0), crossings[1]).min(axis=1, initial=1.0)
        hit = enters <= leaves
        segment, box, start, along = segment[hit], box[hit], start[hit], along[hit]
        places = (start + each[hit, None] * along for each in (enters, leaves))
        rises = [np.sum(place * self._slope[box], axis=1) for place in places]
        found = np.full(len(begin), -np.inf)
        np.maximum.at(found, segment, self._top[box, 2] + np.maximum(*rises))
        return found

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3), m, and (n, 3) normals; inf farther away than 15 cm."""
        boxes = self._near(points[:, :2])
        distances, normals = self._distances(points[:, None], boxes)
        nearest, row = distances.argmin(axis=1), np.arange(len(points))
        return distances[row, nearest], normals[row, nearest]

    def contacts(self, points: Array, limit: Array) -> SurfaceContacts:
        """Return the contacts of points (n, 3) nearer than (n,) limits, of at most 15 cm, with single boxes."""
        cells = self._near.cells(points[:, :2])
        low = np.flatnonzero(points[:, 2] - self._ceiling[cells] < limit)
        boxes = self._near.table[cells[low]]
        distances, normals = self._distances(points[low, None], boxes)
        point, column = np.nonzero(distances < limit[low, None])
        friction = self._coefficient[boxes[point, column]]
        return SurfaceContacts(low[point], distances[point, column], normals[point, column], friction)

    def _highest_box(self, points: Array) -> tuple[Array, IntArray]:
        """Return (n,) heights and the box of each."""
        boxes = self._near_top(points)
        offset = points[:, None] - self._top[boxes, :2]
        inside = (np.abs(np.einsum("nkij,nkj->nki", self._within[boxes], offset)) <= 1.0 + 1e-12).all(axis=2)
        heights = self._top[boxes, 2] + (offset * self._slope[boxes]).sum(axis=2)
        heights = np.where(inside & (boxes >= 0), heights, -np.inf)
        best, row = heights.argmax(axis=1), np.arange(len(points))
        return heights[row, best], boxes[row, best]

    def _distances(self, points: Array, boxes: IntArray) -> tuple[Array, Array]:
        """Return the signed distances of points (n, 1, 3) from boxes (n, k), and the normals (n, k, 3)."""
        local = np.einsum("nkji,nkj->nki", self._axes[boxes], points - self._center[boxes])
        beyond = np.abs(local) - self._half[boxes]
        outside = np.maximum(beyond, 0.0)
        far, deepest = np.linalg.norm(outside, axis=2), beyond.max(axis=2)
        inside = far == 0.0
        # Inside, the way out is through the nearest face.
        direction = np.where(inside[..., None], beyond == deepest[..., None], outside)
        direction = direction * np.where(local < 0.0, -1.0, 1.0)
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        distances = np.where(boxes < 0, np.inf, np.where(inside, deepest, far))
        return distances, np.einsum("nkij,nkj->nki", self._axes[boxes], direction)


class _Grid:
    """The boxes whose outlines in the plane are at most ``reach`` from a cell, for every cell of a grid.

    Args:
        low: (b, 2) lower corners of the outlines, m.
        high: (b, 2) upper corners, m.
        reach: m.

    Attributes:
        table: (cells, k) numbers of the boxes near each cell; -1 fills the rows.
    """

    def __init__(self, low: Array, high: Array, reach: float) -> None:
        low, high = low - reach, high + reach
        self._origin, end = low.min(axis=0), high.max(axis=0)
        extent = end - self._origin
        self._cell = max(float(np.median(high - low)) / 3.0, math.sqrt(float(np.prod(extent)) / _CELLS))
        count = np.floor(extent / self._cell).astype(int) + 1
        # One more row and column on each side, without boxes, stand for all that is outside.
        lists: list[list[int]] = [[] for _ in range((count[0] + 2) * (count[1] + 2))]
        first, last = (np.floor((each - self._origin) / self._cell).astype(int) for each in (low, high))
        for box, (begin, stop) in enumerate(zip(first, last, strict=True)):
            for x in range(begin[0], min(stop[0], count[0] - 1) + 1):
                row = (x + 1) * (count[1] + 2) + 1
                for y in range(begin[1], min(stop[1], count[1] - 1) + 1):
                    lists[row + y].append(box)
        self._count, self._most = count, count + 1
        self.table = np.full((len(lists), max(len(each) for each in lists)), -1)
        for each, boxes in zip(self.table, lists, strict=True):
            each[: len(boxes)] = boxes

    def __call__(self, points: Array) -> IntArray:
        """Return (n, k) the boxes near points (n, 2); -1 fills the rows."""
        return self.table[self.cells(points)]

    def cells(self, points: Array) -> IntArray:
        """Return (n,) the rows of the table for points (n, 2)."""
        place = np.floor((points - self._origin) / self._cell).astype(int) + 1
        place = np.minimum(np.maximum(place, 0), self._most)
        return place[:, 0] * (self._count[1] + 2) + place[:, 1]
