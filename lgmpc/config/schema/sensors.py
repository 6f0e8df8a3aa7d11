"""Config section ``sensors``: how the simulated robot's sensors err. They matter where an estimator listens to them."""

from __future__ import annotations

from pydantic import Field

from lgmpc.settings import NonNegative, Settings

__all__ = ["SensorsSection"]


class SensorsSection(Settings):
    """IMU at the base frame, joint encoders and motor currents; the defaults are those of Solo12's parts."""

    gyro_noise_rad_s_rt_hz: NonNegative = Field(
        default=8.7e-5, description="Density of the gyro's white noise, rad/s/sqrt(Hz)."
    )
    gyro_bias_rad_s: NonNegative = Field(
        default=7e-4, description="Standard deviation of the gyro's bias at the start in each axis, rad/s."
    )
    gyro_bias_walk_rad_s2_rt_hz: NonNegative = Field(
        default=1e-5, description="Density of the white noise that the gyro's bias integrates, rad/s2/sqrt(Hz)."
    )
    accelerometer_noise_m_s2_rt_hz: NonNegative = Field(
        default=2.5e-4, description="Density of the accelerometer's white noise, m/s2/sqrt(Hz)."
    )
    accelerometer_bias_m_s2: NonNegative = Field(
        default=0.02, description="Standard deviation of the accelerometer's bias at the start in each axis, m/s2."
    )
    accelerometer_bias_walk_m_s3_rt_hz: NonNegative = Field(
        default=1e-4, description="Density of the white noise that the accelerometer's bias integrates, m/s3/sqrt(Hz)."
    )
    encoder_noise_rad: NonNegative = Field(default=5e-5, description="Standard deviation of a joint angle, rad.")
    encoder_step_rad: NonNegative = Field(
        default=3.5e-5, description="Angle between two counts of a joint's encoder, rad; 0: no rounding."
    )
    joint_velocity_noise_rad_s: NonNegative = Field(
        default=0.02, description="Standard deviation of a joint's speed as its drive delivers it, rad/s."
    )
    torque_noise_nm: NonNegative = Field(
        default=0.01, description="Standard deviation of a joint torque as its motor current tells it, N.m."
    )
