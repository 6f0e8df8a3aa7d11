"""The verdict on a run by its gate."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum

from lgmpc.runs.figures import figure_of, short_number
from lgmpc.runs.gate import Gate
from lgmpc.runs.metrics import Metrics, Timing
from lgmpc.runs.modes import ModeMetrics
from lgmpc.runs.walking import WalkingMetrics

__all__ = ["Outcome", "Verdict", "judge", "measured"]


class Outcome(str, Enum):
    """The outcome of a run, as in ``run.json``."""

    PASS = "pass"
    FAIL = "fail"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Verdict:
    """The outcome of a run and its reasons: one sentence with numbers for each violated limit."""

    outcome: Outcome
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the run passed its gate."""
        return self.outcome is Outcome.PASS

    @property
    def exit_code(self) -> int:
        """The command line's exit code."""
        return {Outcome.PASS: 0, Outcome.FAIL: 1, Outcome.INTERRUPTED: 130}[self.outcome]


@dataclass(frozen=True)
class _Words:
    """Wording of a metric: a phrase that its value completes, the unit of the value, and its scale."""

    phrase: str
    unit: str = ""
    scale: float = 1.0


# Gate field without its "max_"/"min_" -> words. Order = order of the reasons.
_WORDS = {
    "falls": _Words("falls:"),
    "tilt_deg": _Words("the base tilted by", "deg"),
    "displacement_m": _Words("the base moved by", "mm", 1e3),
    "base_height_m": _Words("the base sank to", "mm", 1e3),
    "base_height_fraction": _Words("the base sank to", "% of its height", 1e2),
    "final_position_error_m": _Words("the base ended away from its start by", "mm", 1e3),
    "final_tilt_deg": _Words("the base ended tilted by", "deg"),
    "final_rotation_deg": _Words("the base ended rotated from its start by", "deg"),
    "slip_m": _Words("a foot slipped by", "mm", 1e3),
    "foot_displacement_m": _Words("a foot moved from its start by", "mm", 1e3),
    "abs_torque_nm": _Words("a joint's torque reached", "N.m"),
    "torque_saturation_fraction": _Words("a joint was at its torque limit during", "% of the ticks", 1e2),
    "friction_margin_n": _Words("the friction margin fell to", "N"),
    "rms_joint_velocity_rad_s": _Words("the joint speeds had an RMS of", "rad/s"),
    "com_rms_error_m": _Words("the centre of mass was off its target by an RMS of", "mm", 1e3),
    "com_error_m": _Words("the centre of mass was off its target by up to", "mm", 1e3),
    "solver_failures": _Words("solver failures:"),
    "deadline_misses": _Words("missed deadlines:"),
    "mpc_p50_ms": _Words("the median MPC update took", "ms"),
    "wbc_p50_ms": _Words("the median whole-body tick took", "ms"),
    "real_time_factor": _Words("the real-time factor was"),
    "velocity_rmse_m_s": _Words("the velocity averaged over a stride was off the command by an RMS of", "m/s"),
    "raw_velocity_rmse_m_s": _Words("the instantaneous velocity was off the command by an RMS of", "m/s"),
    "velocity_bias_m_s": _Words("the mean velocity was off the command by", "m/s"),
    "yaw_rate_rmse_rad_s": _Words("the yaw rate was off the command by an RMS of", "rad/s"),
    "height_rmse_m": _Words("the base's height was off its target by an RMS of", "mm", 1e3),
    "height_std_m": _Words("the base's height varied with a standard deviation of", "mm", 1e3),
    "cost_of_transport": _Words("the cost of transport was"),
    "steps": _Words("steps taken:"),
    "lost_contacts": _Words("contacts lost during a stance:"),
    "leg_collisions": _Words("legs touched each other; times:"),
    "walking_tilt_deg": _Words("the walking base tilted by", "deg"),
    "scuff_m": _Words("a swinging foot slid over the floor by", "mm", 1e3),
    "peak_impact_n": _Words("a foot touched down with", "N"),
    "odometry_drift_percent": _Words("the estimated position drifted by", "% of the distance"),
    "recovery_time_s": _Words("the return to the command after a push took", "s"),
    "stop_strides": _Words("the transition from the end of the command to standing took", "gait cycles"),
    "final_foot_error_m": _Words("a foot ended away from its initial position by", "mm", 1e3),
    "give_up_s": _Words("the joints of the fallen robot were not damped for", "s"),
    "damped_rms_torque_nm": _Words("the damped joints' torque had an RMS of", "N.m"),
    "rises": _Words("rises from the belly:"),
    "descents": _Words("times that the robot lay down:"),
    "torque_step_nm": _Words("lying or rising, a torque changed within a tick by", "N.m"),
}


def judge(metrics: Metrics, gate: Gate, *, interrupted: bool = False) -> Verdict:
    """Compare a run's metrics with its gate.

    Args:
        metrics: of the run.
        gate: the limits.
        interrupted: whether the run was stopped before its end: it has neither passed nor failed.
    """
    if interrupted:
        return Verdict(Outcome.INTERRUPTED, (f"interrupted after {metrics.survived_s:.3g} s",))
    reasons = []
    limits = gate.limits
    for name, words in _WORDS.items():
        for kind in ("max", "min"):
            field = f"{kind}_{name}"
            if field not in limits:
                continue
            limit, value = limits[field], measured(metrics, field)
            if value is None or math.isnan(value):
                reasons.append(f"{field} was not measured, but the gate limits it to {limit:g}")
            elif field == "max_falls" and limit == 0 and value > 0:
                reasons.append(f"the robot fell after {metrics.survived_s:.3g} s")
            elif value > limit if kind == "max" else value < limit:
                reasons.append(_sentence(words, value, limit, kind, field))
    return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))


def measured(metrics: Metrics, limit: str) -> float | None:
    """Return the metric of a limit of the gate; ``None`` if it was not measured.

    Its name is that of the limit, with or without ``max_`` or ``min_``, or that of a median duration; it is a metric of
    the run, of its walking or of its modes.
    """
    if limit in ("max_mpc_p50_ms", "max_wbc_p50_ms"):
        timing: Timing | None = metrics.mpc_ms if limit == "max_mpc_p50_ms" else metrics.wbc_ms
        return None if timing is None else timing.p50
    owner: Metrics | WalkingMetrics | ModeMetrics | None = metrics
    if any(each.name in (limit, figure_of(limit)) for each in fields(WalkingMetrics)):
        owner = metrics.walking
    elif any(each.name in (limit, figure_of(limit)) for each in fields(ModeMetrics)):
        owner = metrics.modes
    if owner is None:
        return None
    value = getattr(owner, limit if hasattr(owner, limit) else figure_of(limit))
    return None if value is None else float(value)


def _sentence(words: _Words, value: float, limit: float, kind: str, field: str) -> str:
    bound = "at most" if kind == "max" else "at least"
    shown, allowed = short_number(words.scale * value, words.scale * limit)
    unit = f" {words.unit}" if words.unit else ""
    return f"{words.phrase} {shown}{unit}, allowed {bound} {allowed}{unit} ({field})"
