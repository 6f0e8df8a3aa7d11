"""``lgmpc check``, ``configs``, ``schema``, ``doctor`` and ``explain``: configs, the installation, and runs."""

import json
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from lgmpc.cli.screen import err, out, show_table, show_verdict
from lgmpc.config import Config, Document, SolveConfig
from lgmpc.config.extensions import own_costs, own_tasks
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import GroundTruth
from lgmpc.doctor import iterate_checks
from lgmpc.errors import InputError
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Verdict
from lgmpc.runs.atomic import atomic_write
from lgmpc.runs.forensics import Explanation
from lgmpc.runs.tables import Table, events_table, margins_table
from lgmpc.shipped import shipped_config, shipped_configs, shipped_sweeps

_NEAREST = 8
_WIDTH = 28
"""Width of the names of checks, in characters."""

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
    show_table(Table(("", ""), list(lines)))
    for note in notes:
        console.print(Text.assemble(("note: ", "yellow"), note))
    console.print(Text.assemble(("OK", "bold green"), f"  {config.source.file}"))


def _robot(robot: Robot) -> Lines:
    base = "free" if robot.floating_base else "fixed"
    yield "robot", f"{robot.name}, {robot.mass:.3f} kg, {base} base, {robot.nu} joints"
    soles = not robot.foot_points.single
    yield "contacts", ("; " if soles else ", ").join(map(str, robot.feet)) or "none"


def _closed_loop(config: Config, robot: Robot) -> Lines:
    yield from _robot(robot)
    plant, mpc = config.plant, config.mpc
    yield "plant", f"{plant.kind} at {plant.rate_hz:g} Hz, friction {plant.friction:g}"
    yield "estimator", config.estimator.kind.replace("_", " ")
    solver = mpc.qp_solver
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
    bounds = config.gate.limits
    yield "gate", f"{'converged' if config.gate.converged else 'need not converge'}, {len(bounds)} bounds"
    yield "figures", ", ".join(figures)


def notes_on(config: Config) -> tuple[str, ...]:
    """Return one sentence for each setting of ``config`` that was probably not intended."""
    notes = []
    for i, push in enumerate(config.pushes):
        if push.time_s >= config.duration_s:
            notes.append(f"pushes.{i} begins at {push.time_s:g} s, after the end of the run ({config.duration_s:g} s)")
        elif push.time_s + push.duration_s > config.duration_s:
            notes.append(f"pushes.{i} is cut short by the end of the run ({config.duration_s:g} s)")
    if config.gate.steady_from_s >= config.duration_s:
        notes.append("gate.steady_from_s is after the end of the run: steady errors are not measured")
    if isinstance(config.estimator, GroundTruth) and config.sensors != type(config.sensors)():
        notes.append("sensors: not used while estimator.kind is ground_truth")
    for section, friction in (("wbc", config.wbc.friction), ("mpc", config.mpc.friction)):
        if friction > config.plant.friction and (section == "wbc" or config.mpc.enabled):
            notes.append(
                f"{section}.friction ({friction:g}) is above the floor's ({config.plant.friction:g}): feet may slip"
            )
    return tuple(notes)


def list_configs() -> None:
    """Print name, command and summary of each shipped config, and of each sweep."""
    console = out()
    for configs in (shipped_configs(), shipped_sweeps()):
        width = max(map(len, configs), default=0)
        for name, config in configs.items():
            console.print(Text.assemble((f"{name:{width}}", "bold"), f"  {config.command:5}  {config.summary}"))
        console.print()
    console.print("next: lgmpc run, solve or sweep NAME; lgmpc configs --copy NAME writes one to edit", style="dim")


def copy_config(name: str, destination: Path | None, *, force: bool) -> None:
    """Write a copy of a shipped config to a file.

    Args:
        name: of the config.
        destination: file, or folder for a file of the config's name; the working directory unless given.
        force: whether to replace an existing file.

    Raises:
        ConfigError: if no shipped config has this name.
        InputError: if the file exists and ``force`` is false, or its folder does not exist.
        RunFolderError: if the file cannot be written.
    """
    config = shipped_config(name)
    file = destination or Path()
    if file.is_dir():
        file /= config.file.name
    if not file.parent.is_dir():
        raise InputError("DEST", file, "a file in a folder that exists")
    if file.exists() and not force:
        raise InputError("DEST", file, "a file that does not exist (--force replaces it)")
    with atomic_write(file) as stream:
        stream.write(config.copy_text().encode("utf-8"))
    out().print(Text(f"wrote {file}"))
    out().print(Text(f"next: lgmpc {config.command} {shlex.quote(str(file))}"), style="dim")


def show_diagnosis() -> int:
    """Print the result of each check, and return 0 if all passed, else 1."""
    console = out()
    failed = 0
    with err().status("checking"):
        for check in iterate_checks():
            failed += not check.ok
            mark = ("ok    ", "green") if check.ok else ("broken", "bold red")
            console.print(Text.assemble(mark, f"  {check.name:<{_WIDTH}}{check.detail}"))
            if check.remedy:
                console.print(Text(f"{'':8}{'':{_WIDTH}}-> {check.remedy}", "yellow"))
    if failed:
        console.print(Text.assemble((f"{failed} broken", "bold red"), ": remedies are in the lines that begin with ->"))
        return 1
    console.print(Text("sound", "bold green"))
    return 0


def explain_shown(folder: Path, *, as_json: bool) -> None:
    """Explain a run and print it."""
    from lgmpc.config.showing import explain

    explanation = explain(folder)
    if as_json:
        print(json.dumps({"folder": str(folder), **explanation.content()}, indent=2))
        return
    _show_explanation(out(), explanation)
    if explanation.events:
        out().print(Text(f"next: {explanation.command(folder)}    (changed from the first event on)", "dim"))
    out().print(Text(f"next: lgmpc report {shlex.quote(str(folder))}    (figures, replay)", "dim"))


def _show_explanation(console: Console, explanation: Explanation) -> None:
    show_verdict(console, Verdict(explanation.outcome), explanation.name)
    for sentence in explanation.summary:
        console.print(Text(f"  - {sentence}"))
    if explanation.events:
        show_table(events_table(explanation.events, explanation.failed_s, explanation.failure))
    if explanation.earlier:
        counts = (f"{count} x {name}" for name, count in explanation.earlier.items())
        console.print(Text(f"earlier: {', '.join(counts)}", "dim"))
    if explanation.nearest:
        show_table(margins_table(explanation.nearest[:_NEAREST]))
