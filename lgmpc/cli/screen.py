"""What the command line prints. Results go to stdout; progress, notes and errors to stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lgmpc.errors import ConfigError, LgmpcError, ModelError, RunFolderError

if TYPE_CHECKING:
    from lgmpc.config import Config, SolveConfig
    from lgmpc.config.execution import FinishedRun
    from lgmpc.problems import Scenario
    from lgmpc.robot import Robot
    from lgmpc.runs import Gate, Metrics, Verdict

__all__ = [
    "figure_name",
    "figure_number",
    "err",
    "has_desktop",
    "out",
    "show_checked",
    "show_crash",
    "show_error",
    "show_checked_problem",
    "show_finished",
    "show_interrupted",
    "show_next",
    "show_verdict",
]

MOST_PROBLEMS = 10
"""How many problems of one config are shown: a screen's worth."""

MOST_CHARACTERS = 1500
"""How many characters all problems of one config may take together: a screen's worth too."""

ISSUES_URL = "the project's issue tracker"


def out() -> Console:
    """Return the console for results (made anew, so that tests and pipes see the current stdout)."""
    return Console(highlight=False, soft_wrap=True)


def err() -> Console:
    """Return the console for progress, notes and errors."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def has_desktop() -> bool:
    """Return whether a browser window can be expected to open here."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def show_error(error: LgmpcError) -> None:
    """Print what the user did wrong and, where it helps, what to do next."""
    console = err()
    head, problems = _parts(error)
    console.print(Text.assemble(("error: ", "bold red"), head))
    for problem in problems[:MOST_PROBLEMS]:
        console.print(Text(f"  - {_shorten(problem, MOST_CHARACTERS // min(len(problems), MOST_PROBLEMS))}"))
    if len(problems) > MOST_PROBLEMS:
        console.print(f"  ... and {len(problems) - MOST_PROBLEMS} more")
    if isinstance(error, RunFolderError) and "does not exist" in str(error):
        console.print("hint: `latest` means the newest run in runs/", style="dim")


def _parts(error: LgmpcError) -> tuple[str, list[str]]:
    """Return a headline and, if there are several problems, all of them."""
    if isinstance(error, ModelError):
        return f"robot '{error.robot}' cannot be used", list(error.problems)
    if isinstance(error, ConfigError) and len(error.problems) > 1:
        return f"{len(error.problems)} problems in the config", [str(problem) for problem in error.problems]
    return str(error), []


def _shorten(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 4] + " ..."


def show_interrupted() -> None:
    """Say that nothing was saved."""
    err().print("\nstopped; nothing was saved")


def show_crash(error: Exception, report: Path | None) -> None:
    """Say that lgmpc itself made a mistake, and where its details are."""
    console = err()
    summary = " ".join(str(error).split())
    console.print(Text.assemble(("internal error: ", "bold red"), f"{type(error).__name__}: {summary[:300]}"))
    if report is not None:
        console.print(Text(f"This is a mistake in lgmpc, not yours. The details are in {report}"))
        console.print(f"Please send that file to {ISSUES_URL}; `lgmpc doctor` shows whether the installation is sound.")


def show_finished(run: FinishedRun, gate: Gate) -> None:
    """Print the verdict, the figures behind it, and what can be done with the run."""
    console = out()
    metrics = run.session.metrics
    if metrics is not None:
        console.print(_figures(metrics, gate))
    show_verdict(console, run.session.verdict, run.result.name)
    show_next(console, run.folder.path)


def show_verdict(console: Console, verdict: Verdict, name: str) -> None:
    """Print whether a run passed, and if not, why."""
    style = {"pass": "bold green", "fail": "bold red", "interrupted": "bold yellow"}[verdict.outcome.value]
    console.print(Text.assemble((verdict.outcome.value.upper(), style), f"  {name}"))
    for reason in verdict.reasons:
        console.print(Text(f"  - {reason}"))


def show_next(console: Console, path: Path) -> None:
    """Print where a run is, and what can be done with it."""
    console.print(Text(f"saved in {path}"))
    console.print(Text(f"next: lgmpc play {path}    (replay in the browser)"), style="dim")
    console.print(Text(f"      lgmpc plot {path}    (figures)"), style="dim")


def show_checked(config: Config, robot: Robot, notes: Sequence[str]) -> None:
    """Print what a config describes."""
    console = out()
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("robot", f"{robot.name}, {robot.mass:.3f} kg, {robot.nu} joints")
    table.add_row("contacts", ", ".join(robot.contact_frames) or "none")
    plant = config.plant
    table.add_row("plant", f"{plant.kind} at {plant.rate_hz:g} Hz, friction {plant.friction:g}")
    table.add_row("estimator", config.estimator.kind.replace("_", " "))
    mpc = config.mpc
    solver = getattr(mpc, "qp_solver", "no quadratic programme")
    horizon = f"{mpc.model} at {mpc.rate_hz:g} Hz, {mpc.nodes} nodes of {mpc.node_s * 1e3:g} ms, {solver}"
    table.add_row("mpc", horizon if mpc.enabled else "off")
    table.add_row("wbc", f"{config.wbc.rate_hz:g} Hz, friction {config.wbc.friction:g}")
    table.add_row("reference", config.reference.kind)
    for push in config.pushes:
        size = sum(each**2 for each in push.impulse_ns) ** 0.5
        table.add_row(
            "push",
            f"{push.body} at {push.time_s:g} s: {size:g} N.s in {push.duration_s:g} s ({size / push.duration_s:g} N)",
        )
    limits = [name for name, value in config.gate if value is not None and name != "steady_from_s"]
    table.add_row("gate", f"{len(limits)} limits" if limits else "none: every run that does not fall passes")
    table.add_row("duration", f"{config.duration_s:g} s simulated")
    console.print(table)
    for note in notes:
        console.print(Text.assemble(("note: ", "yellow"), note))
    console.print(Text.assemble(("OK", "bold green"), f"  {config.source.file}"))


