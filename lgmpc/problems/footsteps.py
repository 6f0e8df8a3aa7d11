"""Footsteps: the base's commanded path, the footholds along it, and the swings between them."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.locomotion.sequence import GaitSequence
from lgmpc.robot.feet import UP
from lgmpc.timegrid import minimum_jerk
from lgmpc.typing import Array, numbers


class BaseProfile(Protocol):
    """The commanded motion of the base: at rest before ``start`` and after ``stop``."""

    @property
    def start(self) -> float:
        """Time at which it begins to move, s."""

    @property
    def stop(self) -> float:
        """Time at which it is at its goal, s."""

    def placements(self, times: ArrayLike) -> Array:
        """Return (..., 4, 4) the motion since the start, in world axes at the base's initial position."""

    def velocities(self, times: ArrayLike) -> Array:
        """Return (..., 6) [linear; angular] velocity in axes that move along, m/s and rad/s."""


@dataclass(frozen=True, eq=False)
class BasePath:
    """A base that moves along a constant twist: a straight line, an arc or a turn in place, from rest to rest.

    Its speed rises linearly over ``ramp``, stays, and falls linearly over ``ramp``.

    Attributes:
        twist: (6,) [linear; angular] velocity between the ramps, m/s and rad/s, in axes that move along.
        start: time at which it begins to move, s.
        stop: time at which it is at rest again, s.
        ramp: s, at most half of the time between; 0 for steps of the speed.

    Raises:
        InputError: times that do not increase, a ramp that is too long, or a twist that is not six finite numbers.
    """

    twist: Array
    start: float
    stop: float
    ramp: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "twist", _finite("twist", self.twist, 6))
        _check_times(self.start, self.stop)
        if not 0 <= self.ramp <= (self.stop - self.start) / 2 * (1 + 1e-12):
            most = (self.stop - self.start) / 2
            raise InputError("ramp", self.ramp, f"0 to {most:g} s, half of the time in which the base moves")

    @classmethod
    def walking(cls, velocity: ArrayLike, yaw_rate: float, start: float, stop: float, ramp: float) -> "BasePath":
        """Return the path of a commanded velocity (2,), ahead and to the left, m/s, and rate of turning, rad/s.

        Raises:
            InputError: as the class, or a velocity of another shape.
        """
        ahead, left = _finite("velocity", velocity, 2)
        return cls(np.array([ahead, left, 0.0, 0.0, 0.0, yaw_rate]), start, stop, ramp)

    def progress(self, times: ArrayLike) -> Array:
        """Return (...) the time, s, in which the full twist covers the distance covered at ``times``."""
        whole, r = self.stop - self.start, self.ramp
        t = np.clip(np.asarray(times, dtype=np.float64) - self.start, 0.0, whole)
        if r == 0.0:
            return t
        rising, falling = t**2 / (2 * r), whole - r - (whole - t) ** 2 / (2 * r)
        return np.where(t < r, rising, np.where(t > whole - r, falling, t - r / 2))

    def placements(self, times: ArrayLike) -> Array:
        """Return (..., 4, 4) the motion since the start."""
        return se3.exp(self.progress(times)[..., None] * self.twist)

    def velocities(self, times: ArrayLike) -> Array:
        """Return (..., 6) the velocity in axes that move along."""
        t = np.asarray(times, dtype=np.float64)
        left = np.minimum(t - self.start, self.stop - t)
        rate = np.where(left >= 0.0, 1.0, 0.0) if self.ramp == 0.0 else np.clip(left / self.ramp, 0.0, 1.0)
        return rate[..., None] * self.twist


@dataclass(frozen=True, eq=False)
class BaseLeap:
    """A base in ballistic flight: on a parabola and turning at a constant rate, at rest before and after.

    Attributes:
        displacement: (3,) from take-off to landing, m.
        yaw: angle by which it turns, rad.
        start: of the flight, s.
        stop: of the flight, s.
        gravity: m/s2.

    Raises:
        InputError: times that do not increase, or a displacement that is not three finite numbers.
    """

    displacement: Array
    yaw: float
    start: float
    stop: float
    gravity: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "displacement", _finite("displacement", self.displacement, 3))
        _check_times(self.start, self.stop)

    def placements(self, times: ArrayLike) -> Array:
        """Return (..., 4, 4) the motion since the start."""
        whole = self.stop - self.start
        t = np.clip(np.asarray(times, dtype=np.float64) - self.start, 0.0, whole)
        position = (t / whole)[..., None] * self.displacement
        position[..., 2] += self.gravity / 2 * t * (whole - t)
        return se3.from_parts(so3.exp((self.yaw * t / whole)[..., None] * np.array([0.0, 0.0, 1.0])), position)

    def velocities(self, times: ArrayLike) -> Array:
        """Return (..., 6) the velocity in axes that move along; zero when the flight ends."""
        t, whole = np.asarray(times, dtype=np.float64), self.stop - self.start
        velocity = np.zeros((*t.shape, 6))
        velocity[..., :3] = self.displacement / whole
        velocity[..., 2] += self.gravity * (whole / 2 - (t - self.start))
        velocity[..., 5] = self.yaw / whole
        back = np.swapaxes(self.placements(t)[..., :3, :3], -1, -2)
        velocity[..., :3] = so3.act(back, velocity[..., :3])
        return np.where(((t >= self.start) & (t < self.stop))[..., None], velocity, 0.0)


