r"""The path of a foot through the air: towards a target that may move, and further down if there is no ground.

Every coordinate is a polynomial of degree 5 in time. A new target replaces it by the one that begins with the present
position, velocity and acceleration, so the path stays twice continuously differentiable; for a target that stays, the
new polynomial is the old one (Flash and Hogan, "The coordination of arm movements", J. Neuroscience 5, 1985).

A step of length d within the time T takes the acceleration :math:`10 d / (\sqrt 3 \, T^2)`. Beyond what the motors
provide the foot lags behind its path, and touches down late and elsewhere than planned. So a long step may take
longer than the gait's swing: as long as the acceleration stays within its limit.
"""

import math
from collections.abc import Sequence
from typing import Union

import numpy as np
from pydantic import Field

from lgmpc.settings import Fraction, NonNegative, Positive, Settings, key
from lgmpc.timegrid import minimum_jerk
from lgmpc.typing import GRAVITY, Array

_STEEPEST = 2.0  # largest touchdown speed, in heights over duration of the fall; up to 2.5 the quintic only falls
_LANDING = 0.4, 0.1  # m/s, of points and soles
_SEARCHING = 0.0, 0.4
_CLEARANCE_SHARE, _DEPTH_SHARE = 1.0 / 7.0, 0.5  # of the height of the centre of mass
_PEAK = 10.0 / math.sqrt(3.0)  # largest acceleration of the quintic from rest to rest, in ways over duration squared
_OBSTRUCTED_SHARE = 0.05  # of the height: on level ground, feet in a tenth of that are pushed
_OBSTACLE_SHARE = 0.35  # of the height: the highest obstacle that a foot rises over
_LOST_COMMANDS = 3
_LEAST_SPEED, _STUCK_SHARE = 0.3, 0.3  # m/s; share of the path's speed
_BEYOND_SHARE = 1.1  # of the largest acceleration: from here on feet are bound to lag
_FREE_SHARE = 0.8  # of the largest acceleration: up to it feet follow their paths unless something is in the way
_RISING_SHARE = 0.6  # of the time up over an obstacle: then the foot moves ahead; on rough ground earlier
_ROUGH_SHARE = 0.5
_AGAIN_SHARE = 0.7  # of a swing's duration, for the step over an obstacle

_MARGIN_SHARE = 0.35  # least height of a foot above what is below its way, in clearances
_NEAR = 1e-3  # m
_TIMES = np.linspace(0.0, 1.0, 41)
_MINIMUM_JERK = minimum_jerk(_TIMES)[0]
_SHAPES = np.array(
    [
        (wait, early, highest)
        for wait in (0.0, 0.1, 0.2, 0.3, 0.4)
        for early in (0.0, 0.1, 0.2, 0.3)
        for highest in (-0.15, 0.0, 0.15, 0.25)
        if wait + early <= 0.5
    ]
)
_COSTS = _SHAPES[:, 0] + _SHAPES[:, 1] + 0.5 * np.abs(_SHAPES[:, 2])

Coefficients = tuple[float, float, float, float, float, float]
State = tuple[float, float, float]  # position, velocity, acceleration
Vector = Union[Sequence[float], Array]  # noqa: UP007 - (3,); plain numbers are faster


class SwingSettings(Settings):
    """Shape of the swings."""

    clearance_m: Positive | None = key(
        None,
        "Apex above the higher one of lift-off and target, m; more on rough ground. null: a seventh of the"
        " height of the centre of mass, of soles a third of that, to the millimetre.",
    )
    apex_share: float = Field(
        default=0.45, strict=True, gt=0.05, lt=0.95, description="Share of the swing at which the foot is highest."
    )
    touchdown_speed_m_s: NonNegative | None = key(
        None,
        "Downward speed at the scheduled touchdown, m/s; less in slow swings, whose feet would rise again"
        " before. null: 0.4, of soles, whose impact a stretched leg transmits to the trunk, 0.1.",
    )
    search_speed_m_s: NonNegative | None = key(
        None,
        "Least downward speed of a late foot from the scheduled touchdown on, m/s. null: that of the"
        " touchdown, of soles 0.4.",
    )
    search_depth_m: NonNegative | None = key(
        None,
        "How far below its target a late foot searches for the ground, m. null: half the height of the"
        " centre of mass, of soles a third of that.",
    )
    freeze_share: Fraction = key(0.8, "Share of the swing from which the target stays where it is.")
    acceleration_m_s2: Positive = key(
        130.0,
        "Largest acceleration of a foot in the plane that a swing is planned with, m/s2: longer steps take"
        " more time, up to longest_share. Robots of any size need the same at the same Froude number.",
    )
    longest_share: float = Field(
        default=1.0,
        strict=True,
        ge=1.0,
        le=3.0,
        description="Longest duration of a long step, as a share of the gait's; 1: every step as the gait has it.",
    )