def show_checked_problem(config: SolveConfig, scenario: Scenario, figures: Sequence[str]) -> None:
    """Print what the config of a problem to solve describes."""
    console, robot, problem, solver = out(), scenario.robot, scenario.problem, config.solver
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    base = "free" if robot.floating_base else "fixed"
    table.add_row("robot", f"{robot.name}, {robot.mass:.3f} kg, {base} base, {robot.nu} joints")
    table.add_row("contacts", ", ".join(robot.contact_frames) or "none")
    grid = f"{problem.nodes} intervals, {scenario.times[-1]:g} s, {problem.state.ndx} states, {problem.nu} controls"
    table.add_row("problem", f"{config.problem.kind}: {grid}")
    for waypoint in scenario.waypoints:
        where = ", ".join(f"{x:.3g}" for x in waypoint.position)
        table.add_row("waypoint", f"{waypoint.name} at [{where}] m, {waypoint.time:g} s")
    table.add_row("solver", f"{solver.method}, at most {solver.max_iterations} iterations")
    bounds = config.gate.bounds
    table.add_row("gate", f"{'converged' if config.gate.converged else 'need not converge'}, {len(bounds)} bounds")
    table.add_row("figures", ", ".join(figures))
    console.print(table)
    for note in robot.notes:
        console.print(Text.assemble(("note: ", "yellow"), note))
    console.print(Text.assemble(("OK", "bold green"), f"  {config.source.file}"))


def _figures(metrics: Metrics, gate: Gate) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("figure")
    table.add_column("measured", justify="right")
    table.add_column("allowed", justify="right")
    table.add_column("")
    limited = [name for name in vars(gate) if name != "steady_from_s" and getattr(gate, name) is not None]
    for limit_name in limited:
        limit = getattr(gate, limit_name)
        value = _measured(metrics, limit_name)
        highest = limit_name.startswith("max_")
        kept = value is not None and (value <= limit if highest else value >= limit)
        mark = Text("ok", "green") if kept else Text("broken", "bold red")
        name, scale = figure_name(limit_name)
        allowed = f"{'<=' if highest else '>='} {scale * limit:g}"
        table.add_row(name, "-" if value is None else figure_number(scale * value), allowed, mark)
    for name, value in _always_shown(metrics):
        if value is not None:
            table.add_row(name, figure_number(value), "", "")
    return table


def _measured(metrics: Metrics, limit: str) -> float | None:
    """Return the figure that a limit of the gate is about: named like it, or like it without "max_" or "min_"."""
    if limit.endswith("_p50_ms"):
        timing = metrics.mpc_ms if "mpc" in limit else metrics.wbc_ms
        return None if timing is None else timing.p50
    value: float | None = getattr(metrics, limit) if hasattr(metrics, limit) else getattr(metrics, limit[4:])
    return value


def _always_shown(metrics: Metrics) -> list[tuple[str, float | None]]:
    estimator = metrics.estimator
    return [
        ("survived / s", metrics.survived_s),
        ("MPC update p50 / ms", metrics.mpc_ms.p50 if metrics.mpc_ms else None),
        ("whole-body tick p50 / ms", metrics.wbc_ms.p50 if metrics.wbc_ms else None),
        ("estimator tick p50 / ms", metrics.estimator_ms.p50 if metrics.estimator_ms else None),
        ("estimated position off by / mm", 1e3 * estimator.max_position_m if estimator else None),
        ("estimated tilt off by / deg", estimator.max_tilt_deg if estimator else None),
        ("estimated yaw off by / deg", estimator.max_yaw_deg if estimator else None),
        ("real-time factor", metrics.real_time_factor),
    ]


def figure_name(figure: str) -> tuple[str, float]:
    """Return ``max_slip_m`` as "max slip / mm" and 1000: with the unit that its values read best in."""
    from lgmpc.runs.figures import figure_words  # not above: `lgmpc --help` needs no NumPy

    words, unit, scale = figure_words(figure)
    return f"{words} / {unit}" if unit else words, scale


def figure_number(value: float) -> str:
    """Return three digits of a figure."""
    return f"{value:.3g}" if value == 0 or abs(value) >= 1e-3 else f"{'<' if value > 0 else '>-'} 0.001"
