"""A quadrotor's equations of motion, flat outputs, and a simulation by a Lie-group Runge-Kutta method (chapter 4.12.3).

Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011 (flat outputs).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.mechanics.checks import check_inertia, check_positive, frozen
from lgmpc.mechanics.rollout import runge_kutta4
from lgmpc.typing import GRAVITY, Array, BoolArray, numbers

__all__ = [
    "Controller",
    "FlatOutput",
    "FlatTrajectory",
    "Flight",
    "Hover",
    "Lissajous",
    "Quadrotor",
    "QuadrotorState",
    "fly",
]

_FASTEST = 0.5
"""rad per step: a vehicle that rotates more is lost; the method would not resolve it."""
_PROJECTED_EVERY = 500
"""Steps between projections to SO(3), from which rounding deviates by 1e-16 each."""

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True)
class Quadrotor:
    """A rigid body with a thrust along its z axis and moments about its three axes.

    ``m x'' = f R e3 - m g e3``, ``J Omega' = J Omega x Omega + M``, ``R' = R hat(Omega)`` (Lee, Leok and McClamroch
    2010, eqs. 2-5, with z up).

    Attributes:
        mass: kg.
        inertia: (3, 3) about the centre of mass, body axes, kg.m2.
        thrust: lowest and highest thrust, N; the lowest is 0 for rotors of fixed sense.
        moment: largest moment about each body axis, N.m.

    Raises:
        InputError: mass or moment not positive, an inertia that no body has, or no range of thrust.
    """

    mass: float
    inertia: Array
    thrust: tuple[float, float] = (-math.inf, math.inf)
    moment: float = math.inf

    def __post_init__(self) -> None:
        check_positive("mass", self.mass, "kg")
        inertia = frozen(check_inertia("inertia", self.inertia))
        if not self.thrust[0] < self.thrust[1]:
            raise InputError("thrust", self.thrust, "(lowest, highest), rising, N")
        if not self.moment > 0:
            raise InputError("moment", self.moment, "a positive number, N.m")
        object.__setattr__(self, "inertia", inertia)

    @classmethod
    def of_the_paper(cls) -> Quadrotor:
        """Return the vehicle of Lee, Leok and McClamroch (2010), section V, without limits."""
        return cls(4.34, np.diag([0.0820, 0.0845, 0.1377]))

    def limited(self, lift: float, moment: float) -> Quadrotor:
        """Return the same vehicle with thrusts from 0 to ``lift`` times the weight, and bounded moments, N.m."""
        return replace(self, thrust=(0.0, lift * self.weight), moment=moment)

    @property
    def weight(self) -> float:
        """Weight, N."""
        return self.mass * GRAVITY


@dataclass(frozen=True)
class QuadrotorState:
    """Placement and velocity; all arrays have the same leading batch axes.

    Attributes:
        position: (..., 3) centre of mass, world, m.
        velocity: (..., 3) world axes, m/s.
        rotation: (..., 3, 3) world from body.
        rate: (..., 3) angular velocity Omega, body axes, rad/s.
    """

    position: Array
    velocity: Array
    rotation: Array
    rate: Array

    @classmethod
    def at_rest(cls, rotation: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0)) -> QuadrotorState:
        """Return the state at rest with given attitudes (..., 3, 3).

        Raises:
            InputError: no rotations, or a position that is not finite.
        """
        turns = so3.compose(np.asarray(rotation, dtype=np.float64), np.eye(3))
        place = np.broadcast_to(np.asarray(position, dtype=np.float64), turns.shape[:-1]).copy()
        if not np.isfinite(place).all():
            raise InputError("position", position, "finite numbers, m")
        return cls(place, np.zeros_like(place), turns, np.zeros_like(place))

    def unless(self, chosen: BoolArray, other: QuadrotorState) -> QuadrotorState:
        """Return this state, replaced by the other one for the selected elements of the batch."""
        if not chosen.any():
            return self
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return QuadrotorState(
            *(np.where(chosen.reshape(chosen.shape + (1,) * (a.ndim - chosen.ndim)), b, a) for a, b in pairs)
        )


class Controller(Protocol):
    """A controller of thrust and moment."""

    def control(self, time: float, state: QuadrotorState) -> tuple[Array, Array]:
        """Return thrusts (...), N, and moments (..., 3), body axes, N.m."""


@dataclass(frozen=True)
class Flight:
    """A simulated flight: n+1 times, batch axes after the time.

    Attributes:
        times: (n+1,) s.
        states: arrays (n+1, ..., 3) and (n+1, ..., 3, 3).
        thrusts: (n+1, ...) applied, N.
        moments: (n+1, ..., 3) applied, N.m.
        lost: (...) whether it rotated faster than the step resolves; its state is constant from then on.
    """

    times: Array
    states: QuadrotorState
    thrusts: Array
    moments: Array
    lost: BoolArray


def fly(
    quadrotor: Quadrotor,
    controller: Controller,
    start: QuadrotorState,
    duration: float,
    step: float = 2e-3,
    disturb: Callable[[float], Array] | None = None,
) -> Flight:
    """Simulate by the Runge-Kutta-Munthe-Kaas method of order 4 (Munthe-Kaas 1999), with continuous-time control.

    Args:
        quadrotor: the vehicle.
        controller: evaluated at every stage of the method.
        start: first state, of any batch shape.
        duration: s; the flight lasts the nearest whole number of steps.
        step: s.
        disturb: from time to a moment (3,) on the body, N.m; none if omitted.

    Raises:
        InputError: duration or step not positive.
    """
    for name, value in (("duration", duration), ("step", step)):
        check_positive(name, value, "s")
    count = round(duration / step)
    times: Array = step * np.arange(count + 1, dtype=np.float64)
    shape = (count + 1, *start.position.shape)
    position, velocity, rate, moments = (np.empty(shape) for _ in range(4))
    rotation, thrusts = np.empty((*shape, 3)), np.empty(shape[:-1])
    inverse = np.linalg.inv(quadrotor.inertia)

    def rates(time: float, state: QuadrotorState) -> tuple[Array, Array, Array, Array]:
        commanded_thrust, commanded_moment = controller.control(time, state)
        thrust = np.clip(commanded_thrust, *quadrotor.thrust)
        moment = np.clip(commanded_moment, -quadrotor.moment, quadrotor.moment)
        acceleration = thrust[..., None] / quadrotor.mass * state.rotation[..., 2] - [0.0, 0.0, GRAVITY]
        torque = moment if disturb is None else moment + disturb(time)
        spin = state.rate @ quadrotor.inertia
        turned = (cross(spin, state.rate) + torque) @ inverse
        return acceleration, turned, thrust, moment

    def slope(elapsed: float, y: Array) -> Array:
        """The rates of position, velocity, rotation vector from the step's first attitude, and body rates."""
        moved = _at(state, y)
        acceleration, turned, *_ = rates(t + elapsed, moved)
        turn = moved.rate
        if elapsed:  # at the step's beginning the Jacobian is the identity
            turn = so3.act.unchecked(so3.right_jacobian_inverse.unchecked(y[..., 2, :]), turn)
        return np.stack((moved.velocity, acceleration, turn, turned), axis=-2)

    state = start
    lost: BoolArray = np.zeros(shape[1:-1], dtype=np.bool_)
    for k in range(count + 1):
        t = times[k]
        *_, thrusts[k], moments[k] = rates(t, state)
        position[k], velocity[k], rotation[k], rate[k] = state.position, state.velocity, state.rotation, state.rate
        if k == count:
            break
        begun = np.stack((state.position, state.velocity, np.zeros_like(state.rate), state.rate), axis=-2)
        ahead = _at(state, runge_kutta4(slope, begun, step))
        lost |= ~(np.linalg.norm(ahead.rate, axis=-1) < _FASTEST / step)
        state = ahead.unless(lost, state)
        if k % _PROJECTED_EVERY == _PROJECTED_EVERY - 1:
            state = replace(state, rotation=so3.project(state.rotation))
    return Flight(times, QuadrotorState(position, velocity, rotation, rate), thrusts, moments, lost)


