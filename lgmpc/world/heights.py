"""Ground given by heights on a grid: triangles between its points, as in MuJoCo.

In MuJoCo feet without a radius catch on the edges of triangles.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.world.surfaces import SurfaceContacts

_MOST = 4_000_000
"""Points of the largest field."""
_NEAR = 0.05
"""Height above the ground, m, up to which distances are those from the nearest triangle."""


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights on a regular grid along the world's axes; between three neighbours the ground is a triangle.

    Attributes:
        heights: (ny, nx) of the points, rows along y, m.
        cell: distance of the points along x and y, m.
        origin: (x, y) of the first point, m.
        coefficient: of Coulomb friction.

    Raises:
        InputError: there are fewer than two points each way, a height is not finite, or the cell is not positive.
    """

    heights: Array
    cell: float
    origin: tuple[float, float] = (0.0, 0.0)
    coefficient: float = 0.6

    def __post_init__(self) -> None:
        shape, expected = np.shape(self.heights), "two or more rows of two or more heights, m"
        if len(shape) != 2 or min(shape) < 2 or math.prod(shape) > _MOST:
            raise InputError("heights", f"an array of shape {shape}", f"{expected}, at most {_MOST} in all")
        bad = np.argwhere(~np.isfinite(self.heights))
        if len(bad):
            raise InputError(
                "heights", f"{len(bad)} not finite, the first in row {bad[0, 0]}, column {bad[0, 1]}", expected
            )
        if not 0.0 < self.cell < math.inf:
            raise InputError("cell", self.cell, "a positive number, m")

    @cached_property
    def corners(self) -> Array:
        """(2, 2) of the field: lower and upper (x, y), m."""
        rows, columns = self.heights.shape
        return np.array(
            [self.origin, (self.origin[0] + self.cell * (columns - 1), self.origin[1] + self.cell * (rows - 1))]
        )

    def height(self, points: Array) -> Array:
        """Return (n,) heights below points (n, 2), m; -inf beside the field."""
        return self._at(points)[0]

    def normal(self, points: Array) -> Array:
        """Return (n, 3) unit normals of the triangles, upward."""
        _, slope, _ = self._at(points)
        normals = np.column_stack([-slope, np.ones(len(points))])
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def friction(self, points: Array) -> Array:
        """Return (n,) the coefficient."""
        return np.full(len(points), self.coefficient)

    def highest(self, begin: Array, end: Array) -> Array:
        """Return (n,) the greatest height along each segment between points (n, 2), m, in steps of a quarter cell."""
        length = float(np.abs(end - begin).max(initial=0.0))
        share = np.linspace(0.0, 1.0, 2 + math.ceil(4.0 * length / self.cell))[:, None, None]
        points = (begin + share * (end - begin)).reshape(-1, 2)
        return self.height(points).reshape(len(share), -1).max(axis=0)

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return (n,) signed distances of points (n, 3), m, and (n, 3) normals; far above, heights above the ground."""
        height, slope, _ = self._at(points[:, :2])
        normals = np.column_stack([-slope, np.ones(len(points))])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        above = points[:, 2] - height
        distances = np.where(above < 0.0, above * normals[:, 2], above)
        found = self.contacts(points, np.full(len(points), _NEAR))
        order = np.argsort(-found.distance, kind="stable")  # the nearest of each point is written last
        distances[found.sphere[order]], normals[found.sphere[order]] = found.distance[order], found.normal[order]
        return distances, normals

    def contacts(self, points: Array, limit: Array) -> SurfaceContacts:
        """Return the contacts of points (n, 3) nearer than (n,) limits, with single triangles; below them with one."""
        height, slope, _ = self._at(points[:, :2])
        above, reach = points[:, 2] - height, float(limit.max(initial=0.0))
        steep = np.sqrt(1.0 + np.sum(slope**2, axis=1))
        sunk, near = np.flatnonzero(above <= 0.0), self._nearby(points, limit, above)
        cells = np.arange(-math.ceil(reach / self.cell), math.ceil(reach / self.cell) + 1)
        place = np.floor((points[near, :2] - self.origin) / self.cell).astype(int)
        column, row = (place[:, i, None, None] + shape for i, shape in ((0, cells), (1, cells[:, None])))
        rows, columns = self.heights.shape
        row, column = np.broadcast_arrays(row, column)
        inside = (row >= 0) & (row < rows - 1) & (column >= 0) & (column < columns - 1)
        i, j = np.clip(row, 0, rows - 2), np.clip(column, 0, columns - 2)
        corners = [self._points(i + dy, j + dx) for dy, dx in ((0, 0), (0, 1), (1, 1), (1, 0))]
        found = []
        for triangle in ((corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])):
            nearest = _nearest_on_triangle(points[near][:, None, None], *triangle)
            offset = points[near][:, None, None] - nearest
            distance = np.where(inside, np.linalg.norm(offset, axis=-1), np.inf)
            sphere, *cell = np.nonzero((distance < limit[near][:, None, None]) & (distance > 0.0))
            at = (sphere, *cell)
            found.append((near[sphere], distance[at], offset[at] / distance[at][:, None]))
        normals = np.column_stack([-slope[sunk], np.ones(len(sunk))]) / steep[sunk, None]
        found.append((sunk, above[sunk] / steep[sunk], normals))
        sphere, distances, directions = (np.concatenate(column) for column in zip(*found, strict=True))
        return SurfaceContacts(sphere, distances, directions, np.full(len(sphere), self.coefficient))

    def _nearby(self, points: Array, limit: Array, above: Array) -> IntArray:
        """Return the points above the ground, or beside it, whose distance from it may be below their limits."""
        low, high = self.corners
        beside = np.flatnonzero(np.isinf(above))
        if beside.size:
            outside = np.maximum(low - points[beside, :2], points[beside, :2] - high).max(axis=1)
            beside = beside[outside < limit[beside]]
            above = above.copy()
            above[beside] = points[beside, 2] - self._at(np.clip(points[beside, :2], low, high))[0]
        # The steepest triangle bounds the height of what is within the limit.
        return np.flatnonzero((above > 0.0) & (above < limit * self._steepest))

    @cached_property
    def _steepest(self) -> float:
        slopes = [np.abs(np.diff(self.heights, axis=axis)).max() / self.cell for axis in (0, 1)]
        return 1.0 + float(np.hypot(*slopes))

    def _points(self, row: IntArray, column: IntArray) -> Array:
        x, y = self.origin[0] + self.cell * column, self.origin[1] + self.cell * row
        return np.stack([x, y, self.heights[row, column]], axis=-1)

    def _at(self, points: Array) -> tuple[Array, Array, BoolArray]:
        """Return (n,) heights, (n, 2) slopes and whether points (n, 2) are on the field."""
        rows, columns = self.heights.shape
        place = (points - self.origin) / self.cell
        inside: BoolArray = np.all((place >= -1e-9) & (place <= [columns - 1 + 1e-9, rows - 1 + 1e-9]), axis=1)
        place = np.clip(place, 0.0, [columns - 1, rows - 1])
        corner = np.minimum(np.floor(place).astype(int), [columns - 2, rows - 2])
        (u, v), (j, i) = (place - corner).T, corner.T
        first, ahead, left, far = (self.heights[i + dy, j + dx] for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)))
        lower = v <= u  # the diagonal is that from the first corner
        along_x, along_y = np.where(lower, ahead - first, far - left), np.where(lower, far - ahead, left - first)
        heights: Array = np.where(inside, first + u * along_x + v * along_y, -np.inf)
        return heights, np.column_stack([along_x, along_y]) / self.cell, inside


def _nearest_on_triangle(points: Array, a: Array, b: Array, c: Array) -> Array:
    """Return (..., 3) the points of triangles that are nearest to points."""
    first, second, offset = b - a, c - a, points - a
    d00, d01, d11 = (np.sum(x * y, axis=-1) for x, y in ((first, first), (first, second), (second, second)))
    d20, d21 = np.sum(offset * first, axis=-1), np.sum(offset * second, axis=-1)
    area = d00 * d11 - d01 * d01
    v, w = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
    best: Array = a + v[..., None] * first + w[..., None] * second
    outside = (v < 0.0) | (w < 0.0) | (v + w > 1.0)
    shortest = np.where(outside, np.inf, 0.0)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        share = np.clip(np.sum((points - start) * edge, axis=-1) / np.sum(edge * edge, axis=-1), 0.0, 1.0)
        on = start + share[..., None] * edge
        distance = np.linalg.norm(points - on, axis=-1)
        nearer = distance < shortest
        best, shortest = np.where(nearer[..., None], on, best), np.where(nearer, distance, shortest)
    return best


def read_heights(file: str, key: str, white_m: float | None) -> Array:
    """Return (ny, nx) heights of a file, m: a picture, or an array (.npy).

    The upper edge of a picture is on the left, its left edge at the beginning.

    Args:
        file: its path.
        key: config key, for messages.
        white_m: height of white, m; black is 0.

    Raises:
        InputError: the file cannot be read, or a picture has no scale.
    """
    try:
        if Path(file).suffix == ".npy":
            return np.asarray(np.load(file, allow_pickle=False), dtype=np.float64)
        from PIL import Image

        with Image.open(file) as picture:
            grey = np.asarray(
                picture if picture.mode.startswith(("I", "F")) else picture.convert("L"), dtype=np.float64
            )
            largest = 65535.0 if picture.mode.startswith("I") else 255.0
    except (OSError, ValueError) as error:
        raise InputError(key, file, f"a picture (.png) or an array of numbers (.npy) ({error})") from error
    if white_m is None:
        raise InputError(key.replace(".file", ".white_m"), None, f"the height of white in {Path(file).name}, m")
    return grey[::-1] / largest * white_m
