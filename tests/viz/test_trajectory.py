"""Replays and figures of solved trajectories: made-up motions of an arm, a quadruped that hops, and a quadrotor."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from snapshot import snapshots

from lgmpc.chromium import find_chromium
from lgmpc.errors import InputError
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.runs import Outcome, SolvedRun, SolveResult, TrajectoryLog, Verdict
from lgmpc.viz.figure_files import Plots
from lgmpc.viz.overlay import Pictures
from lgmpc.viz.plots import plot_run, run_drawings
from lgmpc.viz.replay import replay_page

from .test_replay import content_of
from .test_scene import tracks

FIGURES = {"position_error_m": 1.5e-3, "effort_ratio": float("nan"), "iterations": 12.0}
TOOL = "panda_hand_tcp"


def run_of(robot: Robot, times: np.ndarray, q: list[np.ndarray], **changes: Any) -> SolvedRun:
    """A run along configurations at given times, with velocities by differences; controls of a tenth of the limit."""
    nodes, nc, nv = len(times), robot.nc, robot.nv
    step = np.diff(times)
    v = [pin.difference(robot.model, a, b) / max(dt, 1e-3) for a, b, dt in zip(q, q[1:], step, strict=False)]
    data = robot.create_data()
    values: dict[str, Any] = {
        "times": times,
        "xs": np.hstack([np.array(q), np.array([*v, np.zeros(nv)])]),
        "us": np.tile(0.1 * robot.effort_limit, (nodes - 1, 1)),
        "com": np.array([pin.centerOfMass(robot.model, data, each).copy() for each in q]),
        "contact_points": np.zeros((nodes, nc, 3)),
        "contact_flags": np.zeros((nodes - 1, nc), dtype=bool),
        "contact_forces": np.zeros((nodes - 1, nc, 3)),
        "contact_frames": np.array(robot.contact_frames, dtype=np.str_),
        "control_names": np.array(robot.joint_names, dtype=np.str_),
        "control_lower": -np.array(robot.effort_limit),
        "control_upper": np.array(robot.effort_limit),
        "waypoint_names": np.array([], dtype=np.str_),
        "waypoint_times": np.zeros(0),
        "waypoint_positions": np.zeros((0, 3)),
        "waypoint_rotations": np.zeros((0, 3, 3)),
        "iteration_cost": np.array([30.0, 2.0, 1.0]),
        "iteration_criterion": np.array([10.0, 1e-3, 1e-10]),
        "iteration_gap": np.array([1.0, 0.0, 0.0]),
        "iteration_step": np.array([0.5, 0.0, 1.0]),
        "iteration_regularization": np.zeros(3),
        "iteration_elapsed": np.array([0.1, 0.2, 0.3]),
        "control_unit": "N.m",
        "nq": robot.nq,
        "floating_base": robot.floating_base,
    }
    result = SolveResult("made_up", Verdict(Outcome.PASS), "fddp", "converged", "", FIGURES)
    return SolvedRun(Path("runs/made_up"), "name: made_up\n", TrajectoryLog(**values | changes), result)


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot(RobotSpec(model="panda"))


@pytest.fixture(scope="module")
def reach(panda: Robot) -> SolvedRun:
    """The arm lowers its second joint; its tool has a place with a rotation at the end."""
    times = np.linspace(0.0, 0.5, 6)
    q = [panda.q_reference + 0.4 * t * np.eye(9)[1] for t in times]
    data = panda.create_data()
    pin.framesForwardKinematics(panda.model, data, q[-1])
    place = data.oMf[panda.frame(TOOL)]
    return run_of(
        panda,
        times,
        q,
        waypoint_names=np.array([TOOL]),
        waypoint_times=np.array([0.5]),
        waypoint_positions=place.translation[None].copy(),
        waypoint_rotations=place.rotation[None].copy(),
    )


@pytest.fixture(scope="module")
def hop(solo12: Robot) -> SolvedRun:
    """Stance, take-off, an impact (two nodes at one time), stance; the second foot's force leaves its cone."""
    times = np.array([0.0, 0.1, 0.2, 0.2, 0.3])
    q = [solo12.q_reference + z * np.eye(19)[2] for z in (0.0, 0.0, 0.05, 0.05, 0.05)]
    flags = np.array([[True] * 4, [False] * 4, [False] * 4, [True] * 4])
    forces = np.where(flags[:, :, None], [0.0, 0.0, 6.0], 0.0)
    forces[:, 1, 0] = np.where(flags[:, 1], 5.0, 0.0)
    points = np.zeros((5, 4, 3))
    points[:, :, 0] = np.arange(4) * 0.1
    return run_of(solo12, times, q, contact_flags=flags, contact_forces=forces, contact_points=points, friction=0.6)


