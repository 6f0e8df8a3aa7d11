"""Maps of the ground that a controller may have: heights on a grid about the robot, known or seen.

Anything with the three methods of :class:`ElevationMap` serves, such as the bridge to a mapping system of one's own::

    class MyMap:
        def update(self, time, pose): ...  # called some 200 times a second with the base's pose
        def height(self, points): ...  # NaN where nothing is known
        def steppable(self, points, radius): ...  # lgmpc.locomotion.even(self.height, points, radius, 0.01) will do

``locomotion.terrain.map: {kind: own, use: my_module:MyMap}`` in a config gives it to the controller. The ground of a
simulated robot gets into a :class:`GridMap` by :class:`KnownMap`, or by :class:`SeenMap` from what its sensor sees.
"""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, Protocol, Union, runtime_checkable

import numpy as np
from pydantic import BeforeValidator, Field

from lgmpc.lie import quaternion
from lgmpc.settings import Extension, NonNegative, Positive, Settings, Vector3, key
from lgmpc.typing import Array, BoolArray

_HALF_WIDTH = 5.0  # of the grid, in heights of the centre of mass
_CELL_SHARE = 0.05  # of the height of the centre of mass
_STEEPEST = 1.0  # rise per metre
_UNEVEN_SHARE = 0.03  # of the height of the centre of mass
_NOISE_SHARE = 4.0  # of standard deviations: second differences of heights have 2.4 times their noise
_DIRECTIONS = np.arange(8) * (math.pi / 8.0)
_HALF_RINGS = np.concatenate([r * np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)]) for r in (0.5, 1.0)])


@runtime_checkable
class ElevationMap(Protocol):
    """A robot's map of the ground around it, in the frame of its state estimate."""

    def update(self, time: float, pose: Array) -> None:
        """Move on to ``time``, s, and the base's pose (7,): position, m, and quaternion x y z w."""

    def height(self, points: Array) -> Array:
        """Return (n,) heights of the ground at points (n, 2), m; NaN where it is not known."""

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) whether known, flat ground reaches ``radius``, m, around points (n, 2)."""


class NoMap(Settings):
    """The ground is known from touchdowns only."""

    kind: Literal["none"] = key("none", "No map: the ground is known from touchdowns only.")


class GridSettings(Settings):
    """Errors and resolution of a map."""

    resolution_m: Positive | None = key(
        None, "Distance of the heights, m. null: a twentieth of the height of the centre of mass."
    )
    noise_m: NonNegative = key(0.0, "Standard deviation of every height, m.")
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] | None = key(None, "Seed of errors; null: the run's.")


class KnownMapSettings(GridSettings):
    """The simulated ground, with errors."""

    kind: Literal["known"] = key("known", "The simulated ground, with errors.")
    offset_m: Vector3 = key((0.0, 0.0, 0.0), "Position of the map relative to the ground [x, y, z], m.")
    drift_m_per_m: NonNegative = key(0.0, "Growth of a horizontal offset in a random direction per way walked, m/m.")


class SeenMapSettings(GridSettings):
    """Ground that a simulated depth sensor has seen, put where the robot believed to be then."""

    kind: Literal["elevation"] = key("elevation", "What a simulated depth sensor has seen of the ground.")
    rate_hz: Positive = key(10.0, "Of the sensor, Hz.")
    range_m: Positive | None = key(None, "Longest distance seen, m; null: five times the height of the centre of mass.")
    above_m: NonNegative | None = key(None, "Its place above the base, m. null: half the height of the centre of mass.")


class OwnMapSettings(Extension):
    """A map of one's own."""

    kind: Literal["own"] = key("own", "A class with update, height and steppable; see lgmpc.locomotion.maps.")


def _by_name(value: Any) -> Any:
    return {"kind": value} if isinstance(value, str) else value


MapSettings = Annotated[
    Union[NoMap, KnownMapSettings, SeenMapSettings, OwnMapSettings],  # noqa: UP007
    Field(discriminator="kind"),
    BeforeValidator(_by_name),
]
"""Key ``locomotion.terrain.map``, told apart by ``kind``; the kind's name alone stands for its defaults."""


