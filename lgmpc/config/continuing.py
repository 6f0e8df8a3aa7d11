"""Replay of a recorded run bit for bit up to some time, and its continuation from there with other settings.

A run is repeated, not restored: its config is simulated again and compared with the log, bit for bit, up to the
requested time. Snapshots would be faster (a repetition takes about a fifth of the simulated time), but would have to
contain the state of three C++ libraries that cannot export it, and would verify nothing. Repetition needs no files,
works for all recorded runs, and reports the first tick and channel in which another machine, another version or a
measured computing time changed the result.

From that time on the run continues unchanged or, if settings are changed, in a session that is built from the changed
config and takes over the state of the first (:mod:`lgmpc.config.takeover`). The saved log has both parts, so that
figures, replay and explanation include the history; metrics and verdict are those of the whole run, the certificate is
that of the continuation, because floor and drives may have been changed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, new_folder, save_run, simulated
from lgmpc.config.interrupts import stop_signals
from lgmpc.config.loading import parse_config
from lgmpc.config.schema import Config
from lgmpc.config.session import Notify, ProgressReport
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import InputError, ReplayError, RunFolderError
from lgmpc.notebook import reports
from lgmpc.runs import Run, RunFolder
from lgmpc.runs.difference import first_difference
from lgmpc.runs.folder import CONFIG_FILE, DEPLOYMENT_FILE
from lgmpc.runs.host import host_info, versions
from lgmpc.runs.origin import Origin
from lgmpc.settings.dotted import differing

__all__ = ["run_from"]

_FROM_THE_START = (
    "robot", "wbc.rate_hz", "plant.kind", "plant.rate_hz", "plant.initial_posture", "plant.initial_velocity_m_s",
    "plant.initial_rotation_rad_s", "estimator.kind", "sensors.gyro_bias_rad_s", "sensors.accelerometer_bias_m_s2",
)  # fmt: skip
"""Keys that cannot change during a run, because they act at its start or define its robot and time grid."""


@dataclass(frozen=True)
class _Part:
    """A part of a run with one config.

    Attributes:
        until_s: end of the part, s; inf for the last one.
        config: config of the part.
    """

    until_s: float
    config: Config


def run_from(
    run: str | Path | FinishedRun,
    time_s: float | None = None,
    changes: Sequence[str] = (),
    out: str | Path = "runs",
    *,
    notify: Notify | None = None,
    progress: ProgressReport | None = None,
) -> FinishedRun:
    """Repeat a recorded run bit for bit up to a time, continue it from there, and save it as ``out/<time>-<name>/``.

    Without changes the whole run is repeated and compared. With changes the new settings act from that time on; the
    state of plant, drives, sensors, estimator, gait, plans and solvers is taken over.

    Args:
        run: the value of :func:`run_config`, or a run folder.
        time_s: time from which the changes act, s, rounded to a control tick; the log's end unless given.
        changes: ``key=value``, as for :func:`lgmpc.config.load_config`.
        out: folder of run folders.
        notify: called with a description of what is being prepared.
        progress: called with the progress of the simulation. In a notebook a bar displays both unless either is given.

    Returns:
        The run, whose result has an :class:`~lgmpc.runs.origin.Origin`.

    Raises:
        ReplayError: the run was not repeated bit for bit; names tick and channel.
        InputError: the time is outside the log, a key cannot change during a run, or the run is one of a robot.
        RunFolderError: the folder is not a complete run of a closed loop.
        LgmpcError: as from :func:`run_config`.
    """
    recorded = RunFolder.load(run.folder.path if isinstance(run, FinishedRun) else run)
    if (recorded.path / DEPLOYMENT_FILE).is_file():
        raise InputError(
            "run",
            f"{recorded.path}, a run of a robot",
            f"a simulated run, which can be repeated: `lgmpc run {recorded.path / CONFIG_FILE}` simulates its config",
        )
    parts = list(_parts(recorded))
    period = recorded.log.control_period_s
    tick = _tick(recorded, period, time_s)
    at = tick * period
    changed: dict[str, tuple[Any, Any]] = {}
    if changes:
        begun = [part for part in parts if part.until_s <= at]
        before = parts[len(begun)].config
        after = parse_config(_text(before), name=str(recorded.path), folder=recorded.path, overrides=changes)
        changed = _changes(before, after)
        _require_changeable(before, changed, at, after.duration_s)
        parts = [*begun, *([_Part(at, before)] if tick else []), _Part(math.inf, after)]
    config = parts[-1].config
    _require_repeatable(parts)
    verify_s = at if changes else math.inf
    with (
        stop_signals() as stop,
        new_folder(config, out, stop) as folder,
        reports(notify, progress, simulated) as (announce, advance),
    ):
        if parts[:-1]:
            folder.write_before(_before(parts[:-1]))
        announced, advanced = stop.checked(announce), stop.checked(advance)
        session, anew = _advanced(parts, recorded, tick, period, announced, advanced, verify=bool(changes))
        folder.check_space(session.log_bytes)
        with stop.deferred(advance) as report:
            result = session.run(report)
            if not changes and not result.interrupted:
                _verify(recorded, session, verify_s)
            until = min(verify_s, float(result.log.time[-1]) + 0.5 * period)
            verified = int((recorded.log.time < until - 1e-9).sum())
            origin = Origin(str(recorded.path), at, verified, changed, anew)
            saved = save_run(folder, config, result, origin)
    return FinishedRun(folder, saved, config, result, stop.received if result.interrupted else None)


def _advanced(
    parts: Sequence[_Part],
    recorded: Run,
    tick: int,
    period: float,
    notify: Notify,
    progress: ProgressReport,
    *,
    verify: bool,
) -> tuple[ClosedLoopSession, tuple[str, ...]]:
    """Return the session of the last part, advanced to its first tick, and paths of the objects reset in it."""
    session, anew = _session(parts[0].config, notify), tuple[str, ...]()
    beginning = session.beginning()
    notify(f"repeating {recorded.path}" + (f" up to {tick * period:g} s" if verify else ""))
    for part, following in zip(parts, parts[1:], strict=False):
        session.advance(progress, round(part.until_s / period))
        if verify and following is parts[-1]:
            _verify(recorded, session, part.until_s)
        new = _session(following.config, notify)
        made = new.beginning()
        try:
            anew = new.take_over(session, beginning, draws=part.config.seed == following.config.seed)
        except InputError as error:
            keys = tuple(_changes(part.config, following.config))
            if error.argument in keys:
                raise
            raise InputError(
                ", ".join(keys), str(error), "changes that leave the structure of the run as it is"
            ) from error
        session, beginning = new, made
    return session, anew


def _session(config: Config, notify: Notify) -> ClosedLoopSession:
    session = prepare(config, notify=notify)
    assert isinstance(session, ClosedLoopSession)
    return session


def _verify(recorded: Run, session: ClosedLoopSession, until_s: float) -> None:
    """Compare the repeated part with the recorded log."""
    repeated = session.recorder.log().decimated(_last(recorded).log_every)
    difference = first_difference(recorded.log, repeated, until_s=until_s)
    if difference is not None:
        raise ReplayError(str(recorded.path), difference, _reason(recorded))


def _reason(recorded: Run) -> str:
    """Return a sentence on the versions and the processor that differ from those of the recorded run."""
    now, then = versions(), recorded.result.versions
    others = [f"{name} {now.get(name)} instead of {then.get(name)}" for name in then if now.get(name) != then[name]]
    here, there = host_info().cpu, recorded.result.host.cpu
    others += [f"processor {here} instead of {there}"] if here != there else []
    return f"Different here: {', '.join(others)}." if others else "Versions and processor are the same."


def _parts(recorded: Run) -> Iterator[_Part]:
    """Yield the parts of a recorded run: those of the runs that it continues, and its own."""
    file = recorded.path / "before.yaml"
    content = parse_yaml(recorded.before, str(file))[0] if recorded.before else []
    try:
        pairs = [(float(each["until_s"]), write_yaml(each["config"])) for each in content]
    except (KeyError, TypeError, ValueError) as error:
        raise RunFolderError(f"{file} is damaged: {type(error).__name__} {error}") from error
    for until_s, text in pairs:
        yield _Part(until_s, parse_config(text, name=str(file), folder=recorded.path))
    yield _Part(math.inf, _last(recorded))


def _last(recorded: Run) -> Config:
    return parse_config(recorded.config, name=str(recorded.path / CONFIG_FILE), folder=recorded.path)


def _changes(before: Config, after: Config) -> dict[str, tuple[Any, Any]]:
    """Return the values before and after, by dotted key, where they differ."""
    tables = before.model_dump(mode="json"), after.model_dump(mode="json")
    return {key: (a, b) for key, a, b in differing(*tables)}


def _text(config: Config) -> str:
    return write_yaml(config.model_dump(mode="json"))


def _before(parts: Sequence[_Part]) -> str:
    return write_yaml([{"until_s": part.until_s, "config": part.config.model_dump(mode="json")} for part in parts])


def _tick(recorded: Run, period: float, time_s: float | None) -> int:
    """Return the tick nearest to a time."""
    if recorded.log.ticks == 0:
        raise InputError("run", f"{recorded.path} without a tick", "a run of at least one tick")
    config = _last(recorded)
    logged = round(float(recorded.log.time[-1]) / period) + config.log_every
    end = min(logged, round(config.duration_s / period))
    if time_s is None:
        return end
    if not 0.0 <= time_s <= (end + 0.5) * period:
        raise InputError("time_s", time_s, f"a time in the log of {recorded.path}, 0 to {end * period:g} s")
    return round(time_s / period)


def _require_repeatable(parts: Sequence[_Part]) -> None:
    if any(part.config.timing.computing == "measured" for part in parts):
        raise InputError(
            "timing.computing", "measured", "ideal or modelled: measured computing times are not repeatable"
        )


def _require_changeable(before: Config, changed: dict[str, tuple[Any, Any]], at: float, duration_s: float) -> None:
    """Raise for changes of keys that cannot change during a run."""
    for key, (_, value) in changed.items():
        if any(key == each or key.startswith(f"{each}.") for each in _FROM_THE_START):
            choices = [
                name
                for name in _leaves(before.model_dump(mode="json"))
                if not any(name == each or name.startswith(f"{each}.") for each in _FROM_THE_START)
            ]
            raise InputError(key, value, "no change during a run", choices, word=key)
    if not changed:
        raise InputError("changes", "the values of the run", "other values, or no changes to repeat all of it")
    if duration_s <= at + 1e-9:
        raise InputError("duration_s", duration_s, f"more than the {at:g} s that are repeated, to continue the run")


def _leaves(table: dict[str, Any], key: str = "") -> Iterator[str]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{key}{name}.")
        else:
            yield f"{key}{name}"
