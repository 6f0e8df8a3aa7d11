"""Simulated sensors: IMU at the base, joint encoders, motor currents, motion capture, depth sensor above the base."""

import math
from collections import deque
from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import Field

from lgmpc.control.interface import Measurement
from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot
from lgmpc.settings import Noise, NonNegative, Settings, key
from lgmpc.simulation.plant import PlantSample
from lgmpc.typing import Array


class SensorNoise(Settings):
    """IMU at the base frame, joint encoders and motor currents; the defaults are those of Solo12's parts.

    These are a 3DM-CX5-25, and encoders of 9 x 20000 counts.
    """

    gyro_noise_rad_s_rt_hz: Noise = key(8.7e-5, "Density of the gyro's white noise, rad/s/sqrt(Hz).")
    gyro_bias_rad_s: Noise = key(7e-4, "Standard deviation of the gyro's bias at the start in each axis, rad/s.")
    gyro_bias_walk_rad_s2_rt_hz: Noise = key(
        1e-5, "Density of the noise that the gyro's bias integrates, rad/s2/sqrt(Hz)."
    )
    accelerometer_noise_m_s2_rt_hz: Noise = key(2.5e-4, "Density of the accelerometer's white noise, m/s2/sqrt(Hz).")
    accelerometer_bias_m_s2: Noise = key(
        0.02, "Standard deviation of the accelerometer's first bias in each axis, m/s2."
    )
    accelerometer_bias_walk_m_s3_rt_hz: Noise = key(
        1e-4, "Density of the white noise that the accelerometer's bias integrates, m/s3/sqrt(Hz)."
    )
    encoder_noise_rad: Noise = key(5e-5, "Standard deviation of a joint angle, rad.")
    encoder_step_rad: Noise = key(3.5e-5, "Angle between two counts of a joint's encoder, rad; 0: no rounding.")
    joint_velocity_noise_rad_s: Noise = key(0.02, "Standard deviation of a joint's speed measured by its drive, rad/s.")
    torque_noise_nm: Annotated[NonNegative, Field(le=1e4)] = key(
        0.01, "Standard deviation of a joint torque measured by its motor current, N.m."
    )
    external_rate_hz: Annotated[NonNegative, Field(le=1e4)] = key(
        0.0, "Rate of base poses and velocities by motion capture or another external source, Hz; 0: none."
    )
    external_delay_s: Annotated[NonNegative, Field(le=1.0)] = key(
        0.01, "Age of external poses and velocities when they arrive, s."
    )
    external_position_noise_m: Noise = key(1e-3, "Standard deviation of an external position in each axis, m.")
    external_rotation_noise_rad: Noise = key(2e-3, "Standard deviation of an external orientation in each axis, rad.")
    external_velocity_noise_m_s: Noise | None = key(
        None, "Standard deviation of an external velocity in each axis, m/s. null: the source has poses only."
    )


