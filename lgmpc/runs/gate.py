"""Gates, the limits by which a run or a solution passes or fails, and the verdict on a run."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from enum import Enum
from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from lgmpc.runs.figures import figure_of, is_signed, judge_figures
from lgmpc.runs.metrics import Metrics
from lgmpc.runs.modes import ModeMetrics
from lgmpc.runs.walking import WalkingMetrics
from lgmpc.settings import LARGEST, Finite, Fraction, NonNegative, Problem, Settings, problems

Bound = NonNegative | None
Share = Fraction | None
Count = Annotated[int, Field(strict=True, ge=0)] | None


_KINDS = (WalkingMetrics, ModeMetrics, Metrics)


def _metric(limit: str) -> tuple[type, str]:
    """Return the metric of a limit: the class and its field, named as the limit, with or without max_ or min_."""
    names = [(kind, each.name) for kind in _KINDS for each in fields(kind)]
    return next((kind, name) for kind, name in names if name in (limit, figure_of(limit)))


def _limit(name: str, default: float | None = None) -> Any:
    """Return the field of a limit, which has the description of its metric."""
    kind, metric = _metric(name)
    described = next(each for each in fields(kind) if each.name == metric)
    return Field(default=default, description=described.metadata["description"])


class Gate(Settings):
    """Limits on a run's metrics. A robot that falls fails every gate that does not allow falls.

    Each limit is a number, or null for none. Tilt, base height, torque saturation and solver failures are limited by
    default.
    """

    steady_from_s: NonNegative = Field(
        default=0.0, description="Time from which tracking errors and joint speeds are evaluated, s; not a limit."
    )
    max_tilt_deg: Bound = _limit("max_tilt_deg", 20.0)
    max_displacement_m: Bound = _limit("max_displacement_m")
    min_base_height_m: Bound = _limit("min_base_height_m")
    min_base_height_fraction: Share = _limit("min_base_height_fraction", 0.7)
    max_final_position_error_m: Bound = _limit("max_final_position_error_m")
    max_final_tilt_deg: Bound = _limit("max_final_tilt_deg")
    max_final_rotation_deg: Bound = _limit("max_final_rotation_deg")
    max_slip_m: Bound = _limit("max_slip_m")
    max_foot_displacement_m: Bound = _limit("max_foot_displacement_m")
    max_abs_torque_nm: Bound = _limit("max_abs_torque_nm")
    max_torque_saturation_fraction: Share = _limit("max_torque_saturation_fraction", 0.1)
    min_friction_margin_n: Finite | None = _limit("min_friction_margin_n")
    max_rms_joint_velocity_rad_s: Bound = _limit("max_rms_joint_velocity_rad_s")
    max_com_rms_error_m: Bound = _limit("max_com_rms_error_m")
    max_com_error_m: Bound = _limit("max_com_error_m")
    max_hand_error_m: Bound = _limit("max_hand_error_m")
    max_hand_rotation_deg: Bound = _limit("max_hand_rotation_deg")
    max_solver_failures: Count = _limit("max_solver_failures", 0)
    max_deadline_misses: Count = _limit("max_deadline_misses")
    max_mpc_p50_ms: Bound = Field(default=None, description="Median duration of an MPC update, ms.")
    max_wbc_p50_ms: Bound = Field(default=None, description="Median duration of a whole-body tick, ms.")
    min_real_time_factor: Bound = _limit("min_real_time_factor")
    max_velocity_rmse_m_s: Bound = _limit("max_velocity_rmse_m_s")
    max_raw_velocity_rmse_m_s: Bound = _limit("max_raw_velocity_rmse_m_s")
    max_velocity_bias_m_s: Bound = _limit("max_velocity_bias_m_s")
    max_yaw_rate_rmse_rad_s: Bound = _limit("max_yaw_rate_rmse_rad_s")
    max_height_rmse_m: Bound = _limit("max_height_rmse_m")
    max_height_std_m: Bound = _limit("max_height_std_m")
    max_cost_of_transport: Bound = _limit("max_cost_of_transport")
    min_steps: Count = _limit("min_steps")
    max_lost_contacts: Count = _limit("max_lost_contacts")
    max_leg_collisions: Count = _limit("max_leg_collisions")
    max_self_penetration_m: Bound = _limit("max_self_penetration_m")
    max_walking_tilt_deg: Bound = _limit("max_walking_tilt_deg")
    max_scuff_m: Bound = _limit("max_scuff_m")
    max_peak_impact_n: Bound = _limit("max_peak_impact_n")
    max_odometry_drift_percent: Bound = _limit("max_odometry_drift_percent")
    max_recovery_time_s: Bound = _limit("max_recovery_time_s")
    max_stop_strides: Bound = _limit("max_stop_strides")
    max_final_foot_error_m: Bound = _limit("max_final_foot_error_m")
    max_falls: Count = _limit("max_falls", 0)
    max_give_up_s: Bound = _limit("max_give_up_s")
    max_damped_rms_torque_nm: Bound = _limit("max_damped_rms_torque_nm")
    min_rises: Count = _limit("min_rises")
    min_descents: Count = _limit("min_descents")
    max_torque_step_nm: Bound = _limit("max_torque_step_nm")
    min_maneuvers: Count = _limit("min_maneuvers")
    min_maneuver_rise_m: Bound = _limit("min_maneuver_rise_m")
    max_maneuver_rise_m: Bound = _limit("max_maneuver_rise_m")
    min_maneuver_distance_m: Bound = _limit("min_maneuver_distance_m")
    max_maneuver_distance_m: Bound = _limit("max_maneuver_distance_m")
    min_maneuver_turn_deg: Finite | None = _limit("min_maneuver_turn_deg")
    max_maneuver_turn_deg: Finite | None = _limit("max_maneuver_turn_deg")
    min_flight_s: Bound = _limit("min_flight_s")
    max_landing_tilt_deg: Bound = _limit("max_landing_tilt_deg")

    @property
    def limits(self) -> dict[str, float]:
        """The limits that are set, by their keys."""
        return {name: value for name, value in self if name != "steady_from_s" and value is not None}

    @classmethod
    def phrase(cls, limit: str) -> str:
        """Return the description of the metric of a limit, without its unit and range."""
        whole = re.split("[;:]", str(cls.model_fields[limit].description))[0]
        text = (whole.rpartition(",")[0] or whole).rstrip(".")
        return text if text[1].isupper() else text[0].lower() + text[1:]


class SolveGate(Settings):
    """Bounds on the figures of a solution: ``max_<figure>`` and ``min_<figure>``.

    The figures depend on the problem; an unknown one is an error that names the nearest.
    """

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "additionalProperties": False,
            "patternProperties": {
                "^(max|min)_[a-z0-9_]+$": {
                    "type": "number",
                    "description": "Bound on a figure of the solution; `lgmpc check` lists the figures.",
                }
            },
        },
    )
    __pydantic_extra__: dict[str, Finite] = Field(init=False)

    converged: bool = Field(default=True, strict=True, description="Whether the solver must reach its tolerance.")

    @model_validator(mode="before")
    @classmethod
    def _bounds(cls, data: Any) -> Any:
        """Report all wrong names and values together."""
        if not isinstance(data, dict):
            return data
        wrong = []
        for key, value in data.items():
            if key == "converged":
                continue
            if not key.startswith(("max_", "min_")):
                wrong.append(Problem(key, value, "the key converged, or a bound: max_<figure> or min_<figure>"))
            elif isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
                wrong.append(Problem(key, value, "a finite number"))
            elif value < 0 and not is_signed(figure_of(key)):
                wrong.append(Problem(key, value, f"a number not below 0: {figure_of(key)} cannot be negative"))
        if wrong:
            raise problems(wrong)
        return data

    @property
    def limits(self) -> dict[str, float]:
        """The bounds, by their keys (``max_effort_ratio``)."""
        return dict(self.__pydantic_extra__ or {})


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


def judge(metrics: Metrics, gate: Gate, *, interrupted: bool = False) -> Verdict:
    """Compare a run's metrics with its gate.

    Args:
        metrics: of the run.
        gate: the limits.
        interrupted: whether the run was stopped before its end: it has neither passed nor failed.
    """
    if interrupted:
        return Verdict(Outcome.INTERRUPTED, (f"interrupted after {metrics.survived_s:.3g} s",))
    limits = dict(gate.limits)
    reasons = []
    if gate.max_falls == 0 and metrics.falls:
        del limits["max_falls"]
        reasons.append(f"the robot fell after {metrics.survived_s:.3g} s")
    values = {figure_of(limit): measured(metrics, limit) for limit in limits}
    reasons += judge_figures(values, limits, {limit: gate.phrase(limit) for limit in limits})
    return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))


def measured(metrics: Metrics, limit: str) -> float | None:
    """Return the metric of a limit of the gate; ``None`` if it was not measured.

    Its name is that of the limit, with or without ``max_`` or ``min_``, or that of a median duration; it is a metric of
    the run, of its walking or of its modes.
    """
    if limit in ("max_mpc_p50_ms", "max_wbc_p50_ms"):
        timing = metrics.mpc_ms if limit == "max_mpc_p50_ms" else metrics.wbc_ms
        return None if timing is None else timing.p50
    kind, name = _metric(limit)
    owner = {WalkingMetrics: metrics.walking, ModeMetrics: metrics.modes, Metrics: metrics}[kind]
    value = getattr(owner, name, None)
    return None if value is None else float(value)
