"""Figures of merit of the modes: falls, damping after them, lying and rising, from the log of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lgmpc.runs.intervals import intervals
from lgmpc.runs.log import MODES, RunLog
from lgmpc.typing import BoolArray

__all__ = ["FALL_HEIGHT_FRACTION", "FALL_TILT_DEG", "LOW_MODES", "ModeMetrics", "fallen_ticks", "falls", "mode_metrics"]

FALL_TILT_DEG = 45.0
"""A base tilted further than this has fallen."""

FALL_HEIGHT_FRACTION = 0.5
"""A base below this fraction of its first height or, where modes were recorded, of its target has fallen."""

LOW_MODES = ("lie", "rise", "sit")
"""Modes in which the base is low by design."""


@dataclass(frozen=True)
class ModeMetrics:
    """Metrics of falls, lying and rising. ``None`` where there was nothing to measure.

    Attributes:
        give_up_s: longest time after a fall until the joints are damped.
        damped_rms_torque_nm: RMS torque of all joints while they are damped.
        rises: number of transitions from lying to standing.
        descents: number of transitions from standing to lying.
        torque_step_nm: largest change of a joint's torque between two ticks while it lies, rises or lies down.
    """

    give_up_s: float | None
    damped_rms_torque_nm: float | None
    rises: int
    descents: int
    torque_step_nm: float | None


def fallen_ticks(log: RunLog) -> BoolArray:
    """Return (n,) flags of a fallen robot."""
    fallen: BoolArray = log.tilt_deg > FALL_TILT_DEG
    if log.floating_base:
        upright = log.base_height[:1] if log.mode is None else log.above_ground(log.base_reference[:, :3])
        fallen |= log.base_height < FALL_HEIGHT_FRACTION * upright
    if log.mode is not None:
        fallen &= ~np.isin(log.mode, [MODES.index(mode) for mode in LOW_MODES])
    return fallen


def falls(log: RunLog, fallen: BoolArray) -> list[int]:
    """Return the first tick of each fall; where modes were recorded, one ends when the robot folds its legs again.

    Args:
        log: the log.
        fallen: (n,) flags, see :func:`fallen_ticks`.
    """
    if log.mode is None:
        return [int(tick) for tick in np.flatnonzero(fallen)[:1]]
    lying = log.mode == MODES.index("lie")
    found, tick = [], 0
    while fallen[tick:].any():
        tick += int(np.argmax(fallen[tick:]))
        found.append(tick)
        if not lying[tick:].any():
            break
        tick += int(np.argmax(lying[tick:]))
    return found


def mode_metrics(log: RunLog, fallen: BoolArray) -> ModeMetrics | None:
    """Return the metrics of the modes of a run; ``None`` where they were not recorded.

    Args:
        log: the log, at the full control rate.
        fallen: (n,) flags, see :func:`fallen_ticks`.
    """
    if log.mode is None:
        return None
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
    )


def _longest(flags: BoolArray) -> int:
    """Return the length of the longest run of true values."""
    return max((b - a for a, b in intervals(flags)), default=0)


def _changes(mode: NDArray[np.int8], before: str, after: str) -> int:
    return int(np.count_nonzero((mode[:-1] == MODES.index(before)) & (mode[1:] == MODES.index(after))))
