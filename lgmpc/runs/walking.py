"""Figures of merit of walking: pure functions from the log of a run with motion commands.

Velocities are those of the centre of mass, in the horizontal frame that turns with the base, as commands are. A gait
sways and heaves within each stride, and no command forbids it: so errors are taken of averages over one gait cycle, and
beside them the raw ones. Both count on plateaus only: where the limited command, the gait's period and the push on the
robot, mostly none, have been constant for half a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.runs.estimate import CONTACT_FORCE_N
from lgmpc.runs.log import CONTACT_STATES, RunLog, push_intervals
from lgmpc.typing import Array, BoolArray

__all__ = ["WalkingMetrics", "body_velocity", "heading", "stride_mean", "walking_metrics"]

SETTLING_S = 0.5
"""How long after a change of the command or of the push errors do not count, s."""

RECOVERED_M_S = 0.05
"""A robot whose velocity, averaged over a stride, is closer to the command than this has recovered from a push, m/s."""

STANDING_M_S = 0.02
"""A robot with all feet in stance that is slower than this stands, m/s."""

IMPACT_S = 0.02
"""How long after a touchdown a foot's force counts as that of the impact, s."""

_GRAVITY = 9.81


@dataclass(frozen=True)
class WalkingMetrics:
    """How a robot followed its motion commands. ``None`` where there was nothing to measure.

    Attributes:
        velocity_rmse_m_s: RMS size of the error of the planar velocity averaged over a stride, on plateaus.
        raw_velocity_rmse_m_s: the same of the instantaneous velocity.
        velocity_bias_m_s: size of the mean velocity error on a plateau, the largest of all plateaus.
        yaw_rate_rmse_rad_s: RMS error of the yaw rate averaged over a stride, on plateaus.
        height_rmse_m: RMS error of the base's height, on plateaus.
        height_std_m: standard deviation of the base's height within a plateau, the largest of all plateaus.
        cost_of_transport: sum of ``|torque x joint speed|`` over weight x way in the commanded direction, on plateaus
            with a planar velocity.
        steps: swings begun, of all feet.
        lost_contacts: how often a foot lost its contact in the middle of a stance, of all feet.
        walking_tilt_deg: largest tilt while the command moves or a foot swings.
        max_scuff_m: longest way that a foot slides over the floor within one swing.
        peak_impact_n: largest normal force of a foot within 20 ms from the end of a swing.
        odometry_drift_percent: error of the estimated base position at the end over the way that the base went;
            None without an estimator.
        recovery_time_s: time from the end of a push until the velocity averaged over a stride stays within 0.05 m/s
            of the command (until the next push or change of the command); the largest of all pushes.
        ends_standing: whether the robot stands at the end: all feet in stance, slower than 2 cm/s. None if the last
            command moves.
        stop_strides: time from the command's coming to rest until the robot stands for good, in gait cycles.
        final_foot_error_m: largest horizontal distance of a foot, at the end, from where it was relative to the base
            at the start; of a robot that ends standing.
    """

    velocity_rmse_m_s: float | None
    raw_velocity_rmse_m_s: float | None
    velocity_bias_m_s: float | None
    yaw_rate_rmse_rad_s: float | None
    height_rmse_m: float | None
    height_std_m: float | None
    cost_of_transport: float | None
    steps: int
    lost_contacts: int
    walking_tilt_deg: float
    max_scuff_m: float
    peak_impact_n: float | None
    odometry_drift_percent: float | None
    recovery_time_s: float | None
    ends_standing: bool | None
    stop_strides: float | None
    final_foot_error_m: float | None


def walking_metrics(log: RunLog, tilt: Array) -> WalkingMetrics | None:
    """Measure how a run followed its commands; ``None`` if none moved the robot and it never stepped.

    Args:
        log: the log.
        tilt: (k,) of the base at the first k ticks, deg; later ticks, such as those after a fall, do not count.
    """
    if not (log.commanded or log.stepped) or len(tilt) < 2:
        return None
    walk = _Walk(log, len(tilt))
    moving = walk.command.any(axis=1) | ~walk.stance.all(axis=1)
    return WalkingMetrics(
        **_tracking(walk),
        cost_of_transport=_cost_of_transport(walk),
        steps=_count(walk, "swing"),
        lost_contacts=_count(walk, "lost"),
        walking_tilt_deg=float(tilt[moving].max(initial=0.0)),
        max_scuff_m=_scuff(walk),
        peak_impact_n=_peak_impact(walk),
        odometry_drift_percent=_drift(walk),
        recovery_time_s=_recovery_time(walk),
        **_ending(walk),
    )


