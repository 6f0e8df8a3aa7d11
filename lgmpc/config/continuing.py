"""Repetition of a recorded run, bit for bit, as a whole or up to a time from which other settings act.

A run is repeated, not restored: its config is simulated again and compared with the log up to the requested time.
Snapshots would be faster (a repetition takes about a fifth of the simulated time), but would have to contain the state
of three C++ libraries that cannot export it, and would verify nothing. Repetition needs no files, works for all
recorded runs, and reports the first tick and channel in which another machine, another version or a measured computing
time changed the result.

Other settings are entries of the config's ``changes``, so that the new run is itself repeatable from its config.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, run_session
from lgmpc.config.loading import parse_assignment, parse_config
from lgmpc.config.schema import WHILE_RUNNING, Change, Config
from lgmpc.config.session import Notify, ProgressReport, SessionResult, ignore
from lgmpc.errors import InputError, ReplayError
from lgmpc.runs import Run, RunFolder
from lgmpc.runs.difference import first_difference
from lgmpc.runs.folder import CONFIG_FILE, DEPLOYMENT_FILE
from lgmpc.runs.result import Origin, host_info, versions
from lgmpc.settings.dotted import differing
from lgmpc.wbc.export import TickRecorder, write_tick_library

__all__ = ["export_tick", "run_from"]

_EXPORTED_S = 10.0


def run_from(
    run: str | Path | FinishedRun,
    time_s: float | None = None,
    changes: Sequence[str] = (),
    out: str | Path = "runs",
    *,
    notify: Notify = ignore,
    progress: ProgressReport = ignore,
) -> FinishedRun:
    """Repeat a recorded run bit for bit up to a time, with other settings from there on, as ``out/<time>-<name>/``.

    Without changes the whole run is repeated and compared. Duration, gate, commands and pushes may change as far as
    they act later; all other settings become entries of ``changes`` of the config.

    Args:
        run: the value of :func:`run_config`, or a run folder.
        time_s: time from which the changes act, s, rounded to a control tick; the log's end unless given.
        changes: ``key=value``, as for :func:`lgmpc.config.load_config`.
        out: folder of run folders.
        notify: called with a description of what is being prepared.
        progress: called with the progress of the simulation.

    Returns:
        The run, whose result has an :class:`~lgmpc.runs.result.Origin`.

    Raises:
        ReplayError: the run was not repeated bit for bit; names tick and channel.
        InputError: the time is outside the log, a key cannot change during a run, or the run is one of a robot.
        RunFolderError: the folder is not a complete run of a closed loop.
        LgmpcError: as from :func:`run_config`.
    """
    recorded, before = _repeatable(run)
    period = recorded.log.control_period_s
    at = _tick(recorded, before, period, time_s) * period
    config = _changed(before, dict(map(parse_assignment, changes)), at) if changes else before
    repetition = _Repetition(recorded, before, config, at if changes else math.inf, at)
    return run_session(config, repetition.prepare, out, notify=notify, progress=progress, verify=repetition.verify)


def export_tick(run: str | Path | FinishedRun, folder: Path) -> int:
    """Write the whole-body tick of a run's controller as a C library; see :mod:`lgmpc.wbc.export`.

    The run is repeated up to its first change of settings, for 10 s at most: its ticks are part of the folder.

    Returns:
        The number of ticks.

    Raises:
        ReplayError: the run was not repeated bit for bit; names tick and channel.
        InputError: the run is one of a robot, the folder is not empty, or the controller cannot be written in C.
    """
    recorded, config = _repeatable(run)
    session = prepare(config)
    assert isinstance(session, ClosedLoopSession)
    first, end = session.earlier[0] if session.earlier else (session, session.rates.ticks)
    end = min(end, round(_EXPORTED_S / first.rates.period))
    recorder = TickRecorder(first.controller.wbc)
    first.advance(lambda _: None, end)
    repeated = first.recorder.log().decimated(config.log_every)
    difference = first_difference(recorded.log, repeated, until_s=float(repeated.time[-1]) + 1e-9)
    if difference is not None:
        raise ReplayError(str(recorded.path), difference, _reason(recorded))
    write_tick_library(first.controller.wbc, recorder.ticks, folder)
    return len(recorder.ticks)


def _repeatable(run: str | Path | FinishedRun) -> tuple[Run, Config]:
    """Return a simulated run and its config.

    Raises:
        InputError: a run of a robot, or one whose computing times were measured.
    """
    if not isinstance(run, (str, Path, FinishedRun)):
        raise InputError("run", type(run).__name__, "a run folder, or the value of run_config")
    recorded = RunFolder.load(run.folder.path if isinstance(run, FinishedRun) else run)
    if (recorded.path / DEPLOYMENT_FILE).is_file():
        raise InputError(
            "run",
            f"{recorded.path}, a run of a robot",
            f"a simulated run, which can be repeated: `lgmpc run {recorded.path / CONFIG_FILE}` simulates its config",
        )
    config = parse_config(recorded.config, name=str(recorded.path / CONFIG_FILE), folder=recorded.path)
    if "measured" in [part.timing.computing for _, part in config.parts()]:
        raise InputError(
            "timing.computing", "measured", "ideal or modelled: measured computing times are not repeatable"
        )
    return recorded, config


@dataclass
class _Repetition:
    """The repetition of a recorded run.

    Attributes:
        recorded: the run.
        before: its config.
        after: the config that is simulated.
        until_s: time up to which the logs are equal, s.
        at_s: time from which changed settings act, s.
    """

    recorded: Run
    before: Config
    after: Config
    until_s: float
    at_s: float

    def prepare(self, notify: Notify) -> ClosedLoopSession:
        """Return the session."""
        session = prepare(self.after, notify=notify)
        assert isinstance(session, ClosedLoopSession)
        self._recorder = session.recorder
        notify(f"repeating {self.recorded.path}" + (f" up to {self.at_s:g} s" if self.until_s < math.inf else ""))
        return session

    def verify(self, result: SessionResult) -> Origin:
        """Compare the repeated part with the recorded log.

        Raises:
            ReplayError: they differ.
        """
        log = self.recorded.log
        repeated = self._recorder.log().decimated(self.before.log_every)
        until = self.until_s
        if result.interrupted:
            until = min(until, float(repeated.time[-1]) + 0.5 * log.control_period_s) if repeated.ticks else 0.0
        difference = first_difference(log, repeated, until_s=until)
        if difference is not None:
            raise ReplayError(str(self.recorded.path), difference, _reason(self.recorded))
        changed = _differences(_part_at(self.before, self.at_s), self.after.parts()[-1][1])
        verified = int((log.time < until - 1e-9).sum())
        return Origin(str(self.recorded.path), self.at_s, verified, changed)


def _reason(recorded: Run) -> str:
    """Return a sentence on the versions and the processor that differ from those of the recorded run."""
    now, then = versions(), recorded.result.versions
    others = [f"{name} {now.get(name)} instead of {then.get(name)}" for name in then if now.get(name) != then[name]]
    here, there = host_info().cpu, recorded.result.host.cpu
    others += [f"processor {here} instead of {there}"] if here != there else []
    return f"Different here: {', '.join(others)}." if others else "Versions and processor are the same."


def _part_at(config: Config, time_s: float) -> Config:
    """Return the settings that act at a time."""
    return next(part for begin, part in reversed(config.parts()) if begin <= time_s + 1e-9)


def _differences(before: Config, after: Config) -> dict[str, tuple[Any, Any]]:
    """Return the values before and after, by dotted key, where they differ."""
    tables = before.model_dump(mode="json"), after.model_dump(mode="json")
    return {key: (a, b) for key, a, b in differing(*tables)}


def _changed(config: Config, values: dict[str, Any], at: float) -> Config:
    """Return the config with changes at a time, in place of those that it has from then on.

    Raises:
        InputError: a value that is no change, or one that would have acted before.
    """
    during = {key: value for key, value in values.items() if key.split(".")[0] in WHILE_RUNNING}
    whole = {key: value for key, value in values.items() if key not in during}
    for key in whole:
        if key.split(".")[0] in ("robot", "changes"):
            raise InputError(key, values[key], f"no change during a run; {', '.join(WHILE_RUNNING)} can change")
    earlier = [change for change in config.changes if change.at_s < at - 1e-9]
    if during and at == 0.0:
        whole, during = {**whole, **during}, {}
    entries = [*earlier, *([Change(at_s=at, set=during)] if during else [])]
    try:
        changed = config.replace({**whole, "changes": tuple(entries)})
    except InputError as error:
        prefix = f"changes.{len(earlier)}.set."
        key = error.argument.removeprefix(prefix)
        raise InputError(key, error.got, error.expected, error.choices) from error
    if not _differences(_part_at(config, at), changed.parts()[-1][1]):
        raise InputError("changes", "the values of the run", "other values, or no changes to repeat all of it")
    if changed.duration_s <= at + 1e-9:
        raise InputError(
            "duration_s", changed.duration_s, f"more than the {at:g} s that are repeated, to continue the run"
        )
    for name, time in (("pushes", "time_s"), ("commands", "at_s")):
        past = [[each for each in getattr(part, name) if getattr(each, time) < at - 1e-9] for part in (config, changed)]
        if past[0] != past[1]:
            raise InputError(name, f"a change of what was before {at:g} s", "entries from then on")
    return changed


def _tick(recorded: Run, config: Config, period: float, time_s: float | None) -> int:
    """Return the tick nearest to a time."""
    if recorded.log.ticks == 0:
        raise InputError("run", f"{recorded.path} without a tick", "a run of at least one tick")
    logged = round(float(recorded.log.time[-1]) / period) + config.log_every
    end = min(logged, round(config.duration_s / period))
    if time_s is None:
        return end
    if not 0.0 <= time_s <= (end + 0.5) * period:
        raise InputError("time_s", time_s, f"a time in the log of {recorded.path}, 0 to {end * period:g} s")
    return round(time_s / period)
