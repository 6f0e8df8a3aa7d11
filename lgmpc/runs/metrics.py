"""Figures of merit of a run, computed from its log.

They are computed from the part of the log before the first value that is not finite; :attr:`Metrics.survived_s` is the
length of that part.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import get_args, get_type_hints

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.runs.atomic import Number
from lgmpc.runs.figures import described, metric
from lgmpc.runs.ground import along_ground
from lgmpc.runs.intervals import joined_intervals
from lgmpc.runs.log import SENSOR_FAULTS, RunLog
from lgmpc.runs.modes import ModeMetrics, fallen_ticks, falls, mode_metrics
from lgmpc.runs.walking import WalkingMetrics, rms, walking_metrics
from lgmpc.typing import Array, BoolArray


@described
@dataclass(frozen=True)
class EstimatorErrors:
    """Errors of the estimate over a run.

    Position and yaw are not observable by the robot's own sensors: their errors are drift.
    """

    max_position_m: float = metric("Largest distance between estimated and true base position, m.")
    final_position_m: float = metric("Distance at the end, m.")
    max_tilt_deg: float = metric("Largest angle between estimated and true vertical in the base, degrees.")
    max_yaw_deg: float = metric("Largest absolute error of the yaw, degrees.")
    final_yaw_deg: float = metric("Absolute error of the yaw at the end, degrees.")
    rms_velocity_m_s: float = metric("RMS norm of the error of the base's linear velocity, base axes, m/s.")
    max_velocity_m_s: float = metric("Largest norm of this error, m/s.")
    wrong_contact_fraction: float = metric("Fraction of feet and ticks whose contact was classified wrongly.")
    rejected_measurements: int = metric("Rejected measurements; of feet that slid or had just touched down.")


@described
@dataclass(frozen=True)
class SensorFaults:
    """Ticks in which a quantity's reading could not be true, and was replaced or left out."""

    gyro: int = metric("Of the angular velocity.")
    accelerometer: int = metric("Of the specific force.")
    joints: int = metric("Of a joint angle.")
    speeds: int = metric("Of a joint's speed.")
    torques: int = metric("Of a joint torque.")
    external_pose: int = metric("Of a pose by an external source, left out.", 0)
    external_velocity: int = metric("Of a velocity by an external source, left out.", 0)

    @classmethod
    def of(cls, log: RunLog) -> "SensorFaults | None":
        """Return the counts of a log; None where measurements were not monitored."""
        if log.sensor_faults is None:
            return None
        bits = {name: 1 << bit for bit, name in enumerate(SENSOR_FAULTS)}
        return cls(**{name: int(np.count_nonzero(log.sensor_faults & bit)) for name, bit in bits.items()})


def estimator_errors(log: RunLog) -> EstimatorErrors | None:
    """Return the errors of a log; ``None`` if there was no finite estimate."""
    if log.estimate_q is None or log.estimate_v is None or log.estimate_contacts is None:
        return None
    use = np.flatnonzero(np.isfinite(log.estimate_q).all(axis=1) & np.isfinite(log.estimate_v).all(axis=1))
    if use.size == 0:
        return None
    position = np.linalg.norm(log.estimate_q[use, :3] - log.q[use, :3], axis=1)
    tilt, yaw = tilt_and_yaw_deg(log.estimate_q[use, 3:7], log.q[use, 3:7])
    velocity = np.linalg.norm(log.estimate_v[use, :3] - log.v[use, :3], axis=1)
    return EstimatorErrors(
        max_position_m=float(position.max()),
        final_position_m=float(position[-1]),
        max_tilt_deg=float(tilt.max()),
        max_yaw_deg=float(np.abs(yaw).max()),
        final_yaw_deg=float(abs(yaw[-1])),
        rms_velocity_m_s=float(np.sqrt(np.mean(np.square(velocity)))),
        max_velocity_m_s=float(velocity.max()),
        wrong_contact_fraction=float((log.touching[use] != (log.estimate_contacts[use] != 0)).mean()),
        rejected_measurements=int(np.count_nonzero(log.estimate_contacts == 2)),
    )