class Sensors:
    r"""The sensors of a simulated robot, for any plant.

    The IMU integrates between readings, as real ones do: it measures the constant body rates that lead from the state
    of the last reading to the present one,
    ``w = log(R^T R+) / dt`` and ``a = Gamma_1(w dt)^{-1} R^T (v+ - v - g dt) / dt`` (coning and sculling included;
    Savage, J. Guidance and Control 1998), so the contact impulses of a time-stepping engine are included.

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
        self._white = np.repeat([noise.gyro_noise_rad_s_rt_hz, noise.accelerometer_noise_m_s2_rt_hz], 3) / math.sqrt(
            period
        )
        walk = [noise.gyro_bias_walk_rad_s2_rt_hz, noise.accelerometer_bias_walk_m_s3_rt_hz]
        self._walk = np.repeat(walk, 3) * math.sqrt(period)
        self._bias = np.repeat([noise.gyro_bias_rad_s, noise.accelerometer_bias_m_s2], 3) * rng.normal(size=6)
        self._last: tuple[Array, Array] | None = None
        rate = noise.external_rate_hz
        self._every, self._reads = 0 if rate == 0.0 else max(1, round(1.0 / (rate * period))), 0
        # External poses and velocities, and when they were measured.
        self._underway: deque[tuple[float, Array, Array | None]] = deque()

    @property
    def gyro_bias(self) -> Array:
        """(3,) true bias now, rad/s."""
        return self._bias[:3]

    @property
    def accelerometer_bias(self) -> Array:
        """(3,) true bias now, m/s2."""
        return self._bias[3:]

    def read(self, sample: PlantSample) -> Measurement:
        """Return the measurement at the plant's present state; the first one assumes an unchanged state before."""
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
        joints = sample.q[7:] + noise.encoder_noise_rad * encoders
        if noise.encoder_step_rad > 0.0:
            joints = noise.encoder_step_rad * np.round(joints / noise.encoder_step_rad)
        pose, speed, age = self._external(sample)
        return Measurement(
            sample.time,
            rates[:3],
            rates[3:],
            joints,
            sample.v[6:] + noise.joint_velocity_noise_rad_s * speeds,
            sample.tau + noise.torque_noise_nm * torques,
            external_pose=pose,
            external_velocity=speed,
            external_age=age,
        )

    def _external(self, sample: PlantSample) -> tuple[Array | None, Array | None, float | None]:
        """Return the external pose and velocity that arrive now and their age, if they do."""
        noise = self.noise
        if self._every and self._reads % self._every == 0:
            shift, turn = self._rng.normal(size=(2, 3))
            pose = sample.q[:7].copy()
            pose[:3] += noise.external_position_noise_m * shift
            turned = so3.exp(noise.external_rotation_noise_rad * turn) @ quaternion.to_matrix.unchecked(pose[3:])
            pose[3:] = quaternion.from_matrix.unchecked(turned)
            velocity, deviation = None, noise.external_velocity_noise_m_s
            if deviation is not None:
                velocity = sample.v[:6].copy()
                velocity[:3] += deviation * self._rng.normal(size=3)
            self._underway.append((sample.time, pose, velocity))
        self._reads += 1
        if not self._underway or sample.time - self._underway[0][0] < noise.external_delay_s - 0.5 * self._period:
            return None, None, None
        taken, pose, velocity = self._underway.popleft()
        return pose, velocity, sample.time - taken


_RAYS = 180
_BLIND_SHARE = 0.1  # of the range


class DepthScan:
    """Points of the ground on rays around the sensor that are visible from it.

    Along a ray, ground is hidden behind whatever nearer is seen under a larger elevation.

    Args:
        truth: true heights of points (n, 2), m.
        pose: returns the true pose (7,) of the base, position and quaternion x y z w.
        range_m: longest horizontal distance, m.
        spacing: of points along a ray, m.
        above: height of the sensor above the base, m.
        noise: standard deviation of heights, m.
        rng: of the noise.
    """

    def __init__(
        self,
        truth: Callable[[Array], Array],
        pose: Callable[[], Array],
        range_m: float,
        spacing: float,
        above: float,
        noise: float,
        rng: np.random.Generator,
    ) -> None:
        self._truth, self._pose, self._above, self._noise, self._rng = truth, pose, above, noise, rng
        self._distance = np.arange(_BLIND_SHARE * range_m, range_m, spacing)
        angles = np.arange(_RAYS) * (2.0 * math.pi / _RAYS)
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        self._around = directions[:, None] * self._distance[:, None]

    def __call__(self) -> Array:
        """Return (k, 3) the visible points, in the axes of the base at its origin, m."""
        pose = self._pose()
        rotation = quaternion.to_matrix(pose[3:7])
        eye = pose[:3] + self._above * rotation[:, 2]
        heading = math.atan2(rotation[1, 0], rotation[0, 0])
        c, s = math.cos(heading), math.sin(heading)
        places = self._around @ np.array([[c, s], [-s, c]]) + eye[:2]
        heights = self._truth(places.reshape(-1, 2)).reshape(places.shape[:2])
        elevation = (heights - eye[2]) / self._distance
        visible = elevation >= np.maximum.accumulate(elevation, axis=1)
        points = np.column_stack([places[visible], heights[visible]])
        points[:, 2] += self._noise * self._rng.normal(size=len(points))
        return (points - pose[:3]) @ rotation