@pytest.fixture(scope="module")
def iris() -> Robot:
    return load_robot(RobotSpec(model="iris"))


@pytest.fixture(scope="module")
def flight(iris: Robot) -> SolvedRun:
    """A flip about y by 300 degrees in three steps, with the thrusts of four rotors."""
    times = np.linspace(0.0, 0.6, 4)
    q = []
    for angle in np.radians([0.0, 100.0, 200.0, 300.0]):
        turn = pin.Quaternion(pin.AngleAxis(float(angle), np.array([0.0, 1.0, 0.0])).toRotationMatrix())
        q.append(np.concatenate([[angle, 0.0, 0.5], turn.coeffs()]))
    rotors = np.array([f"iris__rotor_{i}" for i in range(4)])
    thrust = {"us": np.full((3, 4), 3.5), "control_names": rotors, "control_unit": "N"}
    return run_of(iris, times, q, **thrust, control_lower=np.zeros(4), control_upper=np.full(4, 7.0))


@pytest.fixture(scope="module")
def arm_page(panda: Robot, reach: SolvedRun) -> str:
    return replay_page(panda, reach)


def test_pictures_are_interpolated_on_the_manifold(iris: Robot, flight: SolvedRun) -> None:
    pictures = Pictures.of(iris, flight.log, rate_hz=20.0)
    np.testing.assert_allclose(np.linalg.norm(pictures.q[:, 3:7], axis=1), 1.0, atol=1e-12)
    # A constant rate of turning stays one, across half a turn too.
    steps = [pin.difference(iris.model, a, b)[3:] for a, b in zip(pictures.q, pictures.q[1:], strict=False)]
    np.testing.assert_allclose(steps, np.tile([0.0, np.radians(300.0) / 12.0, 0.0], (12, 1)), atol=1e-9)


def test_pictures_pass_the_nodes_and_behind_an_impact_comes_the_next_interval(solo12: Robot, hop: SolvedRun) -> None:
    pictures = Pictures.of(solo12, hop.log, rate_hz=20.0)
    np.testing.assert_allclose(pictures.times, [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3])
    assert pictures.intervals.tolist() == [0, 0, 1, 1, 3, 3, 3]
    np.testing.assert_allclose(pictures.q[[2, 3, 4], 2] - solo12.q_reference[2], [0.0, 0.025, 0.05], atol=1e-12)


def test_an_arms_page_has_its_place_and_its_tools_path(arm_page: str) -> None:
    content = content_of(arm_page)
    paths = [command["path"] for command in content["commands"] if command["type"] == "set_object"]
    assert "/overlay/places/000/x/shaft" in paths and "/overlay/path/0" in paths
    assert not [path for path in paths if "contact" in path or "forces" in path or "/com" in path]
    assert {entry["label"]: entry["note"] for entry in content["legend"] if "note" in entry} == {
        "places to reach": "",
        "path": TOOL,
    }
    assert [curve["label"] for curve in content["series"]["curves"]] == ["effort", "fastest joint"]
    assert content["series"]["curves"][0]["values"] == pytest.approx([10.0] * 51)
    assert content["series"]["curves"][1]["values"][0] == pytest.approx(0.4)
    assert content["marks"] == [0.5] and content["phases"] == [] and content["camera"]["follow"] == []
    assert ["position error", "1.5 mm"] in content["facts"]
    assert not [fact for fact in content["facts"] if fact[0] == "effort ratio"], "what was not measured is not shown"


