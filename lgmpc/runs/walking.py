"""Figures of merit of walking: pure functions from the log of a run with motion commands.

Velocities are those of the centre of mass, in the horizontal frame that turns with the base, as commands are. The sway
and heave within a stride are part of a gait: errors are evaluated for averages over one gait cycle, and for the
instantaneous velocity beside them. Both are evaluated on plateaus only: where the limited command, the gait's period
and the push have been constant for half a second.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.lie import attitude, so3
from lgmpc.runs.atomic import Number
from lgmpc.runs.figures import described, metric
from lgmpc.runs.ground import along_ground
from lgmpc.runs.intervals import push_intervals
from lgmpc.runs.log import CONTACT_STATES, RunLog
from lgmpc.typing import Array, BoolArray

SETTLING_S = 0.5
"""Time after a change of the command or of the push in which errors are not evaluated, s."""

RECOVERED_M_S = 0.05
"""Error of the velocity averaged over a stride, m/s, below which a robot has recovered from a push."""

STANDING_M_S = 0.02
"""Speed below which a robot with all feet in stance stands, m/s."""

IMPACT_S = 0.02
"""Duration of the impact after a touchdown, s."""


@described
@dataclass(frozen=True)
class WalkingMetrics:
    """Metrics of a robot that follows motion commands. ``None`` where there was nothing to measure.

    Plateaus are intervals of constant commands, settled, see the module.
    """

    velocity_rmse_m_s: float | None = metric("RMS error of a stride's mean velocity at constant commands, m/s.")
    raw_velocity_rmse_m_s: float | None = metric("RMS error of the instantaneous velocity at constant commands, m/s.")
    velocity_bias_m_s: float | None = metric("Largest mean velocity error at a constant command, m/s.")
    yaw_rate_rmse_rad_s: float | None = metric("RMS error of a stride's mean yaw rate at constant commands, rad/s.")
    height_rmse_m: float | None = metric("RMS error of the base's height at constant commands, m; above the ground.")
    height_std_m: float | None = metric("Largest standard deviation of the base's height at a constant command, m.")
    cost_of_transport: float | None = metric(
        "Cost of transport: integral of |torque x joint speed| over weight times distance; in the commanded direction, "
        "on plateaus with a planar velocity."
    )
    steps: int = metric("Number of swings of all feet.")
    lost_contacts: int = metric("Number of feet's contacts lost during a stance.")
    walking_tilt_deg: float = metric("Largest tilt of the base while it is to move or a foot swings, degrees.")
    max_scuff_m: Number = metric("Largest distance that a foot slides over the floor in a swing, m.")
    peak_impact_n: float | None = metric("Largest normal force of a foot within 20 ms from its touchdown, N.")
    odometry_drift_percent: float | None = metric("Final error of the estimated base position over the distance, %.")
    recovery_time_s: float | None = metric(
        "Time from a push's end until the velocity is back within 0.05 m/s of the command, s; averaged over a stride, "
        "until the next push or change of the command; the largest of all pushes."
    )
    ends_standing: bool | None = metric("Whether the robot stands at the end; None if it is to move.")
    stop_strides: float | None = metric("Time from the end of the command's motion until it stands, in gait cycles.")
    final_foot_error_m: float | None = metric(
        "Distance of a foot at the end from its initial position relative to the other feet, m; the largest, "
        "horizontal, from the median of all, in axes that turn with the base, of a robot that ends standing."
    )


def walking_metrics(log: RunLog, end: int) -> WalkingMetrics | None:
    """Return the metrics of a run with motion commands; ``None`` if all were zero and no foot swung.

    Args:
        log: the log.
        end: number of ticks that are evaluated; later ones, such as those after a fall, are ignored.
    """
    if not (log.commanded or log.stepped) or end < 2:
        return None
    walk = _Walk(log, end)
    moving = walk.command.any(axis=1) | ~walk.stance.all(axis=1)
    return WalkingMetrics(
        **_tracking(walk),
        cost_of_transport=_cost_of_transport(walk),
        steps=_count(walk, "swing"),
        lost_contacts=_count(walk, "lost"),
        walking_tilt_deg=float(walk.log.tilt_deg[moving].max(initial=0.0)),
        max_scuff_m=_scuff(walk),
        peak_impact_n=_peak_impact(walk),
        odometry_drift_percent=_drift(walk),
        recovery_time_s=_recovery_time(walk),
        **_ending(walk),
    )


def heading(quaternion: Array) -> Array:
    """Return (n,) the headings of bases (n, 4) x y z w: the angle of their x axes in the plane, unwrapped, rad."""
    return np.unwrap(attitude.yaw(so3.from_quaternion.unchecked(quaternion)))


def body_velocity(log: RunLog) -> Array:
    """Return (n, 3) velocity ahead and to the left of the centre of mass, m/s, and yaw rate, rad/s."""
    yaw = heading(log.base_pose[:, 3:])
    rates = np.gradient(np.column_stack((log.com[:, :2], yaw)), log.time, axis=0)
    return np.column_stack((_ahead(yaw, rates[:, :2]), rates[:, 2]))


def stride_mean(values: Array, ticks: int) -> Array:
    """Return the means (n - ticks + 1, ...) over each window of ``ticks`` rows of ``values`` (n, ...)."""
    sums = np.concatenate((np.zeros_like(values[:1]), np.cumsum(values, axis=0)))
    return (sums[ticks:] - sums[:-ticks]) / ticks


class _Walk:
    """The first ``ticks`` of a log, with the quantities from which the metrics are computed."""

    def __init__(self, log: RunLog, ticks: int) -> None:
        self.commanded, self.velocity = log.commanded, body_velocity(log)[:ticks]
        self.log = log = log.until(ticks)
        self.time, self.command, self.period, self.states = log.time, log.command, log.gait_period_s, log.contact_states
        self.dt = float(np.median(np.diff(self.time)))
        self.stance: BoolArray = log.stance != 0

    def constant(self) -> Iterator[tuple[int, int]]:
        """Yield the intervals ``[a, b)`` of ticks in which command, gait period and push are constant."""
        yield from _constant_intervals(self.command, self.period, self.log.push)

    def stride(self, tick: int) -> int:
        """Return the number of ticks of the gait cycle at a tick."""
        return max(1, round(float(self.period[tick]) / self.dt))

    def plateaus(self) -> Iterator[tuple[int, int]]:
        """Yield the settled parts of the intervals with a command that is not zero, at least one stride long."""
        for a, b in self.constant():
            begin = a + round(SETTLING_S / self.dt)
            if self.command[a].any() and b - begin >= self.stride(a):
                yield begin, b


def _constant_intervals(*causes: Array) -> Iterator[tuple[int, int]]:
    """Yield the intervals ``[a, b)`` of rows in which arrays (n,) and (n, k) are constant."""
    rows = np.column_stack(causes)
    changes = np.flatnonzero(np.any(np.diff(rows, axis=0) != 0.0, axis=1)) + 1
    yield from zip([0, *changes.tolist()], [*changes.tolist(), len(rows)], strict=True)


def _tracking(walk: _Walk) -> dict[str, Any]:
    means, raw, heights, biases, deviations = [], [], [], [], []
    desired = walk.log.above_ground(walk.log.base_reference[:, :3])
    for a, b in walk.plateaus():
        error = walk.velocity[a:b] - walk.command[a:b]
        height = walk.log.base_height[a:b]
        means.append(stride_mean(error, walk.stride(a)))
        raw.append(error[:, :2])
        heights.append(height - desired[a:b])
        biases.append(float(np.linalg.norm(error[:, :2].mean(axis=0))))
        deviations.append(float(height.std()))
    strides = np.concatenate(means) if means else np.zeros((0, 3))
    return {
        "velocity_rmse_m_s": rms(strides[:, :2]),
        "raw_velocity_rmse_m_s": rms(np.concatenate(raw)) if raw else None,
        "velocity_bias_m_s": max(biases, default=None),
        "yaw_rate_rmse_rad_s": rms(strides[:, 2:]),
        "height_rmse_m": rms(np.concatenate(heights)[:, None]) if heights else None,
        "height_std_m": max(deviations, default=None),
    }


def _count(walk: _Walk, state: str) -> int:
    """Count the entries of feet into a contact state."""
    return int(np.count_nonzero(np.diff((walk.states == CONTACT_STATES.index(state)).astype(np.int8), axis=0) > 0))


def _cost_of_transport(walk: _Walk) -> float | None:
    log, work, distance = walk.log, 0.0, 0.0
    for a, b in walk.plateaus():
        speed = float(np.hypot(*walk.command[a, :2]))
        if speed > 0.0:
            work += float(np.abs(log.tau[a:b] * log.joint_velocity[a:b]).sum()) * walk.dt
            distance += float((walk.velocity[a:b, :2] @ (walk.command[a, :2] / speed)).sum()) * walk.dt
    return work / (log.weight_n * distance) if distance > 0.0 and np.isfinite(log.mass_kg) else None


def _scuff(walk: _Walk) -> float:
    """Return the largest sum of a point's displacements in one swing between ticks at which the ground pushes it, m."""
    of = walk.log.foot_of
    sliding = (walk.states == CONTACT_STATES.index("swing"))[:, of] & walk.log.closed
    distance = along_ground(np.diff(walk.log.foot_centres, axis=0), walk.log.contact_normals[1:])
    distance = np.where(sliding[1:] & sliding[:-1], distance, 0.0)
    longest = 0.0
    for point, foot in enumerate(of.tolist()):
        swing = np.cumsum(np.concatenate(([False], np.diff(walk.stance[:, foot].astype(np.int8)) < 0)))
        longest = max(longest, float(np.bincount(swing[1:], distance[:, point]).max(initial=0.0)))
    return longest


