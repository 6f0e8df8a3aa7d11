from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.runs import Gate, Metrics, ModeMetrics, Outcome, WalkingMetrics, compute_metrics, judge

BALANCE = Gate(
    max_tilt_deg=5.0,
    max_slip_m=0.005,
    max_displacement_m=0.035,
    max_final_position_error_m=0.005,
    max_final_tilt_deg=0.5,
    max_solver_failures=0,
    max_abs_torque_nm=1.8,
)

MOVED = "largest distance of the base from its initial or commanded position"
OPEN = Gate(**dict.fromkeys(set(Gate().limits) - {"max_falls"}))


def test_a_good_run_passes(standing) -> None:
    verdict = judge(compute_metrics(standing), BALANCE)
    assert verdict.passed
    assert verdict.reasons == ()
    assert verdict.exit_code == 0


def test_every_broken_limit_is_reported_in_words_and_numbers(changed) -> None:
    def bad(arrays):
        arrays["q"][500, 0] += 0.0412
        arrays["contact_points"][400:, 1, 0] += 0.0061
        arrays["wbc_status"][3] = 1

    verdict = judge(compute_metrics(changed(bad)), BALANCE)
    assert verdict.outcome is Outcome.FAIL
    assert verdict.exit_code == 1
    assert verdict.reasons == (
        f"{MOVED}: 41.2 mm, allowed at most 35 mm (max_displacement_m)",
        "largest slip of a foot in contact: 6.1 mm, allowed at most 5 mm (max_slip_m)",
        "MPC updates and whole-body ticks whose solver failed: 1, allowed at most 0 (max_solver_failures)",
    )


def test_a_value_on_the_limit_passes_and_one_just_beyond_is_shown_with_more_digits(standing) -> None:
    metrics = compute_metrics(standing)
    assert judge(replace(metrics, max_tilt_deg=5.0), BALANCE).passed
    (reason,) = judge(replace(metrics, max_tilt_deg=5.0001), BALANCE).reasons
    assert reason == "largest tilt of the base: 5.0001 deg, allowed at most 5 deg (max_tilt_deg)"


def test_large_values_are_shown_without_exponent(standing) -> None:
    (reason,) = judge(replace(compute_metrics(standing), max_displacement_m=2.38), BALANCE).reasons
    assert reason == f"{MOVED}: 2.38 m, allowed at most 0.035 m (max_displacement_m)"


def test_a_fall_fails_a_gate_without_limits(changed) -> None:
    verdict = judge(compute_metrics(changed(lambda arrays: arrays["q"][620:, 2].fill(0.05))), OPEN)
    assert verdict.reasons == ("the robot fell after 0.62 s",)


def test_a_gate_limits_tilt_height_saturation_and_solver_failures_by_default(changed) -> None:
    def slump(arrays):
        arrays["q"][500:, 2] = 0.15
        arrays["q"][500:, 3:7] = [np.sin(np.radians(17.0)), 0.0, 0.0, np.cos(np.radians(17.0))]
        arrays["tau"][:150] = 1.8
        arrays["mpc_status"][3] = 1

    metrics = compute_metrics(changed(slump))
    assert judge(metrics, Gate()).reasons == (
        "largest tilt of the base: 34 deg, allowed at most 20 deg (max_tilt_deg)",
        "lowest height of the base relative to its initial one: 0.625, allowed at least 0.7 (min_base_height_fraction)",
        "fraction of ticks with a joint at its torque limit: 0.15, allowed at most 0.1"
        " (max_torque_saturation_fraction)",
        "MPC updates and whole-body ticks whose solver failed: 1, allowed at most 0 (max_solver_failures)",
    )
    assert judge(metrics, Gate(**dict.fromkeys(Gate().limits))).passed, "null switches a limit off"


def test_lower_limits(standing) -> None:
    metrics = compute_metrics(standing, elapsed_s=1.0)
    verdict = judge(metrics, Gate(min_friction_margin_n=4.0, min_real_time_factor=3.0, min_base_height_m=0.1))
    assert verdict.reasons == (
        "smallest distance of a measured force from its friction cone: 3.6 N, allowed at least 4 N"
        " (min_friction_margin_n)",
        "simulated over elapsed time: 1, allowed at least 3 (min_real_time_factor)",
    )


def test_what_was_not_measured_does_not_pass(standing) -> None:
    (reason,) = judge(compute_metrics(standing), Gate(min_real_time_factor=3.0)).reasons
    assert reason == "min_real_time_factor was not measured, but the gate limits it to 3"
    unmeasured = replace(compute_metrics(standing), com_rms_error_m=np.nan)
    assert not judge(unmeasured, Gate(max_com_rms_error_m=1.0)).passed


def test_interrupted_runs_neither_pass_nor_fail(standing) -> None:
    verdict = judge(compute_metrics(standing), BALANCE, interrupted=True)
    assert verdict.outcome is Outcome.INTERRUPTED
    assert verdict.exit_code == 130
    assert verdict.reasons == ("interrupted after 1 s",)


@pytest.mark.parametrize("field", [name for name in Gate.model_fields if name != "steady_from_s"])
def test_every_limit_of_the_gate_can_fail_a_run(standing, field) -> None:
    """The reason contains the limit's name."""
    metrics = compute_metrics(standing, elapsed_s=0.5)
    worst = 0.0 if field.startswith("min") else 1e9
    walking, modes = ({each.name for each in fields(kind)} for kind in (WalkingMetrics, ModeMetrics))
    metric = field if hasattr(metrics, field) or field in walking else field[4:]
    if metric in walking:
        metrics = replace(metrics, walking=WalkingMetrics(**{**dict.fromkeys(walking), metric: worst}))
    elif metric in modes:
        metrics = replace(metrics, modes=ModeMetrics(**{**dict.fromkeys(modes), metric: worst}))
    elif field in ("max_mpc_p50_ms", "max_wbc_p50_ms"):
        metric = f"{field[4:7]}_ms"
        metrics = replace(metrics, **{metric: replace(getattr(metrics, metric), p50=worst)})
    else:
        metrics = replace(metrics, **{metric: worst})
    limit = (
        1
        if field.endswith(
            ("failures", "misses", "steps", "contacts", "falls", "rises", "descents", "maneuvers", "collisions")
        )
        else 0.5
    )
    (reason,) = judge(metrics, Gate(**{field: limit})).reasons
    assert field in reason


@pytest.mark.parametrize(("field", "value"), [("max_tilt_deg", -1.0), ("max_slip_m", np.nan), ("steady_from_s", -0.1)])
def test_impossible_limits_are_refused(field, value) -> None:
    with pytest.raises(InputError, match=field):
        Gate(**{field: value})


def test_a_limit_has_the_description_of_its_metric() -> None:
    assert "max_slip_m: Largest slip of a foot in contact, m; from the start" in (Metrics.__doc__ or "")
    assert str(Gate.model_fields["max_slip_m"].description).startswith("Largest slip of a foot in contact, m; from")
    assert Gate.phrase("max_slip_m") == "largest slip of a foot in contact"
    assert "integral of ``|torque x joint speed|`` over" in (WalkingMetrics.__doc__ or "")
