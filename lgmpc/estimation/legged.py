"""The state of a legged robot from what it has on board: IMU, joint encoders, motor currents."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from time import perf_counter
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lgmpc.control.interface import Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, InvariantEkf
from lgmpc.estimation.legs import ContactDetector, LegSensing
from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot
from lgmpc.robot.scaling import normal_force_range
from lgmpc.settings import Noise, Positive, RangeFromZero
from lgmpc.typing import Array, BoolArray

__all__ = ["LeggedEstimator", "LeggedEstimatorSettings"]

_LOG = logging.getLogger(__name__)


_CONTACT_FORCE = (0.12, 0.4)
"""N per kg of the robot: below, a foot has lifted off, and above, touched down. A quarter of the weight is 2.5."""


class LeggedEstimatorSettings(ImuNoise):
    """Contact-aided invariant extended Kalman filter on IMU, encoders and motor currents: what a real robot has.

    The noise is what the filter assumes; section ``sensors`` of a config has what the simulated sensors have.
    """

    kind: Literal["inekf"] = Field(default="inekf", description="Contact-aided invariant extended Kalman filter.")
    form: Literal["right", "left", "multiplicative"] = Field(
        default="right", description="Error of the filter: right- or left-invariant, or that of a quaternion filter."
    )
    gyro_bias_rad_s: Noise = Field(
        default=2e-3, description="Standard deviation of the gyro's bias at the start in each axis, rad/s."
    )
    accelerometer_bias_m_s2: Noise = Field(
        default=0.05, description="Standard deviation of the accelerometer's bias at the start in each axis, m/s2."
    )
    encoder_noise_rad: Noise = Field(default=1e-4, description="Standard deviation of a joint angle, rad.")
    foot_noise_m: Annotated[Positive, Field(le=1.0)] = Field(
        default=1e-3, description="Standard deviation of the leg kinematics' error in each axis, m."
    )
    slip_m_s_rt_hz: Noise = Field(
        default=2e-3, description="Density of the velocity noise of feet in contact, m/s/sqrt(Hz)."
    )
    contact_force_n: RangeFromZero | None = Field(
        default=None,
        description="Normal force of a foot, from the joint torques, [below which it lifted off, above which it touched"
        " down], N. null: 0.12 and 0.4 a kg of robot.",
    )
    start_tilt_rad: Noise = Field(
        default=0.01,
        description="Standard deviation of the first roll and pitch, which are the accelerometer's, rad.",
    )
    start_velocity_m_s: Noise = Field(
        default=0.01, description="Standard deviation of the first velocity, about zero, m/s."
    )


class LeggedEstimator:
    """Contact-aided invariant filter of a robot with an IMU at its base (Hartley et al. 2020; chapter 4.11.4).

    Which feet are in contact follows from their forces, and these from the joint torques: nothing that a Solo12
    lacks. The first reading must be taken at rest; it levels the estimate. World axes and origin are those of
    ``start``: position and yaw are not observable, so they drift, slowly while feet stand.

    A reading that is not finite is left out: the estimate stays as it was, and the failure is counted and logged.

    Args:
        robot: the controller's model; its base frame is the IMU's.
        period: time between two readings, s.
        settings: see :class:`LeggedEstimatorSettings`.
        start: (7,) base pose where the robot begins [position, quaternion x y z w]; its roll and pitch are not used.
            The reference posture's if not given.
        progress: called with a description of what is being compiled.

    Attributes:
        settings: as given.
        ekf: the filter.
        legs: positions, rates and forces of the feet at the last reading.
        failures: readings left out so far.
        spent: duration of the last update, s.

    Raises:
        InputError: a robot of another kind, a period that is not positive, or a start that is no pose.
    """

    def __init__(
        self,
        robot: Robot,
        period: float,
        settings: LeggedEstimatorSettings | None = None,
        start: Array | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        settings = LeggedEstimatorSettings() if settings is None else settings
        start = np.asarray(robot.q_reference[:7] if start is None else start, dtype=np.float64)
        if start.shape != (7,) or not np.isfinite(start).all():
            raise InputError("start", start, "seven numbers: position, quaternion x y z w")
        self.legs = LegSensing(robot, settings.encoder_noise_rad, settings.foot_noise_m, progress)
        self.ekf = InvariantEkf(
            robot.nc,
            settings,
            slip=settings.slip_m_s_rt_hz,
            gravity=robot.gravity,
            contact_offset=np.array([0.0, 0.0, robot.contact_radius]),
            form=FORMS[settings.form],
            progress=progress,
        )
        self.failures = 0
        self.spent = 0.0
        release, touch = normal_force_range(settings.contact_force_n, _CONTACT_FORCE, robot.mass)
        self._detector = ContactDetector(robot.nc, touch, release)
        self.settings, self._period = settings, duration_of("period", period)
        self._up = -robot.gravity / np.linalg.norm(robot.gravity)
        self._start = np.eye(5)
        self._start[:3, :3] = quaternion.to_matrix(start[3:])
        self._start[:3, 4] = start[:3]
        self._q, self._v = robot.q_reference.copy(), np.zeros(robot.nv)
        self._q[:7] = start
        self._running = False

    @property
    def contacts(self) -> BoolArray:
        """(nc,) which feet the estimate stands on."""
        touching: BoolArray = self.ekf.touching
        return touching

    def reset(self) -> None:
        """Begin anew with the next reading."""
        self._detector.reset()
        self._running, self.failures = False, 0

    def update(self, measurement: Measurement) -> RobotState:
        """Take a reading and return the state at its time, in new arrays."""
        started = perf_counter()
        m = measurement
        total = m.gyro.sum() + m.accelerometer.sum() + m.joints.sum() + m.speeds.sum() + m.torques.sum()
        if math.isfinite(total):
            self._advance(m.gyro, m.accelerometer, m.joints, m.speeds, m.torques)
        else:
            if self.failures == 0:
                _LOG.warning("a sensor reading is not finite: left out")
            self.failures += 1
        self.spent = perf_counter() - started
        return RobotState(m.time, self._q.copy(), self._v.copy(), self.contacts.copy())

    def _advance(self, gyro: Array, accelerometer: Array, joints: Array, speeds: Array, torques: Array) -> None:
        ekf, legs = self.ekf, self.legs
        if self._running:
            # Rates are those of the legs at the last reading, from which the feet rolled to where they are now.
            ekf.predict(gyro, accelerometer, self._period, legs.rates)
        else:
            self._level(accelerometer)
        legs.update(joints, speeds, torques, ekf.rotation)
        standing = self._detector.update(legs.forces @ self._up)
        for foot in np.flatnonzero(ekf.touching & ~standing).tolist():
            ekf.end_contact(foot)
        new = standing & ~ekf.touching
        ekf.correct(legs.positions, legs.covariances)
        for foot in np.flatnonzero(new).tolist():
            ekf.begin_contact(foot, legs.positions[foot], legs.covariances[foot])
        self._q[:3] = ekf.position
        self._q[3:7] = quaternion.from_matrix.unchecked(ekf.rotation)
        self._q[7:] = joints
        self._v[:3] = ekf.velocity @ ekf.rotation
        self._v[3:6] = gyro - ekf.gyro_bias
        self._v[6:] = speeds

    def _level(self, accelerometer: Array) -> None:
        """Begin at the start pose, turned the shortest way to where the force of rest points up."""
        settings, pose = self.settings, self._start.copy()
        force = pose[:3, :3] @ accelerometer
        across = np.cross(force, self._up)
        sine = np.linalg.norm(across)
        if sine > 0.0:
            pose[:3, :3] = so3.exp(across / sine * math.atan2(float(sine), float(force @ self._up))) @ pose[:3, :3]
        # Neither the yaw nor the position is measured: they define the world's axes and origin.
        tilt = settings.start_tilt_rad * np.sqrt(np.maximum(1.0 - self._up**2, 0.0))
        others = (settings.start_velocity_m_s, 0.0, settings.gyro_bias_rad_s, settings.accelerometer_bias_m_s2)
        self.ekf.reset(pose, np.concatenate([tilt, np.repeat(others, 3)]))
        self._running = True
