"""The ground as a controller believes it to be: a plane through the last footholds, filtered.

A robot without a map knows the ground from its feet. The plane ``z = c + g . (p - m)`` that fits the last foothold of
every foot best (m, their mean) is the ground under the robot and for a step around it; its slope g is filtered, because
single steps on uneven ground tilt the fit. The height c follows at once: filtered, it would lag behind on a slope.

On blocks the fit tilts by chance with every step, and a base that follows throws the robot off its feet. A plane is
told from that by its residual: the more footholds of the last stride are off their plane, the slower the slope follows.

At the foot and the crest of a ramp a robot stands on two planes. Where footholds are off the one plane, heights of the
next footholds and normals of the feet are those of a line through the last two footholds of every foot along the way,
those nearby first: expected on the one plane, feet strike the ramp in the middle of their swing, and slide.

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
_NEAR_SHARE = 0.5
"""Distance within which footholds tell of the ground at a point, in heights of the centre of mass."""
_STEP_SHARE = 0.05
"""Least length of a step, in heights of the centre of mass: a foot whose contact is lost for a moment did not step."""
_DOUBT = 0.01
"""Weight of the plane's slope against that of the footholds near a point, in footholds at that distance."""


class TerrainBeliefSettings(Settings):
    """The ground as a robot believes it to be: conclusions from its footholds, or a map."""

    filter_share: Positive = key(
        0.5,
        "Time constant of the slope, in units of the time in which a pendulum of the robot's height falls,"
        " sqrt(h / g).",
    )
    level_deg: Positive = key(0.75, "Tilt of the footholds' plane up to which the ground counts as level, degrees.")
    steepest_deg: float = Field(default=35.0, strict=True, gt=0.0, le=60.0, description="Largest slope, degrees.")
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
        normal: (3,) unit normal of the plane, exactly vertical where the ground counts as level; a live view.
        normals: (feet, 3) unit normals of the ground at :attr:`places`; a live view.
        places: (feet, 3) where each foot stands or will, m: a live view; None for feet that see the one plane only.
        bends: (feet, 2) by how much more the ground rises at those places than the plane, along the world's x and y.
        slope: rise of the plane per metre along the world's x and y.
        level: whether the ground counts as level.
        upright: whether the base stays upright on a slope: over stairs on soles.
        footholds: (nc, 3) last foothold of every foot, world, m.
    """

    def __init__(self, feet: int, height: float, settings: TerrainBeliefSettings | None = None) -> None:
        self.settings = s = TerrainBeliefSettings() if settings is None else settings
        self.normal = np.array(UP)
        self.normals = np.tile(self.normal, (feet, 1))
        self.places: Array | None = None
        self.slope, self.level, self.upright = (0.0, 0.0), True, False
        self.footholds = np.zeros((feet, 3))
        self._tilt = (0.0, 0.0)  # slope of the filtered plane, before the test for level ground
        self._middle = (0.0, 0.0, 0.0)
        self._elapsed = 0.0
        self._flat, self._steepest = math.tan(math.radians(s.level_deg)), math.tan(math.radians(s.steepest_deg))
        self._fall_time, self._time_constant = (share * math.sqrt(height / GRAVITY) for share in (1.0, s.filter_share))
        self._even, self._unevenness, self._height = _UNEVEN_SHARE * height, 0.0, height
        self._step = _STEP_SHARE * height
        self._before, self._stood, self._bent, self.bends = np.zeros((feet, 3)), [True] * feet, 0.0, np.zeros((feet, 2))
        self._way, self._off = (1.0, 0.0), [(0.0, 0.0)]

    def begin(self, points: Array, stance: BoolArray | None = None) -> None:
        """Begin with feet at ``points`` (nc, 3), m; those that do not stand are taken as level with the others."""
        self._elapsed = self._unevenness = self._bent = 0.0
        self.footholds[...] = points
        if stance is not None and stance.any() and not stance.all():
            self.footholds[~stance, 2] = points[stance, 2].mean()
        self._before[...], self.bends[...] = self.footholds, 0.0
        self._fit(1.0)
        self.normals[...] = self.normal

    def update(self, elapsed: float, points: Array, stance: Sequence[bool]) -> None:
        """Take the contact points (nc, 3) of the feet that stand as their footholds; ``elapsed`` since the last, s.

        The plane follows every few milliseconds.
        """
        self._elapsed += elapsed
        if self._elapsed < _PERIOD:
            return
        for foot, (stands, stood) in enumerate(zip(stance, self._stood, strict=True)):
            if stands:
                if not stood and math.dist(points[foot], self.footholds[foot]) > self._step:
                    self._before[foot] = self.footholds[foot]
                self.footholds[foot] = points[foot]
        self._stood = list(stance)
        share = min(self._elapsed / self._time_constant, 1.0)
        self._fit(share)
        self._bend(share)
        self._elapsed = 0.0

    def plane_at(self, x: float, y: float) -> float:
        """Return the height of the plane at a point of the horizontal plane, m."""
        mx, my, mz = self._middle
        along_x, along_y = self.slope
        return mz + along_x * (x - mx) + along_y * (y - my)

    def height_at(self, x: float, y: float) -> float:
        """Return the height of the ground at a point, m: by the footholds near it where they are off the plane."""
        return self.plane_at(x, y) + (self._bent * self._off_plane(x, y)[0] if self._bent else 0.0)

    def _bend(self, share: float) -> None:
        """Turn the normals at :attr:`places` by ``share`` to those of the ground there, unless the plane is all."""
        if self.places is None:
            self.normals[...] = self.normal
            return
        (mx, my, mz), (gx, gy) = self._middle, self.slope
        points = *self.footholds.tolist(), *self._before.tolist()
        off = [z - mz - gx * (x - mx) - gy * (y - my) for x, y, z in points]
        (ax, ay), count = (self.footholds - self._before)[:, :2].sum(axis=0).tolist(), len(points) // 2
        way = math.hypot(ax, ay)
        self._bent = min(max(max(map(abs, off)) / self._even - 1.0, 0.0), 1.0) if way > self._even * count else 0.0
        if not (self._bent or self.bends.any()):
            self.normals[...] = self.normal
            return
        if self._bent:
            self._way = ax, ay = ax / way, ay / way
            self._off = [(ax * (x - mx) + ay * (y - my), z) for (x, y, _), z in zip(points, off, strict=True)]
        bends = [self._off_plane(x, y)[1] for x, y, _ in self.places.tolist()] if self._bent else [0.0] * count
        self.bends += share * (self._bent * np.outer(bends, self._way) - self.bends)
        self.bends[np.abs(self.bends) < 1e-4] = 0.0
        self.normals[:, :2], self.normals[:, 2] = -self.bends - self.slope, 1.0
        self.normals /= np.linalg.norm(self.normals, axis=1, keepdims=True)
        self.level = self.level and not self.bends.any()

    def _off_plane(self, x: float, y: float) -> tuple[float, float]:
        """Return by how much the ground is above the plane at a point, m, and rises besides along the way.

        A line that fits the last two footholds of every foot, those nearby first: a robot that walks meets other
        ground with one foot after the other, which tells of the slope along its way only.
        """
        (mx, my, _), (ax, ay), size = self._middle, self._way, _NEAR_SHARE * self._height
        here = ax * (x - mx) + ay * (y - my)
        total = sd = sz = dd = dz = 0.0
        for along, off in self._off:
            d = (along - here) / size
            weight = 1.0 / (1.0 + d * d) ** 2
            total, sd, sz = total + weight, sd + weight * d, sz + weight * off
            dd, dz = dd + weight * d * d, dz + weight * d * off
        rise = (dz - sd * sz / total) / (dd - sd * sd / total + _DOUBT)
        return (sz - rise * sd) / total, rise / size

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
