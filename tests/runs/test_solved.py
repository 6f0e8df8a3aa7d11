"""Folders of solved problems: written and read back, distinguished from closed loops, judged by bounds."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.errors import RunFolderError
from lgmpc.runs import Outcome, RunFolder, RunResult, SolveResult, TrajectoryLog, Verdict, judge_figures, load_run
from lgmpc.runs.figures import figure_number, figure_words, unknown_bounds


def trajectory(**changes: Any) -> TrajectoryLog:
    """Three intervals, the second of them an impact, of a robot with two feet and one place to reach."""
    values: dict[str, Any] = {
        "times": np.array([0.0, 0.1, 0.1, 0.2]),
        "xs": np.arange(20.0).reshape(4, 5),
        "us": np.ones((3, 2)),
        "com": np.zeros((4, 3)),
        "contact_points": np.zeros((4, 2, 3)),
        "contact_flags": np.array([[True, False], [True, True], [False, False]]),
        "contact_forces": np.zeros((3, 2, 3)),
        "contact_frames": np.array(["left", "right"]),
        "control_names": np.array(["hip", "knee"]),
        "control_lower": -np.ones(2),
        "control_upper": np.ones(2),
        "waypoint_names": np.array(["hand"]),
        "waypoint_times": np.array([0.2]),
        "waypoint_positions": np.zeros((1, 3)),
        "waypoint_rotations": np.full((1, 3, 3), np.nan),
        **{f"iteration_{name}": np.ones(4) for name in ("cost", "criterion", "gap", "step", "regularization")},
        "iteration_elapsed": np.arange(4.0),
        "control_unit": "N.m",
        "nq": 3,
        "floating_base": False,
    }
    return TrajectoryLog(**values | changes)


@pytest.fixture
def result() -> SolveResult:
    figures = {"cost": 1.5, "effort_ratio": math.nan}
    return SolveResult("arm", Verdict(Outcome.FAIL, ("too slow",)), "sqp", "converged", "fine", figures)


@pytest.fixture
def folder(tmp_path: Path, result: SolveResult) -> RunFolder:
    folder = RunFolder.create(tmp_path, "arm")
    folder.write_config("name: arm\n")
    folder.write_arrays(trajectory())
    folder.write_result(result)
    return folder


def test_a_written_folder_is_read_back(folder: RunFolder, result: SolveResult) -> None:
    run = load_run(folder.path)
    for name, array in trajectory().arrays().items():
        np.testing.assert_array_equal(getattr(run.log, name), array, err_msg=name)
    assert run.config == "name: arm\n"
    assert replace(run.result, figures={}) == replace(result, figures={})
    assert run.result.figures["cost"] == 1.5 and math.isnan(run.result.figures["effort_ratio"])


def test_the_file_contains_its_kind_and_null_for_missing_figures(folder: RunFolder) -> None:
    content = json.loads((folder.path / "run.json").read_text(encoding="utf-8"))
    assert (content["schema"], content["kind"], content["verdict"]) == (1, "solve", "fail")
    assert content["figures"] == {"cost": 1.5, "effort_ratio": None}


def test_each_kind_is_distinguished_from_the_other(folder: RunFolder, result: SolveResult) -> None:
    assert load_run(folder.path).result.kind == "solve"
    with pytest.raises(RunFolderError, match="of a solved problem, not of a closed loop"):
        RunFolder.load(folder.path)
    with pytest.raises(RunFolderError, match="of a closed loop, not of a solved problem"):
        SolveResult.from_json(RunResult("x", result.verdict, None).to_json())
    with pytest.raises(RunFolderError, match="kind unknown here"):
        RunResult.from_json(result.to_json().replace('"solve"', '"tune"', 1))


def test_an_incomplete_folder_is_reported(folder: RunFolder) -> None:
    (folder.path / "trajectory.npz").unlink()
    with pytest.raises(RunFolderError, match=r"no complete run folder|not a complete run folder"):
        load_run(folder.path)


def test_a_truncated_trajectory_is_damaged(folder: RunFolder) -> None:
    path = folder.path / "trajectory.npz"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RunFolderError, match=r"trajectory\.npz is damaged"):
        load_run(folder.path)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"us": np.ones((2, 2))}, "'contact_flags' has shape"),
        ({"xs": np.ones(4)}, "'xs' has 1 axes"),
        ({"us": np.ones((3, 1))}, "'control_names' has shape"),
        ({"contact_flags": np.zeros((3, 2))}, "'contact_flags' holds float64"),
        ({"contact_frames": np.array([1.0, 2.0])}, "'contact_frames' holds"),
        ({"times": np.array([0.0, 0.2, 0.1, 0.3])}, "'times' decreases"),
        ({"times": np.array([0.0, np.nan, 0.1, 0.3])}, "'times' decreases"),
        ({"nq": 6}, "nq = 6 does not fit"),
        ({"floating_base": True}, "nq = 3 does not fit"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(RunFolderError, match=expected.replace("(", r"\(")):
        trajectory(**changes)


def test_missing_arrays_are_named() -> None:
    arrays = trajectory().arrays()
    del arrays["us"], arrays["nq"]
    with pytest.raises(RunFolderError, match="log lacks us, nq"):
        TrajectoryLog.from_arrays(arrays)


def test_the_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        trajectory().xs[0, 0] = 1.0


def test_bounds_hold_on_their_side_and_nan_breaks_them() -> None:
    figures = {"gap_m": 2e-3, "share": math.nan}
    assert judge_figures(figures, {"max_gap_m": 2e-3, "min_gap_m": 2e-3}) == ()
    over, under = judge_figures(figures, {"max_gap_m": 1e-3, "min_gap_m": 0.5})
    assert over == "gap 2 mm, allowed at most 1 mm (max_gap_m)"
    assert under == "gap 2 mm, allowed at least 500 mm (min_gap_m)"
    assert judge_figures(figures, {"max_share": 1.0}) == ("max_share was not measured, but the gate limits it to 1",)
    # So close that three digits would be equal.
    (close,) = judge_figures({"gap_m": 1.00001e-3}, {"max_gap_m": 1e-3})
    assert close == "gap 1.00001 mm, allowed at most 1 mm (max_gap_m)"


def test_unknown_bounds_are_found() -> None:
    assert unknown_bounds(["max_gap_m", "min_gap_m", "max_gap"], ["gap_m"]) == ["max_gap"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("com_rms_error_m", ("CoM RMS error", "mm", 1e3)),
        ("final_joint_velocity_rad_s", ("final joint velocity", "rad/s", 1.0)),
        ("speed_m_s", ("speed", "m/s", 1.0)),
        ("solve_ms", ("solve", "ms", 1.0)),
        ("iterations", ("iterations", "", 1.0)),
        ("mpc_ms.p50", ("MPC p50", "ms", 1.0)),
        ("estimator.max_tilt_deg", ("estimator max tilt", "deg", 1.0)),
        ("walking.steps", ("steps", "", 1.0)),
    ],
)
def test_names_are_shown_with_their_units(name: str, expected: tuple[str, str, float]) -> None:
    assert figure_words(name) == expected


@pytest.mark.parametrize(
    ("value", "unit", "limit", "text"),
    [
        (0.0616, "deg", None, "0.0616"),
        (2.77e-5, "deg", None, "< 0.001"),
        (-2.77e-5, "deg", 1.0, "> -0.001"),
        (2.77e-5, "rad/s", 1e-3, "2.8e-05"),
        (2.8e-17, "rad", 0.0, "2.8e-17"),
        (7.15e-5, "", None, "7.2e-05"),
        (18506.9, "", None, "18507"),
        (0.0, "mm", None, "0"),
        (math.nan, "mm", 1.0, "-"),
    ],
)
def test_figures_are_formatted_for_reading(value: float, unit: str, limit: float | None, text: str) -> None:
    assert figure_number(value, unit, limit) == text