def _peak_impact(walk: _Walk) -> float | None:
    """Return the largest normal force of a foot within the duration of an impact after its touchdown, N."""
    peaks = []
    for foot, forces in enumerate(walk.log.of_feet(np.add, walk.log.normal_forces).T):
        for tick in np.flatnonzero(np.diff(walk.stance[:, foot].astype(np.int8)) > 0) + 1:
            peaks.append(float(forces[tick : tick + max(1, round(IMPACT_S / walk.dt))].max()))
    return max(peaks, default=None)


def _drift(walk: _Walk) -> float | None:
    if walk.log.estimate_q is None:
        return None
    true = walk.log.base_pose[:, :3]
    # Stride by stride: the sway within one is not distance travelled.
    distance = np.linalg.norm(np.diff(true[:: walk.stride(-1), :2], axis=0), axis=1).sum()
    error = np.linalg.norm(walk.log.estimate_q[-1, :3] - true[-1])
    return float(1e2 * error / distance) if distance > 0.0 else None


def _recovery_time(walk: _Walk) -> float | None:
    pushes = [push for push in push_intervals(walk.log) if push.end < walk.time[-1]]
    if not pushes:
        return None
    longest = 0.0
    for push in pushes:
        first = int(np.searchsorted(walk.time, push.end - 0.5 * walk.dt))
        last = next(b for _, b in _constant_intervals(walk.command, walk.log.push) if first < b)
        window = walk.stride(last - 1)  # of the gait after the recovery; steps against pushes have another period
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
    ticks = len(walk.time)
    rest = int(moving[-1]) + 1 if len(moving) else ticks if walk.commanded else 0
    if rest >= ticks:
        return {"ends_standing": None, "stop_strides": None, "final_foot_error_m": None}
    log, velocity = walk.log, walk.velocity[rest:, :2]
    if np.isfinite(log.mass_kg):  # an estimated position, differentiated, has the noise of the joints' encoders
        velocity = log.momentum[rest:, :2] / log.mass_kg
    slow = np.linalg.norm(velocity, axis=1) < STANDING_M_S
    stepping = np.flatnonzero(~(slow & walk.stance[rest:].all(axis=1)))
    stands = rest + int(stepping[-1]) + 1 if len(stepping) else rest
    if stands >= ticks:
        return {"ends_standing": False, "stop_strides": None, "final_foot_error_m": None}
    return {
        "ends_standing": True,
        "stop_strides": float(walk.time[stands] - walk.time[rest]) / float(walk.period[rest]) if len(moving) else None,
        "final_foot_error_m": _foot_error(walk),
    }


def _foot_error(walk: _Walk) -> float:
    base = walk.log.base_pose[[0, -1]]
    apart = _ahead(heading(base[:, 3:])[:, None], walk.log.contact_points[[0, -1], :, :2] - base[:, None, :2])
    moved = apart[1] - apart[0]
    # Not relative to the base: on a slope it begins above the feet along the normal, and stands above them vertically.
    return float(np.linalg.norm(moved - np.median(moved, axis=0), axis=-1).max(initial=0.0)) if moved.size else 0.0


def _ahead(yaw: Array, vectors: Array) -> Array:
    """Return horizontal vectors (..., 2) in axes turned by the yaw (...,), ahead and to the left."""
    return np.stack(attitude.turn(-yaw, vectors[..., 0], vectors[..., 1]), axis=-1)


def rms(errors: Array) -> float | None:
    """Return the RMS norm of the vectors (n, k)."""
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))) if len(errors) else None