def tilt_and_yaw_deg(estimate: Array, truth: Array) -> tuple[Array, Array]:
    """Decompose the rotation from true to estimated orientations into tilt and yaw.

    Args:
        estimate: (n, 4) quaternions x y z w.
        truth: (n, 4).

    Returns:
        (n,) tilts in [0, 180] and (n,) yaws in [-180, 180], degrees: the rotation is the tilt after the yaw.
    """
    one, other = so3.from_quaternion.unchecked(estimate), so3.from_quaternion.unchecked(truth)
    tilt, yaw = attitude.tilt_and_yaw(one @ np.swapaxes(other, -1, -2))
    return np.degrees(tilt), np.degrees(yaw)


CONTACT_GAP_S = 0.02
"""A contact that opens for a shorter time, s, remains one stance, and so does its slip."""
_STANDING = 0.5
"""Vertical component of the ground's normal above which a foot stands on it; on steeper ground it strikes a riser."""


@dataclass(frozen=True)
class Timing:
    """Percentiles of a repeated computation's duration, ms."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class LinkDistances:
    """Distances between links of the robot.

    Attributes:
        time: (k,) times, s.
        least: (k,) the least, m; negative depths of links that overlap.
        links: (k,) of which links they are.
        legs: (k,) least distance of links of two legs, m.
    """

    time: Array
    least: Array
    links: Sequence[str]
    legs: Array


@described
@dataclass(frozen=True)
class Metrics:
    """The metrics of a run; ``None`` where there was nothing to measure."""

    survived_s: Number = metric(
        "Time until the base fell, s; below half its target height, tilted beyond 45 degrees, or not "
        "finite; the whole duration if it did not. A robot that lies, rises or lies down has not fallen."
    )
    fell: bool = metric("Whether it fell.")
    max_tilt_deg: Number = metric("Largest tilt of the base, degrees; from the ground's normal, yaw does not count.")
    max_displacement_m: Number = metric("Largest distance of the base from its initial or commanded position, m.")
    min_base_height_m: Number = metric("Lowest height of the base, m; above the ground, along its normal.")
    final_position_error_m: Number = metric("Distance of the base from its first or commanded position at the end, m.")
    final_tilt_deg: Number = metric("Tilt of the base at the end, degrees.")
    final_rotation_deg: Number = metric("Final rotation of the base from its first or commanded attitude, degrees.")
    max_slip_m: Number = metric("Largest slip of a foot in contact, m; from the start of its stance, rolling included.")
    max_foot_displacement_m: Number = metric("Largest distance of a foot from its initial position, m; steps included.")
    max_abs_torque_nm: Number = metric("Largest torque at any joint, N.m.")
    torque_saturation_fraction: Number = metric("Fraction of ticks with a joint at its torque limit, 0 to 1.")
    min_friction_margin_n: float | None = metric("Smallest distance of a measured force from its friction cone, N.")
    rms_joint_velocity_rad_s: float | None = metric("RMS of the joint speeds from steady_from_s on, rad/s.")
    com_rms_error_m: float | None = metric("RMS error of the centre of mass from steady_from_s on, m.")
    max_com_error_m: float | None = metric("Largest error of the centre of mass from steady_from_s on, m.")
    solver_failures: int = metric("MPC updates and whole-body ticks whose solver failed.")
    deadline_misses: int = metric("Ticks that took longer than their period, estimation and planning in them included.")
    mpc_ms: Timing | None = metric("Duration of an MPC update, ms; contacts ahead and sampling of the plan included.")
    wbc_ms: Timing | None = metric("Duration of a whole-body tick, ms.")
    real_time_factor: float | None = metric("Simulated over elapsed time.")
    estimator_ms: Timing | None = metric("Duration of the estimator's tick, ms.", None)
    estimator: EstimatorErrors | None = metric("Errors of the controller's estimate.", None)
    min_base_height_fraction: float | None = metric("Lowest height of the base relative to its initial one.", None)
    walking: WalkingMetrics | None = metric("Metrics of commanded motion.", None)
    falls: int = metric("Falls; one ends when the robot folds its legs again.", 0)
    modes: ModeMetrics | None = metric("Metrics of falls, lying, rising and manoeuvres.", None)
    joint_friction_nm: float | None = metric("Estimated friction of the joints at the end, mean of all, N.m.", None)
    leg_collisions: int | None = metric("Number of times that two legs touch; convex hulls of their links.", None)
    max_self_penetration_m: float | None = metric("Largest depth to which links overlap, m; of convex hulls.", None)
    forecast_ms: Timing | None = metric("Duration of a tick's forecasts of steps against a push, ms.", None)
    sensor_faults: SensorFaults | None = metric("Replaced readings of sensors.", None)
    max_hand_error_m: float | None = metric("Largest error of a hand's position from steady_from_s on, m.", None)
    max_hand_rotation_deg: float | None = metric("Largest rotation of a hand from its target, degrees.", None)


def compute_metrics(
    log: RunLog, *, steady_from_s: float = 0.0, elapsed_s: float | None = None, distances: LinkDistances | None = None
) -> Metrics:
    """Return the metrics of a run.

    Args:
        log: the log, at the full control rate for complete counts and extremes.
        steady_from_s: time from which tracking errors and joint velocities are evaluated, s.
        elapsed_s: wall-clock time of the run, s; without it there is no real-time factor.
        distances: of links.

    Raises:
        InputError: if the log has no tick with a finite state.
    """
    whole, end = log, log.finite_ticks
    if end == 0:
        raise InputError("log", f"{log.ticks} ticks, none finite", "a log with at least one finite state")
    log = whole if end == whole.ticks else whole.until(end)
    base, tilt, height = log.base_pose, log.tilt_deg, log.base_height
    fallen = fallen_ticks(log)
    fell = bool(fallen.any()) or end < whole.ticks
    fall_index = int(np.argmax(fallen)) if fallen.any() else end
    # The last tick has the period of the others; the time of a fall is that of its first tick.
    last = float(whole.time[-1]) + log.control_period_s
    survived = (float(whole.time[fall_index]) if fall_index < whole.ticks else last) - float(log.time[0])

    home = log.base_reference if log.commanded else base[:1]
    displacement = np.linalg.norm(base[:, :3] - home[:, :3], axis=1)
    rotations = so3.from_quaternion.unchecked(np.stack((home[-1, 3:], base[-1, 3:])))
    walking = walking_metrics(log, fall_index)  # while there are no other large arrays
    from_start = along_ground(log.foot_centres - log.foot_centres[:1], log.contact_normals[:1]).max(initial=0.0)
    torque = np.abs(log.tau)
    saturated = torque >= (1.0 - 1e-9) * log.effort_limit_over_time
    margins = (log.friction_limits - log.tangential_forces)[log.closed]
    steady = log.time >= steady_from_s
    com_error = np.linalg.norm(log.com - log.com_reference, axis=1)[steady]
    hands = _hand_errors(log, steady)
    return Metrics(
        survived_s=survived,
        fell=fell,
        max_tilt_deg=float(tilt.max()),
        max_displacement_m=float(displacement.max()),
        min_base_height_m=float(height.min()),
        final_position_error_m=float(displacement[-1]),
        final_tilt_deg=float(tilt[-1]),
        final_rotation_deg=float(np.degrees(attitude.angle_between(*rotations))),
        max_slip_m=float(slide(log).max(initial=0.0)),
        max_foot_displacement_m=float(from_start),
        max_abs_torque_nm=float(torque.max(initial=0.0)),
        torque_saturation_fraction=float(saturated.any(axis=1).mean()),
        min_friction_margin_n=float(margins.min()) if margins.size else None,
        rms_joint_velocity_rad_s=rms(log.joint_velocity[steady].reshape(-1, 1)),
        com_rms_error_m=rms(com_error[:, None]),
        max_com_error_m=float(com_error.max()) if com_error.size else None,
        solver_failures=int(np.count_nonzero(whole.wbc_status) + np.count_nonzero(whole.mpc_status)),
        deadline_misses=int(np.count_nonzero(_tick_ms(whole) > 1e3 * log.control_period_s)),
        mpc_ms=timing(whole.mpc_ms),
        wbc_ms=timing(whole.wbc_ms),
        real_time_factor=(last - float(log.time[0])) / elapsed_s if elapsed_s else None,
        estimator_ms=None if whole.estimate_ms is None else timing(whole.estimate_ms),
        estimator=estimator_errors(log),
        min_base_height_fraction=float(height.min() / height[0]) if log.floating_base else 1.0,
        walking=walking,
        falls=max(len(falls(log, fallen)), int(fell)),
        modes=mode_metrics(log, fallen),
        leg_collisions=None if distances is None else _count_collisions(distances.legs),
        max_self_penetration_m=None if distances is None else -float(distances.least.min(initial=0.0)),
        forecast_ms=None if whole.forecast_ms is None else timing(whole.forecast_ms[whole.forecast_ms > 0.0]),
        sensor_faults=SensorFaults.of(whole),
        max_hand_error_m=None if hands is None else hands[0],
        max_hand_rotation_deg=None if hands is None else hands[1],
        joint_friction_nm=None if log.joint_friction is None else float(log.joint_friction[-1].mean()),
    )


def _hand_errors(log: RunLog, steady: BoolArray) -> tuple[float, float] | None:
    """Return the largest distance, m, and rotation, degrees, of a hand from its target; None without hands or ticks."""
    if log.hand_poses is None or log.hand_targets is None or not steady.any():
        return None
    hands, targets = log.hand_poses[steady], log.hand_targets[steady]
    distances = np.linalg.norm(hands[..., :3] - targets[..., :3], axis=-1)
    rotations = (so3.from_quaternion.unchecked(poses[..., 3:]) for poses in (hands, targets))
    return float(distances.max()), float(np.degrees(attitude.angle_between(*rotations)).max())


def metric_names() -> tuple[str, ...]:
    """Return the names of all metrics of a run, in order; those of groups as in ``mpc_ms.p50``."""
    names: list[str] = []
    for name, hint in get_type_hints(Metrics).items():
        group = next((each for each in (hint, *get_args(hint)) if is_dataclass(each)), None)
        names += [name] if group is None else [f"{name}.{part.name}" for part in fields(group)]
    return tuple(names)


def flat_metrics(metrics: Metrics) -> dict[str, float | None]:
    """Return the metrics of a run by their names; groups that were not measured, such as ``walking``, are left out."""
    found: dict[str, float | None] = {}
    for name in metric_names():
        owner, _, part = name.rpartition(".")
        group = getattr(metrics, owner) if owner else metrics
        if group is not None:
            value = getattr(group, part)
            found[name] = None if value is None else float(value)
    return found


def rpy_deg(quaternion: Array) -> Array:
    """Return roll, pitch and yaw of orientations: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Args:
        quaternion: (n, 4) x y z w.

    Returns:
        (n, 3) degrees; roll and yaw unwrapped, pitch in [-90, 90].
    """
    angles = attitude.roll_pitch_yaw(so3.from_quaternion.unchecked(quaternion))
    return np.degrees(np.column_stack((np.unwrap(angles[:, 0]), angles[:, 1], np.unwrap(angles[:, 2]))))


def slide(log: RunLog) -> Array:
    """Return (n, nc) displacements of the feet along the ground since the start of their present stance, m.

    A stance is an interval of closed contact with ground less steep than 60 degrees; gaps shorter than 20 ms do not end
    it. Otherwise they are 0.
    """
    closed, moved = log.closed & (log.contact_normals[..., 2] > _STANDING), np.zeros(log.closed.shape)
    for foot in range(closed.shape[1]):
        points, normals = log.foot_centres[:, foot], log.contact_normals[:, foot]
        for a, b in joined_intervals(log.time, closed[:, foot], CONTACT_GAP_S):
            moved[a:b, foot] = along_ground(points[a:b] - points[a], normals[a])
    return moved


def timing(milliseconds: Array) -> Timing | None:
    """Return the percentiles of a computation's durations; ``None`` if it never ran."""
    if milliseconds.size == 0:
        return None
    p50, p99 = np.percentile(milliseconds, [50.0, 99.0])
    return Timing(float(p50), float(p99), float(milliseconds.max()))


def _count_collisions(clearances: Array) -> int:
    touching = clearances < 0.0
    return int(touching[:1].sum() + np.count_nonzero(touching[1:] & ~touching[:-1]))


def _tick_ms(log: RunLog) -> Array:
    """Return (n,) the whole duration of each tick: estimation, planning, forecasts and whole-body control, ms."""
    total: Array = log.wbc_ms.copy()
    for part in (log.estimate_ms, log.forecast_ms):
        total += 0.0 if part is None else part
    planning = np.isin(log.mpc_time, log.time)
    total[np.searchsorted(log.time, log.mpc_time[planning])] += log.mpc_ms[planning]
    return total
