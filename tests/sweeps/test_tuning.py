"""Keys, ranges and objectives of a tuning."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lgmpc.config import load_config
from lgmpc.errors import ConfigError, InputError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.design import value_at

pytest.importorskip("optuna")

from optuna.distributions import FloatDistribution, IntDistribution

from lgmpc.sweeps.study import _Search
from lgmpc.sweeps.tuning import Dimension, Score, parse_dimension, tuning_problem

CONFIG = load_config("solo12_balance")
LOGARITHMIC = FloatDistribution(1e-4, 1e-2, log=True)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("wbc.gains.com.kp", Dimension("wbc.gains.com.kp", 100.0, FloatDistribution(100.0 / 3.0, 300.0, log=True))),
        ("mpc.weights.com", Dimension("mpc.weights.com", (1e3, 1e3, 1e3), FloatDistribution(1.0 / 3.0, 3.0, log=True))),
        ("mpc.nodes", Dimension("mpc.nodes", 20, IntDistribution(7, 60, log=True))),
        ("mpc.nodes=10:30", Dimension("mpc.nodes", 20, IntDistribution(10, 30))),
        (
            "mpc.weights.force=1e-4:1e-2:log",
            Dimension("mpc.weights.force", 1e-3, LOGARITHMIC),
        ),
    ],
)
def test_a_key_has_a_range(text: str, expected: Dimension) -> None:
    assert parse_dimension(CONFIG, text) == expected


def test_choices_include_the_present_value() -> None:
    assert parse_dimension(CONFIG, "mpc.enabled=[false]").ends == (True, False)
    assert parse_dimension(CONFIG, "mpc.nodes=[10, 20, 30]").ends == (20, 10, 30)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mpc.node", "mpc.nodes"),
        ("mpc.model", "a number or a vector, or choices"),
        ("wbc.gains.com", "got a table; .* wbc.gains.com.kp"),
        ("mpc.enabled", r"or choices: KEY=\[A, B\]"),
        ("plant.joint_friction_nm", "no range, and the present value is 0"),
        ("mpc.nodes=10:20.5", "a range of whole numbers"),
        ("mpc.node_s=0.3:0.1", "LOW below HIGH"),
        ("wbc.weights.posture=0:1:log", "above zero"),
        ("mpc.node_s=0.1:0.2", "contains the present value, 0.02"),
        ("mpc.enabled=[true]", "a choice besides the present value"),
        ("mpc.enabled=[{a: 1}]", "choices that are words, numbers or truth values"),
    ],
)
def test_what_cannot_be_tuned_is_an_error_with_key_and_remedy(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_dimension(CONFIG, text)


def test_values_are_applied_and_vectors_scaled() -> None:
    problem = tuning_problem("solo12_balance", ["mpc.weights.com", "mpc.nodes", "mpc.enabled=[false]"], "passed")
    config = problem.apply(CONFIG, {"mpc.weights.com": 2.0, "mpc.nodes": 15, "mpc.enabled": False})
    assert value_at(config, "mpc.weights.com") == (2000.0, 2000.0, 2000.0)
    assert (config.mpc.nodes, config.mpc.enabled) == (15, False)
    assert problem.apply(CONFIG, problem.initial).model_dump() == CONFIG.model_dump()


def test_held_out_points_share_nothing_with_the_tuned_ones() -> None:
    problem = tuning_problem("solo12_balance", ["mpc.nodes"], "passed", overrides=["seed=5"], seeds=2)
    assert [point.config.seed for point in problem.tuned.points] == [5, 6]
    assert [point.config.seed for point in problem.held_out.points] == [7, 8]
    problem = tuning_problem("random_1000", ["mpc.nodes"], "passed", overrides=["samples.count=3"])
    tuned, held_out = problem.tuned.points, problem.held_out.points
    assert not {point.config.seed for point in tuned} & {point.config.seed for point in held_out}
    assert not {repr(point.levels) for point in tuned} & {repr(point.levels) for point in held_out}


def test_held_out_directions_are_between_the_tuned_ones() -> None:
    problem = tuning_problem("push_map", ["mpc.weights.force"], "boundary", overrides=["factors.0.count=4"])
    tuned, held_out = (
        {round(math.degrees(math.atan2(*point.config.pushes[0].impulse_ns[1::-1]))) % 360 for point in half.points}
        for half in (problem.tuned, problem.held_out)
    )
    assert (tuned, held_out) == ({0, 90, 180, 270}, {45, 135, 225, 315})


def test_the_best_config_is_the_base_without_factors_draws_and_variants() -> None:
    problem = tuning_problem("random_1000", ["mpc.weights.com"], "passed", overrides=["samples.count=2"])
    (base,) = problem.bases()
    drawn, shipped = problem.tuned.points[0].config, load_config("solo12_balance_inekf")
    assert (base.plant, base.seed, base.duration_s) == (shipped.plant, shipped.seed, drawn.duration_s)
    assert base.plant != drawn.plant


@pytest.mark.parametrize(
    ("source", "keys", "changes", "message"),
    [
        ("push_map", ["mpc.nodes", "mpc.nodes=10:30"], {}, "mpc.nodes: got the key twice"),
        ("push_map", ["mpc.enabled=[true]"], {}, "False, True at different points; .* one present value"),
        ("push_map", ["mpc.nodes"], {"seeds": 2}, "seeds: got 2; expected no seeds"),
    ],
)
def test_keys_without_one_present_value_are_an_error(
    source: str, keys: list[str], changes: dict[str, int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        tuning_problem(source, keys, "boundary", **changes)


def test_more_passes_count_before_better_values(row: Callable[..., Row]) -> None:
    tilt = tuning_problem("solo12_balance", ["mpc.nodes"], "max_tilt_deg", seeds=1)
    survived = replace(tilt, objective="survived_s")
    assert (tilt.maximized, survived.maximized, replace(tilt, objective="boundary").maximized) == (False, True, True)
    rows = [row("a", metrics={"max_tilt_deg": 2.0}), row("b", Ending.FAIL, metrics={"max_tilt_deg": 4.0})]
    assert tilt.score(rows) == Score(0.5, 3.0)
    ranked = [Score(1.0, 1.0), Score(1.0, 2.0), Score(1.0, math.nan), Score(0.5, 0.0), Score(0.5, 1.0)]
    assert sorted(reversed(ranked), key=tilt.rank, reverse=True) == ranked
    assert survived.rank(Score(1.0, 2.0)) > survived.rank(Score(1.0, 1.0)) > survived.rank(Score(1.0, math.nan))
    broken = tilt.score([row("a", Ending.RAISED)])
    assert broken.passed == 0.0 and math.isnan(broken.value)


@pytest.mark.parametrize(
    ("keys", "objective", "changes", "message"),
    [
        ([], "passed", {}, "keys: got nothing"),
        (["mpc.nodes"], "max_tilt", {}, "max_tilt_deg"),
        (["mpc.nodes"], "boundary", {}, "a metric of a run"),
        (["mpc.nodes"], "passed", {"seeds": 0}, "seeds: got 0"),
        (["mpc.nodes=1:40"], "passed", {}, "mpc.nodes: got 1"),
    ],
)
def test_a_problem_is_checked_before_it_runs(
    keys: list[str], objective: str, changes: dict[str, int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        tuning_problem("solo12_balance", keys, objective, **changes)


def test_a_sweep_that_bisects_is_tuned_by_its_boundary(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected boundary"):
        tuning_problem("push_map", ["mpc.nodes"], "max_tilt_deg")
    with pytest.raises(ConfigError):
        tuning_problem(tmp_path / "nothing.yaml", ["mpc.nodes"], "passed")


def test_a_trial_whose_report_was_cut_off_is_done_again(tmp_path: Path) -> None:
    """A kill between a trial's attributes, or before its state is written: it has no score, and is not counted."""
    problem = tuning_problem("solo12_balance", ["mpc.nodes"], "passed", seeds=1)
    trial = _Search(problem, tmp_path, 0, False).study.ask()
    trial.set_user_attr("passed", 1.0)
    search = _Search(problem, tmp_path, 0, True)
    assert (search.scored(), search.done) == ([], 0)
    asked = search.study.ask({each.key: each.distribution for each in problem.dimensions})
    assert asked.params == problem.initial
