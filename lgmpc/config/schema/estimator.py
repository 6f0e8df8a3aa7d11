"""Config section ``estimator``: how the controllers learn the robot's state."""

from __future__ import annotations

from typing import Annotated, Literal, Union

from pydantic import Field

from lgmpc.settings import NonNegative, Positive, RangeFromZero, Settings

__all__ = ["EstimatorSection", "GroundTruth", "InvariantEkfSection"]


class GroundTruth(Settings):
    """The simulator tells."""

    kind: Literal["ground_truth"] = Field(default="ground_truth", description="The simulator tells the exact state.")


class InvariantEkfSection(Settings):
    """Contact-aided invariant extended Kalman filter on IMU, encoders and motor currents: what a real robot has.

    The noise is what the filter believes; section ``sensors`` has what there is.
    """

    kind: Literal["inekf"] = Field(default="inekf", description="Contact-aided invariant extended Kalman filter.")
    form: Literal["right", "left", "multiplicative"] = Field(
        default="right", description="Error of the filter: right- or left-invariant, or that of a quaternion filter."
    )
    gyro_noise_rad_s_rt_hz: NonNegative = Field(
        default=1e-4, description="Density of the gyro's white noise, rad/s/sqrt(Hz)."
    )
    gyro_bias_rad_s: NonNegative = Field(
        default=2e-3, description="Standard deviation of the gyro's bias at the start in each axis, rad/s."
    )
    gyro_bias_walk_rad_s2_rt_hz: NonNegative = Field(
        default=1e-5, description="Density of the white noise that the gyro's bias integrates, rad/s2/sqrt(Hz)."
    )
    accelerometer_noise_m_s2_rt_hz: NonNegative = Field(
        default=3e-4, description="Density of the accelerometer's white noise, m/s2/sqrt(Hz)."
    )
    accelerometer_bias_m_s2: NonNegative = Field(
        default=0.05, description="Standard deviation of the accelerometer's bias at the start in each axis, m/s2."
    )
    accelerometer_bias_walk_m_s3_rt_hz: NonNegative = Field(
        default=1e-4, description="Density of the white noise that the accelerometer's bias integrates, m/s3/sqrt(Hz)."
    )
    encoder_noise_rad: NonNegative = Field(default=1e-4, description="Standard deviation of a joint angle, rad.")
    foot_noise_m: Positive = Field(
        default=1e-3, description="Standard deviation of the leg kinematics' error in each axis, m."
    )
    slip_m_s_rt_hz: NonNegative = Field(
        default=2e-3, description="Density of the velocity noise of feet that stand, m/s/sqrt(Hz)."
    )
    contact_force_n: RangeFromZero | None = Field(
        default=None,
        description="Normal force of a foot, from the joint torques, [below which it lifted off, above which it touched"
        " down], N. null: 0.12 and 0.4 a kg of robot.",
    )


EstimatorSection = Annotated[
    Union[GroundTruth, InvariantEkfSection],  # noqa: UP007
    Field(discriminator="kind"),
]
