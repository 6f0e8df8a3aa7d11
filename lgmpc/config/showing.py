"""Replay, figures, explanation and report of a saved run."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from lgmpc.config.loading import parse_any_config
from lgmpc.config.robots import build_any_robot, joint_limits
from lgmpc.config.session import Saved
from lgmpc.config.solving import solution_as_run
from lgmpc.errors import InputError
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Run, SolvedRun, TrajectoryLog, load_run
from lgmpc.runs.figures import figure_of
from lgmpc.runs.folder import CONFIG_FILE
from lgmpc.runs.forensics import Explanation, explain_run
from lgmpc.runs.limited import Nearest, figure_margin
from lgmpc.solvers import History, Solution
from lgmpc.viz import Plots, embed_page, in_notebook, open_page, plot_run, replay_page, run_report, write_page
from lgmpc.viz.film import FILM_KINDS, write_film
from lgmpc.viz.recordings import write_mcap, write_rrd
from lgmpc.world import World, make_world

AnyRun: TypeAlias = str | Path | Saved
"""A run folder, ``latest``, or the value of :func:`run_config` or :func:`solve_config`."""


def show(run: AnyRun, html: str | Path | None = None) -> Path | None:
    """Replay a run: embedded in a notebook, else as ``replay.html`` in its folder, which the browser opens.

    Args:
        run: the value of :func:`run_config` or :func:`solve_config`, or a run folder, or ``latest``.
        html: another file for the page, which is self-contained; nothing is displayed.

    Returns:
        The file; ``None`` in a notebook.

    Raises:
        RunFolderError: if the folder is not a complete run, or the page cannot be written.
        InputError: if the run has nothing to show.
    """
    loaded = _load(run)
    return _display(_replay(loaded), html, loaded.path / "replay.html")


def _replay(run: Run | SolvedRun) -> str:
    return replay_page(_robot_of(run), run, _ground_of(run))


def export(run: AnyRun, file: str | Path, table: str | None = None) -> Path:
    """Write a run for other tools, in the format that the file's suffix names.

    Args:
        run: see :func:`show`.
        file: .csv or .parquet, a table of the channels; .mcap for Foxglove or .rrd for rerun, of closed loops; .mp4 or
            .gif, a film of the replay in real time.
        table: of .csv and .parquet; see :meth:`lgmpc.runs.Run.to_pandas`.

    Returns:
        The file.

    Raises:
        RunFolderError: if the folder is not a complete run, or the file cannot be written.
        InputError: for another suffix or table, for a solve as .mcap or .rrd, or if the run has no finite tick.
        MissingDependencyError: if the format's package is not installed, or for a film no ffmpeg or Chromium.
    """
    loaded, path = _load(run), Path(file)
    if path.suffix in (".csv", ".parquet"):
        return loaded.to_csv(path, table) if path.suffix == ".csv" else loaded.to_parquet(path, table)
    if path.suffix in FILM_KINDS and table is None:
        times = loaded.log.time if isinstance(loaded, Run) else loaded.log.times
        write_film(_replay(loaded), path, float(times[-1] - times[0]))
        return path
    if path.suffix not in (".mcap", ".rrd", *FILM_KINDS):
        raise InputError("file", path.name, "one that ends in .csv, .parquet, .mcap, .rrd, .mp4 or .gif")
    if table is not None or isinstance(loaded, SolvedRun):
        got = f"{path.name} of {loaded.path.name}" if table is None else f"{table} for {path.name}"
        raise InputError(
            "table" if table else "file", got, f"{path.suffix} of all of a closed loop, or .csv or .parquet"
        )
    write = write_mcap if path.suffix == ".mcap" else write_rrd
    write(path, _robot_of(loaded), loaded, _ground_of(loaded))
    return path


def show_solution(
    scenario: Scenario | Robot, solution: Solution, html: str | Path | None = None, *, history: History | None = None
) -> Path | None:
    """Replay a solution of a user-defined problem, which no config describes: as :func:`show` does, or ``<name>.html``.

    Args:
        scenario: the problem, its robot, and the contacts, forces and targets to display. Or the robot alone: times
            and contacts are then those of the problem's parameters.
        solution: its solution, converged or not.
        html: see :func:`show`.
        history: the solver's reports.

    Returns:
        The file; ``None`` in a notebook.

    Raises:
        RunFolderError: if the page cannot be written.
        InputError: if the trajectory is not finite or of another robot, or its intervals have no known length.
    """
    robot, run = solution_as_run(scenario, solution, history)
    return _display(replay_page(robot, run), html, Path(f"{run.result.name}.html"))


def plot_solution(scenario: Scenario | Robot, solution: Solution, *, history: History | None = None) -> Plots:
    """Draw the figures of a solution of a user-defined problem; see :func:`plot`.

    Args:
        scenario: see :func:`show_solution`.
        solution: its solution, converged or not.
        history: the solver's reports, for the figure of the convergence.

    Raises:
        InputError: if the trajectory is not finite or of another robot.
    """
    robot, run = solution_as_run(scenario, solution, history)
    return plot_run(robot, run)


def _display(page: str, html: str | Path | None, default: Path) -> Path | None:
    """Write a page to a file, embed it in a notebook, or open it in the browser."""
    if html is not None:
        return write_page(page, html)
    if in_notebook():
        embed_page(page)
        return None
    file = write_page(page, default)
    open_page(file)
    return file


def plot(run: AnyRun) -> Plots:
    """Draw the figures of a run: motion, forces, torques, timings.

    Args:
        run: the value of :func:`run_config` or :func:`solve_config`, or a run folder, or ``latest``.

    Returns:
        Figures of matplotlib by name. A notebook displays them; ``save(folder)`` writes PNG files.

    Raises:
        RunFolderError: if the folder is not a complete run.
        InputError: if the run has nothing to draw.
    """
    loaded = _load(run)
    return plot_run(_robot_of(loaded), loaded)


def explain(run: AnyRun) -> Explanation:
    """Find the events that led to the failure of a closed loop, or the course and end of a solve.

    Args:
        run: the value of :func:`run_config` or :func:`solve_config`, or a run folder, or ``latest``.

    Raises:
        RunFolderError: if the folder is not a complete run.
        InputError: if the run has fewer than two ticks with a finite state.
    """
    loaded = _load(run)
    return _explained(loaded, _robot_of(loaded))


def _explained_solve(run: SolvedRun) -> Explanation:
    result, log = run.result, run.log
    count = len(log.iteration_cost)
    ended = f"{result.method} ended as {result.status.replace('_', ' ')} after {count} iterations"
    summary = [ended]
    if count:
        cost, criterion = log.iteration_cost, log.iteration_criterion
        summary.append(
            f"cost from {cost[0]:.4g} to {cost[-1]:.4g}; criterion of convergence from {criterion[0]:.1e} to"
            f" {criterion[-1]:.1e}; gaps of the dynamics from {log.iteration_gap[0]:.1e} to {log.iteration_gap[-1]:.1e}"
        )
        rejected = np.count_nonzero(log.iteration_step == 0.0)
        if rejected:
            summary.append(f"no step was accepted in {rejected} of the iterations")
    summary += result.explanation.splitlines()
    limits = _config_of(run).gate.limits
    nearest = [figure_margin(key, result.figures[figure_of(key)], limit) for key, limit in limits.items()]
    nearest = sorted((*nearest, *_controls(log)), key=lambda each: -each.used)
    return Explanation(result.name, result.verdict.outcome, result.verdict.reasons, tuple(summary), tuple(nearest))


def _controls(log: TrajectoryLog) -> Iterator[Nearest]:
    """Yield the smallest margin of each control with a limit."""
    limits = np.where(log.us < 0.0, log.control_lower, log.control_upper)
    used = np.divide(log.us, limits, out=np.zeros_like(log.us), where=limits != 0.0)
    for i, name in enumerate(log.control_names):
        k = int(np.argmax(used[:, i]))
        value, limit = float(log.us[k, i]), float(limits[k, i])
        if np.isfinite(limit):
            margin = abs(limit) - abs(value)
            yield Nearest(
                "control", str(name), float(log.times[k]), value, log.control_unit, limit, margin, float(used[k, i])
            )


def report(run: AnyRun, html: str | Path | None = None) -> Path:
    """Write a report of a run: one self-contained page with verdict, events, figures, replay, config and versions.

    Args:
        run: the value of :func:`run_config` or :func:`solve_config`, or a run folder, or ``latest``.
        html: the file; ``report.html`` in the run's own folder unless given.

    Returns:
        The file.

    Raises:
        RunFolderError: if the folder is not a complete run, or the page cannot be written.
        InputError: if the run has nothing to show.
    """
    loaded = _load(run)
    robot, limits = _robot_of(loaded), _config_of(loaded).gate.limits
    page = run_report(robot, loaded, limits, _explained(loaded, robot), _ground_of(loaded))
    return write_page(page, html or loaded.path / "report.html")


def _explained(run: Run | SolvedRun, robot: Robot) -> Explanation:
    if isinstance(run, SolvedRun):
        return _explained_solve(run)
    config = _config_of(run)
    return explain_run(run, config.gate, joint_limits(robot, config.plant.actuators))


def _ground_of(run: Run | SolvedRun) -> World:
    config = _config_of(run)
    return World() if isinstance(run, SolvedRun) else make_world(config.world, config.plant.friction)


def _config_of(run: Run | SolvedRun) -> Any:
    """Return the config of a run: of a closed loop, or of a problem to solve."""
    return parse_any_config(run.config, name=str(run.path / CONFIG_FILE), folder=run.path)


def _load(run: AnyRun) -> Run | SolvedRun:
    place: Any = getattr(getattr(run, "folder", None), "path", run)
    return load_run(place)


def _robot_of(run: Run | SolvedRun) -> Robot:
    return build_any_robot(_config_of(run))
