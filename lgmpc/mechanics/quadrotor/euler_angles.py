"""PID on position and PD on roll, pitch and yaw, for comparison.

Chapter 4.12.3 and G.2; Bouabdallah, Noth and Siegwart, "PID vs LQ control techniques applied to an indoor micro
quadrotor", IROS 2004.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.lie import attitude
from lgmpc.mechanics.checks import check_positive
from lgmpc.mechanics.quadrotor.model import Quadrotor, QuadrotorState
from lgmpc.mechanics.quadrotor.trajectory import FlatTrajectory
from lgmpc.typing import GRAVITY, Array

__all__ = ["EulerAnglePid", "EulerGains"]


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