class SwingTrajectory:
    """The swing of one foot: :meth:`lift_off` or :meth:`put_down`, then every tick :meth:`retarget` and :meth:`sample`.

    Args:
        settings: see :class:`SwingSettings`.
        height: of the centre of mass above the feet, m, of soles a third: the scale of clearance and search depth.
        sole: whether the foot is a sole.

    Attributes:
        clearance: of the apex, m, the least of every swing.
        roughness: added to it in the next swing, m.
        liftoff: of the present swing, s.
        touchdown: as scheduled at lift-off or, of a long step, later, s.
        target: where the foot goes: x, y and the height of the ground there, m.
        touchdown_speed: downward, of the present swing, m/s.
    """

    def __init__(self, settings: SwingSettings | None = None, height: float = 0.21, sole: bool = False) -> None:
        self._scale, self._sole = height, sole
        self.retune(SwingSettings() if settings is None else settings)
        self.roughness = 0.0
        self._obstructed, self._obstacle = _OBSTRUCTED_SHARE * height, _OBSTACLE_SHARE * height
        self.liftoff, self.touchdown = 0.0, 0.0
        self.target = (0.0, 0.0, 0.0)
        self._from = (0.0, 0.0)
        self._latest = self._apex_time = 0.0
        self._again, self._floor = False, 0.0  # it steps over an obstacle; the highest ground that it expects
        self._usual = 0.0  # duration of the swing as it began, s
        self._hastened = math.inf
        self._planned = 0.0  # when the polynomials of x and y begin
        self._ahead_s = 0.0  # by so much they end before the touchdown
        self._x = self._y = self._rise = self._fall = _at_rest(0.0)
        self._fall_begin = 0.0
        self.touchdown_speed = self._landing

    def retune(self, settings: SwingSettings) -> None:
        """Change the settings, for the next swing."""
        self.settings = s = settings
        self._landing = _LANDING[self._sole] if s.touchdown_speed_m_s is None else s.touchdown_speed_m_s
        self._searching = _SEARCHING[self._sole] if s.search_speed_m_s is None else s.search_speed_m_s
        self.clearance = round(_CLEARANCE_SHARE * self._scale, 3) if s.clearance_m is None else s.clearance_m
        self._depth = _DEPTH_SHARE * self._scale if s.search_depth_m is None else s.search_depth_m

    def lift_off(
        self, t: float, touchdown: float, position: Vector, velocity: Vector, target: Vector,
        latest: float | None = None, below: Array | None = None,
    ) -> None:  # fmt: skip
        """Begin a swing.

        Args:
            t: now, s.
            touchdown: when it is scheduled to end, s, after ``t``.
            position: (3,) of the foot's contact point, world, m.
            velocity: (3,) m/s; a downward one is not followed.
            target: (3,) where to put it down, world, m.
            latest: when the swing of a long step has to have ended, s; as scheduled unless given.
            below: (n,) least heights of the foot at equal distances along its way, first and last one included, m.
        """
        s = self.settings
        self.liftoff, self.touchdown, self._hastened, self._ahead_s = t, touchdown, math.inf, 0.0
        longest = touchdown + (s.longest_share - 1.0) * (touchdown - t)
        self._latest = touchdown if latest is None else max(touchdown, min(latest, longest))
        self._from = (float(position[0]), float(position[1]))
        self.target = (float(target[0]), float(target[1]), float(target[2]))
        self._postpone()
        z = float(position[2])
        self._again, self._floor, self._usual = False, max(z, self.target[2]) + self._obstacle, self.touchdown - t
        top = max(z, self.target[2]) if below is None else max(z, self.target[2], float(below[1:-1].max()))
        apex, wait, apex_share = top + self.clearance + self.roughness, 0.0, s.apex_share
        if below is not None:
            margin, shortest = _MARGIN_SHARE * self.clearance, (touchdown - t) ** 2 * s.acceleration_m_s2
            haste = _PEAK / shortest if self._sole else 0.0
            wait, early, apex_share = _shaped(below, z, apex, self.target[2], apex_share, margin, haste)
            self._ahead_s = early * (touchdown - t)
        self._apex_time = t + apex_share * (touchdown - t)
        self._rise = _quintic((z, max(float(velocity[2]), 0.0), 0.0), (apex, 0.0, 0.0), self._apex_time - t)
        self._plan_fall(self._apex_time, (apex, 0.0, 0.0))
        x, y = (float(position[0]), float(velocity[0]), 0.0), (float(position[1]), float(velocity[1]), 0.0)
        if wait > 0.0:
            self._plan_plane(t + wait * (touchdown - t), (x[0], 0.0, 0.0), (y[0], 0.0, 0.0))
        elif self.roughness > 0.0:  # what is ahead may be a riser
            begin = min(t + _ROUGH_SHARE * (self._apex_time - t), max(t, self._latest_begin()))
            self._plan_plane(begin, (x[0], 0.0, 0.0), (y[0], 0.0, 0.0))
        else:
            self._plan_plane(t, x, y)

    def put_down(self, t: float, touchdown: float, position: Vector) -> None:
        """Begin a swing, without rising, of a foot that is in the air at ``position`` (3,), at rest, already."""
        self.liftoff = self._apex_time = t
        self.touchdown = self._latest = touchdown
        self._ahead_s, self._again = 0.0, False
        x, y, z = (float(value) for value in position)
        self.target, self._from = (x, y, z), (x, y)
        self._plan_fall(t, (z, 0.0, 0.0))
        self._plan_plane(t, (x, 0.0, 0.0), (y, 0.0, 0.0))

    def blocked(
        self, t: float, position: Vector, velocity: Vector, wanted: Vector, moving: Vector, period: float = 0.0
    ) -> bool:
        """Return whether an obstacle holds the foot back: it is behind its path, and does not catch up.

        One that rises over an obstacle already is left alone on its way up, and a step that takes all that the motors
        provide lags without an obstacle.

        Args:
            t: now, s.
            position: (3,) of the contact point, m.
            velocity: (3,) m/s.
            wanted: (3,) position of the path, m.
            moving: (3,) velocity of the path, m/s.
            period: between two commands, s; some of them may get lost.
        """
        vx, vy = float(moving[0]), float(moving[1])
        speed = math.hypot(vx, vy)
        if speed < _LEAST_SPEED or (self._again and t < self._apex_time):
            return False
        x, y = float(wanted[0] - position[0]), float(wanted[1] - position[1])
        behind = vx * x + vy * y > (self._obstructed + _LOST_COMMANDS * period * speed) * speed
        slow = vx * float(velocity[0]) + vy * float(velocity[1]) < _STUCK_SHARE * speed * speed
        return behind and slow and self._acceleration() < _FREE_SHARE * self.settings.acceleration_m_s2

    def held(self, position: Vector, velocity: Vector) -> bool:
        """Return whether what is in front of a late foot at ``position`` (3,), m, holds it: it rests off its target."""
        off = math.hypot(self.target[0] - float(position[0]), self.target[1] - float(position[1]))
        resting = math.hypot(float(velocity[0]), float(velocity[1])) < _STUCK_SHARE * _LEAST_SPEED
        return resting and off > self._obstructed and self.touchdown > self.liftoff and not self._sole

    @property
    def unattainable(self) -> bool:
        """Whether the motors cannot swing the foot to its target by the touchdown."""
        return self.touchdown > self.liftoff and self._acceleration() > _BEYOND_SHARE * self.settings.acceleration_m_s2

    def _acceleration(self) -> float:
        """Return the largest acceleration in the plane of a step from rest to the target in the swing's time, m/s2."""
        duration = self.touchdown - self._ahead_s - self.liftoff
        return _PEAK * self._way() / (duration * duration)

    def _shortest(self) -> float:
        """Return the least time of a step from rest, s."""
        return math.sqrt(_PEAK * self._way() / self.settings.acceleration_m_s2)

    def _latest_begin(self) -> float:
        """Return when the foot has to move ahead to get to the target in time, s."""
        return self.touchdown - self._ahead_s - (0.0 if self._sole else self._shortest())

    def _way(self) -> float:
        return math.hypot(self.target[0] - self._from[0], self.target[1] - self._from[1])

    def step_over(self, t: float, position: Vector) -> None:
        """Begin again from ``position`` (3,), where an obstacle holds the foot: upwards, and from there on ahead."""
        duration = max(_AGAIN_SHARE * self._usual, self.touchdown - t)
        self.touchdown = self._latest = t + duration
        x, y, z = (float(value) for value in position)
        self._ahead_s, self.liftoff, self._from = 0.0, t, (x, y)
        apex = min(max(z, self.target[2]), self._floor) + self.clearance + self.roughness
        apex, self._again = max(apex, z), True
        self._apex_time = t + self.settings.apex_share * duration
        self._rise = _quintic((z, 0.0, 0.0), (apex, 0.0, 0.0), self._apex_time - t)
        self._plan_fall(self._apex_time, (apex, 0.0, 0.0))
        self._plan_plane(t + _RISING_SHARE * (self._apex_time - t), (x, 0.0, 0.0), (y, 0.0, 0.0))

    def frozen(self, t: float) -> bool:
        """Return whether the swing is too advanced for another target."""
        return t >= self.liftoff + self.settings.freeze_share * (self.touchdown - self._ahead_s - self.liftoff)

    def leeway(self, t: float) -> float:
        """Return by how much the target may still move for the foot to get there within its acceleration, m."""
        left = max(self.touchdown - self._ahead_s - max(t, self._planned), 0.0)
        return self.settings.acceleration_m_s2 * left * left / _PEAK

    def retarget(self, t: float, target: Vector) -> bool:
        """Move the target (3,), unless the swing is too advanced; return whether it moved. The touchdown may, too."""
        if self.frozen(t):
            return False
        x, y, z = float(target[0]), float(target[1]), float(target[2])
        if (x, y, z) == self.target:
            return True
        fall_changes = z != self.target[2]
        self.target = (x, y, z)
        fall_changes |= self._postpone()
        # Later than now on the way up, of what may be an obstacle only if the step is not too long for that.
        begin = max(t, self._planned if self._again else min(self._planned, self._latest_begin()))
        since = max(begin - self._planned, 0.0)
        self._plan_plane(begin, _evaluate(self._x, since), _evaluate(self._y, since))
        if fall_changes:
            begin = max(t, self._apex_time)
            self._plan_fall(begin, self._height(begin))
        return True

    def search(self, t: float, position: Vector) -> None:
        """Descend at the touchdown speed from ``position`` (3,) on: a stance foot lost its contact."""
        self.liftoff = self.touchdown = self._apex_time = t
        self._hastened, self.touchdown_speed = math.inf, self._landing
        self.target = (float(position[0]), float(position[1]), float(position[2]))

    def hasten(self, t: float) -> None:
        """Fall from now on as fast as freely: the ground is further down than expected."""
        self._hastened = min(self._hastened, t)

    def sample(self, t: float, position: Array, velocity: Array, acceleration: Array) -> None:
        """Write position (3,), velocity and acceleration at time ``t``; after the touchdown, those of a late foot."""
        if t >= self.touchdown:
            self._sample_late(t, position, velocity, acceleration)
            return
        dt = max(min(t, self.touchdown - self._ahead_s) - self._planned, 0.0)
        position[0], velocity[0], acceleration[0] = _evaluate(self._x, dt)
        position[1], velocity[1], acceleration[1] = _evaluate(self._y, dt)
        position[2], velocity[2], acceleration[2] = self._height(t)

    def _sample_late(self, t: float, position: Array, velocity: Array, acceleration: Array) -> None:
        """Straight down to the search depth, at constant speed until hastened, and there to rest."""
        fallen = max(t - self._hastened, 0.0)
        speed = max(self.touchdown_speed, self._searching)
        depth = speed * (t - self.touchdown) + 0.5 * GRAVITY * fallen * fallen
        searching = depth < self._depth
        position[0], position[1], position[2] = self.target
        position[2] -= depth if searching else self._depth
        velocity[:] = acceleration[:] = 0.0
        if searching:
            velocity[2] = -speed - GRAVITY * fallen

    def _postpone(self) -> bool:
        """Postpone the touchdown until the step to the target is within the limit; return whether it had to be."""
        due = min(self.liftoff + self._shortest(), self._latest)
        if due <= self.touchdown:
            return False
        self.touchdown = due
        return True

    def _height(self, t: float) -> State:
        if t < self._apex_time:
            return _evaluate(self._rise, t - self.liftoff)
        return _evaluate(self._fall, t - self._fall_begin)

    def _plan_plane(self, t: float, x: State, y: State) -> None:
        left = self.touchdown - self._ahead_s - t
        self._planned = t
        self._x = _quintic(x, (self.target[0], 0.0, 0.0), left)
        self._y = _quintic(y, (self.target[1], 0.0, 0.0), left)

    def _plan_fall(self, begin: float, state: State) -> None:
        self._fall_begin = begin
        duration, height = self.touchdown - begin, max(state[0] - self.target[2], 0.0)
        # A foot that should arrive faster than this would first rise again.
        self.touchdown_speed = min(self._landing, _STEEPEST * height / duration) if duration > 0.0 else 0.0
        self._fall = _quintic(state, (self.target[2], -self.touchdown_speed, 0.0), duration)


