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

__all__ = ["Gate", "Outcome", "SolveGate", "Verdict", "judge", "measured"]

Bound = NonNegative | None
Share = Fraction | None
Count = Annotated[int, Field(strict=True, ge=0)] | None


def _limit(description: str, default: float | None = None) -> Any:
    return Field(default=default, description=description)


class Gate(Settings):
    """Limits on a run's metrics. A robot that falls fails every gate that does not allow falls.

    Each limit is a number, or null for none. Tilt, base height, torque saturation and solver failures are limited by
    default.
    """

    steady_from_s: NonNegative = _limit(
        "Time from which tracking errors and joint speeds are evaluated, s; not a limit.", 0.0
    )
    max_tilt_deg: Bound = _limit("Largest tilt of the base, degrees.", 20.0)
    max_displacement_m: Bound = _limit(
        "Largest distance of the base from its initial or, with commands, its commanded position, m."
    )
    min_base_height_m: Bound = _limit("Lowest height of the base, m.")
    min_base_height_fraction: Share = _limit(
        "Lowest height of the base as a fraction of its initial height, 0 to 1.", 0.7
    )
    max_final_position_error_m: Bound = _limit(
        "Distance of the base from its initial or, with commands, its commanded position at the end, m."
    )
    max_final_tilt_deg: Bound = _limit("Tilt of the base at the end, degrees.")
    max_final_rotation_deg: Bound = _limit(
        "Rotation of the base from its initial or, with commands, its commanded attitude at the end, yaw "
        "included, degrees."
    )
    max_slip_m: Bound = _limit("Largest slip of a foot in contact, m.")
    max_foot_displacement_m: Bound = _limit("Largest distance of a foot from its initial position, m.")
    max_abs_torque_nm: Bound = _limit("Largest torque at any joint, N.m.")
    max_torque_saturation_fraction: Share = _limit("Fraction of ticks with a joint at its torque limit, 0 to 1.", 0.1)
    min_friction_margin_n: Finite | None = _limit(
        "Smallest distance of a measured force from the friction cone's surface, N."
    )
    max_rms_joint_velocity_rad_s: Bound = _limit("RMS of the joint speeds from steady_from_s on, rad/s.")
    max_com_rms_error_m: Bound = _limit("RMS distance of the centre of mass from its target from steady_from_s on, m.")
    max_com_error_m: Bound = _limit("Largest distance of the centre of mass from its target from steady_from_s on, m.")
    max_solver_failures: Count = _limit("MPC updates and whole-body ticks whose solver failed.", 0)
    max_deadline_misses: Count = _limit(
        "Ticks that took longer than their period, estimation and planning in them included."
    )
    max_mpc_p50_ms: Bound = _limit("Median duration of an MPC update, ms.")
    max_wbc_p50_ms: Bound = _limit("Median duration of a whole-body tick, ms.")
    min_real_time_factor: Bound = _limit("Simulated over elapsed time.")
    max_velocity_rmse_m_s: Bound = _limit("RMS error of the velocity averaged over a stride at constant commands, m/s.")
    max_raw_velocity_rmse_m_s: Bound = _limit("RMS error of the instantaneous velocity at constant commands, m/s.")
    max_velocity_bias_m_s: Bound = _limit("Mean velocity error at any constant command, m/s.")
    max_yaw_rate_rmse_rad_s: Bound = _limit(
        "RMS error of the yaw rate averaged over a stride at constant commands, rad/s."
    )
    max_height_rmse_m: Bound = _limit("RMS error of the base's height at constant commands, m.")
    max_height_std_m: Bound = _limit("Standard deviation of the base's height at any constant command, m.")
    max_cost_of_transport: Bound = _limit(
        "Cost of transport: integral of |torque x joint speed| over weight times distance."
    )
    min_steps: Count = _limit("Number of swings of all feet.")
    max_lost_contacts: Count = _limit("Number of contacts lost during a stance.")
    max_leg_collisions: Count = _limit(
        "Number of times that two legs touch: capsules of the feet's radius along their links."
    )
    max_walking_tilt_deg: Bound = _limit("Largest tilt of the base while it walks, degrees.")
    max_scuff_m: Bound = _limit("Largest distance that a foot slides over the floor in a swing, m.")
    max_peak_impact_n: Bound = _limit("Largest normal force of a foot just after its touchdown, N.")
    max_odometry_drift_percent: Bound = _limit(
        "Error of the estimated base position at the end over the distance travelled, %."
    )
    max_recovery_time_s: Bound = _limit(
        "Time from a push's end until the velocity is back within 0.05 m/s of the command, s."
    )
    max_stop_strides: Bound = _limit(
        "Time from the end of the command's motion until the robot stands, in gait cycles."
    )
    max_final_foot_error_m: Bound = _limit(
        "Distance of a foot at the end from its initial position relative to the other feet, m."
    )
    max_falls: Count = _limit("Falls; null: any number.", 0)
    max_give_up_s: Bound = _limit("Time after a fall until the joints are damped, s.")
    max_damped_rms_torque_nm: Bound = _limit("RMS torque of all joints while they are damped, N.m.")
    min_rises: Count = _limit("Number of transitions from lying to standing.")
    min_descents: Count = _limit("Number of transitions from standing to lying.")
    max_torque_step_nm: Bound = _limit(
        "Change of a joint's torque between two ticks while the robot lies, rises or lies down, N.m."
    )
    min_maneuvers: Count = _limit("Number of manoeuvres performed to their end.")
    min_maneuver_rise_m: Bound = _limit("Rise of the centre of mass in the last manoeuvre, m.")
    max_maneuver_rise_m: Bound = _limit("Rise of the centre of mass in the last manoeuvre, m.")
    min_maneuver_distance_m: Bound = _limit("Horizontal way of the centre of mass in the last manoeuvre, m.")
    max_maneuver_distance_m: Bound = _limit("Horizontal way of the centre of mass in the last manoeuvre, m.")
    min_maneuver_turn_deg: Finite | None = _limit("Turn of the heading to the left in the last manoeuvre, degrees.")
    max_maneuver_turn_deg: Finite | None = _limit("Turn of the heading to the left in the last manoeuvre, degrees.")
    min_flight_s: Bound = _limit("Time without contact in the last manoeuvre, s.")
    max_landing_tilt_deg: Bound = _limit("Largest tilt of the base after the flight of the last manoeuvre, degrees.")

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
    def bounds(self) -> dict[str, float]:
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
    groups = ((metrics.walking, WalkingMetrics), (metrics.modes, ModeMetrics), (metrics, Metrics))
    for owner, kind in groups:
        for name in {each.name for each in fields(kind)} & {limit, figure_of(limit)}:
            value = getattr(owner, name, None)
            return None if value is None else float(value)
    raise AttributeError(limit)
