"""A quadrotor, a free body with a thrust: geometric tracking, and Euler angles for comparison (4.12.3, appendix G).

Controllers and references are CasADi expressions of time and state; derivatives, those of the desired attitude along
the closed loop too, are CasADi's. The controlled vehicle is an Euler-Poincare system on SE(3):

    controller = GeometricController(Quadrotor.of_the_paper(), lissajous())
    motion = controller.quadrotor.system(controller).simulate(np.eye(4), np.zeros(6), HEIGHT, step=2e-3, steps=1000)

Lee, Leok and McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010: attitude errors are
differences of rotation matrices, without singularity. Bouabdallah, Noth and Siegwart, "PID vs LQ control techniques
applied to an indoor micro quadrotor", IROS 2004.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.mechanics.checks import check_inertia, check_positive, frozen
from lgmpc.mechanics.euler_poincare import EulerPoincare, Symbols
from lgmpc.mechanics.rigid_body import SpatialInertia, free_body
from lgmpc.typing import GRAVITY, Array, numbers

_UP = ca.DM([0.0, 0.0, 1.0])

Reference = Callable[[Any], tuple[Any, Any]]
"""From the time, s, to the position (3,), m, and a heading (3,), to which the body's x axis is projected."""


def hover(point: ArrayLike = (0.0, 0.0, 0.0), heading: ArrayLike = (1.0, 0.0, 0.0)) -> Reference:
    """Return a constant reference.

    Raises:
        InputError: a vector of another shape or not finite.
    """
    position, ahead = (ca.DM(numbers(n, v, (3,), finite=True)) for n, v in (("point", point), ("heading", heading)))
    return lambda _: (position, ahead)


def lissajous(
    amplitude: ArrayLike = (1.0, 0.8, 0.4),
    frequency: ArrayLike = (1.5, 3.0, 2.0),
    phase: ArrayLike = (0.0, 0.5, 0.0),
    yaw_rate: float = 0.7,
) -> Reference:
    """Return sinusoids along the axes (m, rad/s, rad), and a heading that turns at a constant rate, rad/s.

    Raises:
        InputError: a vector of another shape, or a number that is not finite.
    """
    given = (("amplitude", amplitude), ("frequency", frequency), ("phase", phase))
    size, rate, start = (ca.DM(numbers(name, value, (3,), finite=True)) for name, value in given)
    turn = float(numbers("yaw_rate", yaw_rate, (), finite=True))
    return lambda t: (size * ca.sin(rate * t + start), ca.vertcat(ca.cos(turn * t), ca.sin(turn * t), 0.0))


class Controller(Protocol):
    """A controller of thrust and moment."""

    def control(self, s: Symbols) -> tuple[Any, Any]:
        """Return the thrust, N, and the moment (3,), body axes, N.m."""


@dataclass(frozen=True, eq=False)
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
        object.__setattr__(self, "inertia", frozen(check_inertia("inertia", self.inertia)))
        if not self.thrust[0] < self.thrust[1]:
            raise InputError("thrust", self.thrust, "(lowest, highest), rising, N")
        if not self.moment > 0:
            raise InputError("moment", self.moment, "a positive number, N.m")

    @classmethod
    def of_the_paper(cls) -> "Quadrotor":
        """Return the vehicle of Lee, Leok and McClamroch (2010), section V, without limits."""
        return cls(4.34, np.diag([0.0820, 0.0845, 0.1377]))

    def limited(self, lift: float, moment: float) -> "Quadrotor":
        """Return the same vehicle with thrusts from 0 to ``lift`` times the weight, and bounded moments, N.m."""
        return replace(self, thrust=(0.0, lift * self.mass * GRAVITY), moment=moment)

    def system(self, controller: Controller) -> EulerPoincare:
        """Return the controlled vehicle, within its limits; its velocity is the body twist, linear first."""

        def wrench(s: Symbols) -> Any:
            thrust, moment = controller.control(s)
            return ca.vertcat(0.0, 0.0, _clipped(thrust, *self.thrust), _clipped(moment, -self.moment, self.moment))

        return free_body(SpatialInertia(self.mass, np.zeros(3), self.inertia), GRAVITY, body_force=wrench)


