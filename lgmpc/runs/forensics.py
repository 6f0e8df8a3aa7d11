"""Diagnosis of a run from its log: the events before a failure, and the smallest margins of a run that passed."""

import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from lgmpc.errors import InputError
from lgmpc.runs.atomic import json_values
from lgmpc.runs.events import Event, EventKind, find_events
from lgmpc.runs.folder import CONFIG_FILE, Run
from lgmpc.runs.gate import Gate, Outcome
from lgmpc.runs.limited import Limited, Nearest, UnloggedLimits, gate_figures, limited_quantities
from lgmpc.runs.log import RunLog
from lgmpc.runs.modes import fallen_ticks

_BEFORE_S = 1.0
"""The chain of events begins this long before the failure, s, or at an earlier cause."""
_CAUSE_S = 3.0
"""A push or a command that began longer before the failure, s, is not a cause of it."""
_AFTER_S = 0.1
"""Events that begin later than this after a failure, s, are consequences."""


@dataclass(frozen=True)
class Explanation:
    """The diagnosis of a closed loop or, without time of failure and events, of a solve.

    Attributes:
        name: name of the run.
        outcome: outcome of its verdict.
        reasons: reasons of the verdict.
        summary: sentences.
        nearest: smallest margin of each limited quantity up to the failure, in order of the share used. Slip without
            a limit is not among them.
        failed_s: time of the failure, s; ``None`` if it passed, or violated only limits on figures of the whole run.
        failure: the failure in words; empty if it passed.
        events: the chain before the failure, in order; of a run that passed, all of its events.
        earlier: number of events of each name before the chain.
    """

    name: str
    outcome: Outcome
    reasons: tuple[str, ...]
    summary: tuple[str, ...]
    nearest: tuple[Nearest, ...]
    failed_s: float | None = None
    failure: str = ""
    events: tuple[Event, ...] = ()
    earlier: Mapping[str, int] = field(default_factory=dict)

    @property
    def replay_from_s(self) -> float | None:
        """Time just before the first event, s, a multiple of 10 ms, from which other settings would act.

        ``None`` without events.
        """
        first = min((each.start_s for each in self.events), default=None)
        return None if first is None else max(0, math.floor(1e2 * first + 1e-6) - 1) / 1e2

    def command(self, folder: Path) -> str:
        """Return the command that repeats the run, with other settings from just before its first event on."""
        change = f'"changes=[{{at_s: {self.replay_from_s:g}, set: {{KEY: VALUE}}}}]"' if self.replay_from_s else ""
        return f"lgmpc run {shlex.quote(str(folder / CONFIG_FILE))} --set {change or 'KEY=VALUE'}"

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON, without the arrays."""
        content = {each.name: getattr(self, each.name) for each in fields(self)}
        content["replay_from_s"] = self.replay_from_s
        content |= {name: [asdict(each) for each in content[name]] for name in ("events", "nearest")}
        return cast("dict[str, Any]", json_values(content))


def explain_run(run: Run, gate: Gate, joints: UnloggedLimits | None = None) -> Explanation:
    """Find the events that led to a run's failure, and its smallest margins.

    Args:
        run: contents of the run folder.
        gate: limits of its verdict.
        joints: limits of positions and speeds; without them these are not examined.

    Raises:
        InputError: if the log has fewer than two ticks with a finite state.
    """
    log = run.log.until(run.log.finite_ticks)
    broke_s = None if log.ticks == run.log.ticks else float(run.log.time[log.ticks])
    if log.ticks < 2:
        raise InputError("run", f"{run.path} with {log.ticks} ticks", "a run of at least two ticks with a finite state")
    verdict = run.result.verdict
    quantities = tuple(limited_quantities(log, gate, joints))
    if verdict.passed:
        failure = _Failure(None, "")
    else:
        overall = verdict.reasons[0] if verdict.reasons else verdict.outcome.value
        failure = _failure(log, quantities, broke_s) or _Failure(None, overall)
    failed_s = failure.time_s
    events = find_events(log, quantities, run.result.changes)
    chain, earlier = _chain(events, failed_s)
    end = log.ticks if failed_s is None else int(np.searchsorted(log.time, failed_s, side="right"))
    # The threshold of the event is no limit of slip.
    limited = (each for each in quantities if each.name != "slip" or each.judged)
    found = (quantity.at(slice(end)).nearest(log.time[:end]) for quantity in limited)
    nearest = [each for each in found if each is not None]
    if failed_s is None and run.result.metrics is not None:
        nearest += gate_figures(run.result.metrics, gate)
    nearest.sort(key=lambda each: -each.used)
    found_out = (_summary(failure, chain, nearest), tuple(nearest), failed_s, failure.words, chain, earlier)
    return Explanation(run.result.name, verdict.outcome, verdict.reasons, *found_out)


class _Failure(NamedTuple):
    """Time of a failure, ``None`` for a figure of the whole run; words, empty if it passed; whether it fell."""

    time_s: float | None
    words: str
    fell: bool = False


def _failure(log: RunLog, quantities: Sequence[Limited], broke_s: float | None) -> _Failure | None:
    """Return the fall of a run or its first violation of a limit on each tick; ``None`` if there is neither."""
    if log.floating_base:
        fallen = fallen_ticks(log)
        if fallen.any():
            tick = int(np.argmax(fallen))
            height = 100.0 * log.base_height[tick] / log.base_height[0]
            state = f"tilt {log.tilt_deg[tick]:.3g} deg, base at {height:.3g} % of its first height"
            return _Failure(float(log.time[tick]), f"the robot fell ({state})", fell=True)
    if broke_s is not None:
        return _Failure(broke_s, "the state was no longer finite")
    found: list[_Failure] = []
    for quantity in quantities:
        beyond = quantity.margins < 0.0
        if quantity.judged and beyond.any():
            tick = int(np.argmax(beyond.any(axis=1)))
            subject = int(np.argmax(beyond[tick]))
            where = f" of {quantity.subjects[subject]}" if quantity.subjects[subject] else ""
            limit = f"{quantity.limits[tick, subject]:.3g} {quantity.unit}"
            words = f"the {quantity.name}{where} went beyond its limit of {limit}"
            found.append(_Failure(float(log.time[tick]), words))
    return min(found, default=None)


def _chain(events: Sequence[Event], failed_s: float | None) -> tuple[tuple[Event, ...], dict[str, int]]:
    """Return the events from the last cause on, or from a second before the failure, and counts of those before."""
    if failed_s is None:
        return tuple(events), {}
    causes = [each.start_s for each in events if each.kind is EventKind.CAUSE and each.start_s <= failed_s]
    near = [time for time in causes if failed_s - time < _CAUSE_S]
    begin = min([failed_s - _BEFORE_S, *near[-1:]]) - 1e-9
    chain = [each for each in events if each.end_s >= begin and each.start_s <= failed_s + _AFTER_S]
    return tuple(chain), dict(Counter(each.name for each in events if each.end_s < begin))


def _summary(failure: _Failure, chain: Sequence[Event], nearest: Sequence[Nearest]) -> tuple[str, ...]:
    if not failure.words:
        # Of a run that passed, only quantities that its gate does not limit are beyond a limit.
        close = next((each for each in nearest if each.used <= 1.0 or each.judged), None)
        return ("it passed", *((f"nearest to its limit: {close}",) if close else ()))
    failed_s = failure.time_s
    if failed_s is None:
        return (failure.words,)
    causes = [each for each in chain if each.kind is EventKind.CAUSE and each.start_s <= failed_s]
    after = ""
    if causes:
        cause = causes[-1]
        after = f", {_duration(failed_s - cause.start_s)} after the beginning of: {cause.words}"
    sentences = [f"{failure.words} at {failed_s:.3f} s{after}"]
    signs = [each for each in chain if each.kind.is_sign and each.start_s <= failed_s]
    if signs:
        first = signs[0]
        before = _duration(failed_s - first.start_s)
        sentences.append(f"first sign, at {first.start_s:.3f} s ({before} before): {first.words}")
    beyond = [each for each in chain if each.name == "capture point" and each.start_s <= failed_s <= each.end_s]
    if beyond and failure.fell:
        sentences.append(
            f"from {beyond[-1].start_s:.3f} s on the capture point was outside the support: without a step, no contact "
            "forces could bring the robot to rest"
        )
    return tuple(sentences)


def _duration(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.0f} ms"
