"""Controllers: geometric tracking on SE(3), and a PID on Euler angles for comparison (chapter 4.12.3, appendix G).

Lee, Leok and McClamroch, CDC 2010: attitude errors are differences of rotation matrices, without singularity. The
desired attitude's angular velocity and acceleration are exact: they are computed from the trajectory's derivatives and
from the closed loop's acceleration and jerk. Bouabdallah, Noth and Siegwart, "PID vs LQ control techniques applied to
an indoor micro quadrotor", IROS 2004.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import attitude, checks, so3
from lgmpc.mechanics.checks import check_positive, frozen
from lgmpc.mechanics.quadrotor.model import FlatOutput, FlatTrajectory, Quadrotor, QuadrotorState, cross, dot
from lgmpc.typing import GRAVITY, Array

__all__ = ["AttitudeCommand", "EulerAnglePid", "EulerGains", "GeometricController", "GeometricGains", "attitude_error"]

_E3 = np.array([0.0, 0.0, 1.0])
_VANISHING = 1e-9
"""Fraction of the weight, or of a unit vector, below which a vector is treated as zero."""


@dataclass(frozen=True, eq=False)
class GeometricGains:
    """Gains of the four errors: one number for all axes, or three, one for each.

    Attributes:
        position: k_x, world axes, N/m.
        velocity: k_v, world axes, N.s/m.
        rotation: k_R, stiffness about each axis of the desired body for small errors, N.m.
        rate: k_Omega, body axes, N.m.s.

    Raises:
        InputError: a gain that is not positive, or neither a number nor three.
    """

    position: float | Array
    velocity: float | Array
    rotation: float | Array
    rate: float | Array

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "rotation", "rate"):
            gain = frozen(checks.finite(name, getattr(self, name)))
            if gain.shape not in ((), (3,)) or not (gain > 0.0).all():
                raise InputError(name, getattr(self, name), "a positive number, or three of them: a gain")
            object.__setattr__(self, name, gain if gain.ndim else float(gain))

    @classmethod
    def of_the_paper(cls, mass: float = 4.34) -> GeometricGains:
        """Return the gains of section V of the paper."""
        return cls(16.0 * mass, 5.6 * mass, 8.81, 2.54)


@dataclass(frozen=True)
class AttitudeCommand:
    """A desired attitude with its rate and acceleration; leading batch axes.

    Attributes:
        rotation: (..., 3, 3) R_d, world from desired body.
        rate: (..., 3) Omega_d, desired body axes, rad/s.
        acceleration: (..., 3) its time derivative, rad/s2.
    """

    rotation: Array
    rate: Array
    acceleration: Array


def attitude_error(rotation: Array, desired: Array, stiffness: ArrayLike = 1.0) -> tuple[Array, Array]:
    """Return the error function and its derivative.

        Psi = 1/2 tr(G (I - R_d^T R)),      e_R = 1/2 vee(G R_d^T R - R^T R_d G)

    With G = I, Psi is 1 - cos of the angle between the two: 0 to 2. At 2 the error vector vanishes as it does at 0. In
    general ``G = tr(K) I - 2 K`` for a diagonal K > 0, the stiffness: e_R is K phi for small errors phi, and the time
    derivative of Psi is ``Omega . e_R`` for any error (Bullo and Murray, "Tracking for fully actuated mechanical
    systems: a geometric framework", Automatica 35, 1999). If the three stiffnesses differ, the other
    equilibria are half turns about the three axes.

    Args:
        rotation: (..., 3, 3) R.
        desired: (..., 3, 3) R_d.
        stiffness: diagonal of K, a number or (3,), about the axes of the desired body.

    Returns:
        Psi (...) and e_R (..., 3).
    """
    stiff = np.broadcast_to(np.asarray(stiffness, dtype=np.float64), 3)
    weights = stiff[[1, 2, 0]] + stiff[[2, 0, 1]] - stiff
    weighted = weights[:, None] * (np.swapaxes(desired, -1, -2) @ rotation)
    psi: Array = 0.5 * (weights.sum() - np.trace(weighted, axis1=-2, axis2=-1))
    return psi, _vee(weighted)


class GeometricController:
    """Thrust and moment that track a trajectory from almost every attitude.

    Args:
        quadrotor: the model. Thrusts are clipped to its limits, which the desired attitude's rates account for.
        trajectory: the reference.
        gains: of the errors; the paper's, scaled with the mass, unless given.
    """

    def __init__(self, quadrotor: Quadrotor, trajectory: FlatTrajectory, gains: GeometricGains | None = None) -> None:
        self.quadrotor = quadrotor
        self.trajectory = trajectory
        self.gains = GeometricGains.of_the_paper(quadrotor.mass) if gains is None else gains

    def control(self, time: float, state: QuadrotorState) -> tuple[Array, Array]:
        """Return thrusts (...), N, and moments (..., 3), body axes, N.m (eqs. 19 and 20 of the paper).

        Raises:
            InputError: the desired force is zero or parallel to the heading, which leaves the attitude undefined.
        """
        force, command = self._command(self.trajectory.at(time), state)
        thrust = np.clip(np.sum(force * state.rotation[..., 2], axis=-1), *self.quadrotor.thrust)
        return thrust, self.moment(state, command)

    def moment(self, state: QuadrotorState, command: AttitudeCommand) -> Array:
        """Return (..., 3) the moment that tracks an attitude, body axes, N.m.

        ``M = -e_R - k_Omega e_Omega + Omega x J Omega - J (hat(Omega) R^T R_d Omega_d - R^T R_d Omega_d')``
        """
        inertia, gains, omega = self.quadrotor.inertia, self.gains, state.rate
        _, error = attitude_error(state.rotation, command.rotation, gains.rotation)
        back = np.swapaxes(state.rotation, -1, -2) @ command.rotation
        desired, ahead = (so3.act.unchecked(back, v) for v in (command.rate, command.acceleration))
        moment: Array = -error - gains.rate * (omega - desired)
        moment += cross(omega, omega @ inertia) - (cross(omega, desired) - ahead) @ inertia
        return moment

    def command(self, time: float, state: QuadrotorState) -> AttitudeCommand:
        """Return the attitude for the desired force and heading.

        Raises:
            InputError: as :meth:`control`.
        """
        return self._command(self.trajectory.at(time), state)[1]

    def _command(self, desired: FlatOutput, state: QuadrotorState) -> tuple[Array, AttitudeCommand]:
        mass, gains = self.quadrotor.mass, self.gains
        x, v, a, j, s = desired.position
        axis = state.rotation[..., 2]
        axis_rate = so3.act.unchecked(state.rotation, cross(state.rate, _E3))

        # The desired force and its two derivatives; acceleration and jerk are those of the closed loop.
        force = gains.position * (x - state.position) + gains.velocity * (v - state.velocity)
        force = force + mass * (a + GRAVITY * _E3)
        needed = dot(force, axis)
        thrust = np.clip(needed, *self.quadrotor.thrust)
        acceleration = thrust / mass * axis - GRAVITY * _E3
        force1 = gains.position * (v - state.velocity) + gains.velocity * (a - acceleration) + mass * j
        thrust1 = dot(force1, axis) + dot(force, axis_rate)
        thrust1 = np.where(thrust == needed, thrust1, 0.0)  # a saturated thrust is constant
        jerk = (thrust1 * axis + thrust * axis_rate) / mass
        force2 = gains.position * (a - acceleration) + gains.velocity * (j - jerk) + mass * s

        if np.linalg.norm(force, axis=-1).min(initial=np.inf) < _VANISHING * self.quadrotor.weight:
            raise InputError("state", "a desired force of zero", "errors for which the desired force does not vanish")
        third = _unit(force, force1, force2)
        h, h1, h2 = desired.heading
        side = cross(third[0], h)
        if np.linalg.norm(side, axis=-1).min(initial=np.inf) < _VANISHING:
            raise InputError("heading", "parallel to the desired thrust", "a heading across the desired thrust")
        side1 = cross(third[1], h) + cross(third[0], h1)
        side2 = cross(third[2], h) + 2.0 * cross(third[1], h1) + cross(third[0], h2)
        second = _unit(side, side1, side2)
        first = (
            cross(second[0], third[0]),
            cross(second[1], third[0]) + cross(second[0], third[1]),
            cross(second[2], third[0]) + 2.0 * cross(second[1], third[1]) + cross(second[0], third[2]),
        )
        r, r1, r2 = (np.stack(columns, axis=-1) for columns in zip(first, second, third, strict=True))
        back = np.swapaxes(r, -1, -2)
        omega = _vee(back @ r1)
        # R'' = R (hat(Omega)^2 + hat(Omega')): the square is symmetric, the other part is not.
        return force, AttitudeCommand(r, omega, _vee(back @ r2))


def _unit(a: Array, a1: Array, a2: Array) -> tuple[Array, Array, Array]:
    """Return a/|a| and its first two derivatives, given those of a."""
    size = np.linalg.norm(a, axis=-1, keepdims=True)
    u, b1, b2 = a / size, a1 / size, a2 / size
    along = dot(u, b1)
    u1 = b1 - along * u
    # d/dt of b1 and of (u . b1) with |a|' = |a| (u . b1).
    slope = b2 - along * b1
    turn = dot(u1, b1) + dot(u, slope)
    return u, u1, slope - turn * u - along * u1


def _vee(matrix: Array) -> Array:
    """Return the vector of the antisymmetric part."""
    skew = 0.5 * (matrix - np.swapaxes(matrix, -1, -2))
    found: Array = so3.vee.unchecked(skew)
    return found


@dataclass(frozen=True)
class EulerGains:
    """Gains per unit of mass and inertia: squared frequencies, 1/s2, and dampings, 1/s.

    Attributes:
        position: of the position error.
        velocity: of its derivative.
        integral: of its integral, 1/s3.
        angle: of the errors of roll, pitch and yaw.
        angle_rate: of their derivatives.
        tilt: largest commanded roll and pitch, rad.

    Raises:
        InputError: one that is not positive.
    """

    position: float = 4.0
    velocity: float = 4.0
    integral: float = 0.5
    angle: float = 100.0
    angle_rate: float = 20.0
    tilt: float = 0.7

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_positive(name, value, "rad" if name == "tilt" else "a gain")


class EulerAnglePid:
    """Thrust and moment from Euler angles (roll, pitch, yaw about z, y', x''), for small tilts.

    Around hovering it equals the geometric controller with the same gains. Far from it the angles are singular: their
    rates ``W(roll, pitch) Omega`` are unbounded at 90 degrees of pitch, and rolls of 179 and -179 degrees, close to
    each other, differ by 358 degrees.

    Args:
        quadrotor: the model.
        trajectory: the reference; the yaw is that of its heading.
        gains: of the errors.
    """

    def __init__(self, quadrotor: Quadrotor, trajectory: FlatTrajectory, gains: EulerGains | None = None) -> None:
        self.quadrotor = quadrotor
        self.trajectory = trajectory
        self.gains = EulerGains() if gains is None else gains
        self._sum: Array = np.zeros(3)  # integral of the position error, m.s
        self._time = 0.0

    def control(self, time: float, state: QuadrotorState) -> tuple[Array, Array]:
        """Return thrusts (...), N, and moments (..., 3), body axes, N.m."""
        desired, gains, quadrotor = self.trajectory.at(time), self.gains, self.quadrotor
        error = desired.position[0] - state.position
        self._accumulate(time, error)
        pull = desired.position[2] + gains.position * error + gains.velocity * (desired.position[1] - state.velocity)
        pull = pull + gains.integral * self._sum
        angles = attitude.roll_pitch_yaw(state.rotation)
        yaw = np.arctan2(desired.heading[0, 1], desired.heading[0, 0])
        ahead, left = attitude.turn(-yaw, pull[..., 0], pull[..., 1])
        roll, pitch = (np.clip(each / GRAVITY, -gains.tilt, gains.tilt) for each in (-left, ahead))
        target = np.stack([roll, pitch, np.broadcast_to(yaw, roll.shape)], axis=-1)
        away = target - angles
        away[..., 2] = (away[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
        turn = gains.angle * away - gains.angle_rate * angle_rates(angles, state.rate)
        tilt = np.cos(angles[..., 0]) * np.cos(angles[..., 1])
        # The thrust increases with the tilt; upside down no thrust balances the weight.
        thrust = quadrotor.mass * (GRAVITY + pull[..., 2]) / np.where(np.abs(tilt) < 0.2, 0.2, tilt)
        return thrust, turn @ quadrotor.inertia

    def _accumulate(self, time: float, error: Array) -> None:
        if time < self._time:  # a new flight
            self._sum, self._time = np.zeros(3), time
        self._sum = self._sum + error * (time - self._time)
        self._time = time


def angle_rates(angles: Array, rate: Array) -> Array:
    """Return (..., 3) the derivatives of roll, pitch and yaw for body rates (..., 3); singular at pitch 90 deg."""
    (roll, pitch, _), (p, q, r) = np.moveaxis(angles, -1, 0), np.moveaxis(rate, -1, 0)
    across = q * np.sin(roll) + r * np.cos(roll)
    cosine = np.cos(pitch)
    cosine = np.where(np.abs(cosine) < 1e-6, 1e-6, cosine)
    return np.stack([p + across * np.tan(pitch), q * np.cos(roll) - r * np.sin(roll), across / cosine], axis=-1)
