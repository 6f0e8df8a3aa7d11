"""The ground as a controller believes it to be: a plane through the last footholds, filtered.

A robot without a map knows the ground from its feet. The plane ``z = c + g . (p - m)`` that fits the last foothold of
every foot best (m, their mean) is the ground under the robot and for a step around it; its slope g is filtered, because
single steps on uneven ground tilt the fit. The height c follows at once: filtered, it would lag behind on a slope.

On blocks the fit tilts by chance with every step, and a base that follows throws the robot off its feet. A plane is
told from that by its residual: the more footholds of the last stride are off their plane, the slower the slope follows.

Footholds of a level floor differ by some millimetres in height, by what feet sink in and by errors of the estimate. A
plane within that is taken as level, exactly: its slope counts in full from twice the tilt on.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from lgmpc.locomotion.maps import MapSettings, NoMap
from lgmpc.robot.feet import UP
from lgmpc.settings import NonNegative, Positive, Settings, key
from lgmpc.typing import GRAVITY, Array, BoolArray

_PERIOD = 5e-3
"""Time between two fits, s: the feet that stand hardly move meanwhile."""
_RIDGE = 1e-6
"""Weight of a level plane in the fit, in units of the footholds' squared distances: decides where they lie in line."""
_UNEVEN_SHARE = 0.01
"""Residual of the fit at which the slope follows at half the speed, in heights of the centre of mass."""
_MEMORY_SHARE = 3.0
"""Time in which a residual is forgotten, about a stride, in units of sqrt(h / g)."""


class TerrainBeliefSettings(Settings):
    """The ground as a robot believes it to be: conclusions from its footholds, or a map."""

    filter_share: Positive = key(
        0.5,
        "Time constant of the slope, in units of the time in which a pendulum of the robot's height falls,"
        " sqrt(h / g).",
    )
    level_deg: Positive = key(0.75, "Tilt of the footholds' plane up to which the ground counts as level, degrees.")
    steepest_deg: float = Field(
        default=35.0, strict=True, gt=0.0, le=60.0, description="Largest slope of the plane, degrees."
    )
    map: MapSettings = key(NoMap(), "What the controller knows of the ground ahead.")
    edge_margin_m: NonNegative | None = key(
        None,
        "Distance of footholds on a map from edges, besides the foot's radius, m. null: a twentieth of the"
        " height of the centre of mass.",
    )


