"""Figures of merit of a run: pure functions from its log.

Everything is measured on the part of the log before the first value that is not finite, so a run that blew up still
yields figures, and :attr:`Metrics.survived_s` says when it ended.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.runs.estimate import CONTACT_FORCE_N, EstimatorErrors, estimator_errors
from lgmpc.runs.log import RunLog
from lgmpc.runs.walking import WalkingMetrics, walking_metrics
from lgmpc.typing import Array, BoolArray

__all__ = [
    "FALL_HEIGHT_FRACTION",
    "FALL_TILT_DEG",
    "Metrics",
    "Timing",
    "compute_metrics",
    "friction_margin",
    "rotate",
    "rpy_deg",
    "slip",
    "tilt_deg",
    "timing",
]

FALL_TILT_DEG = 45.0
"""A base tilted further than this has fallen."""

FALL_HEIGHT_FRACTION = 0.5
"""A base below this fraction of its first height has fallen."""

CONTACT_GAP_S = 0.02
"""A contact that opens for a shorter time has chattered, not stepped: the stance goes on, and so does its slip."""


@dataclass(frozen=True)
class Timing:
    """Percentiles of a repeated computation's duration, ms."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class Metrics:
    """What a run is judged by. ``None`` where there was nothing to measure.

    Attributes:
        survived_s: time until the base fell (below half its first height, tilted beyond 45 degrees, or not finite);
            the whole duration if it did not.
        fell: whether it fell.
        max_tilt_deg: largest angle between the base's upright axis and the vertical. The upright axis is the one that
            is vertical in the reference posture, so yaw does not count.
        max_displacement_m: largest distance of the base's position from where it began or, in a run with motion
            commands, from where they lead it (the target base pose).
        min_base_height_m: lowest base height.
        final_position_error_m: distance of the last base position from the first, or from the target.
        final_tilt_deg: tilt at the end.
        final_rotation_deg: angle of the rotation from the first base orientation, or from the last target, to the
            last one, yaw included.
        max_slip_m: largest horizontal distance of a contact point from where its stance began. The rolling of a
            spherical foot counts: it moves the contact point too.
        max_foot_displacement_m: largest horizontal distance of a contact point from where it was at the start, steps
            and hops included.
        max_abs_torque_nm: largest torque applied.
        torque_saturation_fraction: fraction of the ticks in which at least one joint was at its limit.
        min_friction_margin_n: smallest ``mu f_n - |f_t|`` of the measured forces over closed contacts and time.
        rms_joint_velocity_rad_s: RMS over joints and time, from ``steady_from_s`` on.
        com_rms_error_m: RMS distance of the centre of mass from its target, from ``steady_from_s`` on.
        max_com_error_m: largest such distance, from ``steady_from_s`` on.
        solver_failures: ticks and MPC updates without a solution.
        deadline_misses: ticks and MPC updates that took longer than their period.
        mpc_ms: duration of the MPC updates.
        wbc_ms: duration of the whole-body controller's ticks.
        real_time_factor: simulated over elapsed time.
        estimator_ms: duration of the estimator's ticks.
        estimator: how far the controller's estimate was from the truth.
        min_base_height_fraction: lowest base height over the first; 1 for a base that is fixed.
        walking: how motion commands were followed; None for a run without.
    """

    survived_s: float
    fell: bool
    max_tilt_deg: float
    max_displacement_m: float
    min_base_height_m: float
    final_position_error_m: float
    final_tilt_deg: float
    final_rotation_deg: float
    max_slip_m: float
    max_foot_displacement_m: float
    max_abs_torque_nm: float
    torque_saturation_fraction: float
    min_friction_margin_n: float | None
    rms_joint_velocity_rad_s: float | None
    com_rms_error_m: float | None
    max_com_error_m: float | None
    solver_failures: int
    deadline_misses: int
    mpc_ms: Timing | None
    wbc_ms: Timing | None
    real_time_factor: float | None
    estimator_ms: Timing | None = None
    estimator: EstimatorErrors | None = None
    min_base_height_fraction: float | None = None
    walking: WalkingMetrics | None = None


