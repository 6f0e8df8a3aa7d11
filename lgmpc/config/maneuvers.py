"""Planned motions of section ``maneuvers``: solved when a closed loop is built, or read from run folders."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lgmpc.config.loading import load_solve_config
from lgmpc.config.schema import Config, ManeuverSource
from lgmpc.config.session import Notify
from lgmpc.config.solving import prepare_solve
from lgmpc.control.maneuver import Maneuver
from lgmpc.errors import InputError, RunFolderError
from lgmpc.problems.legged_settings import LeggedSettings
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog, load_run


def build_maneuvers(config: Config, robot: Robot, notify: Notify) -> Sequence[Maneuver]:
    """Return the planned motions of a closed loop, and check that its commands name no others.

    Args:
        config: the closed loop.
        robot: its robot.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: a problem without a solution, a run of another kind, a trajectory of another robot or one that does
            not lead from standing to standing; a command with a motion that does not exist. The key is named.
    """
    mode = "stand"
    for i, entry in enumerate(config.commands):
        mode = entry.mode or mode
        if entry.maneuver is not None and entry.maneuver not in config.maneuvers:
            words = "a name in section maneuvers" if config.maneuvers else "none, because section maneuvers is empty"
            raise config.error(f"commands.{i}.maneuver", entry.maneuver, words, tuple(config.maneuvers))
        if entry.maneuver is not None and mode != "stand":
            words = f"none in mode {mode}, as commanded until then: mode stand has them"
            raise config.error(f"commands.{i}.maneuver", entry.maneuver, words)
    found = []
    for name, source in config.maneuvers.items():
        key = f"maneuvers.{name}"
        log = _solved(config, key, source.run) if source.run else _solve(config, key, source, notify)
        try:
            if log.contact_frames.tolist() != list(robot.contact_frames):
                raise InputError("contact frames", ", ".join(log.contact_frames), ", ".join(robot.contact_frames))
            motion = log.times, log.xs, log.contact_flags, log.contact_forces
            planned = Maneuver.of(name, robot, *motion, 1.0 / config.wbc.rate_hz)
            found.append(replace(planned, anchored=source.anchor == "world"))
        except InputError as error:
            raise config.error(key, f"{error.argument}: {error.got}", error.expected) from error
    return found


def _solved(config: Config, key: str, folder: str) -> TrajectoryLog:
    try:
        run = load_run(Path(folder))
    except RunFolderError as error:
        raise config.error(f"{key}.run", folder, f"a run folder: {error}") from error
    if not isinstance(run, SolvedRun) or not run.log.finite:
        raise config.error(f"{key}.run", folder, "the run of a solved problem, as `lgmpc solve` saves it")
    return run.log


def _solve(config: Config, key: str, source: ManeuverSource, notify: Notify) -> TrajectoryLog:
    name = source.problem or ""
    notify(f"solving {name} for {key}")
    try:
        problem = load_solve_config(name)
    except InputError as error:
        raise config.error(f"{key}.problem", f"{name}: {error.got}", error.expected) from error
    changes: dict[str, Any] = {"robot": config.robot}
    if isinstance(problem.problem, LeggedSettings):
        unseeded = getattr(config.world, "seed", 0) is None
        changes["problem.world"] = config.world.replace({"seed": config.seed}) if unseeded else config.world
    try:
        problem = problem.replace(changes).replace(source.set)
    except InputError as error:
        raise config.error(f"{key}.set", f"{error.argument}: {error.got}", error.expected) from error
    outcome = prepare_solve(problem).run(lambda iteration: None)
    if outcome.verdict.reasons:
        got, words = f"{name}: {'; '.join(outcome.verdict.reasons)}", "a problem whose solution passes its gate"
        raise config.error(f"{key}.problem", got, f"{words}; `lgmpc solve {name}` shows its iterations")
    return outcome.log