def even(height: Callable[[Array], Array], points: Array, radius: float, tolerance: float) -> BoolArray:
    """Return (n,) whether the ground around points (n, 2) is a plane less steep than 45 degrees, up to a tolerance.

    On a plane the heights of two opposite points of a circle have the mean of its centre.

    Args:
        height: of points (k, 2), m; NaN is not even.
        points: m.
        radius: of the ground to examine, at 32 points, m.
        tolerance: largest deviation, m.
    """
    around = radius * _HALF_RINGS
    places = points[:, None] + np.concatenate([around, -around, [[0.0, 0.0]]])
    found = height(places.reshape(-1, 2)).reshape(len(points), -1)
    count = len(around)
    ahead, behind, here = found[:, :count], found[:, count:-1], found[:, -1:]
    with np.errstate(invalid="ignore"):
        flat = np.abs(0.5 * (ahead + behind) - here) < tolerance
        gentle = np.abs(ahead - behind) < 2.0 * _STEEPEST * np.linalg.norm(around, axis=1)
    return (flat & gentle).all(axis=1)


class GridMap:
    """Heights on a square grid along the world's axes that moves with the robot, bilinear between its points.

    Args:
        cell: distance of the grid's points, m.
        half_width: of the grid, m.
        tolerance: unevenness up to which ground is steppable, m.

    Attributes:
        heights: (n, n) of the points, rows along x, m; NaN where nothing is known. After a change of single values,
            call :meth:`changed`.
        cell: m.
        tolerance: m.
    """

    def __init__(self, cell: float, half_width: float, tolerance: float) -> None:
        self.cell, self.tolerance = cell, tolerance
        count = 2 * math.ceil(half_width / cell) + 1
        self.heights = np.full((count, count), np.nan)
        self._corner = np.zeros(2, dtype=np.int64)  # of the first point, in cells
        self._slack = count // 8
        self._placed = False
        self._steppable: dict[int, BoolArray] = {}

    @property
    def points(self) -> Array:
        """(n, n, 2) places of the heights, world, m."""
        axes = [self.cell * (first + np.arange(len(self.heights))) for first in self._corner]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def changed(self) -> None:
        """Take notice of heights that were changed."""
        self._steppable.clear()

    def centre(self, x: float, y: float) -> bool:
        """Move the grid if the robot at (x, y), m, has moved far from its middle; return whether it did."""
        count = len(self.heights)
        shift = np.round(np.array([x, y]) / self.cell).astype(np.int64) - count // 2 - self._corner
        if self._placed and np.abs(shift).max() <= self._slack:
            return False
        old, self.heights = self.heights, np.full((count, count), np.nan)
        if np.abs(shift).max() < count and self._placed:
            to, of = ([slice(max(sign * s, 0), count + min(sign * s, 0)) for s in shift.tolist()] for sign in (-1, 1))
            self.heights[tuple(to)] = old[tuple(of)]
        self._corner = self._corner + shift
        self._placed = True
        self.changed()
        return True

    def height(self, points: Array) -> Array:
        """Return (n,) heights at points (n, 2), m; NaN where one of the four heights around is not known."""
        x, y = points.T / self.cell - self._corner[:, None]
        h, count = self.heights.reshape(-1), len(self.heights)
        i, j = x.astype(np.int64), y.astype(np.int64)
        inside = (x >= 0.0) & (x < count - 1) & (y >= 0.0) & (y < count - 1)
        first, u, v = np.where(inside, count * i + j, 0), x - i, y - j
        near = (1.0 - v) * h[first] + v * h[first + 1]
        far = (1.0 - v) * h[first + count] + v * h[first + count + 1]
        return np.where(inside, (1.0 - u) * near + u * far, np.nan)

    def steppable(self, points: Array, radius: float) -> BoolArray:
        """Return (n,) whether the points of the grid within ``radius``, m, of its point nearest to each are in a plane.

        Planes are as in :func:`even`.
        """
        reach = math.ceil(radius / self.cell - 1e-9)
        if reach not in self._steppable:
            self._steppable[reach] = self._even(reach)
        i, j = np.round(points.T / self.cell).astype(np.int64) - self._corner[:, None]
        count = len(self.heights)
        inside = (i >= 0) & (i < count) & (j >= 0) & (j < count)
        return inside & self._steppable[reach].reshape(-1)[np.where(inside, count * i + j, 0)]

    def _even(self, reach: int) -> BoolArray:
        """Return (n, n) which points are the middles of planes with a radius of so many cells."""
        count, result = len(self.heights), np.zeros(self.heights.shape, dtype=np.bool_)
        inner = result[reach : count - reach, reach : count - reach]
        inner[...] = True
        here = self.heights[reach : count - reach, reach : count - reach]
        steps = [(a, b) for a in range(reach + 1) for b in range(-reach, reach + 1) if (a > 0 or b > 0)]

        def moved(a: int, b: int) -> Array:
            return self.heights[reach + a : count - reach + a, reach + b : count - reach + b]

        with np.errstate(invalid="ignore"):
            for a, b in steps:
                distance = math.hypot(a, b)
                if distance <= reach:
                    ahead, behind = moved(a, b), moved(-a, -b)
                    inner &= np.abs(0.5 * (ahead + behind) - here) < self.tolerance
                    inner &= np.abs(ahead - behind) < 2.0 * _STEEPEST * distance * self.cell
        return result


