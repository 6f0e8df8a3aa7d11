"""The state of a legged robot from its own sensors: IMU, joint encoders, motor currents."""

import functools
import logging
import math
from collections import deque
from collections.abc import Callable
from time import perf_counter
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from lgmpc.compile import StageKernel
from lgmpc.control.interface import Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of, read_only
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, InvariantEkf, chi_square_bound
from lgmpc.estimation.legs import ContactDetector, LegSensing, normalised_square
from lgmpc.estimation.plausibility import MOST_FAULTS, MeasurementMonitor
from lgmpc.lie import checks, quaternion, so3
from lgmpc.robot import Robot
from lgmpc.robot.feet import UP
from lgmpc.robot.scaling import normal_force_range
from lgmpc.settings import Noise, NonNegative, Positive, RangeFromZero, key
from lgmpc.typing import Array, BoolArray, IntArray, instance

_LOG = logging.getLogger(__name__)


_OLDEST_S = 0.2
"""Largest age of an external pose or velocity that is used, s."""
_OUTLIER = 8.0
"""Distance of an external pose or velocity from the estimate at which it cannot be true, in standard deviations."""
_CONTACT_FORCE = (0.12, 0.8)
"""N per kg of the robot: thresholds of lift-off and touchdown. A quarter of the weight is 2.5."""
_SURE = 6.0
"""Standard deviations of the load of a foot in the air that a touchdown takes: noise of the joints' speeds,
differentiated, times the inertia of a heavy leg may be more than the threshold, and is smoothed until it is not."""


class LeggedEstimatorSettings(ImuNoise):
    """Contact-aided invariant extended Kalman filter on IMU, joint encoders and motor currents.

    The noise is that assumed by the filter; that of the simulated sensors is in section ``sensors`` of a config.
    """

    kind: Literal["inekf"] = key("inekf", "Contact-aided invariant extended Kalman filter.")
    form: Literal["right", "left", "multiplicative"] = key(
        "right", "Error of the filter: right- or left-invariant, or that of a quaternion filter."
    )
    gyro_bias_rad_s: Noise = key(2e-3, "Standard deviation of the gyro's bias at the start in each axis, rad/s.")
    accelerometer_bias_m_s2: Noise = key(0.05, "Standard deviation of the accelerometer's first bias, m/s2.")
    encoder_noise_rad: Noise = key(1e-4, "Standard deviation of a joint angle, rad.")
    joint_velocity_noise_rad_s: Noise = key(0.02, "Standard deviation of a joint's speed, rad/s.")
    foot_noise_m: Annotated[Positive, Field(le=1.0)] = key(1e-3, "Standard error of leg kinematics in each axis, m.")
    slip_m_s_rt_hz: Noise = key(2e-3, "Density of the velocity noise of feet in contact, m/s/sqrt(Hz).")
    resting_speed_m_s: Positive = key(
        7.5e-3,
        "Standard deviation of the speed of a resting foot's contact point in each axis, m/s: it deforms,"
        " and is not quite a sphere.",
    )
    outlier_probability: Annotated[float, Field(strict=True, ge=0.0, le=0.5)] = key(
        1e-3,
        "Probability, under the assumed errors, that a resting foot fails the tests of velocity and"
        " innovation. Feet that fail do not correct the estimate. 0: all feet in contact correct it.",
    )
    rest_s: NonNegative = key(0.02, "Time for which a foot that slid must pass the tests until it corrects again, s.")
    floor_noise_m: Annotated[Positive, Field(le=1.0)] | None = key(
        None,
        "Standard deviation of the floor's height where a foot touches down, about a level plane, m. null: "
        "the floor is unknown, and the estimated height drifts.",
    )
    contact_force_n: RangeFromZero | None = key(
        None,
        "Normal force of a foot, from the joint torques: [lift-off below, touchdown above], N. null: 0.12 "
        "and 0.8 per kg of robot.",
    )
    external_position_noise_m: Annotated[Positive, Field(le=1.0)] = key(
        2e-3, "Noise of an external position, each axis, m."
    )
    external_rotation_noise_rad: Annotated[Positive, Field(le=1.0)] = key(5e-3, "Noise of an external attitude, rad.")
    external_velocity_noise_m_s: Annotated[Positive, Field(le=10.0)] = key(0.03, "Noise of an external velocity, m/s.")
    replace_implausible: bool = Field(
        default=True,
        strict=True,
        description="Whether readings that contradict what joints and a trunk can do within a tick are replaced.",
    )
    start_tilt_rad: Noise = key(0.01, "Standard deviation of the first roll and pitch, by the accelerometer, rad.")
    start_velocity_m_s: Noise = key(0.01, "Standard deviation of the first velocity, about zero, m/s.")