def _at(base: QuadrotorState, y: Array) -> QuadrotorState:
    """Return the state at position, velocity, rotation vector from the base's attitude, and rate, (..., 4, 3)."""
    turned = base.rotation @ so3.exp.unchecked(y[..., 2, :])
    return QuadrotorState(y[..., 0, :], y[..., 1, :], turned, y[..., 3, :])


def cross(a: Array, b: Array) -> Array:
    """Return a x b over the last axis (..., 3)."""
    found: Array = a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1)
    return found


def dot(a: Array, b: Array) -> Array:
    """Return a . b over the last axis, which is kept with length 1."""
    found: Array = np.einsum("...i,...i->...", a, b)[..., None]
    return found


@dataclass(frozen=True)
class FlatOutput:
    """Position and heading at one time, with the derivatives that determine state and control.

    Attributes:
        position: (5, 3) position and its first four time derivatives, world axes, m/s^k.
        heading: (3, 3) direction onto which the body's x axis is projected, and two derivatives.
    """

    position: Array
    heading: Array


class FlatTrajectory(Protocol):
    """A reference trajectory."""

    def at(self, time: float) -> FlatOutput:
        """Return position and heading at a time, s."""


@dataclass(frozen=True)
class Hover:
    """A constant reference point.

    Attributes:
        point: (3,) m.
        heading: (3,) direction of the body's x axis.

    Raises:
        InputError: a vector of another shape or not finite, or no direction.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        numbers("point", self.point, (3,), finite=True)
        if not numbers("heading", self.heading, (3,), finite=True).any():
            raise InputError("heading", self.heading, "a direction")

    def at(self, time: float) -> FlatOutput:
        """Return the point at any time."""
        position, heading = np.zeros((5, 3)), np.zeros((3, 3))
        position[0], heading[0] = self.point, self.heading
        return FlatOutput(position, heading)


@dataclass(frozen=True)
class Lissajous:
    """Sinusoids along the axes, and a heading that turns at a constant rate.

    Attributes:
        amplitude: (3,) m.
        frequency: (3,) rad/s.
        phase: (3,) rad.
        yaw_rate: of the heading, rad/s.

    Raises:
        InputError: vectors of another shape, or a number that is not finite.
    """

    amplitude: tuple[float, float, float] = (1.0, 0.8, 0.4)
    frequency: tuple[float, float, float] = (1.5, 3.0, 2.0)
    phase: tuple[float, float, float] = (0.0, 0.5, 0.0)
    yaw_rate: float = 0.7

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency", "phase"):
            numbers(name, getattr(self, name), (3,), finite=True)
        numbers("yaw_rate", self.yaw_rate, (), finite=True)

    def at(self, time: float) -> FlatOutput:
        """Return position and heading; the k-th derivative of a sine leads it by k quarter turns."""
        size, rate = np.array(self.amplitude), np.array(self.frequency)
        orders = np.arange(5)[:, None]
        position = size * rate**orders * np.sin(rate * time + np.array(self.phase) + 0.5 * np.pi * orders)
        yaw = self.yaw_rate * time + 0.5 * np.pi * np.arange(3)
        heading = (self.yaw_rate ** np.arange(3))[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(3)])
        return FlatOutput(position, heading)
