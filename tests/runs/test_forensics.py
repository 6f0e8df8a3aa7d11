"""Events before a failure, from logs in which they are known by construction."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.runs import Gate, Outcome, Run, RunLog, RunResult, compute_metrics, judge
from lgmpc.runs.events import Event, EventKind, event_lines
from lgmpc.runs.forensics import Explanation, explain_run
from lgmpc.runs.limited import UnloggedLimits, gate_figures

JOINTS = UnloggedLimits(np.full(12, -2.0), np.full(12, 2.0), np.full(12, 30.0))
Edit = Callable[[dict[str, np.ndarray]], None]
Explain = Callable[..., Explanation]


@pytest.fixture
def explain(changed: Callable[[Edit], RunLog]) -> Explain:
    """Explain the standing log after a change."""

    def run(edit: Edit, gate: Gate | None = None, **fields: object) -> Explanation:
        gate = gate or Gate()
        log = replace(changed(edit), mass_kg=2.5, **fields)
        metrics = compute_metrics(log)
        return explain_run(Run(Path("run"), "", log, RunResult("test", judge(metrics, gate), metrics)), gate, JOINTS)

    return run


def fall(arrays: dict[str, np.ndarray]) -> None:
    """The base sinks below half its height at 0.8 s, after a push and with a joint at its limit."""
    arrays["push"][300:400, 1] = 20.0
    arrays["tau"][450:520, 7] = 1.8
    arrays["tau"][480:520, 3] = -1.8
    arrays["wbc_status"][600:604] = 1
    arrays["q"][800:, 2] = 0.1


def named(explanation: Explanation, name: str) -> Event:
    (event,) = [each for each in explanation.events if each.name == name]
    return event


def test_a_fall_has_a_cause_a_first_sign_and_a_time(explain: Explain) -> None:
    found = explain(fall)
    assert found.failed_s == pytest.approx(0.8)
    assert [each.name for each in found.events] == ["push", "torque", "whole-body QP", "base height"]
    push, torque, solver = found.events[:3]
    assert (push.kind, push.start_s, push.end_s) == (EventKind.CAUSE, pytest.approx(0.3), pytest.approx(0.4))
    assert "2 N.s [0, 2, 0]" in push.words
    assert (torque.start_s, torque.end_s) == (pytest.approx(0.45), pytest.approx(0.519))
    assert torque.words == "torque at its limit of 1.8 N.m: joint 8 (70 ms), joint 4 (40 ms)"
    assert "4 ticks" in solver.words
    assert found.summary[0].startswith(
        "the robot fell (tilt 0 deg, base at 41.7 % of its first height) at 0.800 s, 500 ms"
    )
    assert found.summary[1].startswith("first sign, at 0.450 s (350 ms before): torque at its limit")


def test_a_run_that_passes_has_its_nearest_limits(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["tau"][500, 4] = 1.71
        arrays["q"][700, 7 + 5] = -1.5
        arrays["v"][200, 6 + 2] = 3.0

    found = explain(edit, Gate(max_rms_joint_velocity_rad_s=4.0))
    assert (found.failed_s, found.failure, found.events) == (None, "", ())
    first, second, *_ = found.nearest
    assert (first.name, first.subject, first.time_s) == ("torque", "joint 5", pytest.approx(0.5))
    assert (first.margin, first.used) == (pytest.approx(0.09), pytest.approx(0.95))
    assert (second.name, second.subject, second.limit, second.used) == ("joint position", "joint 6", -2.0, 0.75)
    speed = next(each for each in found.nearest if each.name == "joint speed")
    assert (speed.used, speed.time_s) == (pytest.approx(0.1), pytest.approx(0.2))
    whole = next(each for each in found.nearest if each.name == "RMS joint velocity")
    assert whole.time_s is None and whole.value == pytest.approx(3.0 / np.sqrt(12000.0))
    assert found.summary == ("it passed", "nearest to its limit: torque of joint 5: 1.71 N.m at 0.500 s, limit 1.8 N.m")


def test_a_gate_that_is_broken_without_a_fall_has_its_moment(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["contact_points"][600:, 2, 0] -= 0.008
        arrays["contact_forces"][590:640, 2, 0] = 3.6  # on the cone of friction 0.6

    found = explain(edit, Gate(max_slip_m=0.005))
    assert found.failed_s == pytest.approx(0.6)
    assert found.failure == "the slip of HL went beyond its limit of 5 mm"
    assert named(found, "friction").words == "friction cone (coefficient 0.6) used up: HL (50 ms)"
    assert named(found, "slip").words == "feet slid by up to 8 mm: HL (400 ms)"


def test_a_failure_of_the_whole_run_has_no_moment(explain: Explain) -> None:
    found = explain(
        lambda arrays: arrays["v"].__setitem__((slice(None), 8), 1.0), Gate(max_rms_joint_velocity_rad_s=0.1)
    )
    assert found.failed_s is None
    assert found.summary == (found.reasons[0],)


def test_lost_contacts_count_only_where_the_controller_relies_on_them(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["com"][:, :2] = -0.02  # not on a diagonal of the feet
        arrays["contact_forces"][300:330, 1] = 0.0
        arrays["contact_forces"][500:506, 0] = 0.0  # bounces

    assert named(explain(edit), "contact lost").words.endswith("relies on it: FR (30 ms)")
    stance = np.ones((1000, 4), dtype=np.int8)
    stance[300:330, 1] = 0
    steps = {
        "command": np.zeros((1000, 3)),
        "mode": np.full(1000, 3, dtype=np.int8),
        "gait_period_s": np.full(1000, 0.4),
        "stance": stance,
        "contact_states": np.zeros((1000, 4), dtype=np.int8),
        "swing_targets": np.zeros((1000, 4, 3)),
        "footholds": np.tile([0.2, -0.15, 0.0], (1000, 4, 1)),
    }
    assert explain(edit, **steps).events == ()


def test_the_capture_point_in_flight_is_as_at_take_off(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["momentum"][400:, 1] = 2.5 * 1.5  # 0.21 m ahead, where the support ends at 0.15
        arrays["contact_forces"][450:, :] = 0.0
        arrays["q"][700:, 2] = 0.1

    found = explain(edit)
    beyond = named(found, "capture point")
    assert (beyond.start_s, beyond.end_s) == (pytest.approx(0.4), pytest.approx(0.999))
    assert found.summary[-1].startswith("from 0.400 s on the capture point was outside the support")


def test_solver_failures_missed_ticks_and_wrong_estimates(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["mpc_status"][30:33] = 1
        arrays["time"][700:] += 0.004

    angle = np.radians(3.0)
    estimate = np.zeros((1000, 19))
    estimate[:, 2], estimate[:, 6] = 0.24, 1.0
    estimate[800:850, 3:7] = [np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)]
    fields = {
        "estimate_q": estimate,
        "estimate_v": np.zeros((1000, 18)),
        "estimate_contacts": np.ones((1000, 4), dtype=np.int8),
        "estimate_ms": np.zeros(1000),
    }
    found = explain(edit, **fields)
    assert named(found, "MPC").words == "3 MPC updates without a solution: the plan of 0.290 s remained in use"
    assert named(found, "missed ticks").words == "1 times ticks were missed, for up to 5 ms"
    assert named(found, "estimate").words == "estimate off by up to 3 deg of tilt and 0 m/s"


def test_what_came_long_before_is_counted(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["time"] *= 10.0  # ticks of 10 ms, 10 s
        arrays["mpc_time"] *= 10.0
        for first in (50, 100, 150):
            arrays["tau"][first : first + 5, 0] = 1.8
        arrays["tau"][780:790, 1] = 1.8
        arrays["q"][800:, 2] = 0.1

    found = explain(edit, control_period_s=0.01, mpc_period_s=0.1)
    assert found.earlier == {"torque": 3}
    assert [each.name for each in found.events] == ["torque", "base height"]


def test_a_state_that_is_not_finite_is_the_failure(explain: Explain) -> None:
    found = explain(lambda arrays: arrays["q"].__setitem__((slice(700, None), 3), np.nan))
    assert (found.failed_s, found.failure) == (pytest.approx(0.7), "the state was no longer finite")
    assert all(each.time_s is not None and each.time_s < 0.7 for each in found.nearest)


def test_json_has_all_but_the_arrays(explain: Explain) -> None:
    content = json.loads(json.dumps(explain(fall).content(), allow_nan=False))
    assert content["outcome"] == "fail"
    assert content["events"][0]["kind"] == "cause"
    assert not {"log", "quantities"} & content.keys()


def test_nothing_finite_is_an_error(standing: RunLog) -> None:
    log = standing.until(1)
    metrics = compute_metrics(log)
    with pytest.raises(InputError, match="1 ticks; expected a run of at least two ticks"):
        explain_run(Run(Path("run"), "", log, RunResult("test", judge(metrics, Gate()), metrics)), Gate())


@pytest.mark.parametrize(("value", "used"), [(0.5, -10.0), (-1.0, 0.2), (-5.0, 1.0), (-8.0, 1.6)])
def test_the_share_of_a_negative_lower_limit_grows_with_the_violation(
    standing: RunLog, value: float, used: float
) -> None:
    metrics = replace(compute_metrics(standing), min_friction_margin_n=value)
    found = {each.name: each for each in gate_figures(metrics, Gate(min_friction_margin_n=-5.0))}
    assert found["friction margin"].used == pytest.approx(used)
    assert found["friction margin"].margin == pytest.approx(value + 5.0)


def test_a_limit_of_zero_is_a_limit(explain: Explain) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["contact_points"][600:, 2, 0] -= 1e-3

    found = explain(edit, Gate(max_slip_m=0.0))
    assert found.failed_s == pytest.approx(0.6)
    assert found.failure == "the slip of HL went beyond its limit of 0 mm"


def slide(arrays: dict[str, np.ndarray]) -> None:
    """A foot slides by 20 mm at 0.6 s, and the capture point leaves the support for a while."""
    arrays["contact_points"][600:, 2, 0] -= 0.02
    arrays["momentum"][400:450, 1] = 2.5 * 1.5


def test_only_limits_of_the_gate_are_broken(explain: Explain) -> None:
    passed = explain(slide, Gate(max_slip_m=None))
    assert passed.outcome is Outcome.PASS
    assert not any(each.broken for each in passed.nearest)
    assert "slip" not in [each.name for each in passed.nearest]
    assert named(passed, "slip").words.startswith("feet slid by up to 20 mm")  # what happened is told
    (capture,) = [each for each in passed.nearest if each.name == "capture point"]
    assert capture.margin < 0.0 and not any(each in passed.summary[-1] for each in ("slip", "capture point"))
    failed = explain(slide, Gate(max_slip_m=0.01))
    assert failed.outcome is Outcome.FAIL
    assert [each.name for each in failed.nearest if each.broken] == ["slip"]


def test_periodic_events_are_one_line() -> None:
    def event(start: float, length: float, kind: EventKind, name: str) -> Event:
        return Event(start, start + length, kind, name, f"{name} at {start:g}")

    pushes = [event(1.0 + k, 0.2, EventKind.CAUSE, "push") for k in range(4)]
    limits = [event(1.1 + 0.3 * k, 0.05 if k == 3 else 0.01, EventKind.LIMIT, "torque") for k in range(8)]
    slips = [event(1.2, 0.1, EventKind.CONTACT, "slip")]
    lines = event_lines(sorted([*pushes, *limits, *slips], key=lambda each: each.start_s))
    assert [line.words for line in lines] == [
        "push at 1",
        "torque at 2 (at 2.000 s, the longest of 8 until 3.210 s)",
        "slip at 1.2",
        *(f"push at {k}" for k in (2, 3, 4)),
    ]
    assert lines[1].start_s == pytest.approx(1.1) and lines[1].lasting_s == pytest.approx(0.12)