def attitude_error(rotation: Any, desired: Any) -> tuple[Any, Any]:
    """Return the error function Psi and its derivative e_R (3,) of rotations (3, 3), expressions or numbers.

        Psi = 1/2 tr(I - R_d^T R),      e_R = 1/2 vee(R_d^T R - R^T R_d)

    Psi is 1 - cos of the angle between the two: 0 to 2. At 2 the error vector vanishes as it does at 0. The time
    derivative of Psi is ``Omega . e_R``.
    """
    between = ca.mtimes(ca.transpose(desired), rotation)
    return 0.5 * (3.0 - ca.trace(between)), ca.inv_skew(between)


@dataclass(frozen=True)
class GeometricGains:
    """Gains of the four errors.

    Attributes:
        position: k_x, N/m.
        velocity: k_v, N.s/m.
        rotation: k_R, N.m.
        rate: k_Omega, N.m.s.

    Raises:
        InputError: a gain that is not positive.
    """

    position: float
    velocity: float
    rotation: float
    rate: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_positive(name, value, "a gain")

    @classmethod
    def of_the_paper(cls, mass: float = 4.34) -> "GeometricGains":
        """Return the gains of section V of the paper."""
        return cls(16.0 * mass, 5.6 * mass, 8.81, 2.54)


class GeometricController:
    """Thrust and moment that track a reference from almost every attitude (eqs. 19 and 20 of the paper).

    It is undefined, NaN, where the desired force is zero or along the heading.

    Args:
        quadrotor: the model. Thrusts are clipped to its limits, which the desired attitude's rates account for.
        reference: smooth.
        gains: of the errors; the paper's, scaled with the mass, unless given.

    Attributes:
        command: (time, position, velocity, rotation, rate) -> desired force (3,), world axes, N; the attitude R_d
            (3, 3) for it and the heading; its rate Omega_d (3,), its own axes, rad/s, and the rate's derivative.
    """

    def __init__(self, quadrotor: Quadrotor, reference: Reference, gains: GeometricGains | None = None) -> None:
        self.quadrotor, self.reference = quadrotor, reference
        self.gains = GeometricGains.of_the_paper(quadrotor.mass) if gains is None else gains
        self.command = self._command()

    def control(self, s: Symbols) -> tuple[Any, Any]:
        """Return the thrust, N, and the moment (3,), body axes, N.m."""
        rotation, rate = s.pose[:3, :3], s.velocity[3:]
        state = s.pose[:3, 3], rotation @ s.velocity[:3], rotation, rate
        force, *command = self.command(s.time, *state)
        return ca.dot(force, rotation[:, 2]), self.moment(rotation, rate, *command)

    def moment(self, rotation: Any, rate: Any, desired: Any, desired_rate: Any, acceleration: Any) -> Any:
        """Return (3,) the moment that tracks an attitude, body axes, N.m.

        ``M = -k_R e_R - k_Omega e_Omega + Omega x J Omega - J (hat(Omega) R^T R_d Omega_d - R^T R_d Omega_d')``
        """
        inertia, back = ca.DM(self.quadrotor.inertia), ca.mtimes(ca.transpose(rotation), desired)
        wanted, ahead = ca.mtimes(back, desired_rate), ca.mtimes(back, acceleration)
        error = attitude_error(rotation, desired)[1]
        moment = -self.gains.rotation * error - self.gains.rate * (rate - wanted)
        return moment + ca.cross(rate, inertia @ rate) - inertia @ (ca.cross(rate, wanted) - ahead)

    def _command(self) -> ca.Function:
        mass, gains = self.quadrotor.mass, self.gains
        t, x, v = ca.SX.sym("time"), ca.SX.sym("position", 3), ca.SX.sym("velocity", 3)
        rotation, omega = ca.SX.sym("rotation", 3, 3), ca.SX.sym("rate", 3)
        goal, speed, pull = _derivatives(self.reference(t)[0], t)
        force = gains.position * (goal - x) + gains.velocity * (speed - v) + mass * (pull + GRAVITY * _UP)

        third = _unit(force)
        second = _unit(ca.cross(third, self.reference(t)[1]))
        desired = ca.horzcat(ca.cross(second, third), second, third)

        # Along the closed loop, whose acceleration is known.
        thrust = _clipped(ca.dot(force, rotation[:, 2]), *self.quadrotor.thrust)
        moving = ca.vertcat(t, x, v, ca.vec(rotation))
        rates = ca.vertcat(1.0, v, thrust / mass * rotation[:, 2] - GRAVITY * _UP, ca.vec(rotation @ ca.skew(omega)))
        slope = ca.reshape(ca.jtimes(ca.vec(desired), moving, rates), 3, 3)
        rate = ca.inv_skew(desired.T @ slope)
        outputs = [force, desired, rate, ca.jtimes(rate, moving, rates)]
        return ca.Function("command", [t, x, v, rotation, omega], [*map(ca.densify, outputs)])


