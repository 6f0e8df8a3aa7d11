"""The gate that a run has to pass, and what it says when it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum

from lgmpc.errors import InputError
from lgmpc.runs.figures import figure_of, short_number
from lgmpc.runs.metrics import Metrics, Timing

__all__ = ["Gate", "Outcome", "Verdict", "judge", "measured"]


class Outcome(str, Enum):
    """How a run ended, as ``run.json`` spells it."""

    PASS = "pass"
    FAIL = "fail"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Gate:
    """Limits on a run's metrics; ``None`` = not limited. A robot that falls fails every gate.

    Attributes:
        steady_from_s: not a limit: when the transient is over, for the tracking error and the joint velocity.
        max_tilt_deg: limit of :attr:`Metrics.max_tilt_deg`, and so on for the others.
    """

    steady_from_s: float = 0.0
    max_tilt_deg: float | None = None
    max_displacement_m: float | None = None
    min_base_height_m: float | None = None
    max_final_position_error_m: float | None = None
    max_final_tilt_deg: float | None = None
    max_final_rotation_deg: float | None = None
    max_slip_m: float | None = None
    max_foot_displacement_m: float | None = None
    max_abs_torque_nm: float | None = None
    max_torque_saturation_fraction: float | None = None
    min_friction_margin_n: float | None = None
    max_rms_joint_velocity_rad_s: float | None = None
    max_com_rms_error_m: float | None = None
    max_com_error_m: float | None = None
    max_solver_failures: int | None = None
    max_deadline_misses: int | None = None
    max_mpc_p50_ms: float | None = None
    max_wbc_p50_ms: float | None = None
    min_real_time_factor: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not math.isfinite(value):
                raise InputError(f"gate.{field.name}", value, "a finite number")
            if value is not None and value < 0 and field.name != "min_friction_margin_n":
                raise InputError(f"gate.{field.name}", value, "a number that is not negative")


@dataclass(frozen=True)
class Verdict:
    """Whether a run passed, and if not, why: one sentence with numbers for each limit that it broke."""

    outcome: Outcome
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the run passed its gate."""
        return self.outcome is Outcome.PASS

    @property
    def exit_code(self) -> int:
        """What the command line returns for it."""
        return {Outcome.PASS: 0, Outcome.FAIL: 1, Outcome.INTERRUPTED: 130}[self.outcome]


@dataclass(frozen=True)
class _Words:
    """How a metric is told: a phrase that its value completes, the unit it is told in, and its scale."""

    phrase: str
    unit: str = ""
    scale: float = 1.0


# Gate field without its "max_"/"min_" -> words. Order = order of the reasons.
_WORDS = {
    "tilt_deg": _Words("the base tilted by", "deg"),
    "displacement_m": _Words("the base moved by", "mm", 1e3),
    "base_height_m": _Words("the base sank to", "mm", 1e3),
    "final_position_error_m": _Words("the base ended away from its start by", "mm", 1e3),
    "final_tilt_deg": _Words("the base ended tilted by", "deg"),
    "final_rotation_deg": _Words("the base ended rotated from its start by", "deg"),
    "slip_m": _Words("a foot slipped by", "mm", 1e3),
    "foot_displacement_m": _Words("a foot moved from its start by", "mm", 1e3),
    "abs_torque_nm": _Words("a joint's torque reached", "N.m"),
    "torque_saturation_fraction": _Words("a joint was at its torque limit during", "% of the ticks", 1e2),
    "friction_margin_n": _Words("the friction margin fell to", "N"),
    "rms_joint_velocity_rad_s": _Words("the joints trembled at an RMS of", "rad/s"),
    "com_rms_error_m": _Words("the centre of mass missed its target by an RMS of", "mm", 1e3),
    "com_error_m": _Words("the centre of mass missed its target by up to", "mm", 1e3),
    "solver_failures": _Words("solver failures:"),
    "deadline_misses": _Words("missed deadlines:"),
    "mpc_p50_ms": _Words("the median MPC update took", "ms"),
    "wbc_p50_ms": _Words("the median whole-body tick took", "ms"),
    "real_time_factor": _Words("the real-time factor was"),
}


def judge(metrics: Metrics, gate: Gate, *, interrupted: bool = False) -> Verdict:
    """Hold a run's metrics against its gate.

    Args:
        metrics: what was measured.
        gate: the limits.
        interrupted: whether the run was stopped before its end; then it neither passed nor failed.
    """
    if interrupted:
        return Verdict(Outcome.INTERRUPTED, (f"interrupted after {metrics.survived_s:.3g} s",))
    reasons = []
    if metrics.fell:
        reasons.append(f"the robot fell after {metrics.survived_s:.3g} s")
    for name, words in _WORDS.items():
        for kind in ("max", "min"):
            field = f"{kind}_{name}"
            limit = getattr(gate, field, None)
            if limit is None:
                continue
            value = measured(metrics, field)
            if value is None or math.isnan(value):
                reasons.append(f"{field} was not measured, but the gate limits it to {limit:g}")
            elif value > limit if kind == "max" else value < limit:
                reasons.append(_sentence(words, value, limit, kind, field))
    return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))


def measured(metrics: Metrics, limit: str) -> float | None:
    """Return the metric that a limit of the gate is about; ``None`` if it was not measured.

    It is called like the limit, or like it without "max_" or "min_", or it is a median duration.
    """
    if limit in ("max_mpc_p50_ms", "max_wbc_p50_ms"):
        timing: Timing | None = metrics.mpc_ms if limit == "max_mpc_p50_ms" else metrics.wbc_ms
        return None if timing is None else timing.p50
    value = getattr(metrics, limit if hasattr(metrics, limit) else figure_of(limit))
    return None if value is None else float(value)


def _sentence(words: _Words, value: float, limit: float, kind: str, field: str) -> str:
    bound = "at most" if kind == "max" else "at least"
    shown, allowed = short_number(words.scale * value, words.scale * limit)
    unit = f" {words.unit}" if words.unit else ""
    return f"{words.phrase} {shown}{unit}, allowed {bound} {allowed}{unit} ({field})"