class _External:
    """Corrections of a filter by base poses and velocities of an external source, which arrive late.

    The motion since a measurement is that of the estimates: both lead to the present pose and velocity, which correct
    the filter. The first pose defines the world's axes and origin; velocities are in base axes, and need no pose.
    One that is far off the estimate, measured by the covariances of both, is left out unless that persists: then the
    pose defines the world anew.

    Args:
        ekf: the filter.
        settings: of the estimator.
        period: of the readings, s.
        monitor: counts what is left out; where there is none, nothing is.
    """

    def __init__(
        self, ekf: InvariantEkf, settings: LeggedEstimatorSettings, period: float, monitor: MeasurementMonitor | None
    ) -> None:
        self._ekf, self._settings, self._period, self._monitor = ekf, settings, period, monitor
        self.reset()

    def reset(self) -> None:
        """Forget what was before the next reading."""
        self._past: deque[Array] = deque(maxlen=math.ceil(_OLDEST_S / self._period) + 1)
        self._used = self._anchored = False
        self._outliers = {"external_pose": 0, "external_velocity": 0}

    def update(self, reading: Measurement) -> bool:
        """Correct the estimate with what a reading has of the source; return whether a pose defined the world."""
        pose, velocity = _finite(reading.external_pose, 7), _finite(reading.external_velocity, 3)
        given = pose is not None or velocity is not None
        self._used = self._used or given
        if not self._used:
            return False
        ekf, settings, age = self._ekf, self._settings, reading.external_age or 0.0
        now = ekf.pose[:5, :5].copy()
        self._past.append(now)
        if not (given and 0.0 <= age < (len(self._past) - 0.5) * self._period):
            return False
        then = self._past[-1 - round(age / self._period)]
        taken = then.copy()
        if pose is not None:
            taken[:3, :3], taken[:3, 4] = quaternion.to_matrix(pose[3:]), pose[:3]
        taken[:3, 3] = taken[:3, :3] @ (then[:3, 3] @ then[:3, :3] if velocity is None else velocity)
        measured = taken @ np.linalg.solve(then, now)
        anew = pose is not None and (not self._anchored or self._outliers["external_pose"] >= MOST_FAULTS)
        if anew:
            self._begin(measured)
        elif pose is not None:
            deviations = settings.external_rotation_noise_rad, settings.external_position_noise_m
            columns = measured[:3, [0, 1, 2, 4]].ravel(order="F")
            self._correct("external_pose", reading.time, lambda gate: ekf.correct_pose(columns, deviations, gate))
        if velocity is not None and not anew:
            moving, deviation = measured[:3, 3] @ measured[:3, :3], settings.external_velocity_noise_m_s
            correct = functools.partial(ekf.correct_velocity, moving, deviation)
            self._correct("external_velocity", reading.time, correct)
        change = ekf.pose[:5, :5] @ np.linalg.inv(now)
        for k, each in enumerate(self._past):
            self._past[k] = change @ each
        return anew

    def _correct(self, name: str, time: float, correct: Callable[[float], float]) -> None:
        """Correct, unless the measurement is an outlier and not one of a long series."""
        watched = self._monitor is not None and self._outliers[name] < MOST_FAULTS
        within = correct(_OUTLIER**2 if watched else math.inf) <= _OUTLIER**2
        self._outliers[name] = 0 if within else self._outliers[name] + 1
        if watched and not within:
            assert self._monitor is not None
            self._monitor.leave_out(name, time)

    def _begin(self, pose: Array) -> None:
        """Move the estimate to a pose with a velocity (5, 5), with its biases, without contacts."""
        ekf, settings = self._ekf, self._settings
        self._anchored, self._outliers["external_pose"] = True, 0
        spread = (settings.external_rotation_noise_rad, settings.start_velocity_m_s, settings.external_position_noise_m)
        biases = (settings.gyro_bias_rad_s, settings.accelerometer_bias_m_s2)
        ekf.reset(pose, np.repeat([*spread, *biases], 3), ekf.gyro_bias.copy(), ekf.accelerometer_bias.copy())


