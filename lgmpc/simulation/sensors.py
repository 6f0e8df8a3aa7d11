"""What a simulated robot's sensors tell: an IMU at the base, joint encoders, and torques from motor currents."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from lgmpc.control.interface import Measurement
from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.simulation.plant import PlantSample
from lgmpc.typing import Array

if TYPE_CHECKING:
    from lgmpc.robot import Robot

__all__ = ["SensorNoise", "Sensors"]


@dataclass(frozen=True)
class SensorNoise:
    """How the sensors err. The defaults are those of Solo12's parts: a 3DM-CX5-25, and encoders of 9 x 20000 counts.

    Attributes:
        gyro: density, rad/s/sqrt(Hz).
        accelerometer: density, m/s2/sqrt(Hz).
        gyro_bias: standard deviation of the bias at the start in each axis, rad/s.
        accelerometer_bias: the same, m/s2.
        gyro_bias_walk: density of the bias's rate, rad/s2/sqrt(Hz).
        accelerometer_bias_walk: the same, m/s3/sqrt(Hz).
        encoder: standard deviation of a joint angle, rad.
        encoder_step: angle between two counts, to which joint angles are rounded, rad; 0 for none.
        joint_velocity: standard deviation of a joint rate as the drives deliver it, rad/s.
        torque: standard deviation of a joint torque, N.m.

    Raises:
        InputError: a number that is negative or not finite.
    """

    gyro: float = 8.7e-5
    accelerometer: float = 2.5e-4
    gyro_bias: float = 7e-4
    accelerometer_bias: float = 0.02
    gyro_bias_walk: float = 1e-5
    accelerometer_bias_walk: float = 1e-4
    encoder: float = 5e-5
    encoder_step: float = 3.5e-5
    joint_velocity: float = 0.02
    torque: float = 0.01

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(field.name, value, "a number that is not negative")


class Sensors:
    r"""The sensors of a robot in a plant, whichever engine moves it.

    The IMU integrates, as real ones do inside: it tells the constant body rates that would have led from the state of
    the last reading to the present one,
    ``w = log(R^T R+) / dt`` and ``a = Gamma_1(w dt)^{-1} R^T (v+ - v - g dt) / dt`` (coning and sculling included;
    Savage, J. Guidance and Control 1998), so the contact impulses of a time-stepping engine are in it, whole.

    Args:
        robot: a robot with a floating base; the IMU is in its base frame.
        noise: see :class:`SensorNoise`.
        period: time between two readings, s.
        rng: random numbers; the same seed gives the same readings.

    Attributes:
        noise: as given.

    Raises:
        InputError: a fixed base, joints without one coordinate each, or a period that is not positive.
    """

    def __init__(self, robot: Robot, noise: SensorNoise, period: float, rng: np.random.Generator) -> None:
        if not robot.floating_base or robot.nq - 7 != robot.nu:
            raise InputError("robot", robot.name, "a robot with a floating base and joints of one coordinate each")
        if not 0.0 < period < math.inf:
            raise InputError("period", period, "a positive number of seconds")
        self.noise, self._period, self._rng = noise, period, rng
        self._gravity = np.array(robot.gravity)
        self._count = 12 + 3 * robot.nu
        self._white = np.repeat([noise.gyro, noise.accelerometer], 3) / math.sqrt(period)
        self._walk = np.repeat([noise.gyro_bias_walk, noise.accelerometer_bias_walk], 3) * math.sqrt(period)
        self._bias = np.repeat([noise.gyro_bias, noise.accelerometer_bias], 3) * rng.normal(size=6)
        self._last: tuple[Array, Array] | None = None

    @property
    def gyro_bias(self) -> Array:
        """(3,) true bias now, rad/s."""
        return self._bias[:3]

    @property
    def accelerometer_bias(self) -> Array:
        """(3,) true bias now, m/s2."""
        return self._bias[3:]

    def read(self, sample: PlantSample) -> Measurement:
        """Return the measurement at the plant's present state; the first one assumes that it was so before."""
        rotation = quaternion.to_matrix.unchecked(sample.q[3:7])
        velocity = rotation @ sample.v[:3]
        rates = np.empty(6)
        if self._last is None:
            rates[:3], rates[3:] = sample.v[3:6], -self._gravity @ rotation
        else:
            before, slower = self._last
            turn = so3.log.unchecked(before.T @ rotation)
            gained = before.T @ (velocity - slower - self._period * self._gravity)
            rates[:3] = turn / self._period
            rates[3:] = so3.left_jacobian_inverse.unchecked(turn) @ gained / self._period
        self._last = rotation, velocity
        noise, draws = self.noise, self._rng.normal(size=self._count)
        self._bias = self._bias + self._walk * draws[:6]
        rates += self._bias + self._white * draws[6:12]
        encoders, speeds, torques = draws[12:].reshape(3, -1)
        joints = sample.q[7:] + noise.encoder * encoders
        if noise.encoder_step > 0.0:
            joints = noise.encoder_step * np.round(joints / noise.encoder_step)
        return Measurement(
            sample.time,
            rates[:3],
            rates[3:],
            joints,
            sample.v[6:] + noise.joint_velocity * speeds,
            sample.tau + noise.torque * torques,
        )
