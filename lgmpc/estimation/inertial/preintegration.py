"""IMU preintegration on SE_2(3): many samples as one relative motion, with bias Jacobian and covariance."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.estimation.checks import instance, three
from lgmpc.estimation.inertial.increments import IncrementRule, exponential_increment
from lgmpc.estimation.inertial.kinematics import flow_differential, free_flow, gravity_increment
from lgmpc.lie import checks, sek3
from lgmpc.settings import Noise, Settings
from lgmpc.typing import Array

__all__ = ["ImuNoise", "Preintegration"]


class ImuNoise(Settings):
    """Densities of white noise, as data sheets have them; a sample over ``dt`` has variance ``density^2 / dt``.

    The random walk of a bias integrates white noise: it adds ``density^2 dt`` to the bias's variance.
    """

    gyro_noise_rad_s_rt_hz: Noise = Field(
        default=1e-4, description="Density of the gyro's white noise, rad/s/sqrt(Hz)."
    )
    gyro_bias_walk_rad_s2_rt_hz: Noise = Field(
        default=1e-5, description="Density of the white noise that the gyro's bias integrates, rad/s2/sqrt(Hz)."
    )
    accelerometer_noise_m_s2_rt_hz: Noise = Field(
        default=3e-4, description="Density of the accelerometer's white noise, m/s2/sqrt(Hz)."
    )
    accelerometer_bias_walk_m_s3_rt_hz: Noise = Field(
        default=1e-4, description="Density of the white noise that the accelerometer's bias integrates, m/s3/sqrt(Hz)."
    )

    @property
    def densities(self) -> tuple[float, float, float, float]:
        """Densities of gyro, accelerometer, random walk of the gyro's bias and of the accelerometer's."""
        return (
            self.gyro_noise_rad_s_rt_hz,
            self.accelerometer_noise_m_s2_rt_hz,
            self.gyro_bias_walk_rad_s2_rt_hz,
            self.accelerometer_bias_walk_m_s3_rt_hz,
        )


class Preintegration:
    r"""The product of IMU increments between two instants, independent of the initial state.

    From ``X_j = Gamma phi(X_i) Upsilon_ij`` (see :mod:`lgmpc.estimation.inertial.kinematics`) follow, for a sample with
    increment ``u`` and Jacobian ``J``, and the error ``Upsilon_true = Upsilon exp(xi)``::

        Upsilon <- phi_dt(Upsilon) u          xi <- Ad(u^-1) F_dt xi - J db + J n

    and from the second line the bias Jacobian and the covariance (Forster et al., IEEE TRO 2017; on SE_2(3), where the
    first line is exact for errors of any size: Brossard et al., IEEE TRO 2021). Forster's velocity and position errors
    are those here rotated by ``Upsilon``'s rotation.

    Args:
        noise: densities of the sensors' noise; biases are constant over the interval.
        gyro_bias: (3,) subtracted from every angular velocity, rad/s.
        accelerometer_bias: (3,) subtracted from every specific force, m/s2.
        rule: :func:`~lgmpc.estimation.inertial.exponential_increment`, exact for constant body rates, or
            :func:`~lgmpc.estimation.inertial.zero_order_hold_increment`, that of Forster et al.

    Attributes:
        pose: (5, 5) Upsilon: rotation, velocity, position.
        duration: s.
        bias_jacobian: (9, 6): ``Upsilon(b + db) = Upsilon(b) exp(bias_jacobian db)`` to first order, gyro first.
        covariance: (9, 9) of ``xi``.

    Raises:
        InputError: a bias that is no finite 3-vector.
    """

    def __init__(
        self,
        noise: ImuNoise,
        gyro_bias: Array,
        accelerometer_bias: Array,
        rule: IncrementRule = exponential_increment,
    ) -> None:
        instance("noise", noise, ImuNoise)
        self.pose = sek3.identity(2)
        self.duration = 0.0
        self.bias_jacobian = np.zeros((9, 6))
        self.covariance = np.zeros((9, 9))
        self._bias = _biases(gyro_bias, accelerometer_bias)
        self._densities = np.repeat(np.square(noise.densities[:2]), 3)
        self._rule = rule

    def integrate(self, gyro: Array, accelerometer: Array, duration: float) -> None:
        """Integrate one sample.

        Args:
            gyro: (3,) measured angular velocity, rad/s.
            accelerometer: (3,) measured specific force, m/s2.
            duration: until the next sample, s.

        Raises:
            InputError: a sample that is not finite, or a duration that is not positive.
        """
        bias = self._bias
        step = self._rule(three("gyro", gyro) - bias[:3], three("accelerometer", accelerometer) - bias[3:], duration)
        self.pose = free_flow(self.pose, duration) @ step.pose
        transition = sek3.adjoint.unchecked(sek3.inverse.unchecked(step.pose)) @ flow_differential(duration)
        self.bias_jacobian = transition @ self.bias_jacobian - step.jacobian
        noise = (step.jacobian * (self._densities / duration)) @ step.jacobian.T
        self.covariance = transition @ self.covariance @ transition.T + noise
        self.duration += duration

    def corrected(self, gyro_bias: Array, accelerometer_bias: Array) -> Array:
        """Return (5, 5) the increment for other biases, to first order in their change, without integrating again."""
        change = _biases(gyro_bias, accelerometer_bias) - self._bias
        return sek3.compose(self.pose, sek3.exp(self.bias_jacobian @ change))

    def predict(self, start: Array, gravity: Array) -> Array:
        """Return (5, 5) the pose at the end of a motion from ``start``; gravity (3,) in world axes, m/s2.

        Raises:
            InputError: ``start`` is not in SE_2(3), or gravity no finite 3-vector.
        """
        end: Array = gravity_increment(gravity, self.duration) @ free_flow(_start(start), self.duration) @ self.pose
        return end

    def residual(self, start: Array, end: Array, gravity: Array, gyro_bias: Array, accelerometer_bias: Array) -> Array:
        """Return (9,) the difference of ``end`` from the integrated motion, in the tangent space of :attr:`covariance`.

        ``log(corrected^-1 phi(start)^-1 Gamma^-1 end)``: the error of a preintegration factor.

        Raises:
            InputError: a pose that is not in SE_2(3), or a vector that is not finite.
        """
        before = gravity_increment(gravity, self.duration) @ free_flow(_start(start), self.duration)
        moved = sek3.inverse(before) @ checks.extended_pose("end", end)
        return sek3.log(sek3.inverse(self.corrected(gyro_bias, accelerometer_bias)) @ moved)


def _biases(gyro: Array, accelerometer: Array) -> Array:
    biases = three("gyro_bias", gyro), three("accelerometer_bias", accelerometer)
    return np.concatenate(biases)


def _start(pose: Array) -> Array:
    pose = checks.extended_pose("start", pose)
    if pose.shape != (5, 5):
        raise InputError("start", f"shape {pose.shape}", "shape (5, 5): rotation, velocity, position")
    return pose
