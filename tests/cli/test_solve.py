"""``lgmpc solve``: exit codes, what it prints, the folder, and Ctrl-C."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from documents import ARM

from lgmpc.config import load_solve_config
from lgmpc.runs import load_run

from .conftest import STAND, Invoke, Result, Start


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.yaml"
    path.write_text(ARM, encoding="utf-8")
    return path


def test_a_solution_within_its_gate_exits_with_0_and_can_be_repeated(
    result: Result, invoke: Invoke, arm: Path, tmp_path: Path
) -> None:
    finished = result("solve", arm)
    assert (finished.returncode, "PASS  arm" in finished.stdout) == (0, True), finished.stderr
    assert "position error / mm" in finished.stdout and "iterations" in finished.stdout
    for heading in ("iteration", "cost", "reduction", "gap", "step", "regularis."):
        assert heading in finished.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert f"lgmpc play runs/{folder.name}" in finished.stdout
    assert sorted(path.name for path in folder.iterdir()) == ["config.yaml", "run.json", "trajectory.npz"]
    code, output = invoke("solve", folder / "config.yaml", "--json", "--out", tmp_path / "again")
    content = json.loads(output[output.index("{") :])
    assert (code, content["verdict"], content["kind"]) == (0, "pass", "solve")
    first, second = load_run(folder), load_run(content["folder"])
    assert first.log.xs.tobytes() == second.log.xs.tobytes(), "not the same bits"


def test_a_solve_that_does_not_converge_exits_with_1_and_explains_itself(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("solve", arm, "--out", arm.parent / "runs", "--set", "solver.max_iterations=1")
    assert code == 1
    assert "FAIL  arm" in output and "not converged: iteration limit after 1 iteration" in output
    assert "stationarity: largest gradient" in output


def test_a_broken_bound_exits_with_1(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("solve", arm, "--out", arm.parent / "runs", "--set", "gate.max_iterations=1")
    assert code == 1
    assert "broken" in output and "allowed at most 1 (max_iterations)" in output


def test_quiet_is_quiet(invoke: Invoke, arm: Path) -> None:
    assert invoke("solve", arm, "--out", arm.parent / "runs", "--quiet") == (0, "PASS  arm\n")


def test_overrides_reach_the_resolved_config(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("solve", arm, "--out", arm.parent / "runs", "--set", "solver.method=sqp", "problem.nodes=10")
    assert code in (0, 1), output
    (folder,) = (arm.parent / "runs").iterdir()
    config = load_solve_config(folder / "config.yaml")
    assert (config.solver.method, config.problem.nodes) == ("sqp", 10)
    assert len(load_run(folder).log.us) == 10


def test_the_wrong_command_names_the_right_one(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("run", arm)
    assert code == 2 and f"To solve this: lgmpc solve {arm}" in output
    code, output = invoke("solve", STAND)
    assert code == 2 and f"To simulate this: lgmpc run {STAND}" in output


def test_bad_input_exits_with_2_and_leaves_no_folder(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("solve", arm, "--out", arm.parent / "runs", "--set", "gate.max_position_eror_m=1")
    assert code == 2 and "Did you mean gate.max_position_error_m" in output
    assert not list((arm.parent / "runs").glob("*"))


def test_check_shows_the_problem_and_its_figures(invoke: Invoke, arm: Path) -> None:
    code, output = invoke("check", arm)
    assert code == 0, output
    for words in ("reach: 20 intervals, 0.4 s", "link2 at", "box_fddp", "position_error_m", "OK"):
        assert words in output


def test_a_solved_run_is_plotted_and_played(invoke: Invoke, arm: Path) -> None:
    runs = arm.parent / "runs"
    assert invoke("solve", arm, "--out", runs, "--quiet")[0] == 0
    code, output = invoke("plot", "latest", "--runs", runs, "--out", arm.parent / "figures")
    assert code == 0, output
    assert sorted(path.stem for path in (arm.parent / "figures").iterdir()) == ["controls", "convergence", "joints"]
    code, output = invoke("play", "latest", "--runs", runs, "--html", arm.parent / "arm.html")
    assert code == 0 and "open it in any browser" in output
    assert (arm.parent / "arm.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_ctrl_c_saves_the_iterate_and_exits_with_130(start: Start, arm: Path, tmp_path: Path) -> None:
    # A tolerance that it hardly reaches, at some 20 ms an iteration.
    long = ("problem.nodes=1000", "problem.node_s=4e-4", "solver={method: box_fddp, tolerance: 1e-300}", "gate={}")
    with start("solve", arm, "--set", *long, "solver.max_iterations=100000") as process:
        assert process.stderr is not None and process.stdout is not None
        while "reduction" not in (line := process.stderr.readline()):
            assert line, "the solve ended before it began"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
        output, errors = process.stdout.read(), process.stderr.read()
    assert "INTERRUPTED  arm" in output
    assert "Traceback" not in output + errors
    (folder,) = (tmp_path / "runs").iterdir()
    run = load_run(folder)
    assert run.result.verdict.outcome.value == "interrupted"
    assert np.isfinite(run.log.xs).all() and len(run.log.iteration_cost) > 0
