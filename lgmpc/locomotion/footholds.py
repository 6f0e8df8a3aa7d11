r"""Heuristic footholds: under the hips, shifted so that the velocity is the commanded one after the coming stance.

The linear inverted pendulum of height h has the rate :math:`w = \sqrt{g / h}`. Supported for a time T at a point that
the centre of mass passes in the middle, its velocity v is the same afterwards if the point is ahead of it at touchdown
by the neutral distance :math:`v \tanh(w T / 2) / w` (about v T / 2, Raibert, "Legged robots that balance", 1986). Put
further ahead by :math:`(v - v_{cmd}) / (w \sinh(w T))`, the velocity becomes the commanded one within the stance (dead
beat); for a stance without end both together are the capture point :math:`v / w` (Pratt et al., "Capture point",
Humanoids 2006). Over stairs on soles the velocity is held: v T / 2 of the commanded one. Friction
brakes by no more than :math:`\mu g`: a shift beyond :math:`\mu h` would turn the base over its feet, and a larger error
takes several stances. While the command changes, the velocity expected at touchdown is
compared with the command at the end of the stance, which supports the acceleration. A spherical foot of radius r rolls
by r / h of the distance travelled, and is placed that much less far ahead. In a turn the support moves outward by
:math:`h / g \; v \times \omega`, which provides the centripetal acceleration (Kim et al., "Highly dynamic quadruped
locomotion via whole-body impulse control and model predictive control", 2019, has the term with another factor).

A force F that lasts would accelerate the pendulum: the support moves by :math:`h F / (m g)`, where the weight's moment
balances it.

The mean velocity of a robot on two feet is determined by its footholds alone: a horizontal force only tilts it about
the line between the feet. Therefore the position error of the centre of mass shifts footholds too.

Legs without abduction move their feet in a plane. A sideways shift becomes one ahead or back that leaves the line
between two feet where it should be: a trot, with two lines in turn, then controls both components of the velocity.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from lgmpc.lie import attitude
from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.command import VelocityRamp
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.settings import Fraction, NonNegative, Settings, key
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import GRAVITY, Array, BoolArray

_REACH_SHARES = 0.92, 0.98
_ROUNDING = 1e-9  # m
_LOWEST_SHARE = 0.1  # of the height
_PROJECTIONS = 12
"""Alternating projections onto reach and distance from the other feet; one suffices unless both bind."""

_GAP = 0.015
"""Least distance between two soles, m."""

_STEEPEST = 0.1
"""Sine of the least angle between a line of feet and the plane of a leg for which one is moved along the line."""

Point = tuple[float, float]


class FootholdSettings(Settings):
    """Feedback gains of footholds, and their bounds relative to the hips."""

    feedback: NonNegative = key(1.0, "Feedback of the velocity error, in units of the pendulum's dead-beat gain.")
    position_feedback: NonNegative = key(0.7, "Shift of footholds per position error of the centre of mass.")
    centrifugal: NonNegative = key(1.0, "Outward shift in a turn, in units of that of the centripetal acceleration.")
    reach_share: Fraction | None = key(
        None,
        "Longest distance from hip to foothold, as a share of the stretched leg's length. null: 0.92, to"
        " the ankle of a sole 0.98.",
    )
    side_share: float = Field(
        default=0.25,
        strict=True,
        ge=-1.0,
        le=1.0,
        description="Least distance of a foot from the base's middle plane on its own side, as a share of that in the"
        " reference posture; negative: largest distance on the other side.",
    )
    spacing_share: Fraction = key(0.3, "Shortest distance between two feet, as a share of the stretched leg's length.")
    error_decay_s: NonNegative = key(0.15, "Predicted time in which velocity errors decay after the present swing, s.")


@dataclass(slots=True)
class BaseMotion:
    """Motion of the robot in the horizontal plane, world axes.

    Attributes:
        x: centre of mass, m.
        y: centre of mass, m.
        vx: its velocity, m/s; of a robot that steps against pushes on a support short of its height with what its
            turning is worth: angular momentum L about the centre of mass moves the capture point like the velocity
            L / (m h).
        vy: m/s.
        yaw: of the base, rad.
        yaw_rate: commanded, rad/s.
        commanded_vx: commanded velocity, world axes, m/s.
        commanded_vy: m/s.
        error_x: position error of the centre of mass, measured minus desired, world axes, m.
        error_y: m.
        ramp: coming change of the commanded velocity, world axes.
        height: commanded, of the base relative to the reference posture, m.
        friction: Coulomb coefficient of the floor.
        rise_ahead: sine of the angle by which the base's x axis points upwards.
        rise_left: the same of its y axis.
        load_x: acceleration that a lasting external force gives to the robot, world axes, m/s2.
        load_y: m/s2.
    """

    x: float
    y: float
    vx: float
    vy: float
    yaw: float
    yaw_rate: float = 0.0
    commanded_vx: float = 0.0
    commanded_vy: float = 0.0
    error_x: float = 0.0
    error_y: float = 0.0
    ramp: VelocityRamp = VelocityRamp()
    height: float = 0.0
    friction: float = math.inf
    rise_ahead: float = 0.0
    rise_left: float = 0.0
    load_x: float = 0.0
    load_y: float = 0.0

    def as_desired(self) -> "BaseMotion":
        """Return the motion without errors of position and velocity."""
        x, y, vx, vy = self.x - self.error_x, self.y - self.error_y, self.commanded_vx, self.commanded_vy
        return replace(self, x=x, y=y, error_x=0.0, error_y=0.0, vx=vx, vy=vy)


class FootholdPlanner:
    """Heuristic footholds of every foot, for the present swing and those after it.

    Args:
        legs: legs of the robot.
        settings: see :class:`FootholdSettings`.
        ground: belief of the ground; level at 0 if omitted.

    Attributes:
        legs: as given.
        settings: as given.
        ground: as given.
        height: of the centre of mass above the feet, m.
        feet: (nc,) of (x, y) in the reference posture, from the centre of mass, axes of the base, m.
        hips: (nc,) of (x, y), the same.
        sides: (nc,) smallest lateral distance of a foot on its own side, base axes, with the sign of the side, m.
        reach_share: longest distance from hip to foothold, as a share of the stretched leg's length.
        spacing: smallest distance between two point feet, m.
        normals: (nc,) of (x, y), directions in which legs cannot move their feet, axes of the base; zeros for others.
    """

    def __init__(
        self, legs: LegGeometry, settings: FootholdSettings | None = None, ground: TerrainBelief | None = None
    ) -> None:
        self.legs = legs
        self.settings = s = FootholdSettings() if settings is None else settings
        self.ground = TerrainBelief(len(legs.feet), legs.height) if ground is None else ground
        self.height = legs.height
        self._rate = math.sqrt(GRAVITY / legs.height)
        self._rolling = legs.radius / legs.height
        self.feet = [(float(x), float(y)) for x, y, _ in legs.feet]
        x, y, _ = legs.feet.mean(axis=0).tolist()
        # Standing, the centre of mass may be off the middle of the feet; on two feet that offset accelerates it.
        self._walking = [(ahead - x, left - y) for ahead, left in self.feet]
        self.hips = [(float(x), float(y)) for x, y, _ in legs.hips]
        self.sides = [s.side_share * y for _, y in self.feet]
        drops = legs.hips[:, 2] + legs.height
        self.reach_share = _REACH_SHARES[legs.sole[1] > 0.0] if s.reach_share is None else s.reach_share
        self._legs = [
            (self.reach_share * float(length), float(drop)) for length, drop in zip(legs.length, drops, strict=True)
        ]
        self.spacing = s.spacing_share * float(legs.length.min())
        self._beside = legs.beside + _GAP if legs.beside > 0.0 else 0.0
        self.normals = [(float(x), float(y)) for x, y, _ in legs.normals]
        self._towards = [_oblique(*pair) for pair in zip(self.normals, self._walking, strict=True)]
        self._stance = math.nan  # s, to which the next three belong: a stance has the same duration for many ticks
        self._neutral = self._gain = 0.0
        self._reaches: tuple[float, list[float]] = (math.nan, [])  # height, and the reach of every leg at it

    def place(
        self, foot: int, motion: BaseMotion, remaining: float, stance: float, others: Sequence[Point] = (),
        width: float = 1.0,
    ) -> Point:  # fmt: skip
        """Return the foothold (x, y) of a foot.

        Args:
            foot: index of the foot.
            motion: present motion.
            remaining: time until the touchdown, s.
            stance: duration of the stance after it, s; inf to stand from then on.
            others: present or coming positions of other feet.
            width: width of the gait; a foot that stands from then on is placed as in the reference posture, others
                around the centre of mass.
        """
        com = self.expected(motion, remaining, present=True)
        return self._place(foot, motion, com, (motion.vx, motion.vy), remaining, stance, others, width)

    def heading(self, motion: BaseMotion, remaining: float, stance: float) -> float:
        """Return the heading of the base in the middle of the stance that begins in ``remaining``, s, rad."""
        return motion.yaw + motion.yaw_rate * (remaining + (0.5 * stance if stance < math.inf else 0.0))

    def place_later(self, foot: int, motion: BaseMotion, remaining: float, stance: float, width: float = 1.0) -> Point:
        """Return the foothold of a later swing: as :meth:`place`, after the velocity error has decayed."""
        left = self._left(remaining)
        ex, ey = motion.vx - motion.commanded_vx, motion.vy - motion.commanded_vy
        com = self.expected(motion, remaining, present=False)
        wx, wy = attitude.turn(motion.yaw_rate * remaining, motion.commanded_vx, motion.commanded_vy)
        return self._place(foot, motion, com, (wx + left * ex, wy + left * ey), remaining, stance, (), width)

    def expected(self, motion: BaseMotion, remaining: float, present: bool) -> Point:
        """Return the predicted centre of mass: at constant velocity in a present swing, else with decaying error."""
        if present:
            return motion.x + motion.vx * remaining, motion.y + motion.vy * remaining
        ex, ey = motion.vx - motion.commanded_vx, motion.vy - motion.commanded_vy
        drift = self.settings.error_decay_s * (1.0 - self._left(remaining))
        # The commanded velocity turns with the base: along the chord of the arc until the touchdown.
        cx, cy = attitude.turn(0.5 * motion.yaw_rate * remaining, motion.commanded_vx, motion.commanded_vy)
        return motion.x + cx * remaining + ex * drift, motion.y + cy * remaining + ey * drift

    def reach(self, foot: int, height: float) -> float:
        """Return the largest horizontal distance of a foothold from its hip, m, at a commanded height, m."""
        longest, drop = self._legs[foot]
        return math.sqrt(max(longest**2 - (drop + height) ** 2, 0.0))

    def highest(self, distance: float) -> float:
        """Return the largest commanded height, m, at which feet reach a horizontal distance from their hips, m.

        No lower than by a tenth of the height: at 1 m/s G1 would crouch by a seventh.
        """
        heights = (math.sqrt(max(longest**2 - distance**2, 0.0)) - drop for longest, drop in self._legs)
        return max(min(heights), -_LOWEST_SHARE * self.height)

    def _left(self, remaining: float) -> float:
        """Return the share of the velocity error that is left after a time, s."""
        decay = self.settings.error_decay_s
        return math.exp(-remaining / decay) if decay > 0.0 else 0.0

    def _place(
        self, foot: int, motion: BaseMotion, com: Point, velocity: Point, remaining: float, stance: float,
        others: Sequence[Point], width: float,
    ) -> Point:  # fmt: skip
        s, rate, omega = self.settings, self._rate, motion.yaw_rate
        turned = omega * remaining
        half = 0.5 * stance if stance < math.inf else 0.0
        vx, vy = velocity
        # Change of the command until the touchdown, and until the end of the stance.
        ramp = motion.ramp
        before, after = min(remaining, ramp.duration), min(remaining + stance, ramp.duration)
        vx, vy = vx + before * ramp.ax, vy + before * ramp.ay
        wx, wy = attitude.turn(turned, motion.commanded_vx + after * ramp.ax, motion.commanded_vy + after * ramp.ay)
        # To the middle of the stance: the path of the centre of mass turns by half of the base's rotation.
        nx, ny = attitude.turn(0.5 * omega * half, vx, vy)
        if stance != self._stance:
            self._stance, self._neutral = stance, math.tanh(0.5 * rate * stance) / rate
            self._gain = s.feedback / (rate * math.sinh(rate * stance)) if rate * stance < 50.0 else 0.0
        neutral, gain = self._neutral, self._gain
        # The plan holds the velocity over treads: half of the way of a stance is ahead of its middle.
        steady = half > 0.0 and self.ground.upright
        rolled = neutral - half if steady else self._rolling * neutral
        outward = s.centrifugal * omega / (rate * rate)
        ahead, left = self.feet[foot]
        if stance < math.inf:
            ahead, left = self._walking[foot]
            left *= width
        fx, fy = attitude.turn(motion.yaw + turned + omega * half, ahead, left)
        bx, by = gain * (vx - wx), gain * (vy - wy)
        shift, most = math.hypot(bx, by), motion.friction * self.height
        if shift > most:
            bx, by = bx * most / shift, by * most / shift
        ax, ay = s.position_feedback * motion.error_x, s.position_feedback * motion.error_y
        if stance < math.inf and (motion.load_x or motion.load_y):  # the weight's moment balances that of the load
            aside, along = attitude.turn(motion.yaw + turned, *self.normals[foot])
            across = aside * motion.load_x + along * motion.load_y  # planar legs have no foothold against it
            ax += (motion.load_x - across * aside) / (rate * rate)
            ay += (motion.load_y - across * along) / (rate * rate)
        x = com[0] + fx + neutral * nx + bx - rolled * wx + outward * wy + ax
        y = com[1] + fy + neutral * ny + by - rolled * wy - outward * wx + ay
        return self._bound(foot, (x, y), com, motion.yaw + turned, motion, others)

    def _bound(
        self, foot: int, point: Point, com: Point, yaw: float, motion: BaseMotion, others: Sequence[Point]
    ) -> Point:
        """Return the point within reach of the hip, on the foot's own side of the base and clear of the other feet.

        Where these exclude each other, clear of the other feet. A planar leg has it in its plane, where the line to the
        middle of the feet meets that plane: on a diagonal of feet, only the distance of the centre of mass from their
        line determines how the robot falls.
        """
        cx, cy = com
        # In the axes of the base at touchdown.
        wanted, *near = [attitude.turn(-yaw, x - cx, y - cy) for x, y in (point, *others)]
        before = apart = self._clear(foot, wanted, near)
        for _ in range(_PROJECTIONS):
            point = self._reachable(foot, *apart, motion.height)
            if point == before == wanted:  # clear, and within reach
                apart = point
                break
            apart = self._clear(foot, point, near)
            if apart == point:
                break
        x, y = apart
        nx, ny = self.normals[foot]
        if nx or ny:
            (fx, fy), (tx, ty) = self.feet[foot], self._towards[foot]
            # The plane tilts with the base, and meets the ground beside the centre of mass.
            tilted = (self.height + motion.height) * (nx * motion.rise_ahead + ny * motion.rise_left)
            out = nx * (x - fx) + ny * (y - fy) - tilted
            x, y = x - out * tx, y - out * ty
        x, y = attitude.turn(yaw, x, y)
        return cx + x, cy + y

    def _clear(self, foot: int, point: Point, others: Sequence[Point]) -> Point:
        """Return the point moved away from each of the other feet that is nearer than the least distance."""
        x, y = point
        if self._beside:  # soles are side by side, and legs do not cross
            side = math.copysign(1.0, self.feet[foot][1])
            for _, oy in others:
                least = side * oy + self._beside
                if side * y < least:  # around the centre of mass: beside a foot that is off it, it would stay off, too
                    y = side * max(least, 0.5 * self._beside)
            return x, y
        least = self.spacing - _ROUNDING
        for ox, oy in others:
            dx, dy = x - ox, y - oy
            if abs(dx) < least and abs(dy) < least and (distance := math.hypot(dx, dy)) < least:
                if distance == 0.0:
                    dx, dy = self.feet[foot]
                    distance = math.hypot(dx, dy)
                x, y = ox + dx * self.spacing / distance, oy + dy * self.spacing / distance
        return x, y

    def clear(self, feet: Sequence[int], apart: Array, turn: Array) -> BoolArray:
        """Return (k, n) which points are clear of others, from arms from these (k, n, m, 2) and base axes (k, 2, 2)."""
        if not self._beside:
            return np.all(np.linalg.norm(apart, axis=-1) >= self.spacing - _ROUNDING, axis=-1)
        aside = np.einsum("knmi,ki->knm", apart, turn[:, 1] * np.sign([self.feet[foot][1:] for foot in feet]))
        return np.all(aside >= self._beside - _ROUNDING, axis=-1)

    def _reachable(self, foot: int, x: float, y: float, height: float) -> Point:
        """Return the point on the foot's own side of the base, and within reach of the hip."""
        left, side = self.feet[foot][1], self.sides[foot]
        y = max(y, side) if left > 0.0 else min(y, side) if left < 0.0 else y
        hx, hy = self.hips[foot]
        dx, dy = x - hx, y - hy
        if height != self._reaches[0]:
            self._reaches = height, [self.reach(each, height) for each in range(len(self.hips))]
        distance, reach = math.hypot(dx, dy), self._reaches[1][foot]
        if distance > reach:
            x, y = hx + dx * reach / distance, hy + dy * reach / distance
        return x, y

    def horizon(
        self,
        clock: GaitClock,
        motion: BaseMotion,
        grid: TimeGrid,
        contacts: Array,
        points: Array,
        stance: Sequence[bool] | None = None,
        yaws: Array | None = None,
    ) -> None:
        """Write the contact point or next foothold of each foot in each interval of a horizon.

        Args:
            clock: the schedule.
            motion: present motion.
            grid: intervals of the horizon.
            contacts: (nc, 3) contact points of the feet that stand, targets of those that swing, world, m.
            points: (N, nc, 3), overwritten.
            stance: (nc,) feet that stand; those that lift off now then have their next foothold here, not among
                ``contacts``. Those that the clock has on the ground unless given.
            yaws: (N, nc) headings of the feet there, overwritten from their next lift-off on, rad.
        """
        points[:], t = contacts, grid.start
        for foot in range(clock.nc):
            for swing in clock.swings(foot, t, grid.end):
                lifts_now = swing.liftoff <= t
                if lifts_now and (stance is None or not stance[foot]):
                    continue
                place = self.place if lifts_now else self.place_later
                duration = clock.stance_duration(foot, swing.liftoff)
                x, y = place(foot, motion, swing.touchdown - t, duration, width=clock.gait.width)
                begin = grid.first_from(swing.liftoff)
                points[begin:, foot] = x, y, self.ground.height_at(x, y)
                if yaws is not None:
                    yaws[begin:, foot] = self.heading(motion, swing.touchdown - t, duration)


def _oblique(normal: Point, line: Point) -> Point:
    """Return the vector along ``line`` with a unit along ``normal``; the normal itself if they are at right angles."""
    across = normal[0] * line[0] + normal[1] * line[1]
    if abs(across) < _STEEPEST * math.hypot(*line):
        return normal
    return line[0] / across, line[1] / across
