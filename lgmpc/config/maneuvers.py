"""Planned motions of section ``maneuvers``: solved when a closed loop is built, or read from run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lgmpc.config.loading import load_solve_config
from lgmpc.config.schema import Config
from lgmpc.config.session import Notify
from lgmpc.config.solving import prepare_solve
from lgmpc.control.maneuver import Maneuver
from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog, load_run

__all__ = ["build_maneuvers"]

_MASS_ERROR = 0.02  # of the robot's mass: a plan for a heavier one is another plan


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
    for i, entry in enumerate(config.commands):
        if entry.maneuver is not None and entry.maneuver not in config.maneuvers:
            words = "a name in section maneuvers" if config.maneuvers else "none, because section maneuvers is empty"
            raise config.error(f"commands.{i}.maneuver", entry.maneuver, words, tuple(config.maneuvers))
    found = []
    for name, source in config.maneuvers.items():
        key = f"maneuvers.{name}"
        log = _trajectory(config, key, source, notify)
        try:
            if log.contact_frames.tolist() != list(robot.contact_frames):
                raise InputError("contact frames", ", ".join(log.contact_frames), ", ".join(robot.contact_frames))
            found.append(
                Maneuver.of(
                    name, robot, log.times, log.xs, log.contact_flags, log.contact_forces, 1.0 / config.wbc.rate_hz
                )
            )
        except InputError as error:
            raise config.error(key, f"{source}: {error.argument}: {error.got}", error.expected) from error
    return found


def _trajectory(config: Config, key: str, source: str, notify: Notify) -> TrajectoryLog:
    if Path(source).is_dir():
        run = load_run(Path(source))
        if not isinstance(run, SolvedRun):
            raise config.error(key, f"{source}, a run of a closed loop", "a run of a solved problem, or its config")
        if not run.log.finite:
            raise config.error(key, f"{source}, a trajectory that is not finite", "a solved problem")
        return run.log
    notify(f"planning the manoeuvre of {source}")
    outcome = prepare_solve(load_solve_config(source), notify=notify).run(lambda iteration: None)
    if outcome.verdict.reasons:
        words = f"a problem whose solution passes its gate: `lgmpc solve {source}` shows why it does not"
        raise config.error(key, f"{source}, {'; '.join(outcome.verdict.reasons)}", words)
    return outcome.log
