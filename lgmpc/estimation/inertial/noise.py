"""Noise densities of an inertial measurement unit."""

from __future__ import annotations

from pydantic import Field

from lgmpc.settings import Noise, Settings

__all__ = ["ImuNoise"]


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
