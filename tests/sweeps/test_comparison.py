"""Two runs, and two sweeps, side by side."""

import json
import re
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from documents import ARM

from lgmpc.config import load_config
from lgmpc.config.execution import run_config, solve_config
from lgmpc.config.loading import parse_solve_config
from lgmpc.errors import InputError, RunFolderError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.comparison import compare_folders
from lgmpc.sweeps.folder import SweepFolder

from .conftest import Parse

Save = Callable[..., Path]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A robot that stands, one with three times the mass, and the first one with another margin to its gate."""
    out = tmp_path_factory.mktemp("runs")
    config = load_config("solo12_stand", ["duration_s=0.1", "mpc.enabled=false", "gate={max_com_error_m: 0.1}"])
    changes = {"same": {}, "again": {}, "heavy": {"plant.mass_scale": 3.0}, "strict": {"gate.max_com_error_m": 1e-9}}
    return {name: run_config(config.replace(change), out).folder.path for name, change in changes.items()}


def test_the_same_run_is_not_worse_and_differs_in_nothing(runs: dict[str, Path]) -> None:
    found = compare_folders(runs["same"], runs["again"], margin=0.0)
    assert (found.worse, found.differences, found.reasons) == (False, (), ())
    judged = {each.name: each for each in found.quantities if each.worsening is not None}
    gate = load_config(runs["same"] / "config.yaml").gate
    assert "max_com_error_m" in gate.limits
    assert set(judged) == set(gate.limits)
    assert all(each.worsening == 0.0 for each in judged.values())


def test_what_the_gate_limits_is_judged_relative_to_the_limit(runs: dict[str, Path]) -> None:
    found = compare_folders(runs["same"], runs["heavy"], margin=0.001)
    assert [(each.key, each.first, each.second) for each in found.differences] == [("plant.mass_scale", 1.0, 3.0)]
    error = next(each for each in found.quantities if each.name == "max_com_error_m")
    assert error.first is not None and error.second is not None and error.worsening is not None
    assert error.limit == 0.1
    (reason,) = (each for each in found.reasons if each.startswith("max_com_error_m"))
    assert reason.endswith(f"worse by {100.0 * error.worsening:.3g} % of the limit of 0.1")
    assert error.worsening == pytest.approx((error.second - error.first) / 0.1)
    assert error.worse and any(reason.startswith("max_com_error_m: ") for reason in found.reasons)
    assert not compare_folders(runs["heavy"], runs["same"], margin=0.0).worse
    # A margin wider than the change: worse by nothing that counts.
    assert not compare_folders(runs["same"], runs["heavy"], margin=1.01 * max(1.0, error.worsening)).worse


def test_a_run_that_fails_where_the_other_passed_is_worse(runs: dict[str, Path]) -> None:
    found = compare_folders(runs["same"], runs["strict"])
    assert found.reasons[0].startswith("only the first passed: largest error of the centre of mass")
    assert json.loads(json.dumps(found.content(), allow_nan=False))["worse"] is True


def test_a_metric_is_judged_on_request(runs: dict[str, Path]) -> None:
    found = compare_folders(runs["same"], runs["heavy"], margin=0.1, metrics=["max_abs_torque_nm"])
    assert any(re.fullmatch(r"max_abs_torque_nm: .*, worse by .* % of A's", reason) for reason in found.reasons)
    with pytest.raises(InputError, match="Did you mean max_abs_torque_nm"):
        compare_folders(runs["same"], runs["heavy"], metrics=["max_abs_torqe_nm"])


@pytest.fixture
def save(tmp_path: Path, parse: Parse) -> Save:
    """Save a sweep over thirty seeds, with the ending and the metric of each."""

    def make(name: str, passes: Callable[[int], bool], tilt: Callable[[int], float], text: str = "") -> Path:
        sweep = parse("samples: {count: 30, keys: [{key: plant.friction, kind: uniform, range: [0.5, 0.9]}]}\n" + text)
        with closing(SweepFolder.open(tmp_path / name, sweep, resume=False)) as folder:
            for i, point in enumerate(sweep.points):
                ending, metrics = Ending.PASS if passes(i) else Ending.FAIL, {"max_tilt_deg": tilt(i)}
                folder.append(Row(point.key, ending, metrics=metrics, base=point.base, levels=point.levels, draw=i))
        return folder.path

    return make


def test_sweeps_are_compared_in_pairs(save: Save) -> None:
    before = save("before", lambda i: i < 28, lambda i: 10.0 * i)
    # A tenth of a degree more in each pair: nothing beside the spread of the points, but sure in pairs.
    after = save("after", lambda i: i < 27, lambda i: 10.0 * i + 0.1)
    found = compare_folders(before, after, margin=0.0, metrics=["max_tilt_deg"])
    tilt = next(each for each in found.quantities if each.name == "max_tilt_deg")
    assert tilt.difference is not None
    assert (tilt.difference.value, tilt.difference.low, tilt.difference.high) == pytest.approx((0.1, 0.1, 0.1))
    assert [reason.partition(":")[0] for reason in found.reasons] == ["max_tilt_deg"]
    passed = next(each for each in found.quantities if each.name == "passed")
    assert passed.worsening == pytest.approx(1 / 28)
    assert not passed.worse  # one of thirty is chance
    assert not compare_folders(before, after, margin=0.01, metrics=["max_tilt_deg"]).worse


def test_a_share_that_drops_beyond_chance_is_worse(save: Save) -> None:
    before, after = save("a", lambda i: True, float), save("b", lambda i: i % 2 == 0, float)
    found = compare_folders(before, after)
    assert [reason.partition(":")[0] for reason in found.reasons] == ["passed"]
    assert not compare_folders(after, before).worse


def test_a_solved_problem_is_compared_with_its_like_only(
    runs: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    solved = solve_config(parse_solve_config(ARM), tmp_path).folder.path
    with pytest.raises(InputError, match="B: got the run of a closed loop .*; expected a solved problem, as A is"):
        compare_folders(solved, runs["same"])
    with pytest.raises(InputError, match="B: got a solved problem .*; expected the run of a closed loop, as A is"):
        compare_folders(runs["same"], solved)
    assert not compare_folders(solved, solved).worse


def test_what_cannot_be_compared_is_refused(save: Save, runs: dict[str, Path], tmp_path: Path, parse: Parse) -> None:
    sweep = save("a", lambda i: True, float)
    with pytest.raises(InputError, match="B: got the run of a closed loop .*; expected a sweep, as A is"):
        compare_folders(sweep, runs["same"])
    with pytest.raises(InputError, match="margin: got -0.1"):
        compare_folders(sweep, sweep, margin=-0.1)
    empty = SweepFolder.open(tmp_path / "empty", parse("variants: {a: {}, b: {seed: 1}}"), resume=False)
    empty.close()
    with pytest.raises(RunFolderError, match="no finished point in common"):
        compare_folders(sweep, empty.path)
    with pytest.raises(RunFolderError, match="does not exist"):
        compare_folders(tmp_path / "none", runs["same"])


def test_a_worsening_is_told_as_a_ratio_and_as_a_share_of_the_limit(runs: dict[str, Path]) -> None:
    found = compare_folders(runs["same"], runs["heavy"], margin=1e-4)
    error = next(each for each in found.quantities if each.name == "max_com_error_m")
    assert error.first and error.second and error.worsening
    (reason,) = [each for each in found.reasons if each.startswith("max_com_error_m: ")]
    ratio, share = error.second / error.first, 100.0 * error.worsening
    assert reason.endswith(
        f" became {error.second:.4g}, {ratio:.3g} times as much, worse by {share:.3g} % of the limit of 0.1"
    )