def test_contacts_show_forces_and_cones_while_they_last(solo12: Robot, hop: SolvedRun) -> None:
    content = content_of(replay_page(solo12, hop))
    spans = {phase["name"]: phase["spans"] for phase in content["phases"]}
    assert spans["FL_FOOT"] == [[0.0, 0.1], [0.2, 0.3]]
    visible = tracks(content, "/overlay/cones/cones/FL_FOOT")[".visible"]
    assert visible["values"] == [True, False, True]
    assert visible["times"] == pytest.approx([0.0, 0.1, 0.2])
    # The second foot pushes sideways with 5 N of 6 N: out of a cone of 0.6.
    assert tracks(content, "/overlay/cones/slipping/FR_FOOT")[".visible"]["values"] == [True, False, True]
    assert [entry["note"] for entry in content["legend"] if entry["label"] == "friction cones"] == ["µ = 0.6"]


def test_a_quadrotors_page_has_thrusts_and_shows_it_above_the_floor(iris: Robot, flight: SolvedRun) -> None:
    content = content_of(replay_page(iris, flight))
    paths = [command["path"] for command in content["commands"] if command["type"] == "set_object"]
    assert [f"/overlay/thrusts/iris__rotor_{i}/shaft" for i in range(4)] == [p for p in paths if p.endswith("shaft")]
    assert [curve["label"] for curve in content["series"]["curves"]] == ["effort", "tilt"]
    assert max(content["series"]["curves"][1]["values"]) == pytest.approx(180.0, abs=6.0)
    low = replace(flight, log=replace(flight.log, xs=flight.log.xs - 4.0 * np.eye(13)[2]))
    lifted = content_of(replay_page(iris, low))
    (lift,) = [c["value"][2] for c in lifted["commands"] if c.get("path") == "/robot" and c["property"] == "position"]
    assert lift > 3.5, "below the floor nothing could be seen"


def test_what_cannot_be_shown_is_refused(panda: Robot, solo12: Robot, reach: SolvedRun) -> None:
    with pytest.raises(InputError, match=r"nq = 9; expected a run of solo12 \(nq = 19\)"):
        replay_page(solo12, reach)
    xs = reach.log.xs.copy()
    xs[2, 0] = np.nan
    broken = replace(reach, log=replace(reach.log, xs=xs))
    for show in (replay_page, plot_run):
        with pytest.raises(InputError, match="NaN or infinity"):
            show(panda, broken)


def test_the_figures_that_there_are_data_for_are_drawn(
    panda: Robot, solo12: Robot, iris: Robot, reach: SolvedRun, hop: SolvedRun, flight: SolvedRun, tmp_path: Path
) -> None:
    for robot, run, figures in (
        (panda, reach, ["joints", "controls", "convergence"]),
        (iris, flight, ["base", "controls", "convergence"]),
    ):
        assert [name for name, draw in run_drawings(robot, run).items() if draw(Figure())] == figures
    plots = plot_run(solo12, hop)
    assert list(plots) == ["base", "joints", "controls", "forces", "convergence"]
    for path in Plots({each: plots[each] for each in ("base", "forces", "convergence")}, "dog").save(tmp_path):
        image = imread(path)[..., :3]
        assert min(image.shape[:2]) > 300
        assert (np.ptp(image, axis=2) > 0.2).sum() > 300, f"{path.stem} has no coloured line"


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium")
def test_a_browser_shows_the_arm_moving_and_its_place(browser: Any, arm_page: str, tmp_path: Path) -> None:
    page = tmp_path / "arm.html"
    page.write_text(arm_page, encoding="utf-8")
    pngs = snapshots(browser, page, (0.0, 0.5), size=(640, 480), panels=False)
    first, last = (np.round(255.0 * imread(BytesIO(png))[..., :3]).astype(int) for png in pngs)
    moved = np.abs(first - last).max(axis=2) > 40
    assert 500 < moved.sum() < 0.5 * moved.size
    red, green, blue = np.moveaxis(first, 2, 0)
    assert ((red > 120) & (green < 90) & (blue < 90)).sum() > 20, "the place's x axis"
    assert ((blue > 120) & (red < 90) & (green < 140)).sum() > 20, "the place's z axis"
