"""Configs of problems to solve: which file is which, gates on figures, solving into a folder; on a small arm."""

from __future__ import annotations

import math
import signal
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import SolveConfig, load_config, load_solve_config, parse_any_config, parse_config, parse_solve_config
from lgmpc.config.execution import FinishedSolve, solve_config
from lgmpc.config.session import Progress
from lgmpc.config.solving import check_scenario, prepare_solve
from lgmpc.errors import ConfigError, ConfigErrors
from lgmpc.runs import Outcome, load_run

ARM = """\
name: arm
robot: {model: double_pendulum, effort_limit_nm: 2.0, velocity_limit_rad_s: 20.0, position_limit_rad: [-3.0, 3.0]}
problem:
  kind: reach
  frame: link2
  position_m: [0.0290872, 0.06, 0.115]
  nodes: 20
  node_s: 0.02
solver: {method: box_fddp}
gate: {max_position_error_m: 0.002, max_effort_ratio: 1.0}
"""


def arm(*overrides: str) -> SolveConfig:
    return parse_solve_config(ARM, name="arm.yaml", overrides=overrides)


def message(*overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        check_scenario(arm(*overrides))
    return str(caught.value)


def test_shipped_problems_can_be_built(shipped_problem: Path) -> None:
    config = load_solve_config(shipped_problem)
    scenario, names = check_scenario(config)
    assert scenario.times[-1] > 0.0
    assert {"iterations", "effort_ratio"} < set(names)


def test_a_config_is_of_one_kind_and_the_right_command_is_named(shipped_run: Path, shipped_problem: Path) -> None:
    with pytest.raises(ConfigError, match=r"a closed loop to simulate.* lgmpc solve "):
        load_config(shipped_problem)
    with pytest.raises(ConfigError, match=r"a problem to solve.* lgmpc run "):
        load_solve_config(shipped_run)
    assert isinstance(parse_any_config(ARM), SolveConfig)


def test_the_right_command_is_named_before_anything_else_is_wrong() -> None:
    with pytest.raises(ConfigError, match=r"^f\.yaml:3: problem: got a problem to solve"):
        parse_config(ARM.replace("nodes: 20", "nodez: 20"), name="f.yaml")


BAD = [
    ("problem.nodez=3", "problem.nodez: got an unknown key (value 3); expected a key of problem. Did you mean"),
    ("problem.kind=reech", "problem.kind: got the text 'reech'; expected one of"),
    ("problem.position_m=[0, 1]", "problem.position_m: got the list [0, 1]; expected a list of three numbers"),
    ("problem.frame=link3", "problem.frame: got link3; expected a frame of 2dof_planar. Did you mean link2"),
    ("problem={kind: gait, pattern: trott}", "expected one of walk, trot, pace, bound (A quadruped's gait"),
    ("solver.methd=sqp", "Did you mean solver.method?"),
    (
        "solver.method=ddp",
        "solver.method: got the text 'ddp'; expected one of fddp, box_fddp, al_fddp, sqp, ipopt, fatrop",
    ),
    ("solver.max_iterations=-1", "solver.max_iterations: got -1; expected a number not below 0"),
    ("solver={method: fatrop, time_limit_s: 1}", "solver.time_limit_s: got 1; expected null: fatrop cannot"),
    ("gate.max_position_eror_m=1", "Did you mean gate.max_position_error_m"),
    ("gate.foo=1", "gate.foo: got 1; expected the key converged, or a bound"),
    ("gate.max_cost=.nan", "gate.max_cost: got NaN (.nan); expected a finite number"),
    ("gate.max_cost=true", "gate.max_cost: got true; expected a finite number"),
    ("gate.max_position_error_m=-1", "got -1; expected a number not below 0: position_error_m cannot be negative"),
    ("gate.min_iterations=-1", "got -1; expected a number not below 0: iterations cannot be negative"),
    ("gate.converged=1", "gate.converged: got 1; expected true or false"),
    ("robot.model=iris", "robot: got iris, whose base is free; expected a robot with a fixed base"),
]


@pytest.mark.parametrize(("override", "expected"), BAD, ids=[each[0] for each in BAD])
def test_bad_values_are_reported_with_their_place(override: str, expected: str) -> None:
    text = message(override)
    assert expected in text
    assert text.startswith("--set: ") or text.startswith("arm.yaml:2: robot")


def test_bounds_on_margins_and_distances_may_be_negative() -> None:
    bounds = arm("gate={min_friction_margin_n: -0.001, max_forward_distance_m: -0.1}").gate.limits
    assert bounds == {"min_friction_margin_n": -0.001, "max_forward_distance_m": -0.1}


def test_all_unknown_bounds_are_found_at_once() -> None:
    with pytest.raises(ConfigErrors) as caught:
        check_scenario(arm("gate.max_foo=1", "gate.min_position_eror_m=0"))
    assert [problem.key for problem in caught.value.problems] == ["gate.max_foo", "gate.min_position_eror_m"]
    assert "gate.min_position_error_m" in caught.value.problems[1].suggestions


def test_names_and_numbers_of_a_gate_are_refused_together() -> None:
    with pytest.raises(ConfigErrors) as caught:
        arm("gate.foo=1", "gate.max_cost=x")
    assert [problem.key for problem in caught.value.problems] == ["gate.foo", "gate.max_cost"]


def test_a_method_that_cannot_take_the_constraints_names_those_that_can() -> None:
    with pytest.raises(ConfigError, match=r"solver\.method: got fddp for .*; expected box_fddp .*al_fddp, sqp, ipopt"):
        check_scenario(arm("solver.method=fddp"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> FinishedSolve:
    return solve_config(arm(), tmp_path_factory.mktemp("runs"))


def test_a_solution_is_saved_with_its_figures(finished: FinishedSolve) -> None:
    run = load_run(finished.folder.path)
    assert run.result.verdict.outcome is Outcome.PASS
    assert run.result.status == "converged"
    assert run.result.figures == finished.outcome.figures
    figures, log = run.result.figures, run.log
    assert figures["iterations"] == len(log.iteration_cost)
    assert figures["cost"] == pytest.approx(log.iteration_cost[-1])
    assert figures["dynamics_gap"] < 1e-9
    assert figures["effort_ratio"] == pytest.approx(np.abs(log.us).max() / 2.0)
    assert figures["ms_per_iteration"] == pytest.approx(figures["solve_ms"] / figures["iterations"])
    np.testing.assert_allclose(log.times, 0.02 * np.arange(21))
    assert log.waypoint_names.tolist() == ["link2"]
    np.testing.assert_array_equal(log.control_upper, 2.0)
    assert (np.diff(log.iteration_elapsed) > 0.0).all()
    assert load_run(finished.folder.path).result == run.result


def test_its_config_repeats_it(finished: FinishedSolve, tmp_path: Path) -> None:
    config = load_solve_config(finished.folder.path / "config.yaml")
    assert config == arm()
    again = solve_config(config, tmp_path)
    assert again.outcome.log.xs.tobytes() == finished.outcome.log.xs.tobytes(), "not the same bits"


@pytest.mark.parametrize("method", ["sqp", "ipopt", "fatrop"])
def test_every_method_finds_the_same(method: str, finished: FinishedSolve, tmp_path: Path) -> None:
    other = solve_config(arm(f"solver.method={method}"), tmp_path).outcome
    assert other.verdict.passed, other.verdict.reasons
    assert other.figures["cost"] == pytest.approx(finished.outcome.figures["cost"], rel=1e-6)
    assert (len(other.log.iteration_cost) > 0) == (method != "fatrop")  # which reports none


def test_a_solve_without_convergence_fails_unless_the_gate_allows_it() -> None:
    outcome = prepare_solve(arm("solver.max_iterations=1")).run(lambda now: None)
    assert outcome.verdict.outcome is Outcome.FAIL
    assert "not converged: iteration limit after 1 iteration; raise max_iterations" in outcome.verdict.reasons[0]
    assert "iteration limit after 1 iteration" in outcome.explanation
    lenient = prepare_solve(arm("solver.max_iterations=1", "gate={converged: false}")).run(lambda now: None)
    assert lenient.verdict.outcome is Outcome.PASS and not lenient.converged


def test_broken_bounds_are_reported_in_readable_units() -> None:
    outcome = prepare_solve(arm("gate={max_position_error_m: 1e-6, min_effort_ratio: 1.5}")).run(lambda now: None)
    first, second = outcome.verdict.reasons
    assert first.startswith("position error 0.") and "mm, allowed at most 0.001 mm (max_position_error_m)" in first
    assert "allowed at least 1.5 (min_effort_ratio)" in second


def test_a_time_limit_is_kept() -> None:
    outcome = prepare_solve(arm("solver.time_limit_s=1e-9")).run(lambda now: None)
    assert outcome.status == "time_limit"
    assert outcome.figures["iterations"] == 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_the_iterate_and_marks_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def send(now: Progress) -> None:
        if now.iteration == 2:
            signal.raise_signal(number)

    before = signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    try:
        finished = solve_config(arm(), tmp_path, progress=send)
    finally:
        signal.signal(number, before)
    assert (finished.signal, finished.exit_code) == (number, 128 + number)
    run = load_run(finished.folder.path)
    assert run.result.verdict.outcome is Outcome.INTERRUPTED
    assert run.result.verdict.reasons == ("interrupted after 2 iterations",)
    assert len(run.log.iteration_cost) == 2 and run.log.finite


def test_the_size_of_a_trajectory_is_computed_before_the_solve() -> None:
    session = prepare_solve(arm())
    log = session.run(lambda now: None).log
    written = log.times.nbytes + log.xs.nbytes + log.us.nbytes + log.com.nbytes + log.contact_forces.nbytes
    assert written <= session.log_bytes <= 1.2 * written


def test_a_solve_that_breaks_leaves_no_folder(tmp_path: Path) -> None:
    def broken(now: Progress) -> None:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        solve_config(arm(), tmp_path, progress=broken)
    assert list(tmp_path.iterdir()) == []


def test_a_trajectory_that_is_not_finite_fails_with_a_reason() -> None:
    session = prepare_solve(arm("gate={converged: false, max_position_error_m: 1}"))
    session.scenario.problem.x0[0] = math.nan
    outcome = session.run(lambda now: None)
    assert outcome.status == "not_finite"
    assert outcome.verdict.outcome is Outcome.FAIL
    assert math.isnan(outcome.figures["position_error_m"])


def test_false_convergence_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A "solution" whose states are not those of the dynamics is found by measuring it."""
    from dataclasses import replace

    session = prepare_solve(arm("gate={converged: true}"))
    honest = session.solver.solve

    def lie(guess, callback):  # type: ignore[no-untyped-def]
        solution = honest(guess, callback=callback)
        xs = solution.xs.copy()
        xs[7, 0] += 1e-3
        return replace(solution, xs=xs)

    monkeypatch.setattr(session.solver, "solve", lie)
    outcome = session.run(lambda now: None)
    assert outcome.status == "converged"
    assert outcome.verdict.outcome is Outcome.FAIL
    assert "gaps of the dynamics reach" in outcome.verdict.reasons[0] and "computed anew" in outcome.verdict.reasons[0]


def test_multipliers_of_another_trajectory_are_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    session = prepare_solve(arm("gate={converged: true}"))
    honest = session.solver.solve

    def lie(guess, callback):  # type: ignore[no-untyped-def]
        solution = honest(guess, callback=callback)
        return replace(solution, costates=1.01 * solution.costates)

    assert session.run(lambda now: None).verdict.passed
    monkeypatch.setattr(session.solver, "solve", lie)
    outcome = session.run(lambda now: None)
    assert outcome.verdict.outcome is Outcome.FAIL
    assert "gradients of the Lagrangian reach" in outcome.verdict.reasons[0]