def _finite(values: Array | None, count: int) -> Array | None:
    """Return the first numbers, if they are all finite."""
    return None if values is None or not np.isfinite(values[:count]).all() else values[:count]


def _share_of_newest(most: float, noise: float) -> float:
    """Return the share of a first-order filter's newest input with which differenced white noise leaves ``most``.

    Differences of unit variance each leave a standard deviation of ``s / sqrt(2 - s)``.
    """
    square = (most / noise) ** 2 if noise > most else 1.0
    return 0.5 * (math.sqrt(square * (square + 8.0)) - square)


class GroundBelief(Protocol):
    """The surface under the feet, as a controller believes it to be."""

    @property
    def normal(self) -> Array:
        """(3,) unit normal of the surface."""

    @property
    def normals(self) -> Array:
        """(3,) the same, or (nc, 3) one for each foot."""

    @property
    def level(self) -> bool:
        """Whether it is level."""


class LevelGround:
    """A level surface: the :class:`GroundBelief` of an estimator without a controller."""

    normal = normals = read_only(np.array(UP))
    level = True


class LeggedEstimator:
    """Contact-aided invariant filter of a robot with an IMU at its base (Hartley et al. 2020).

    Contacts are detected from the feet's forces, and these are estimated from joint torques, so that no foot sensors
    are required. Only resting feet correct the estimate: a foot in contact whose contact point moves, according to
    joint speeds and the estimate, slides or has just touched down, which would appear as motion of the base. Feet that
    slide too slowly for this test are detected by their innovation, and begin a new contact where they come to rest.
    On ground that counts as level, up to ``floor_noise_m``, each touchdown also measures the height of the contact
    point: the height does not drift, and a tilt can be distinguished from a bias of the accelerometer.
    The first reading must be taken at rest; it determines roll and pitch. World axes and origin are those of ``start``:
    position and yaw are not observable and drift, slowly during contact, unless readings have external poses. External
    velocities are fused too; their angular part is not used, as the gyro is far better.

    A quantity that cannot be true, such as a spike of one tick, is replaced by its prediction for some ticks
    (:class:`~lgmpc.estimation.MeasurementMonitor`). A reading that is not finite even then is skipped: the estimate is
    unchanged, and the failure is counted and logged.

    Args:
        robot: the controller's model; its base frame is the IMU's.
        period: time between two readings, s.
        settings: see :class:`LeggedEstimatorSettings`.
        start: (7,) initial base pose [position, quaternion x y z w], whose roll and pitch are not used; that of the
            reference posture unless given.

    Attributes:
        settings: as given.
        ground: the surface under the feet, level unless replaced by the belief of a controller.
        ekf: the filter.
        legs: positions, motion and forces of the feet at the last reading.
        contacts: (nc,) which feet are in contact with the ground, with all corners of a sole; the filter uses those of
            them that rest.
        rejected: (nc,) which feet in contact did not correct the estimate at the last reading, because they moved.
        monitor: replaces quantities that cannot be true; None where the settings leave it out.
        failures: number of skipped readings.
        spent: duration of the last update, s.

    Raises:
        InputError: a robot of another kind, a period that is not positive, or a start that is no pose.
    """

    def __init__(
        self, robot: Robot, period: float, settings: LeggedEstimatorSettings | None = None, start: Array | None = None
    ) -> None:
        settings = LeggedEstimatorSettings() if settings is None else settings
        instance("robot", robot, Robot)
        instance("settings", settings, LeggedEstimatorSettings)
        start = checks.finite("start", robot.q_reference[:7] if start is None else start)
        if start.shape != (7,):
            raise InputError("start", start, "seven numbers: position, quaternion x y z w")
        self.legs = LegSensing(robot, period, settings.encoder_noise_rad, settings.foot_noise_m)
        self.ekf = InvariantEkf(
            robot.nc, settings, slip=settings.slip_m_s_rt_hz, gravity=robot.gravity, form=FORMS[settings.form],
            contact_offset=-robot.foot_points.lever(), outlier_probability=settings.outlier_probability,
        )  # fmt: skip
        self.ground: GroundBelief = LevelGround()
        self._even, self._feet = True, robot.foot_points
        self.monitor = MeasurementMonitor(robot, period) if settings.replace_implausible else None
        self.failures, self.spent = 0, 0.0
        release, touch = normal_force_range(settings.contact_force_n, _CONTACT_FORCE, robot.mass)
        self._detector = ContactDetector(robot.nf, touch, release)
        self.contacts: BoolArray = self._feet.spread(self._detector.touching)
        noise = self.legs.load_noise(robot.q_reference[7:], settings.joint_velocity_noise_rad_s)
        self._loads, self._newest = np.zeros(robot.nf), _share_of_newest(touch, _SURE * noise)
        self.rejected = np.zeros(robot.nc, dtype=np.bool_)
        self._moved = np.full(robot.nc, -math.inf)  # when each foot was last found to move, s
        self._gate, self._rest = chi_square_bound(settings.outlier_probability), settings.rest_s
        self._resting = settings.resting_speed_m_s**2 * np.eye(3)
        self._base_covariance, self._squares = np.zeros((3, 3)), np.zeros((robot.nc, 1))
        self._normalise = StageKernel.of(normalised_square).bind(
            robot.nc, velocity=self.legs.velocities, spread=self.legs.spreads.reshape(-1, 9),
            base=self._base_covariance.reshape(-1), variance=np.array([settings.joint_velocity_noise_rad_s**2]),
            square=self._squares,
        )  # fmt: skip
        self.settings, self._period = settings, duration_of("period", period)
        self._up = robot.up
        self._external = _External(self.ekf, settings, period, self.monitor)
        self._start = np.eye(5)
        self._start[:3, :3] = quaternion.to_matrix(start[3:])
        self._start[:3, 4] = start[:3]
        self._q, self._v = robot.q_reference.copy(), np.zeros(robot.nv)
        self._q[:7] = start
        self._running = False
        self._floor, self._time = math.nan, 0.0  # height of the floor against gravity, m; of the last reading, s

    def reset(self) -> None:
        """Start again with the next reading."""
        self._detector.reset()
        self._loads[:] = 0.0
        self.legs.reset()
        self._moved[:] = -math.inf
        self.rejected[:] = False
        if self.monitor is not None:
            self.monitor.reset()
        self._external.reset()
        self._running, self.failures, self._floor = False, 0, math.nan

    def update(self, measurement: Measurement) -> RobotState:
        """Process a reading and return the state at its time, in new arrays."""
        started = perf_counter()
        m = measurement if self.monitor is None else self.monitor.check(measurement)
        if math.isfinite(sum(map(np.add.reduce, (m.gyro, m.accelerometer, m.joints, m.speeds, m.torques)))):
            self._advance(m)
        else:
            if self.failures == 0:
                _LOG.warning("a sensor reading is not finite: skipped")
            self.failures += 1
        self.spent = perf_counter() - started
        return RobotState(m.time, self._q.copy(), self._v.copy(), self.contacts.copy(), m.torques)

    def _advance(self, reading: Measurement) -> None:
        ekf, legs, periods = self.ekf, self.legs, 1
        self._write_normals()
        if self._running:
            periods = max(1, round((reading.time - self._time) / self._period))  # since readings that were lost too
            # Rates are those of the legs at the last reading, since which the feet have rolled.
            ekf.predict(reading.gyro, reading.accelerometer, periods * self._period, legs.rates)
        else:
            self._level(reading.accelerometer)
        self._time = reading.time
        legs.update(reading, ekf.rotation, ekf.velocity, ekf.gyro_bias, periods)
        normal_forces = legs.forces @ self._up if self._even else (legs.forces * legs.normals).sum(axis=1)
        self._loads *= 1.0 - self._newest
        self._loads += self._newest * self._feet.total(normal_forces)
        self.contacts = self._feet.spread(self._detector.update(self._loads))
        resting = self.contacts & self._slow() & (reading.time - self._moved >= self._rest)
        for foot in (ekf.touching & ~resting).nonzero()[0].tolist():
            ekf.end_contact(foot)
        new = resting & ~ekf.touching
        ekf.correct(legs.positions, legs.covariances)
        self._moved[ekf.rejected] = reading.time
        for foot in ekf.rejected.nonzero()[0].tolist():
            ekf.end_contact(foot)
        for foot in new.nonzero()[0].tolist():
            ekf.begin_contact(foot, legs.positions[foot], legs.covariances[foot])
        if self.settings.floor_noise_m is not None and new.any():
            self._touch_floor(new.nonzero()[0], self.settings.floor_noise_m)
        if self._external.update(reading):
            _LOG.info("world axes and origin are those of the external source from %.3f s on", reading.time)
            self._floor = math.nan
        np.greater(self.contacts, ekf.touching, out=self.rejected)
        self._q[:3] = ekf.position
        self._q[3:7] = quaternion.from_matrix.unchecked(ekf.rotation)
        self._q[7:] = reading.joints
        self._v[:3] = ekf.velocity @ ekf.rotation
        self._v[3:6] = reading.gyro - ekf.gyro_bias
        self._v[6:] = reading.speeds

    def _write_normals(self) -> None:
        """Write the normal of the ground into the kinematics of the feet and the filter's contacts."""
        level = self.ground.level
        if level and self._even:
            return
        self._even = level
        self.legs.normals[...] = self.ground.normals
        self.ekf.contact_offset[...] = -self._feet.lever(self.ground.normal)

    def _touch_floor(self, feet: IntArray, noise: float) -> None:
        """Correct with the height of a level floor at the contact points of ``feet``; the first ones define it."""
        if not self._even:
            self._floor = math.nan
            return
        if math.isnan(self._floor):
            self._floor = float((self._up @ self.ekf.points[:, feet]).mean())
        for foot in feet.tolist():
            self.ekf.correct_height(foot, self._floor, noise)

    def _slow(self) -> BoolArray:
        """Return (nc,) which contact points may be at rest: the chi-square test of their velocities about zero."""
        # Of the right-invariant error this is the velocity's covariance without the attitude's, which is small.
        np.add(self.ekf.covariance[3:6, 3:6], self._resting, out=self._base_covariance)
        self._normalise()
        return self._squares[:, 0] <= self._gate

    def _level(self, accelerometer: Array) -> None:
        """Start at the start pose, rotated by the smallest rotation for which the specific force at rest points up."""
        settings, pose = self.settings, self._start.copy()
        force = pose[:3, :3] @ accelerometer
        across = np.cross(force, self._up)
        sine = np.linalg.norm(across)
        if sine > 0.0:
            pose[:3, :3] = so3.exp(across / sine * math.atan2(float(sine), float(force @ self._up))) @ pose[:3, :3]
        # Yaw and position are not measured: they define the world's axes and origin.
        tilt = settings.start_tilt_rad * np.sqrt(np.maximum(1.0 - self._up**2, 0.0))
        others = (settings.start_velocity_m_s, 0.0, settings.gyro_bias_rad_s, settings.accelerometer_bias_m_s2)
        self.ekf.reset(pose, np.concatenate([tilt, np.repeat(others, 3)]))
        self._running = True
