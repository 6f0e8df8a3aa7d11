"""The contact-aided invariant filter and the quaternion filter on a trot, from errors of 45 degrees and 1 m/s.

Chapter 4.11.4; Hartley et al., IJRR 2020. Both filters have the same measurements, noise and initial covariance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.stats import chi2

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape, largest
from lgmpc.demos.simulated_trot import DOWN, SimulatedTrot, simulate_trot
from lgmpc.estimation.inertial import ImuNoise, error_dynamics
from lgmpc.estimation.invariant_ekf import MULTIPLICATIVE, RIGHT, ErrorForm, InvariantEkf
from lgmpc.lie import sek3, so3
from lgmpc.typing import Array

RUNS, DURATION, EVERY = 16, 1.0, 20
NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    accelerometer_noise_m_s2_rt_hz=2e-2,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_bias_walk_m_s3_rt_hz=1e-2,
)
SLIP = 0.005
TILT, SPEED = np.radians(45.0), 1.0
DEVIATIONS = np.repeat([TILT, SPEED, 0.1, 0.005, 0.05], 3)
SETTLED = 100
"""First instant of the evaluation, 0.5 s."""


@dataclass(frozen=True)
class _Run:
    """The errors of one filter on one trot.

    Attributes:
        tilts: (n,) angle between estimated and true vertical, deg.
        speeds: (n,) error of the velocity in the base, m/s.
        predicted: (n,) standard deviation of the tilt by the filter's covariance, deg.
        squares: normalised squared errors, every EVERY instants.
        freedoms: their degrees of freedom.
        poses: (n, 5, 5) estimates.
    """

    tilts: Array
    speeds: Array
    predicted: Array
    squares: Array
    freedoms: Array
    poses: Array


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    right, quaternion = (_runs(form) for form in (RIGHT, MULTIPLICATIVE))
    settled = slice(SETTLED // EVERY, None)
    freedom = int(sum(run.freedoms[settled].sum() for run in right))
    ratio = sum(run.squares[settled].sum() for run in right) / freedom
    # Errors at instants 0.1 s apart are correlated, so that the mean's variance is that of one instant a run.
    independent = freedom // len(right[0].squares[settled])
    tolerance = max(abs(chi2.ppf(p, independent) / independent - 1.0) for p in (1e-4, 1.0 - 1e-4))
    # The RMS of two angles in 16 runs has a standard deviation of an eighth: three times that is allowed.
    predicted, found = (_rms(right, name) for name in ("predicted", "tilts"))
    rows = (
        Row("error off expm(A t) xi(0)", 0.0, _log_linear(), 1e-10),
        Row("right form: NEES / freedom", 1.0, ratio, float(tolerance)),
        Row("right form: RMS tilt error", predicted, found, 0.375 * predicted, "deg"),
    )
    lag = _rms(quaternion, "tilts"), _rms(quaternion, "predicted")
    overconfident = np.median([run.squares[settled] / run.freedoms[settled] for run in quaternion])
    return Outcome(
        rows,
        _panels(right, quaternion),
        _times(),
        _scene(_walk(0), right[0], quaternion[0]),
        remarks=(
            f"From 0.5 s on, the quaternion filter is off by {lag[0]:.2g} deg (RMS) and assumes {lag[1]:.2g} deg;"
            f" its median NEES is {overconfident:.2g} times its freedom.",
            "Its linearisation about a wrong attitude adds false information; that of the invariant filter does not"
            " depend on the attitude.",
            "Predicted is the invariant filter's own standard deviation.",
        ),
        floor=True,
    )


def _walk(seed: int) -> SimulatedTrot:
    return simulate_trot(np.random.default_rng(seed), NOISE, duration=DURATION, slip=SLIP)


def _runs(form: ErrorForm) -> list[_Run]:
    ekf = InvariantEkf(4, NOISE, slip=SLIP, form=form)
    return [_one(ekf, seed) for seed in range(RUNS)]


def _one(ekf: InvariantEkf, seed: int) -> _Run:
    walk, rng = _walk(seed), np.random.default_rng(1000 + seed)
    axis, direction = np.append(rng.normal(size=2), 0.0), rng.normal(size=3)
    start = walk.poses[0].copy()
    start[:3, :3] = so3.exp(TILT * axis / np.linalg.norm(axis)) @ start[:3, :3]
    start[:3, 3] += SPEED * direction / np.linalg.norm(direction)
    ekf.reset(start, DEVIATIONS)
    errors, squares, poses = [], [], []
    for k in walk.run(ekf):
        true, rotation = walk.poses[k], ekf.rotation
        up, estimated_up = true[2, :3], rotation[2]
        tilt = np.arctan2(np.linalg.norm(np.cross(up, estimated_up)), up @ estimated_up)
        speed = np.linalg.norm(ekf.velocity @ rotation - true[:3, 3] @ true[:3, :3])
        # The error of the vertical is up x (rotation error), in world axes for the right-invariant form.
        spread = ekf.covariance[:3, :3]
        across = np.eye(3)[:2] if ekf.form is RIGHT else so3.hat(estimated_up)
        errors.append((np.degrees(tilt), speed, np.degrees(np.sqrt(np.trace(across @ spread @ across.T)))))
        poses.append(ekf.pose[:5, :5].copy())
        if k % EVERY == 0:
            squares.append(walk.normalised_error(ekf, k))
    tilts, speeds, predicted = np.array(errors).T
    ratios, freedoms = np.array(squares).T
    return _Run(tilts, speeds, predicted, ratios, freedoms, np.array(poses))


def _rms(runs: list[_Run], name: str) -> float:
    return float(np.sqrt(np.mean([np.square(getattr(run, name)[SETTLED:]) for run in runs])))


def _log_linear() -> float:
    """Return the deviation of the right-invariant error from its linear dynamics in 1 s, from 2 rad and metres."""
    rng = np.random.default_rng(7)
    start, xi = sek3.exp(rng.normal(size=9)), rng.normal(size=9)
    xi[:3] *= 2.0 / np.linalg.norm(xi[:3])
    filters = [InvariantEkf(4, NOISE) for _ in range(2)]
    for ekf, pose in zip(filters, (start, sek3.exp(xi) @ start), strict=True):
        ekf.reset(pose, np.zeros(15))
        ekf.begin_contact(0, np.array([0.2, 0.15, -0.25]), 1e-6 * np.eye(3))
    true, estimate = filters
    first, dynamics, dt = estimate.error(true.pose, np.zeros(6))[:-6], error_dynamics(DOWN, 6), 0.005
    worst = 0.0
    for k in range(1, 201):
        sample = 3.0 * rng.normal(size=3), 20.0 * rng.normal(size=3)
        for ekf in filters:
            ekf.predict(*sample, dt)
        if k % 20 == 0:
            error = estimate.error(true.pose, np.zeros(6))[:-6]
            worst = max(worst, largest(error - expm(dynamics * dt * k) @ first))
    return worst


def _times() -> Array:
    return np.linspace(0.0, DURATION, round(DURATION / _walk(0).period) + 1)


def _panels(right: list[_Run], quaternion: list[_Run]) -> tuple[Panel, ...]:
    times = _times()

    def both(name: str) -> tuple[Curve, ...]:
        curves = []
        for label, runs in (("right-invariant", right), ("quaternion", quaternion)):
            values = np.array([getattr(run, name) for run in runs])
            curves.append(Curve(f"{label}, median", times, np.median(values, axis=0)))
            curves.append(Curve(f"{label}, worst", times, values.max(axis=0)))
        return tuple(curves)

    sparse = times[::EVERY]
    ratios = tuple(
        Curve(label, sparse, np.mean([run.squares / run.freedoms for run in runs], axis=0))
        for label, runs in (("right-invariant", right), ("quaternion", quaternion))
    )
    consistent = Curve("consistent", sparse, np.ones_like(sparse), dashed=True)
    return (
        Panel.over_time("Tilt error from 45 degrees", "deg", *both("tilts"), log_y=True),
        Panel.over_time("Velocity error from 1 m/s", "m/s", *both("speeds"), log_y=True),
        Panel.over_time("Squared error over its freedom", "NEES / freedom", *ratios, consistent, log_y=True),
    )


def _scene(walk: SimulatedTrot, right: _Run, quaternion: _Run) -> tuple[Body, ...]:
    found = []
    for name, poses, color, opacity in (
        ("truth", walk.poses, 0x4C78A8, 1.0),
        ("right-invariant", right.poses, 0x54A24B, 0.5),
        ("quaternion", quaternion.poses, 0xE45756, 0.5),
    ):
        shapes = (
            Shape("box", (0.4, 0.16, 0.06), color=color, opacity=opacity),
            Shape("box", (0.04, 0.1, 0.04), (0.21, 0.0, 0.02), color, opacity),
        )
        found.append(Body(name, shapes, poses[:, :3, 4], poses[:, :3, :3]))
    still = np.tile(np.eye(3), (len(walk.poses), 1, 1))
    for foot in range(4):
        # A foot in the air is shown below its hip, above the floor.
        points = walk.points[:, foot] + np.where(walk.touching[:, foot, None], 0.0, [0.0, 0.0, 0.05])
        found.append(Body(f"feet/{foot + 1}", (Shape("sphere", (0.016,) * 3, color=0x333333),), points, still))
    return tuple(found)
