"""Replay and figures of a run, from what running it returned or from its folder."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from documents import ARM
from matplotlib.figure import Figure

import lgmpc
from lgmpc import load_config, load_solve_config, plot, run_config, show, solve_config
from lgmpc.actions import ImpulseAction, PythonAction
from lgmpc.config.solving import solution_as_run
from lgmpc.costs import Parameter, ParameterLayout
from lgmpc.errors import InputError, RunFolderError
from lgmpc.state import StateMultibody
from lgmpc.viz import plots


def test_a_finished_run_and_its_folder_give_the_same_page(tmp_path: Path) -> None:
    run = run_config(load_config("solo12_stand", ["duration_s=0.1"]), tmp_path)
    page = show(run, tmp_path / "run.html")
    again = show(str(run.folder.path), str(tmp_path / "folder.html"))
    assert page is not None and again is not None
    assert page == tmp_path / "run.html"
    assert page.read_text(encoding="utf-8") == again.read_text(encoding="utf-8")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert run.show(tmp_path / "method.html") == tmp_path / "method.html"
    assert (tmp_path / "method.html").read_text(encoding="utf-8") == page.read_text(encoding="utf-8")


def test_a_runs_figures_are_matplotlibs_and_saved_where_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = ("base", "torques")  # all of them are drawn in tests/viz/test_plots.py
    monkeypatch.setattr(plots, "FIGURES", {name: plots.FIGURES[name] for name in some})
    run = run_config(load_config("solo12_stand", ["duration_s=0.1"]), tmp_path)
    figures = plot(run)
    assert isinstance(figures["torques"], Figure) and list(figures) == list(run.plot()) == list(some)
    files = figures.save(tmp_path / "drawn")
    assert files == tuple(tmp_path / "drawn" / f"{name}.png" for name in figures) and all(map(Path.is_file, files))
    assert not (run.folder.path / "figures").exists()


def test_a_solved_problem_is_shown_too(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    solved = solve_config(load_solve_config(tmp_path / "arm.yaml"), tmp_path)
    page = show(solved, tmp_path / "reach.html")
    assert page is not None and "arm \u00b7 lgmpc replay" in page.read_text(encoding="utf-8")
    assert solved.show(tmp_path / "again.html") is not None
    assert solved.robot.name == "double_pendulum" and solved.problem.nodes == len(solved.solution.us)
    assert solved.solution.status.solved and np.array_equal(solved.solution.xs, solved.outcome.log.xs)
    assert len(solved.solution.feedback) == solved.problem.nodes
    assert lgmpc.load_run(solved.folder.path.name, tmp_path).path == solved.folder.path
    assert {"joints", "controls"} <= set(solved.plot()) == set(plot(solved.folder.path))


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError):
        show(tmp_path, tmp_path / "page.html")
    assert list(tmp_path.iterdir()) == []


def test_solutions_of_ones_own_problem_are_shown_and_drawn_without_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")  # five nodes and few iterations: less than compiling takes
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    limits = {"effort_limit_nm": 1.8, "velocity_limit_rad_s": 30.0, "position_limit_rad": (-3.0, 3.0)}
    robot = lgmpc.load_robot(lgmpc.RobotSpec(model="solo12", contact_frames=feet, **limits))
    dynamics = lgmpc.ContactForwardDynamics(robot.model, feet)
    costs = [
        lgmpc.CostItem("posture", lgmpc.StateError(dynamics.state, robot.x_reference)),
        lgmpc.CostItem("effort", lgmpc.Control(12), 0.1),
    ]
    stand, land = lgmpc.MultibodyAction("stand", dynamics, costs), ImpulseAction("land", robot.model, feet, costs[:1])
    problem = lgmpc.ShootingProblem([stand, stand, land, stand, stand], terminal=stand)
    problem.set("duration", 0.02)
    problem.set("contact_flags", [1.0, 0.0, 0.0, 1.0], nodes=[0, 1])
    problem.set_initial_state(robot.x_reference)
    history = lgmpc.History()
    solution = lgmpc.Fddp(problem).solve(callback=history)
    log = solution_as_run(robot, solution, history)[1].log
    np.testing.assert_allclose(log.times, [0.0, 0.02, 0.04, 0.04, 0.06, 0.08])
    assert log.contact_flags.sum(axis=1).tolist() == [2, 2, 4, 4, 4]
    assert (np.abs(log.contact_forces).sum(axis=2) > 0.0).sum(axis=1).tolist() == [2, 2, 0, 4, 4]
    # Momentum: what the forces and the weight give the centre of mass in an interval.
    model, data = robot.model, robot.create_data()
    for k in (0, 3):
        ends = [(x[: robot.nq], x[robot.nq :]) for x in solution.xs[k : k + 2]]
        before, after = (pin.computeCentroidalMomentum(model, data, q, v).linear for q, v in ends)
        weight = robot.mass * np.array([0.0, 0.0, -9.81])
        np.testing.assert_allclose((after - before) / 0.02, log.contact_forces[k].sum(axis=0) + weight, atol=0.5)
    page = lgmpc.show_solution(robot, solution, tmp_path / "page.html")
    assert page is not None and "stand · lgmpc replay" in page.read_text(encoding="utf-8")
    figures = lgmpc.plot_solution(robot, solution, history=history)
    assert {"base", "joints", "controls", "forces", "convergence"} <= set(figures)
    arm = lgmpc.FreeForwardDynamics(pin.buildSampleModelManipulator())
    other = lgmpc.Fddp(lgmpc.ShootingProblem(lgmpc.MultibodyAction("arm", arm), 2)).solve(max_iterations=0)
    with pytest.raises(InputError, match="solution: got states with nx = 12; expected states of solo12, nx = 37"):
        lgmpc.show_solution(robot, other)


class Swing(PythonAction):
    """A pendulum under torques, whose interval is a parameter or a number of its own."""

    name, nu = "swing", 2

    def __init__(self, model: pin.Model, *parameters: Parameter) -> None:
        self.state, self.parameters = StateMultibody(model), ParameterLayout(*parameters)
        self._model, self._data = model, model.createData()

    def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        h = p[0] if p.size else 0.05
        v = x[2:] + h * pin.aba(self._model, self._data, x[:2], x[2:], u)
        return np.concatenate([x[:2] + h * v, v])

    def residual(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.concatenate([x[:2] - [1.0, 0.5], 0.1 * u])


def test_solutions_of_actions_of_python_are_shown_and_drawn(tmp_path: Path) -> None:
    limits = {"effort_limit_nm": 2.0, "velocity_limit_rad_s": 20.0, "position_limit_rad": (-3.0, 3.0)}
    robot = lgmpc.load_robot(lgmpc.RobotSpec(model="double_pendulum", **limits))

    def solved(*parameters: Parameter) -> lgmpc.Solution:
        problem = lgmpc.ShootingProblem(Swing(robot.model, *parameters), 6)
        problem.set_initial_state(robot.x_reference)
        return lgmpc.Fddp(problem).solve(max_iterations=2)

    timed = solved(Parameter("duration", 1, "length of the interval, s", 0.05))
    np.testing.assert_allclose(solution_as_run(robot, timed)[1].log.times, 0.05 * np.arange(7))
    page = lgmpc.show_solution(robot, timed, tmp_path / "swing.html")
    assert page is not None and "swing \u00b7 lgmpc replay" in page.read_text(encoding="utf-8")
    assert {"joints", "controls"} <= set(lgmpc.plot_solution(robot, timed))
    for make in (lgmpc.plot_solution, lgmpc.show_solution):
        with pytest.raises(InputError, match="solution: got intervals of no known length .'swing'.; expected actions"):
            make(robot, solved())