class HeadingTrajectory:
    """The heading of one sole in its swing: :meth:`begin`, then every tick :meth:`retarget` and :meth:`sample`."""

    def __init__(self) -> None:
        self._planned = self._touchdown = self._target = 0.0
        self._yaw = _at_rest(0.0)

    def begin(self, t: float, yaw: float) -> None:
        """Begin a swing at rest at heading ``yaw``, rad."""
        self._planned = self._touchdown = t
        self._target, self._yaw = yaw, _at_rest(yaw)

    def retarget(self, t: float, touchdown: float, yaw: float) -> None:
        """Be at rest at heading ``yaw``, rad, at ``touchdown``, s."""
        if (touchdown, yaw) != (self._touchdown, self._target):
            now = self.sample(t)
            self._target = now[0] + math.remainder(yaw - now[0], 2.0 * math.pi)
            self._yaw = _quintic(now, (self._target, 0.0, 0.0), touchdown - t)
            self._planned, self._touchdown = t, touchdown

    def sample(self, t: float) -> State:
        """Return heading, rad, its rate and acceleration at time ``t``; after the touchdown at rest."""
        return _evaluate(self._yaw, t - self._planned) if t < self._touchdown else (self._target, 0.0, 0.0)


def _shaped(
    below: Array, z: float, apex: float, target: float, apex_share: float, margin: float, haste: float
) -> tuple[float, float, float]:
    """Return when the foot moves ahead, and how early it arrives, and when it is highest, as shares of the swing.

    The least deviations from the usual shape with which it is by ``margin``, m, above the (n,) heights ``below`` it; or
    those with which it comes nearest to that. To rise by 1 m in all of the swing takes ``haste`` times the largest
    acceleration: heavy legs that rise or fall quickly shake the trunk.
    """
    wait, early, highest = _SHAPES.T[:, :, None]
    way = np.linspace(0.0, 1.0, len(below))
    time = wait + (1.0 - wait - early) * np.interp(way, _MINIMUM_JERK, _TIMES)
    highest = apex_share + highest
    rising = np.interp(np.minimum(time / highest, 1.0), _TIMES, _MINIMUM_JERK)
    falling = np.interp(np.clip((time - highest) / (1.0 - highest), 0.0, 1.0), _TIMES, _MINIMUM_JERK)
    height = np.where(time < highest, z + (apex - z) * rising, apex + (target - apex) * falling)
    least = below + margin * np.minimum(1.0, 4.0 * np.minimum(way, 1.0 - way))
    lacking = np.maximum(least - height, 0.0)[:, 1:-1].max(axis=1)
    up, down = highest[:, 0], 1.0 - highest[:, 0]
    costs = _COSTS + haste * ((apex - z) / (up * up) + (apex - target) / (down * down))
    best = int(np.argmin(np.where(lacking < _NEAR, 0.0, lacking) + 1e-3 * costs * _NEAR))
    return float(_SHAPES[best, 0]), float(_SHAPES[best, 1]), float(apex_share + _SHAPES[best, 2])


def _at_rest(position: float) -> Coefficients:
    return position, 0.0, 0.0, 0.0, 0.0, 0.0


def _quintic(begin: State, end: State, duration: float) -> Coefficients:
    """Return the polynomial of degree 5 from one state to another within ``duration``, s; lowest degree first."""
    if not duration > 0.0 or not math.isfinite(duration):
        return _at_rest(end[0])
    p, v, a = begin
    t = duration
    # What is left at the end beyond the motion of constant acceleration, in units of the duration.
    dp = end[0] - (p + t * (v + 0.5 * a * t))
    dv = (end[1] - (v + a * t)) * t
    da = (end[2] - a) * t * t
    cube = 1.0 / (t * t * t)
    third, fourth = (10.0 * dp - 4.0 * dv + 0.5 * da) * cube, (-15.0 * dp + 7.0 * dv - da) * cube / t
    return p, v, 0.5 * a, third, fourth, (6.0 * dp - 3.0 * dv + 0.5 * da) * cube / (t * t)


def _evaluate(c: Coefficients, t: float) -> State:
    """Return position, velocity and acceleration at ``t``."""
    c0, c1, c2, c3, c4, c5 = c
    rate = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    value = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    return value, rate, 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