@dataclass(frozen=True, eq=False)
class EulerAngleController:
    """Thrust and moment from Euler angles (roll, pitch, yaw about z, y', x'') and their rates, for small tilts.

    Around hovering it equals the geometric controller with the same gains. Far from it the angles are singular: their
    rates ``W(roll, pitch) Omega`` are unbounded at 90 degrees of pitch, and rolls of 179 and -179 degrees, close to
    each other, differ by 358 degrees. Gains are per unit of mass and inertia: squared frequencies, 1/s2, and dampings,
    1/s.

    Attributes:
        quadrotor: the model.
        reference: smooth; the yaw is that of its heading.
        position: gain of the position error.
        velocity: of its derivative.
        angle: of the errors of roll, pitch and yaw.
        angle_rate: of their derivatives.
        tilt: largest commanded roll and pitch, rad.
    """

    quadrotor: Quadrotor
    reference: Reference
    position: float = 4.0
    velocity: float = 4.0
    angle: float = 100.0
    angle_rate: float = 20.0
    tilt: float = 0.7

    def control(self, s: Symbols) -> tuple[Any, Any]:
        """Return the thrust, N, and the moment (3,), body axes, N.m."""
        r, (goal, speed, pull) = s.pose[:3, :3], _derivatives(self.reference(s.time)[0], s.time)
        pull += self.position * (goal - s.pose[:3, 3]) + self.velocity * (speed - r @ s.velocity[:3])
        heading = self.reference(s.time)[1]
        yaw = ca.atan2(heading[1], heading[0])
        c, si = ca.cos(yaw), ca.sin(yaw)
        tilts = (si * pull[0] - c * pull[1]) / GRAVITY, (c * pull[0] + si * pull[1]) / GRAVITY
        target = ca.vertcat(_clipped(ca.vertcat(*tilts), -self.tilt, self.tilt), yaw)

        angles = euler_angles(r)
        away = target - angles
        away[2] -= 2.0 * ca.pi * ca.floor(away[2] / (2.0 * ca.pi) + 0.5)
        turn = self.angle * away - self.angle_rate * euler_rates(angles, s.velocity[3:])
        # The thrust increases with the tilt; upside down no thrust balances the weight.
        tilt = ca.cos(angles[0]) * ca.cos(angles[1])
        thrust = self.quadrotor.mass * (GRAVITY + pull[2]) / ca.if_else(ca.fabs(tilt) < 0.2, 0.2, tilt)
        return thrust, ca.DM(self.quadrotor.inertia) @ turn


def euler_angles(rotation: Any) -> Any:
    """Return (3,) roll, pitch (within +-pi/2) and yaw of a rotation (3, 3) ``Rz(yaw) Ry(pitch) Rx(roll)``, rad."""
    r, pitch = rotation, ca.asin(_clipped(-rotation[2, 0], -1.0, 1.0))
    return ca.vertcat(ca.atan2(r[2, 1], r[2, 2]), pitch, ca.atan2(r[1, 0], r[0, 0]))


def euler_rates(angles: Any, rate: Any) -> Any:
    """Return (3,) the derivatives of roll, pitch and yaw for body rates (3,); singular at pitch 90 deg."""
    (roll, pitch, _), (p, q, r) = ca.vertsplit(angles), ca.vertsplit(rate)
    across = q * ca.sin(roll) + r * ca.cos(roll)
    cosine = ca.if_else(ca.fabs(ca.cos(pitch)) < 1e-6, 1e-6, ca.cos(pitch))
    return ca.vertcat(p + across * ca.tan(pitch), q * ca.cos(roll) - r * ca.sin(roll), across / cosine)


def _derivatives(position: Any, time: Any) -> tuple[Any, Any, Any]:
    """Return a reference's position with velocity and acceleration."""
    goal = ca.densify(ca.SX(position))
    speed = ca.densify(ca.jacobian(goal, time))
    return goal, speed, ca.densify(ca.jacobian(speed, time))


def _clipped(value: Any, low: float, high: float) -> Any:
    return ca.fmin(ca.fmax(value, low), high)


def _unit(vector: Any) -> Any:
    return vector / ca.norm_2(vector)