class KnownMap(GridMap):
    """The true heights about the robot, displaced and with noise.

    Args:
        truth: true heights of points (n, 2), m.
        settings: of errors and resolution.
        height: of the robot's centre of mass above its feet, m.
        rng: of the errors.
    """

    def __init__(
        self, truth: Callable[[Array], Array], settings: KnownMapSettings, height: float, rng: np.random.Generator
    ) -> None:
        cell = _CELL_SHARE * height if settings.resolution_m is None else settings.resolution_m
        super().__init__(cell, _HALF_WIDTH * height, _UNEVEN_SHARE * height + _NOISE_SHARE * settings.noise_m)
        self._truth, self._rng, self._noise = truth, rng, settings.noise_m
        self._offset, self._drift = np.array(settings.offset_m), settings.drift_m_per_m
        angle = rng.uniform(0.0, 2.0 * math.pi)
        self._direction = np.array([math.cos(angle), math.sin(angle)])
        self._last: Array | None = None
        self._way = 0.0

    def update(self, time: float, pose: Array) -> None:
        """Fill what comes into the range of the grid."""
        at = np.array(pose[:2])
        self._way += 0.0 if self._last is None else float(np.linalg.norm(at - self._last))
        self._last = at
        if self.centre(float(at[0]), float(at[1])):
            new = np.isnan(self.heights)
            places = self.points[new] - self._offset[:2] - self._drift * self._way * self._direction
            heights = self._truth(places) + self._offset[2]
            self.heights[new] = heights + self._noise * self._rng.normal(size=len(heights))


class SeenMap(GridMap):
    """Heights of what a depth sensor has seen; the latest view of a place counts.

    Args:
        scan: returns points (k, 3) seen now, in axes at the base's origin, m.
        settings: of rate and resolution.
        height: of the robot's centre of mass above its feet, m.
    """

    def __init__(self, scan: Callable[[], Array], settings: SeenMapSettings, height: float) -> None:
        cell = _CELL_SHARE * height if settings.resolution_m is None else settings.resolution_m
        super().__init__(cell, _HALF_WIDTH * height, _UNEVEN_SHARE * height + _NOISE_SHARE * settings.noise_m)
        self._scan, self._period, self._due = scan, 1.0 / settings.rate_hz, -math.inf

    def update(self, time: float, pose: Array) -> None:
        """Take a view if it is time to."""
        if time < self._due - 1e-9:
            return
        self._due = time + self._period
        self.centre(float(pose[0]), float(pose[1]))
        seen = self._scan() @ quaternion.to_matrix(pose[3:7]).T + pose[:3]
        place = np.round(seen[:, :2] / self.cell).astype(np.int64) - self._corner
        count = len(self.heights)
        inside = ((place >= 0) & (place < count)).all(axis=1)
        cells, heights = place[inside] @ [count, 1], seen[inside, 2]
        number = np.bincount(cells, minlength=count * count)
        hit = number > 0
        means = np.bincount(cells, heights, count * count)[hit] / number[hit]
        self.heights.reshape(-1)[hit] = means
        self._fill()
        self.changed()

    def _fill(self) -> None:
        """Give cells between known ones that the rays missed the mean of their neighbours."""
        h = self.heights
        inner = h[1:-1, 1:-1]
        around = np.stack(
            [h[1 + a : len(h) - 1 + a, 1 + b : len(h) - 1 + b] for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        )
        known = ~np.isnan(around)
        missed = np.isnan(inner) & ((known[0] & known[1]) | (known[2] & known[3]))
        inner[missed] = np.nansum(around, axis=0)[missed] / known.sum(axis=0)[missed]
