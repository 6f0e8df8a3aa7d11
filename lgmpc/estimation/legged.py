"""The state of a legged robot from what it has on board: IMU, joint encoders, motor currents."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from time import perf_counter

import numpy as np

from lgmpc.control.interface import Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, InvariantEkf
from lgmpc.estimation.legs import ContactDetector, LegSensing
from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

__all__ = ["LeggedEstimator", "LeggedEstimatorSettings"]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class LeggedEstimatorSettings:
    """What the filter believes of its sensors, feet and start.

    Attributes:
        form: name of the error's form, see :data:`lgmpc.estimation.invariant_ekf.FORMS`.
        imu: densities of the IMU's noise.
        encoder_noise: standard deviation of a joint angle, rad.
        foot_noise: standard deviation of the kinematic model's error of a foot position in each axis, m.
        slip: density of the contact points' velocity noise, m/s/sqrt(Hz).
        touch_force: a foot whose estimated normal force exceeds this has touched down, N.
        release_force: one below this has lifted off, N.
        start_tilt: standard deviation of the first roll and pitch, which the accelerometer gives, rad.
        start_velocity: standard deviation of the first velocity, about zero, m/s.
        start_gyro_bias: standard deviation of the gyro bias, about zero, rad/s.
        start_accelerometer_bias: standard deviation of the accelerometer bias, about zero, m/s2.

    Raises:
        InputError: an unknown form, or a number that is negative or not finite.
    """

    form: str = "right"
    imu: ImuNoise = ImuNoise()
    encoder_noise: float = 1e-4
    foot_noise: float = 1e-3
    slip: float = 2e-3
    touch_force: float = 1.0
    release_force: float = 0.3
    start_tilt: float = 0.01
    start_velocity: float = 0.01
    start_gyro_bias: float = 2e-3
    start_accelerometer_bias: float = 0.05

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise InputError("form", self.form, "a form of the error", tuple(FORMS))
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not (math.isfinite(value) and value >= 0.0):
                raise InputError(field.name, value, "a number that is not negative")


class LeggedEstimator:
    """Contact-aided invariant filter of a robot with an IMU at its base (Hartley et al. 2020; chapter 4.11.4).

    Which feet stand is told from their forces, which the joint torques give: nothing that a Solo12 does not have. The
    first reading must be taken at rest; it levels the estimate. World axes and origin are those of ``start``: position
    and yaw are not observable, so they drift, slowly while feet stand.

    A reading that is not finite is left out: the estimate stays as it was, and the failure is counted and logged.

    Args:
        robot: the controller's model; its base frame is the IMU's.
        period: time between two readings, s.
        settings: see :class:`LeggedEstimatorSettings`.
        start: (7,) base pose where the robot begins [position, quaternion x y z w]; its roll and pitch are not used.
            The reference posture's if not given.
        progress: told what is being compiled.

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
        self.legs = LegSensing(robot, settings.encoder_noise, settings.foot_noise, progress)
        self.ekf = InvariantEkf(
            robot.nc,
            settings.imu,
            slip=settings.slip,
            gravity=robot.gravity,
            contact_offset=np.array([0.0, 0.0, robot.contact_radius]),
            form=FORMS[settings.form],
            progress=progress,
        )
        self.failures = 0
        self.spent = 0.0
        self._detector = ContactDetector(robot.nc, settings.touch_force, settings.release_force)
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
        felt = pose[:3, :3] @ accelerometer
        across = np.cross(felt, self._up)
        sine = np.linalg.norm(across)
        if sine > 0.0:
            pose[:3, :3] = so3.exp(across / sine * math.atan2(float(sine), float(felt @ self._up))) @ pose[:3, :3]
        # Neither the yaw nor the position is a matter of measurement: they say which world is meant.
        tilt = settings.start_tilt * np.sqrt(np.maximum(1.0 - self._up**2, 0.0))
        others = (settings.start_velocity, 0.0, settings.start_gyro_bias, settings.start_accelerometer_bias)
        self.ekf.reset(pose, np.concatenate([tilt, np.repeat(others, 3)]))
        self._running = True