def heading(quaternion: Array) -> Array:
    """Return (n,) the headings of bases (n, 4) x y z w: the angle of their x axes in the plane, unwrapped, rad."""
    x, y, z, w = quaternion.T
    angle: Array = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return angle


def body_velocity(log: RunLog) -> Array:
    """Return (n, 3) velocity ahead and to the left of the centre of mass, m/s, and yaw rate, rad/s."""
    yaw = heading(log.base_pose[:, 3:])
    vx, vy, rate = np.gradient(np.column_stack((log.com[:, :2], yaw)), log.time, axis=0).T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack((c * vx + s * vy, c * vy - s * vx, rate))


def stride_mean(values: Array, ticks: int) -> Array:
    """Return the means (n - ticks + 1, ...) over each window of ``ticks`` rows of ``values`` (n, ...)."""
    sums = np.concatenate((np.zeros_like(values[:1]), np.cumsum(values, axis=0)))
    means: Array = (sums[ticks:] - sums[:-ticks]) / ticks
    return means


class _Walk:
    """The first ``ticks`` of a log in the form that the figures are measured in."""

    def __init__(self, log: RunLog, ticks: int) -> None:
        assert log.command is not None and log.gait_period_s is not None
        assert log.stance is not None and log.contact_states is not None
        self.log, self.ticks = log, ticks
        self.time, self.command = log.time[:ticks], log.command[:ticks]
        self.dt = float(np.median(np.diff(self.time)))
        self.period = log.gait_period_s[:ticks]
        self.stance: BoolArray = log.stance[:ticks] != 0
        self.states = log.contact_states[:ticks]
        self.velocity = body_velocity(log)[:ticks]

    def constant(self) -> Iterator[tuple[int, int]]:
        """The stretches ``[a, b)`` of ticks in which command, gait period and push are constant."""
        causes = np.column_stack((self.command, self.period, self.log.push[: self.ticks]))
        changes = np.flatnonzero(np.any(np.diff(causes, axis=0) != 0.0, axis=1)) + 1
        yield from zip([0, *changes.tolist()], [*changes.tolist(), self.ticks], strict=True)

    def stride(self, tick: int) -> int:
        """The ticks of one gait cycle."""
        return max(1, round(float(self.period[tick]) / self.dt))

    def plateaus(self) -> Iterator[tuple[int, int]]:
        """The settled parts of the stretches in which the robot is to move, at least one stride long."""
        for a, b in self.constant():
            begin = a + round(SETTLING_S / self.dt)
            if self.command[a].any() and b - begin >= self.stride(a):
                yield begin, b


def _tracking(walk: _Walk) -> dict[str, Any]:
    means, raw, heights, biases, deviations = [], [], [], [], []
    for a, b in walk.plateaus():
        error = walk.velocity[a:b] - walk.command[a:b]
        height = walk.log.base_pose[a:b, 2]
        means.append(stride_mean(error, walk.stride(a)))
        raw.append(error[:, :2])
        heights.append(height - walk.log.base_reference[a:b, 2])
        biases.append(float(np.linalg.norm(error[:, :2].mean(axis=0))))
        deviations.append(float(height.std()))
    strides = np.concatenate(means) if means else np.zeros((0, 3))
    return {
        "velocity_rmse_m_s": _rms(strides[:, :2]),
        "raw_velocity_rmse_m_s": _rms(np.concatenate(raw)) if raw else None,
        "velocity_bias_m_s": max(biases, default=None),
        "yaw_rate_rmse_rad_s": _rms(strides[:, 2:]),
        "height_rmse_m": _rms(np.concatenate(heights)[:, None]) if heights else None,
        "height_std_m": max(deviations, default=None),
    }


def _count(walk: _Walk, state: str) -> int:
    """Count the entries into a contact state."""
    return int(np.count_nonzero(np.diff((walk.states == CONTACT_STATES.index(state)).astype(np.int8), axis=0) > 0))


def _cost_of_transport(walk: _Walk) -> float | None:
    log, work, way = walk.log, 0.0, 0.0
    for a, b in walk.plateaus():
        speed = float(np.hypot(*walk.command[a, :2]))
        if speed > 0.0:
            work += float(np.abs(log.tau[a:b] * log.joint_velocity[a:b]).sum()) * walk.dt
            way += float((walk.velocity[a:b, :2] @ (walk.command[a, :2] / speed)).sum()) * walk.dt
    return work / (log.mass_kg * _GRAVITY * way) if way > 0.0 and np.isfinite(log.mass_kg) else None