@dataclass(frozen=True, eq=False)
class SwingCurve:
    """Reference of a foot in the air: velocity and acceleration are zero at both ends.

    With ``s`` from 0 to 1, ``start + (end - start)(10 s^3 - 15 s^4 + 6 s^5)`` (minimum jerk) plus
    ``64 height s^3 (1 - s)^3`` along the ground's normal, whose apex is at half time.

    Attributes:
        start: (3,) position at lift-off, world, m.
        end: (3,) position at touchdown, world, m.
        height: of the apex above the line, m.
        liftoff: time, s.
        touchdown: time, s.
        normal: (3,) of the ground, world axes.
    """

    start: Array
    end: Array
    height: float
    liftoff: float
    touchdown: float
    normal: Array | tuple[float, float, float] = UP

    @property
    def ends(self) -> tuple[tuple[float, Array], tuple[float, Array]]:
        """Times and positions of lift-off and touchdown."""
        return (self.liftoff, self.start), (self.touchdown, self.end)

    def progress(self, times: ArrayLike) -> Array:
        """Return (...) the share of the swing's time that has passed, 0 before and 1 after it."""
        return np.clip((np.asarray(times, dtype=np.float64) - self.liftoff) / (self.touchdown - self.liftoff), 0.0, 1.0)

    def positions(self, times: ArrayLike) -> Array:
        """Return (..., 3) the positions at ``times``, world, m; those of the ends before and after."""
        s = self.progress(times)
        points = self.start + minimum_jerk(s)[0][..., None] * (self.end - self.start)
        return points + (64.0 * self.height * (s * (1.0 - s)) ** 3)[..., None] * np.asarray(self.normal)


@dataclass(frozen=True, eq=False)
class Footsteps:
    """Positions of the feet over a gait.

    Attributes:
        start: (nc, 3) the feet's positions at time 0, world, m.
        swings: for each foot its swings in order of time; it is on the ground in between.
    """

    start: Array
    swings: tuple[tuple[SwingCurve, ...], ...]

    @classmethod
    def plan(cls, gait: GaitSequence, motion: BaseProfile, start: ArrayLike, origin: ArrayLike) -> "Footsteps":
        """Return footsteps whose footholds are the nominal foot positions at the middle of each stance.

        Nominal positions are fixed to the base; the leg is as far ahead at touchdown as behind at lift-off (Raibert,
        "Legged robots that balance", 1986). The foothold of each foot's last stance is that of the motion's end.

        Args:
            gait: every swing of it begins and ends.
            motion: of the base.
            start: (nc, 3) the feet's positions at time 0, world, m.
            origin: (3,) position of the base at time 0, world, m.

        Raises:
            InputError: a foot that is in the air at the gait's beginning or end, or positions of another shape.
        """
        places = numbers("start", start, (len(gait.feet), 3), finite=True).copy()
        base = np.asarray(origin, dtype=np.float64)
        return cls(
            places,
            tuple(_swings(gait, motion, foot, place, base) for foot, place in zip(gait.feet, places, strict=True)),
        )

    def positions(self, times: ArrayLike) -> Array:
        """Return (..., nc, 3) the feet's positions at ``times``, world, m."""
        t = np.asarray(times, dtype=np.float64)
        points = np.broadcast_to(self.start, (*t.shape, *self.start.shape)).copy()
        for i, swings in enumerate(self.swings):
            for swing in swings:
                points[..., i, :] = np.where((t >= swing.liftoff)[..., None], swing.positions(t), points[..., i, :])
        return points


def _swings(gait: GaitSequence, motion: BaseProfile, foot: str, start: Array, base: Array) -> tuple[SwingCurve, ...]:
    swings, here, curves = gait.swings(foot), start, []
    for i, swing in enumerate(swings):
        if not (math.isfinite(swing.liftoff) and math.isfinite(swing.touchdown)):
            raise InputError("gait", f"{foot} in the air at an end", "every foot on the ground at beginning and end")
        last = i == len(swings) - 1
        middle = motion.stop if last else (swing.touchdown + swings[i + 1].liftoff) / 2
        there = base + se3.act(motion.placements(middle), start - base)
        curves.append(SwingCurve(here, there, swing.height, swing.liftoff, swing.touchdown))
        here = there
    return tuple(curves)


def _finite(name: str, values: ArrayLike, size: int) -> Array:
    array = numbers(name, values, (size,), finite=True).copy()
    array.flags.writeable = False
    return array


def _check_times(start: float, stop: float) -> None:
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise InputError("start, stop", f"{start}, {stop}", "two finite, increasing times")
