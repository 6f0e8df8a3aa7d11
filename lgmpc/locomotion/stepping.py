"""The ground as a controller with a map believes it to be, and where on it the feet can step.

Nominal footholds are moved to the nearest point of a patch around them that is steppable: flat as far as the foot and a
margin reach, within reach of the leg from touchdown to lift-off, clear of the other feet, and with the shank above the
ground. Soles are flat as far as they are long; the base comes within reach of them, because they lead it. A height
above the plane under the robot counts as a distance: legs climb one step, not two. A swing under way
goes on to ground of the height that it was shaped for, and where the foot still gets in time. Heights and normals of
footholds are those of the map. The plane under the robot, which its base follows, fits the steppable ground below the
body best, a little ahead of it: the base leads into stairs.

Map and state estimate differ in height by an offset that drifts; feet that stand measure it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.maps import ElevationMap
from lgmpc.locomotion.terrain import TerrainBelief, TerrainBeliefSettings
from lgmpc.robot.feet import UP
from lgmpc.robot.soles import FootPoints
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import GRAVITY, Array, BoolArray

_PATCH_SHARE, _PATCH_CELLS = 0.36, 11  # radius in leg lengths; points along it
_MARGIN_SHARE = 0.05  # of the height of the centre of mass
_LEAD_SHARE = 0.5  # of sqrt(h / g)
_BODY = (1.25, 1.5)  # length and width of the ground that counts, in distances of the feet
_SAMPLES = (15, 5)
_LEAST_SAMPLES = 12
_LEAST_BODY = 0.5  # size of it, in heights of the centre of mass
_PERIOD = 0.01  # s; between two looks at the map
_LASTING_S = 0.05  # of a choice whose nominal foothold stays
_MOVED = 0.3, 1.0  # in cells of the patch: by more a present, a later nominal foothold has to move for another choice
_SAME_SHARE = 0.1  # of the height of the centre of mass: a swing goes on to ground of this height
_STAY_SHARE = 1.5  # of the patch's cell: by so much nearer another point has to be
_SHANK = np.array([0.4, 0.7, 1.0])  # shares of the way from foot to knee
_AHEAD = np.array([1.0, 1.5, 2.0])  # in radii of even ground: a map has errors
_WAY = np.linspace(0.0, 1.0, 13)
_OFFSET_TIME = 0.15  # s
_CREDIBLE_SHARE = 0.2  # of the height of the centre of mass: a larger offset is that of another place
_TURN_S = 0.02  # s; in which the normal at a foot in the air turns to that of its foothold


class _Choice(NamedTuple):
    """A foothold that was chosen: when, s, for which nominal one (2,), m, where (3,), m, and the (3,) normal there."""

    time: float
    nominal: list[float]
    place: Array
    normal: Array

    def serves(self, time: float, nominal: Sequence[float], tolerance: float) -> bool:
        """Return whether it holds still: it is recent, and the nominal foothold is the same up to a tolerance, m."""
        (x, y), (at_x, at_y) = nominal, self.nominal
        return time - self.time < _LASTING_S and math.hypot(x - at_x, y - at_y) < tolerance


_NONE = _Choice(-math.inf, [math.nan, math.nan], np.full(3, math.nan), np.array(UP))


class MappedBelief(TerrainBelief):
    """The ground of a map, and the plane through it under the robot.

    Args:
        points: of the feet.
        legs: of the robot.
        settings: see :class:`~lgmpc.locomotion.TerrainBeliefSettings`.
        elevation: the map.
        pose: (7,) of the base; a live view.

    Attributes:
        elevation: as given.
        offset: height of the map above the ground that feet stand on, m; NaN before it is measured.
        radius: of flat ground around a foothold, m.
    """

    def __init__(
        self, points: FootPoints, legs: LegGeometry, settings: TerrainBeliefSettings, elevation: ElevationMap,
        pose: Array,
    ) -> None:  # fmt: skip
        super().__init__(len(points.of), legs.height, settings)
        self.elevation, self.offset, self.upright = elevation, 0.0, legs.sole[1] > 0.0
        self._of, self._foot = points.of, legs.radius + 0.5 * legs.sole[0]
        self.radius = self._foot + (
            _MARGIN_SHARE * legs.scale if settings.edge_margin_m is None else settings.edge_margin_m
        )
        self._legs, self._pose, self._time, self._begun = legs, pose, 0.0, False
        self._credible, self._same = _CREDIBLE_SHARE * legs.height, _SAME_SHARE * legs.height
        self._lead = _LEAD_SHARE * math.sqrt(legs.height / GRAVITY)
        self._velocity = (0.0, 0.0)
        length = float(legs.length.min())
        self.cell = _PATCH_SHARE * length / _PATCH_CELLS
        axis = np.arange(-_PATCH_CELLS, _PATCH_CELLS + 1) * self.cell
        patch = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        patch = patch[np.linalg.norm(patch, axis=1) <= _PATCH_SHARE * length]
        self._patch = patch[np.argsort(np.linalg.norm(patch, axis=1), kind="stable")]
        self._far = np.linalg.norm(self._patch, axis=1)
        extent = np.maximum(np.ptp(legs.feet[:, :2], axis=0), _LEAST_BODY * legs.height)
        ahead, left = (
            0.5 * size * each * np.linspace(-1.0, 1.0, n) for size, each, n in zip(_BODY, extent, _SAMPLES, strict=True)
        )
        self._body = np.stack(np.meshgrid(ahead, left, indexing="ij"), axis=-1).reshape(-1, 2)
        fade = [0.6 + 0.4 * np.cos(np.pi * np.linspace(-1.0, 1.0, n)) for n in _SAMPLES]
        self._share = np.outer(*fade).reshape(-1)
        self._targets = np.tile(np.array(UP), (points.feet, 1))
        self._chosen = [_NONE] * points.feet
        self._later: dict[tuple[int, int], _Choice] = {}  # by foot, and number of its swing over the horizon

    def look(self, time: float, motion: BaseMotion) -> None:
        """Take the time, s, and the motion for the next :meth:`update`; what is ahead counts first."""
        self._time, self._velocity = time, (motion.commanded_vx, motion.commanded_vy)
        if not self._begun:
            self._begun = True
            self.elevation.update(time, self._pose)
            self._follow(1.0)

    def begin(self, points: Array, stance: BoolArray | None = None) -> None:
        """Begin with feet at ``points`` (nc, 3), m."""
        super().begin(points, stance)
        self._begun, self.offset = False, math.nan
        self._chosen, self._later = [_NONE] * len(self._chosen), {}

    @property
    def _shift(self) -> float:
        return 0.0 if math.isnan(self.offset) else self.offset

    def height(self, points: Array) -> Array:
        """Return (n,) heights at points (n, 2), m: the plane's where the map has none."""
        heights = self.elevation.height(points) - self._shift
        unknown = np.isnan(heights)
        if unknown.any():
            (mx, my, mz), slope = self._middle, self.slope
            heights[unknown] = mz + (points[unknown] - (mx, my)) @ slope
        return heights

    def update(self, elapsed: float, points: Array, stance: Sequence[bool]) -> None:
        """Take the contact points (nc, 3) of the feet that stand as their footholds; the plane follows the map."""
        self._elapsed += elapsed
        if self._elapsed < _PERIOD - 1e-9:
            return
        self.elevation.update(self._time, self._pose)
        stands = np.array(stance)
        self.footholds[stands] = points[stands]
        if stands.any():
            above = self.elevation.height(points[stands, :2]) - points[stands, 2]
            above = above[~np.isnan(above)]
            if above.size:
                found, new = float(np.median(above)), math.isnan(self.offset)
                if new or abs(found - self.offset) < self._credible:
                    self.offset = found if new else self.offset + self._elapsed / _OFFSET_TIME * (found - self.offset)
        self._follow(min(self._elapsed / self._time_constant, 1.0))
        self.normals += min(self._elapsed / _TURN_S, 1.0) * (self._targets[self._of] - self.normals)
        self.normals /= np.linalg.norm(self.normals, axis=1, keepdims=True)
        self._elapsed = 0.0

    def _follow(self, share: float) -> None:
        """Move the plane by ``share`` towards that of the ground below the body."""
        x, y = float(self._pose[0]), float(self._pose[1])
        c, s = _heading(self._pose)
        turn = np.array([[c, s], [-s, c]])
        cx, cy = x + self._lead * self._velocity[0], y + self._lead * self._velocity[1]
        arms = self._body @ turn
        places = arms + (cx, cy)
        heights = self.elevation.height(places) - self._shift
        weights = self._share * (self.elevation.steppable(places, self._legs.radius) & ~np.isnan(heights))
        above = float(self._pose[2]) - self._legs.base[2] - heights  # of the centre of mass
        weights *= np.abs(above - self._legs.height) < self._legs.height
        if np.count_nonzero(weights) < _LEAST_SAMPLES:
            self._fit(share)
            return
        heights = np.where(weights > 0.0, heights, 0.0)
        terms = np.column_stack([np.ones(len(arms)), arms])
        square = (terms.T * weights) @ terms
        square[1:, 1:] += 1e-6 * np.trace(square[1:, 1:]) * np.eye(2)
        z, fx, fy = np.linalg.solve(square, (terms.T * weights) @ heights).tolist()
        gx, gy = self._tilt
        mx, my, mz = self._middle
        expected = mz + gx * (cx - mx) + gy * (cy - my)
        self._middle = (cx, cy, expected + share * (z - expected))
        self._turn_to(fx, fy, share)

    def aim(
        self, foot: int, time: float, planner: FootholdPlanner, motion: BaseMotion, nominal: tuple[float, float],
        remaining: float, stance: float, others: Sequence[tuple[float, float]], leeway: float | None = None,
    ) -> list[float]:  # fmt: skip
        """Return the (3,) foothold of a present swing, near a nominal one (2,).

        One under way moves by no more than its ``leeway``, m; without, the swing begins.
        """
        kept = self._chosen[foot]
        if leeway is None or not kept.serves(time, nominal, _MOVED[0] * self.cell):
            last = (None, math.inf) if leeway is None else (kept.place, leeway)
            places, normals = self.choose(
                planner, motion, [foot], np.array([nominal]), np.array([remaining]), stance, np.array(others), *last
            )
            self._chosen[foot] = kept = _Choice(time, list(nominal), places[0], normals[0])
            self._targets[foot] = kept.normal
        return kept.place.tolist()

    def spread(
        self, planner: FootholdPlanner, motion: BaseMotion, grid: TimeGrid, stance_s: float, now: Array, points: Array,
        normals: Array,
    ) -> None:  # fmt: skip
        """Put the later footholds of a horizon on the map.

        Args:
            planner: of nominal footholds.
            motion: of the robot.
            grid: intervals of the horizon.
            stance_s: duration of stances, s.
            now: (nc, 3) present contact points, and targets of the present swings.
            points: (N, nc, 3) contact points, overwritten where they differ from ``now``.
            normals: (N, nc, 3), overwritten.
        """
        normals[...] = self.normals
        before = np.concatenate([now[None], points[:-1]])
        rows, feet = np.nonzero((points != before).any(axis=2))
        if not len(rows):
            return
        nominal, owners = points[rows, feet, :2], feet.tolist()
        keys = [(foot, owners[:i].count(foot)) for i, foot in enumerate(owners)]
        due = [
            i
            for i, (key, at) in enumerate(zip(keys, nominal.tolist(), strict=True))
            if not self._later.get(key, _NONE).serves(self._time, at, _MOVED[1] * self.cell)
        ]
        if due:
            remaining = grid.elapsed[rows[due]]
            places, found = self.choose(planner, motion, feet[due].tolist(), nominal[due], remaining, stance_s)
            for i, place, normal in zip(due, places, found, strict=True):
                self._later[keys[i]] = _Choice(self._time, nominal[i].tolist(), place, normal)
        for row, key in zip(rows.tolist(), keys, strict=True):
            chosen = self._later[key]  # a later one of the foot follows and overwrites
            points[row:, key[0]], normals[row:, self._of == key[0]] = chosen.place, chosen.normal

    def choose(
        self, planner: FootholdPlanner, motion: BaseMotion, feet: Sequence[int], nominal: Array, remaining: Array,
        stance: float, others: Array | None = None, before: Array | None = None, leeway: float = math.inf,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return (k, 3) footholds nearest to nominal ones on steppable ground, and (k, 3) normals there.

        Where no point of the patch is, the nearest within reach and clear of other feet serves on which the foot just
        fits; or else one out of reach, or the nominal one.

        Args:
            planner: of nominal footholds, whose limits hold.
            motion: of the robot.
            feet: (k,) whose.
            nominal: (k, 2) world, m.
            remaining: (k,) times until the touchdown, s.
            stance: duration of the stance after it, s.
            others: (m, 2) footholds of other feet to be clear of; none unless given.
            before: (3,) the choice before, of a single foot, which is kept unless another one is nearer, on ground of
                the same height if possible.
            leeway: distance from it within which the foot can still get to another one, m.
        """
        legs, count = self._legs, len(feet)
        yaw = motion.yaw + motion.yaw_rate * remaining
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=1)
        points, far = nominal[:, None] + self._patch @ turn, self._far
        if before is not None:
            points = np.concatenate([points, before[None, None, :2]], axis=1)
            far = np.append(far, math.dist(before[:2], nominal[0]))
        knees = legs.knees[feet] - legs.feet[feet]
        arms = (knees[:, None, :2] @ turn)[:, 0]
        ground = self.height(points.reshape(-1, 2)).reshape(points.shape[:2])
        flat = self.elevation.steppable(points.reshape(-1, 2), self.radius).reshape(points.shape[:2])
        clear = np.ones_like(flat)
        if others is not None and len(others):
            clear = planner.clear(feet, points[:, :, None] - others, turn)
        near = clear
        if not legs.sole[0]:  # soles lead the base, which comes within reach of them
            near = clear & self._within(
                planner, motion, feet, points, ground, remaining, stance, turn, others is not None
            )
        if before is not None:
            near = near & (np.linalg.norm(points - before[:2], axis=2) <= leeway)
        ok = flat & near
        which, place = np.nonzero(ok)
        below = points[which, place][:, None] + _SHANK[:, None] * arms[which, None]
        shank = ground[which, place][:, None] + _SHANK * knees[which, 2, None]
        ok[which, place] = (self.height(below.reshape(-1, 2)).reshape(shank.shape) < shank).all(axis=1)
        (mx, my, mz), slope = self._middle, self.slope
        plane = mz + (points - (mx, my)) @ slope
        cost, tiers = np.hypot(far, ground - plane), [ok]
        if not ok.any(axis=1).all():
            barely = self.elevation.steppable(points.reshape(-1, 2), self._foot).reshape(points.shape[:2])
            tiers += [barely & near, barely & clear]
        if before is not None:
            cost[0, -1] -= _STAY_SHARE * self.cell
            tiers = [ok & (np.abs(ground - before[2]) < self._same), *tiers]
        best, row, served = np.zeros(count, dtype=np.int64), np.arange(count), np.zeros(count, dtype=np.bool_)
        for each in tiers:
            best = np.where(served, best, np.where(each, cost, np.inf).argmin(axis=1))
            served |= each.any(axis=1)
        chosen = points[row, best]
        height = np.where(served, ground[row, best], plane[row, best])
        return np.column_stack([chosen, height]), self._normals_at(chosen, served)

    def _within(
        self, planner: FootholdPlanner, motion: BaseMotion, feet: Sequence[int], points: Array, ground: Array,
        remaining: Array, stance: float, turn: Array, present: bool,
    ) -> BoolArray:  # fmt: skip
        """Return (k, n) which points are within reach of the hips from touchdown to lift-off.

        A point that is no farther away than the first one, on the plane, is within reach in any case.
        """
        legs, (mx, my, mz), slope = self._legs, self._middle, self.slope
        com = np.array([planner.expected(motion, each, present) for each in remaining.tolist()])
        hips = com + (legs.hips[feet][:, None, :2] @ turn)[:, 0]
        way = (stance if stance < math.inf else 0.0) * np.array([motion.commanded_vx, motion.commanded_vy])
        longest = planner.reach_share * legs.length[feet, None]
        nominal = mz + (points[:, 0] - (mx, my)) @ slope
        result = np.ones(points.shape[:2], dtype=np.bool_)
        for hip in (hips, hips + way):
            above = mz + (hip - (mx, my)) @ slope + legs.height + legs.hips[feet, 2] + motion.height
            squares = ((points - hip[:, None]) ** 2).sum(axis=2)
            most = np.maximum(longest**2, squares[:, :1] + (above - nominal)[:, None] ** 2 + 1e-12)
            result &= squares + (above[:, None] - ground) ** 2 <= most
        return result

    def _normals_at(self, points: Array, flat: BoolArray) -> Array:
        """Return (k, 3) normals of the map at points (k, 2), from heights at a foot's edge.

        Ground less steep than what counts as level is level, exactly; where it is not flat, the plane's normal holds.
        """
        r = max(self._foot, self.cell)  # feet may be points
        steps = np.array([[r, 0.0], [-r, 0.0], [0.0, r], [0.0, -r]])
        h = self.height((points[:, None] + steps).reshape(-1, 2)).reshape(-1, 4)
        slope = np.column_stack([h[:, 0] - h[:, 1], h[:, 2] - h[:, 3]]) / (2.0 * r)
        slope[np.linalg.norm(slope, axis=1) <= self._flat] = 0.0
        normals = np.column_stack([-slope, np.ones(len(points))])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals[~flat] = self.normal
        return normals

    def under(self, foot: int, begin: Sequence[float], end: Sequence[float]) -> Array:
        """Return (13,) the least heights of a foot on a straight way from ``begin`` to ``end`` (3,), m.

        Foot and shank are above the ground there; -inf where they are in any case.
        """
        legs, c, s = self._legs, *_heading(self._pose)
        knee = legs.knees[foot] - legs.feet[foot]
        first, last = np.array(begin[:2]), np.array(end[:2])
        way = first + _WAY[:, None] * (last - first)
        r, (length, width), between = legs.radius, legs.sole, math.dist(begin[:2], end[:2]) / (len(_WAY) - 1)
        around = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        if length > 0.0:  # heel and toe pass edges between two of these points, too
            around = around * [0.5 * length + between, 0.5 * width] @ [[c, s], [-s, c]]
        else:
            around *= r
        shank = _SHANK[:, None] * [c * knee[0] - s * knee[1], s * knee[0] + c * knee[1]]
        places = way[:, None] + np.concatenate([around, shank])
        heights = self.height(places.reshape(-1, 2)).reshape(len(_WAY), -1)
        heights[:, 5:] -= _SHANK * knee[2] - r
        return heights.max(axis=1)

    def holds(self, point: Sequence[float], moving: Sequence[float]) -> bool:
        """Return whether the ground ahead of a foot at (3,) may hold it back: it is higher, or not known.

        Args:
            point: of the contact point, m.
            moving: (3,) velocity of its path, not vertical, m/s.
        """
        ahead = _AHEAD[:, None] * (self.radius / math.hypot(moving[0], moving[1]) * np.array(moving[:2]))
        return not bool((self.elevation.height(point[:2] + ahead) - self._shift < point[2]).all())

    def unevenness(self, points: Array) -> float:
        """Return the largest height by which footholds (nc, 3) are off the plane, m."""
        places: list[list[float]] = points.tolist()
        return max(abs(z - self.plane_at(x, y)) for x, y, z in places)


def _heading(pose: Array) -> tuple[float, float]:
    """Return cosine and sine of the heading of a pose (7,)."""
    x, y, z, w = pose[3:7].tolist()
    c, s = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w)
    size = math.hypot(c, s) or 1.0
    return c / size, s / size