class TerrainBelief:
    """The plane through the last foothold of every foot.

    Args:
        feet: their number.
        height: of the standing robot's centre of mass above its feet, m.
        settings: see :class:`TerrainBeliefSettings`.

    Attributes:
        settings: as given.
        normal: (3,) unit normal of the surface, exactly vertical where the ground counts as level; a live view.
        normals: (feet, 3) unit normals of the surface at every foot; a live view.
        slope: rise of that surface per metre along the world's x and y.
        level: whether the ground counts as level.
        footholds: (nc, 3) last foothold of every foot, world, m.
    """

    def __init__(self, feet: int, height: float, settings: TerrainBeliefSettings | None = None) -> None:
        self.settings = s = TerrainBeliefSettings() if settings is None else settings
        self.normal = np.array(UP)
        self.normals = np.broadcast_to(self.normal, (feet, 3))
        self.slope, self.level = (0.0, 0.0), True
        self.footholds = np.zeros((feet, 3))
        self._tilt = (0.0, 0.0)  # slope of the filtered plane, before the test for level ground
        self._middle = (0.0, 0.0, 0.0)
        self._elapsed = 0.0
        self._flat, self._steepest = math.tan(math.radians(s.level_deg)), math.tan(math.radians(s.steepest_deg))
        self._fall_time, self._time_constant = (share * math.sqrt(height / GRAVITY) for share in (1.0, s.filter_share))
        self._even, self._unevenness = _UNEVEN_SHARE * height, 0.0

    def begin(self, points: Array, stance: BoolArray | None = None) -> None:
        """Begin with feet at ``points`` (nc, 3), m; those that do not stand are taken as level with the others."""
        self._elapsed = self._unevenness = 0.0
        self.footholds[...] = points
        if stance is not None and stance.any() and not stance.all():
            self.footholds[~stance, 2] = points[stance, 2].mean()
        self._fit(1.0)

    def update(self, elapsed: float, points: Array, stance: Sequence[bool]) -> None:
        """Take the contact points (nc, 3) of the feet that stand as their footholds; ``elapsed`` since the last, s.

        The plane follows every few milliseconds.
        """
        self._elapsed += elapsed
        if self._elapsed < _PERIOD:
            return
        if all(stance):
            self.footholds[...] = points
        else:
            for foot, stands in enumerate(stance):
                if stands:
                    self.footholds[foot] = points[foot]
        self._fit(min(self._elapsed / self._time_constant, 1.0))
        self._elapsed = 0.0

    def height_at(self, x: float, y: float) -> float:
        """Return the height of the ground at a point of the horizontal plane, m."""
        mx, my, mz = self._middle
        along_x, along_y = self.slope
        return mz + along_x * (x - mx) + along_y * (y - my)

    def carried(self, unevenness: float) -> BoolArray:
        """Return (nc,) which feet stand as soon as a robot is let down on its present footholds.

        All, if they are in one plane up to ``unevenness``, m; else those that are level with the lowest one.
        """
        (mx, my, mz), (gx, gy), points = self._middle, self._tilt, self.footholds
        deviations = points[:, 2] - mz - gx * (points[:, 0] - mx) - gy * (points[:, 1] - my)
        if np.abs(deviations).max() < unevenness:
            return np.ones(len(points), dtype=np.bool_)
        return points[:, 2] - points[:, 2].min() < unevenness

    def _fit(self, share: float) -> None:
        """Move the slope towards that of the plane that fits the footholds best: by ``share``, less if uneven."""
        points: list[list[float]] = self.footholds.tolist()
        count = len(points)
        mx, my, mz = (sum(each) / count for each in zip(*points, strict=True))
        xx = xy = yy = xz = yz = 0.0
        for x, y, z in points:
            x, y, z = x - mx, y - my, z - mz
            xx, xy, yy, xz, yz = xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z
        ridge = _RIDGE * (xx + yy)
        xx, yy = xx + ridge, yy + ridge
        determinant = xx * yy - xy * xy
        self._middle = (mx, my, mz)
        if determinant > 0.0:
            fx, fy = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
            squares = sum((z - mz - fx * (x - mx) - fy * (y - my)) ** 2 for x, y, z in points)
            forgotten = math.exp(-self._elapsed / (_MEMORY_SHARE * self._fall_time))
            self._unevenness = max(math.sqrt(squares / count), forgotten * self._unevenness)
            self._turn_to(fx, fy, share / (1.0 + (self._unevenness / self._even) ** 2))

    def _turn_to(self, fx: float, fy: float, share: float) -> None:
        """Move the slope by ``share`` towards (fx, fy)."""
        gx, gy = self._tilt
        gx, gy = gx + share * (fx - gx), gy + share * (fy - gy)
        steepness = math.hypot(gx, gy)
        if steepness > self._steepest:
            gx, gy = gx * self._steepest / steepness, gy * self._steepest / steepness
        self._tilt = (gx, gy)
        self._set_surface(gx, gy, steepness)

    def _set_surface(self, gx: float, gy: float, steepness: float) -> None:
        if steepness <= self._flat:
            if not self.level:
                self.slope, self.level = (0.0, 0.0), True
                self.normal[:] = UP
            return
        counted = min((steepness - self._flat) / self._flat, 1.0)
        self.slope, self.level = (counted * gx, counted * gy), False
        x, y = self.slope
        size = math.sqrt(1.0 + x * x + y * y)
        self.normal[:] = -x / size, -y / size, 1.0 / size
