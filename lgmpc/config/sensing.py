"""From sections ``estimator`` and ``sensors`` of a config to what lets a controller do without the truth."""

from __future__ import annotations

import numpy as np

from lgmpc.config.schema import Config, InvariantEkfSection
from lgmpc.config.session import Notify
from lgmpc.estimation import ImuNoise, LeggedEstimator, LeggedEstimatorSettings
from lgmpc.robot import Robot
from lgmpc.simulation.sensors import SensorNoise, Sensors

__all__ = ["build_estimator", "build_sensors"]

_CONTACT_FORCE = (0.12, 0.4)
"""N per kg of the robot: below, a foot has lifted off, and above, touched down. A quarter of the weight is 2.5."""


def build_sensors(config: Config, robot: Robot) -> Sensors:
    """Return the simulated sensors of section ``sensors``, their noise seeded by ``seed``."""
    section = config.sensors
    noise = SensorNoise(
        gyro=section.gyro_noise_rad_s_rt_hz,
        accelerometer=section.accelerometer_noise_m_s2_rt_hz,
        gyro_bias=section.gyro_bias_rad_s,
        accelerometer_bias=section.accelerometer_bias_m_s2,
        gyro_bias_walk=section.gyro_bias_walk_rad_s2_rt_hz,
        accelerometer_bias_walk=section.accelerometer_bias_walk_m_s3_rt_hz,
        encoder=section.encoder_noise_rad,
        encoder_step=section.encoder_step_rad,
        joint_velocity=section.joint_velocity_noise_rad_s,
        torque=section.torque_noise_nm,
    )
    return Sensors(robot, noise, 1.0 / config.wbc.rate_hz, np.random.default_rng(config.seed))


def build_estimator(config: Config, robot: Robot, notify: Notify = lambda message: None) -> LeggedEstimator | None:
    """Return the estimator of section ``estimator``; None where the simulator tells the state."""
    section = config.estimator
    if not isinstance(section, InvariantEkfSection):
        return None
    release, touch = section.contact_force_n or tuple(force * robot.mass for force in _CONTACT_FORCE)
    imu = ImuNoise(
        gyro=section.gyro_noise_rad_s_rt_hz,
        accelerometer=section.accelerometer_noise_m_s2_rt_hz,
        gyro_bias_walk=section.gyro_bias_walk_rad_s2_rt_hz,
        accelerometer_bias_walk=section.accelerometer_bias_walk_m_s3_rt_hz,
    )
    settings = LeggedEstimatorSettings(
        form=section.form,
        imu=imu,
        encoder_noise=section.encoder_noise_rad,
        foot_noise=section.foot_noise_m,
        slip=section.slip_m_s_rt_hz,
        touch_force=touch,
        release_force=release,
        start_gyro_bias=section.gyro_bias_rad_s,
        start_accelerometer_bias=section.accelerometer_bias_m_s2,
    )
    return LeggedEstimator(robot, 1.0 / config.wbc.rate_hz, settings, progress=notify)