def _scuff(walk: _Walk) -> float:
    """Sum the ways of each foot's contact point between ticks of one swing at which the floor pushes the foot."""
    touching = walk.log.contact_forces[: walk.ticks, :, 2] > CONTACT_FORCE_N
    sliding = (walk.states == CONTACT_STATES.index("swing")) & touching
    way = np.linalg.norm(np.diff(walk.log.contact_points[: walk.ticks, :, :2], axis=0), axis=2)
    way = np.where(sliding[1:] & sliding[:-1], way, 0.0)
    longest = 0.0
    for foot in range(way.shape[1]):
        swing = np.cumsum(np.concatenate(([False], np.diff(walk.stance[:, foot].astype(np.int8)) < 0)))
        longest = max(longest, float(np.bincount(swing[1:], way[:, foot]).max(initial=0.0)))
    return longest


def _peak_impact(walk: _Walk) -> float | None:
    """Look for the peaks while each foot carries since no longer than the duration of an impact."""
    forces = walk.log.contact_forces[: walk.ticks, :, 2]
    peaks = []
    for foot in range(forces.shape[1]):
        for tick in np.flatnonzero(np.diff(walk.stance[:, foot].astype(np.int8)) > 0) + 1:
            peaks.append(float(forces[tick : tick + max(1, round(IMPACT_S / walk.dt)), foot].max()))
    return max(peaks, default=None)


def _drift(walk: _Walk) -> float | None:
    if walk.log.estimate_q is None:
        return None
    true = walk.log.base_pose[: walk.ticks, :3]
    # By strides: the sway within one is no way.
    way = np.linalg.norm(np.diff(true[:: walk.stride(walk.ticks - 1), :2], axis=0), axis=1).sum()
    error = np.linalg.norm(walk.log.estimate_q[walk.ticks - 1, :3] - true[-1])
    return float(1e2 * error / way) if way > 0.0 else None


def _recovery_time(walk: _Walk) -> float | None:
    pushes = [push for push in push_intervals(walk.log) if push.end < walk.time[-1]]
    if not pushes:
        return None
    longest = 0.0
    for push in pushes:
        first = int(np.searchsorted(walk.time, push.end - 0.5 * walk.dt))
        last = next(b for _, b in walk.constant() if first < b)
        window = walk.stride(first)
        begin = max(0, first + 1 - window)
        errors = stride_mean((walk.velocity - walk.command)[begin:last, :2], window)
        far = np.flatnonzero(np.linalg.norm(errors, axis=1) > RECOVERED_M_S)
        back = begin + window + int(far[-1]) if len(far) else first
        if back >= last:
            return None
        longest = max(longest, float(walk.time[back]) - push.end)
    return longest


def _ending(walk: _Walk) -> dict[str, Any]:
    moving = np.flatnonzero(walk.command.any(axis=1))
    # Of a run whose commands move the robot, it may have fallen before.
    rest = int(moving[-1]) + 1 if len(moving) else walk.ticks if walk.log.commanded else 0
    if rest >= walk.ticks:
        return {"ends_standing": None, "stop_strides": None, "final_foot_error_m": None}
    slow = np.linalg.norm(walk.velocity[rest:, :2], axis=1) < STANDING_M_S
    stepping = np.flatnonzero(~(slow & walk.stance[rest:].all(axis=1)))
    stands = rest + int(stepping[-1]) + 1 if len(stepping) else rest
    if stands >= walk.ticks:
        return {"ends_standing": False, "stop_strides": None, "final_foot_error_m": None}
    return {
        "ends_standing": True,
        "stop_strides": float(walk.time[stands] - walk.time[rest]) / float(walk.period[rest]) if len(moving) else None,
        "final_foot_error_m": _foot_error(walk),
    }


def _foot_error(walk: _Walk) -> float:
    ticks = np.array([0, walk.ticks - 1])
    base, yaw = walk.log.base_pose[ticks], heading(walk.log.base_pose[ticks, 3:])
    apart = walk.log.contact_points[ticks, :, :2] - base[:, None, :2]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = c * apart[..., 0] + s * apart[..., 1], c * apart[..., 1] - s * apart[..., 0]
    return float(np.hypot(x[1] - x[0], y[1] - y[0]).max(initial=0.0))


def _rms(errors: Array) -> float | None:
    """RMS size of the vectors (n, k)."""
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))) if len(errors) else None
