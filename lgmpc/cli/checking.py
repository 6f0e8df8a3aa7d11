"""``lgmpc check``: the contents of a config, with notes on probable mistakes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.table import Table
from rich.text import Text

from lgmpc.cli.screen import out
from lgmpc.config import Config, Document, SolveConfig
from lgmpc.config.extensions import own_costs, own_tasks
from lgmpc.config.notes import notes_on
from lgmpc.config.robots import build_robot
from lgmpc.problems import Scenario
from lgmpc.robot import Robot

__all__ = ["show_checked"]

Lines = Iterable[tuple[str, str]]
"""Pairs of names and descriptions."""


def show_checked(config: Config | SolveConfig) -> None:
    """Build a session from a config, without running or solving it, and print its parts.

    Raises:
        LgmpcError: what cannot be built, naming the key.
    """
    if isinstance(config, SolveConfig):
        from lgmpc.config.solving import check_scenario

        scenario, figures = check_scenario(config)
        _show(config, _problem(config, scenario, figures), scenario.robot.notes)
    else:
        robot = build_robot(config)
        _show(config, _closed_loop(config, robot), (*notes_on(config), *robot.notes))


def _show(config: Document, lines: Lines, notes: Sequence[str]) -> None:
    console = out()
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, words in lines:
        table.add_row(name, words)
    console.print(table)
    for note in notes:
        console.print(Text.assemble(("note: ", "yellow"), note))
    console.print(Text.assemble(("OK", "bold green"), f"  {config.source.file}"))


def _robot(robot: Robot) -> Lines:
    base = "free" if robot.floating_base else "fixed"
    yield "robot", f"{robot.name}, {robot.mass:.3f} kg, {base} base, {robot.nu} joints"
    yield "contacts", ", ".join(robot.contact_frames) or "none"


def _closed_loop(config: Config, robot: Robot) -> Lines:
    yield from _robot(robot)
    plant, mpc = config.plant, config.mpc
    yield "plant", f"{plant.kind} at {plant.rate_hz:g} Hz, friction {plant.friction:g}"
    yield "estimator", config.estimator.kind.replace("_", " ")
    solver = getattr(mpc, "qp_solver", "no quadratic programme")
    horizon = f"{mpc.model} at {mpc.rate_hz:g} Hz, {mpc.nodes} nodes of {mpc.node_s * 1e3:g} ms, {solver}"
    yield "mpc", horizon if mpc.enabled else "off"
    yield "wbc", f"{config.wbc.rate_hz:g} Hz, friction {config.wbc.friction:g}"
    yield from (("own task", each.name) for each in own_tasks(config, robot))
    yield from (("own cost", each.name) for each in own_costs(config, robot))
    yield "reference", config.reference.kind
    for push in config.pushes:
        size = sum(each**2 for each in push.impulse_ns) ** 0.5
        force = size / push.duration_s
        yield "push", f"{push.body} at {push.time_s:g} s: {size:g} N.s in {push.duration_s:g} s ({force:g} N)"
    limits = [f"{name} {limit:g}" for name, limit in config.gate.limits.items()]
    yield "gate", ", ".join(limits) or "none: every run that does not fall passes"
    yield "duration", f"{config.duration_s:g} s simulated"


def _problem(config: SolveConfig, scenario: Scenario, figures: Sequence[str]) -> Lines:
    yield from _robot(scenario.robot)
    problem, solver = scenario.problem, config.solver
    grid = f"{problem.nodes} intervals, {scenario.times[-1]:g} s, {problem.state.ndx} states, {problem.nu} controls"
    yield "problem", f"{config.problem.kind}: {grid}"
    for waypoint in scenario.waypoints:
        where = ", ".join(f"{x:.3g}" for x in waypoint.position)
        yield "waypoint", f"{waypoint.name} at [{where}] m, {waypoint.time:g} s"
    yield "solver", f"{solver.method}, at most {solver.max_iterations} iterations"
    bounds = config.gate.bounds
    yield "gate", f"{'converged' if config.gate.converged else 'need not converge'}, {len(bounds)} bounds"
    yield "figures", ", ".join(figures)
