"""Figures of merit of the modes: falls, damping after them, lying and rising, manoeuvres, from the log of a run."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.lie import attitude, quaternion
from lgmpc.runs.figures import described, metric
from lgmpc.runs.intervals import intervals
from lgmpc.runs.log import MODES, RunLog
from lgmpc.typing import BoolArray

FALL_TILT_DEG = 45.0
"""A base tilted further than this has fallen."""

FALL_HEIGHT_FRACTION = 0.5
"""A base below this fraction of the height of its target has fallen."""

LOW_MODES = ("lie", "rise", "sit", "maneuver")
"""Modes in which the base may be low by design; a manoeuvre that fails ends in another."""


@described
@dataclass(frozen=True)
class ModeMetrics:
    """Metrics of falls, lying, rising and manoeuvres. ``None`` where there was nothing to measure."""

    give_up_s: float | None = metric("Time after a fall until the joints are damped, s; the longest.")
    damped_rms_torque_nm: float | None = metric("RMS torque of all joints while they are damped, N.m.")
    rises: int = metric("Number of transitions from lying to standing.")
    descents: int = metric("Number of transitions from standing to lying.")
    torque_step_nm: float | None = metric("Largest step of a torque while the robot lies, rises or lies down, N.m.")
    maneuvers: int = metric("Number of manoeuvres performed to their end.", 0)
    maneuver_rise_m: float | None = metric("Rise of the centre of mass in the last manoeuvre, m.", None)
    maneuver_distance_m: float | None = metric("Horizontal way of the CoM in the last manoeuvre, m.", None)
    maneuver_turn_deg: float | None = metric("Turn to the left in the last manoeuvre, degrees.", None)
    flight_s: float | None = metric("Time without contact in the last manoeuvre, s.", None)
    landing_tilt_deg: float | None = metric("Largest tilt after the last manoeuvre's flight, degrees.", None)


def fallen_ticks(log: RunLog) -> BoolArray:
    """Return (n,) flags of a fallen robot."""
    fallen: BoolArray = log.tilt_deg > FALL_TILT_DEG
    if log.floating_base:
        fallen |= log.base_height < FALL_HEIGHT_FRACTION * log.above_ground(log.base_reference[:, :3])
    fallen &= ~np.isin(log.mode, [MODES.index(mode) for mode in LOW_MODES])
    return fallen


def falls(log: RunLog, fallen: BoolArray) -> list[int]:
    """Return the first tick of each fall; one ends when the robot folds its legs again.

    Args:
        log: the log.
        fallen: (n,) flags, see :func:`fallen_ticks`.
    """
    lying = log.mode == MODES.index("lie")
    found, tick = [], 0
    while fallen[tick:].any():
        tick += int(np.argmax(fallen[tick:]))
        found.append(tick)
        if not lying[tick:].any():
            break
        tick += int(np.argmax(lying[tick:]))
    return found


def mode_metrics(log: RunLog, fallen: BoolArray) -> ModeMetrics:
    """Return the metrics of the modes of a run.

    Args:
        log: the log, at the full control rate.
        fallen: (n,) flags, see :func:`fallen_ticks`.
    """
    mode, tau = log.mode, log.tau
    damped = mode == MODES.index("damp")
    low = np.isin(mode, [MODES.index(each) for each in LOW_MODES])
    steps = np.abs(np.diff(tau, axis=0))[low[1:] & low[:-1]]
    return ModeMetrics(
        give_up_s=_longest(fallen & ~damped) * log.control_period_s if fallen.any() else None,
        damped_rms_torque_nm=float(np.sqrt(np.mean(np.square(tau[damped])))) if damped.any() else None,
        rises=_changes(mode, "rise", "stand"),
        descents=_changes(mode, "sit", "lie"),
        torque_step_nm=float(steps.max()) if steps.size else None,
        **_maneuver(log),
    )


def _maneuver(log: RunLog) -> dict[str, Any]:
    """Return the metrics of manoeuvres by name; empty without one."""
    performs = log.mode == MODES.index("maneuver")
    if not performs.any():
        return {}
    begin, end = intervals(performs)[-1]
    path = log.com[begin : end + 1]
    x, y, _ = path[-1] - path[0]
    air = np.flatnonzero(~log.contact_forces[begin:end].any(axis=(1, 2)))
    landed = begin + int(air[-1]) if air.size else begin
    first, last = quaternion.to_matrix(log.q[[begin, min(end, len(log.q) - 1)], 3:7])
    return {
        "maneuvers": _changes(log.mode, "maneuver", "stand"),
        "maneuver_rise_m": float(path[:, 2].max() - path[0, 2]),
        "maneuver_distance_m": float(np.hypot(x, y)),
        "maneuver_turn_deg": float(np.degrees(attitude.tilt_and_yaw(first.T @ last)[1])),
        "flight_s": log.control_period_s * air.size,
        "landing_tilt_deg": float(log.tilt_deg[landed:].max()),
    }


def _longest(flags: BoolArray) -> int:
    """Return the length of the longest run of true values."""
    return max((b - a for a, b in intervals(flags)), default=0)


def _changes(mode: NDArray[np.int8], before: str, after: str) -> int:
    return int(np.count_nonzero((mode[:-1] == MODES.index(before)) & (mode[1:] == MODES.index(after))))