def compute_metrics(log: RunLog, *, steady_from_s: float = 0.0, elapsed_s: float | None = None) -> Metrics:
    """Measure a run.

    Args:
        log: the log, at the full control rate if counts and extremes are to be complete.
        steady_from_s: when the transient is over: tracking errors and joint velocities count from here.
        elapsed_s: wall-clock time that the run took; without it there is no real-time factor.

    Raises:
        InputError: if the log has no tick whose state is finite.
    """
    finite = np.isfinite(log.q).all(axis=1) & np.isfinite(log.v).all(axis=1)
    end = log.ticks if finite.all() else int(np.argmin(finite))
    if end == 0:
        raise InputError("log", f"{log.ticks} ticks, none finite", "a log with at least one finite state")
    use = slice(0, end)
    time = log.time[use]
    base = log.base_pose[use]
    tilt = tilt_deg(base[:, 3:], log.base_reference[0, 3:])
    fallen = tilt > FALL_TILT_DEG
    if log.floating_base:
        fallen |= base[:, 2] < FALL_HEIGHT_FRACTION * base[0, 2]
    fell = bool(fallen.any()) or end < log.ticks
    fall_index = int(np.argmax(fallen)) if fallen.any() else end
    # The last tick lasts as long as the others; a fall is dated by the tick that shows it.
    last = float(log.time[-1]) + log.control_period_s
    survived = (float(log.time[fall_index]) if fall_index < log.ticks else last) - float(time[0])

    home = log.base_reference[use] if log.commanded else base[:1]
    displacement = np.linalg.norm(base[:, :3] - home[:, :3], axis=1)
    torque = np.abs(log.tau[use])
    saturated = torque >= (1.0 - 1e-9) * log.effort_limit
    stance_slip, from_start = slip(time, log.contact_points[use], log.contact_forces[use, :, 2])
    steady = time >= steady_from_s
    com_error = np.linalg.norm(log.com[use] - log.com_reference[use], axis=1)[steady]
    joint_velocity = log.joint_velocity[use][steady]
    tick_ms = log.wbc_ms if log.estimate_ms is None else log.wbc_ms + log.estimate_ms
    return Metrics(
        survived_s=survived,
        fell=fell,
        max_tilt_deg=float(tilt.max()),
        max_displacement_m=float(displacement.max()),
        min_base_height_m=float(base[:, 2].min()),
        final_position_error_m=float(displacement[-1]),
        final_tilt_deg=float(tilt[-1]),
        final_rotation_deg=_rotation_deg(home[-1, 3:], base[-1, 3:]),
        max_slip_m=float(stance_slip.max(initial=0.0)),
        max_foot_displacement_m=float(from_start.max(initial=0.0)),
        max_abs_torque_nm=float(torque.max(initial=0.0)),
        torque_saturation_fraction=float(saturated.any(axis=1).mean()),
        min_friction_margin_n=friction_margin(log.contact_forces[use], log.friction),
        rms_joint_velocity_rad_s=_rms(joint_velocity.ravel()),
        com_rms_error_m=_rms(com_error),
        max_com_error_m=float(com_error.max()) if com_error.size else None,
        solver_failures=int(np.count_nonzero(log.wbc_status) + np.count_nonzero(log.mpc_status)),
        deadline_misses=_late(tick_ms, log.control_period_s) + _late(log.mpc_ms, log.mpc_period_s),
        mpc_ms=timing(log.mpc_ms),
        wbc_ms=timing(log.wbc_ms),
        real_time_factor=(last - float(log.time[0])) / elapsed_s if elapsed_s else None,
        estimator_ms=None if log.estimate_ms is None else timing(log.estimate_ms),
        estimator=estimator_errors(log, end),
        min_base_height_fraction=float(base[:, 2].min() / base[0, 2]) if log.floating_base else 1.0,
        walking=walking_metrics(log, tilt[:fall_index]),
    )


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return ``R(quaternion) vector`` for unit quaternions (..., 4) x y z w and vectors (..., 3), broadcast."""
    imaginary, real = quaternion[..., :3], quaternion[..., 3:]
    twice_cross = 2.0 * np.cross(imaginary, vector)
    rotated: Array = vector + real * twice_cross + np.cross(imaginary, twice_cross)
    return rotated


def tilt_deg(quaternion: Array, reference: Array) -> Array:
    """Return the angle between the base's upright axis and the vertical.

    Args:
        quaternion: (n, 4) base orientations, x y z w.
        reference: (4,) orientation of the reference posture; the body axis that is vertical in it is the upright axis.

    Returns:
        (n,) angles in degrees, in [0, 180].
    """
    vertical = np.array([0.0, 0.0, 1.0])
    upright = rotate(reference * [-1.0, -1.0, -1.0, 1.0], vertical)
    axis = rotate(quaternion, upright)
    # atan2 of sine and cosine: arccos alone loses half the digits near zero.
    angle: Array = np.degrees(np.arctan2(np.linalg.norm(axis[:, :2], axis=1), axis[:, 2]))
    return angle


def rpy_deg(quaternion: Array) -> Array:
    """Return roll, pitch and yaw of orientations: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Args:
        quaternion: (n, 4) x y z w.

    Returns:
        (n, 3) degrees; roll and yaw without jumps of whole turns, pitch in [-90, 90].
    """
    x, y, z, w = quaternion.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    angles: Array = np.degrees(np.column_stack((np.unwrap(roll), pitch, np.unwrap(yaw))))
    return angles


def slip(time: Array, points: Array, normal_forces: Array) -> tuple[Array, Array]:
    """Return how far the contact points went, horizontally.

    Args:
        time: (n,) s.
        points: (n, nc, 3) contact points, m.
        normal_forces: (n, nc) measured normal forces, N. A stance is a stretch of closed contact; gaps shorter than
            20 ms do not end it.

    Returns:
        (nc,) largest distance from where the stance began, over all stances, and (nc,) largest distance from where the
        point was at the first tick, m.
    """
    horizontal = points[:, :, :2]
    from_start: Array = np.linalg.norm(horizontal - horizontal[0], axis=2).max(axis=0)
    worst = np.zeros(points.shape[1])
    for contact in range(points.shape[1]):
        for a, b in _stances(time, normal_forces[:, contact] > CONTACT_FORCE_N):
            moved = np.linalg.norm(horizontal[a:b, contact] - horizontal[a, contact], axis=1)
            worst[contact] = max(worst[contact], float(moved.max()))
    return worst, from_start


def _stances(time: Array, closed: BoolArray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], closed.astype(np.int8), [0]))))
    stances: list[tuple[int, int]] = []
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stances and time[a] - time[stances[-1][1] - 1] < CONTACT_GAP_S:
            stances[-1] = (stances[-1][0], b)
        else:
            stances.append((a, b))
    return stances


def friction_margin(forces: Array, friction: float) -> float | None:
    """Return the smallest ``mu f_n - |f_t|`` over closed contacts of (n, nc, 3) forces, N; ``None`` if all are open."""
    closed = forces[..., 2] > CONTACT_FORCE_N
    if not closed.any():
        return None
    margin = friction * forces[..., 2] - np.linalg.norm(forces[..., :2], axis=-1)
    return float(margin[closed].min())


def timing(milliseconds: Array) -> Timing | None:
    """Return the percentiles of a computation's durations; ``None`` if it never ran."""
    if milliseconds.size == 0:
        return None
    p50, p99 = np.percentile(milliseconds, [50.0, 99.0])
    return Timing(float(p50), float(p99), float(milliseconds.max()))


def _late(milliseconds: Array, period_s: float) -> int:
    return int(np.count_nonzero(milliseconds > 1e3 * period_s)) if period_s > 0.0 else 0


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None


def _rotation_deg(first: Array, second: Array) -> float:
    # For unit quaternions |q0 - q1| = 2 sin(angle / 4) and |q0 + q1| = 2 cos(angle / 4); the smaller of the two signs.
    apart, together = np.linalg.norm(first - second), np.linalg.norm(first + second)
    return float(np.degrees(4.0 * np.arctan2(min(apart, together), max(apart, together))))
