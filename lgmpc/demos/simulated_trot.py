"""A simulated trot with IMU samples and leg kinematics of given noise: test data for filters."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.estimation.inertial import ImuNoise, exponential_increment, propagate
from lgmpc.estimation.invariant_ekf import InvariantEkf
from lgmpc.lie import so3
from lgmpc.typing import GRAVITY, Array, BoolArray

DOWN = np.array([0.0, 0.0, -GRAVITY])
_FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
_PERIOD, _DUTY = 0.5, 0.6  # s; duty factor
_PHASES = np.array([0.0, 0.5, 0.5, 0.0])  # phases of the four feet: a trot


@dataclass(frozen=True)
class SimulatedTrot:
    """The motion of a trotting robot with four point feet, and the readings of its sensors; n samples.

    Attributes:
        period: s between samples.
        poses: (n + 1, 5, 5) true rotation, velocity, position.
        biases: (n + 1, 6) true biases, gyro first.
        points: (n + 1, 4, 3) true contact points, world axes, m; meaningless while a foot is in the air.
        touching: (n + 1, 4) contacts.
        gyro: (n, 3) measured over each sample, rad/s.
        accelerometer: (n, 3) measured, m/s2.
        measured: (n + 1, 4, 3) measured foot positions, base axes, m.
        foot_noise: standard deviation of ``measured``, m.
    """

    period: float
    poses: Array
    biases: Array
    points: Array
    touching: BoolArray
    gyro: Array
    accelerometer: Array
    measured: Array
    foot_noise: float

    def run(self, ekf: InvariantEkf) -> Iterator[int]:
        """Run a filter on the readings; yield k, from 0 on, after it has processed those up to instant k.

        Raises:
            InputError: a filter that is not for four feet.
        """
        if ekf.contacts != 4:
            raise InputError("ekf", f"a filter for {ekf.contacts} feet", "one for four")
        covariances = np.tile(self.foot_noise**2 * np.eye(3), (4, 1, 1))
        for k in range(len(self.touching)):
            if k:
                ekf.predict(self.gyro[k - 1], self.accelerometer[k - 1], self.period)
            for foot in np.flatnonzero(ekf.touching & ~self.touching[k]):
                ekf.end_contact(int(foot))
            new = self.touching[k] & ~ekf.touching
            ekf.correct(self.measured[k], covariances)
            for foot in np.flatnonzero(new):
                ekf.begin_contact(int(foot), self.measured[k, foot], covariances[foot])
            yield k

    def normalised_error(self, ekf: InvariantEkf, k: int) -> tuple[float, int]:
        """Return the normalised squared error of a filter at instant k, and its degrees of freedom.

        For a consistent filter it is chi-square distributed (NEES; Bar-Shalom et al. 2001).

        Args:
            ekf: for four feet.
            k: the instant, 0 to n.
        """
        truth = np.eye(9)
        truth[:5, :5], truth[:3, 5:] = self.poses[k], self.points[k].T
        used = np.repeat([True, *ekf.touching, True], [9, 3, 3, 3, 3, 6])
        error = ekf.error(truth, self.biases[k])[used]
        return float(error @ np.linalg.solve(ekf.covariance[np.ix_(used, used)], error)), len(error)


def simulate_trot(
    rng: np.random.Generator,
    noise: ImuNoise,
    *,
    duration: float = 2.0,
    period: float = 0.005,
    foot_noise: float = 0.002,
    slip: float = 0.005,
    gyro_bias: float = 0.005,
    accelerometer_bias: float = 0.05,
) -> SimulatedTrot:
    """Simulate a trot: 0.3 m/s forward, swaying, nodding and turning.

    Args:
        rng: random numbers.
        noise: of the IMU.
        duration: s.
        period: of the IMU, s.
        foot_noise: standard deviation of a measured foot position in each axis, m.
        slip: density of the contact points' velocity noise, m/s/sqrt(Hz).
        gyro_bias: standard deviation of the first bias in each axis, rad/s.
        accelerometer_bias: the same, m/s2.

    Raises:
        InputError: a duration shorter than a sample, or a period that is not positive.
    """
    if not 0.0 < period <= duration:
        raise InputError("period", period, f"a positive time, at most the duration ({duration:g} s)")
    n = round(duration / period)
    rates, poses = _motion(period, n)
    walk = np.repeat(noise.densities[2:], 3) * np.sqrt(period)
    steps = walk * rng.normal(size=(n, 6))
    first = np.repeat([gyro_bias, accelerometer_bias], 3) * rng.normal(size=6)
    biases = first + np.concatenate([np.zeros((1, 6)), np.cumsum(steps, axis=0)])
    white = np.repeat(noise.densities[:2], 3) / np.sqrt(period) * rng.normal(size=(n, 6))
    samples = rates + biases[:-1] + white
    touching = _standing(period, n)
    points = _contact_points(poses, touching, slip * np.sqrt(period) * rng.normal(size=(n + 1, 4, 3)))
    relative = points - poses[:, None, :3, 4]
    measured = np.einsum("nji,nfj->nfi", poses[:, :3, :3], relative) + foot_noise * rng.normal(size=relative.shape)
    return SimulatedTrot(period, poses, biases, points, touching, samples[:, :3], samples[:, 3:], measured, foot_noise)


@functools.lru_cache(maxsize=4)
def _motion(period: float, n: int) -> tuple[Array, Array]:
    """Return (n, 6) constant body rates and the (n + 1, 5, 5) poses that follow from them."""
    rates = _body_rates(period, n)
    poses = np.empty((n + 1, 5, 5))
    poses[0] = _pose(0.0)
    for k in range(n):
        step = exponential_increment(rates[k, :3], rates[k, 3:], period)
        poses[k + 1] = propagate(poses[k], step, DOWN, period)
    rates.flags.writeable = poses.flags.writeable = False
    return rates, poses


def _pose(t: float) -> Array:
    """Return the planned pose at time t, s."""
    pose, h = np.eye(5), 1e-4
    swing = 2.0 * np.pi * t
    angles = [0.12 * np.sin(0.9 * swing + 0.5), 0.1 * np.sin(1.3 * swing), 0.4 * np.sin(0.8 * t)]
    roll, pitch, yaw = (so3.exp(angle * axis) for angle, axis in zip(angles, np.eye(3), strict=True))
    pose[:3, :3] = yaw @ pitch @ roll
    pose[:3, 3] = (_position(t + h) - _position(t - h)) / (2.0 * h)
    pose[:3, 4] = _position(t)
    return pose


def _position(t: float) -> Array:
    swing = 2.0 * np.pi * t
    return np.array(
        [0.3 * t + 0.02 * np.sin(1.7 * swing), 0.03 * np.sin(1.1 * swing), 0.24 + 0.015 * np.sin(2.0 * swing)]
    )


def _body_rates(period: float, n: int) -> Array:
    """Return (n, 6) the constant body rates that lead from each planned pose to the next."""
    planned = np.array([_pose(period * k) for k in range(n + 1)])
    turns = so3.log(np.swapaxes(planned[:-1, :3, :3], -1, -2) @ planned[1:, :3, :3])
    gained = np.diff(planned[:, :3, 3], axis=0) - period * DOWN
    in_body = np.einsum("nji,nj->ni", planned[:-1, :3, :3], gained)
    force = np.einsum("nij,nj->ni", so3.left_jacobian_inverse(turns), in_body)
    return np.concatenate([turns, force], axis=1) / period


def _standing(period: float, n: int) -> BoolArray:
    times = period * np.arange(n + 1)
    return (times[:, None] / _PERIOD + _PHASES) % 1.0 < _DUTY


def _contact_points(poses: Array, touching: BoolArray, slips: Array) -> Array:
    """Return the contact points: on the floor below the hips at touchdown, then fixed except for slip."""
    points: Array = poses[:, None, :3, 4] + np.einsum("nij,fj->nfi", poses[:, :3, :3], _FEET)
    points[:, :, 2] = 0.0
    for k in range(1, len(points)):
        stays = touching[k] & touching[k - 1]
        points[k, stays] = points[k - 1, stays] + slips[k, stays]
    return points
