"""The events of a run, from its log: pushes, commands, limits reached, contacts and solutions lost, late ticks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from lgmpc.runs.intervals import intervals, joined_intervals, push_intervals
from lgmpc.runs.limited import Limited
from lgmpc.runs.log import MODES, SENSOR_FAULTS, RunLog
from lgmpc.runs.metrics import tilt_and_yaw_deg
from lgmpc.runs.result import SettingsChange
from lgmpc.typing import Array, BoolArray

_JOINED_S = 0.05
"""Shorter gaps do not end an event."""
_OPEN_S = 0.01
"""A foot in stance that is unloaded for a shorter time bounces: no event."""
_TILT_OFF_DEG, _VELOCITY_OFF_M_S = 2.0, 0.2
"""Errors of the estimate above which it counts as wrong."""
_AT_LIMIT = 1e-3
"""A quantity within this share of its limit has reached it."""
_BRIEF_S = 0.005
"""A joint or a foot that is at its limit for a shorter time is not named."""
_NAMED = 3
"""Largest number of joints or feet named in an event."""
_SINGLE, _SINGLE_CHANGES = 3, 12
"""Largest number of events of one name, and of causes and changes of mode, with a line for each."""


class EventKind(Enum):
    """Role of an event in a failure."""

    CAUSE = "cause"
    """External: a push, a new command, changed settings."""
    LIMIT = "limit"
    """A joint or a friction cone at its limit."""
    CONTACT = "contact"
    """A foot that slides, or has no contact in stance."""
    BALANCE = "balance"
    """The capture point outside the support, the base too low or too tilted."""
    SOLVER = "solver"
    """A quadratic programme or an MPC update without a solution."""
    TIMING = "timing"
    """Ticks that were missed."""
    ESTIMATE = "estimate"
    """An estimate far from the truth."""
    MODE = "mode"
    """A change of the controller's mode."""

    @property
    def is_sign(self) -> bool:
        """Whether events of this kind precede a failure."""
        return self not in (EventKind.CAUSE, EventKind.MODE)


@dataclass(frozen=True)
class Event:
    """An interval of a run.

    Attributes:
        start_s: time of its first tick, s.
        end_s: time of its last tick, s.
        kind: role in a failure.
        name: common name of events of the same sort, by which they are counted.
        words: description with figures.
    """

    start_s: float
    end_s: float
    kind: EventKind
    name: str
    words: str


@dataclass(frozen=True)
class EventLine:
    """A line of a list: an event, or all events of one name if there are many, such as those of every step of a gait.

    Attributes:
        events: the events in order, at least one, of one kind.
    """

    events: tuple[Event, ...]

    @property
    def kind(self) -> EventKind:
        """Role of the events in a failure."""
        return self.events[0].kind

    @property
    def start_s(self) -> float:
        """Time of the first tick, s."""
        return self.events[0].start_s

    @property
    def lasting_s(self) -> float:
        """Sum of the durations, s."""
        return sum(each.end_s - each.start_s for each in self.events)

    @property
    def words(self) -> str:
        """Description of the event; of several, of the longest, with their number."""
        if len(self.events) == 1:
            return self.events[0].words
        longest = max(self.events, key=lambda each: each.end_s - each.start_s)
        among = f"the longest of {len(self.events)} until {self.events[-1].end_s:.3f} s"
        return f"{longest.words} (at {longest.start_s:.3f} s, {among})"


def event_lines(events: Sequence[Event]) -> tuple[EventLine, ...]:
    """Return the events as lines of a list, in order of their start."""
    named: dict[str, list[Event]] = {}
    for each in events:
        named.setdefault(each.name, []).append(each)
    lines: list[EventLine] = []
    for alike in named.values():
        many = len(alike) > (_SINGLE if alike[0].kind.is_sign else _SINGLE_CHANGES)
        lines += [EventLine(tuple(alike))] if many else [EventLine((each,)) for each in alike]
    return tuple(sorted(lines, key=lambda line: events.index(line.events[0])))


def find_events(
    log: RunLog, quantities: Sequence[Limited], changes: Sequence[SettingsChange] = ()
) -> tuple[Event, ...]:
    """Return the events of a log, in order of their start.

    Args:
        log: log, finite throughout.
        quantities: quantities with limits, see :func:`lgmpc.runs.limited.limited_quantities`.
        changes: of settings during the run.
    """
    finders: tuple[Callable[[RunLog], Iterator[Event]], ...] = (
        _pushes,
        _commands,
        _contacts,
        _solvers,
        _missed,
        _estimates,
        _sensors,
        _motors,
        _modes,
    )
    found = [event for find in finders for event in find(log)]
    for quantity in quantities:
        found += _reached(log, quantity)
    for change in changes:
        words = f"settings changed: {change.differences}"
        found.append(Event(change.time_s, change.time_s, EventKind.CAUSE, "settings", words))
    # Of events that begin at the same tick, the cause is first.
    return tuple(sorted(found, key=lambda each: (each.start_s, list(EventKind).index(each.kind))))


def _episodes(time: Array, flags: BoolArray) -> list[tuple[int, int]]:
    return joined_intervals(time, flags, _JOINED_S)


def _event(log: RunLog, span: tuple[int, int], kind: EventKind, name: str, words: str) -> Event:
    return Event(float(log.time[span[0]]), float(log.time[span[1] - 1]), kind, name, words)


def _period(log: RunLog) -> float:
    return float(np.median(np.diff(log.time)))


def _involved(log: RunLog, flags: BoolArray, names: Sequence[str], span: tuple[int, int]) -> str:
    """Return the joints or feet of an interval in the order in which their flags (n, k) rose, with durations."""
    part = flags[span[0] : span[1]]
    order = np.argsort(np.where(part.any(axis=0), part.argmax(axis=0), len(part)), kind="stable")
    shown = []
    for k in [k for k in order if part[:, k].any()]:
        begin = float(log.time[span[0] + int(part[:, k].argmax())])
        duration = f"{1e3 * part[:, k].sum() * _period(log):.0f} ms"
        late = begin - float(log.time[span[0]])
        shown.append(f"{names[k]} ({duration}{f', from {begin:.3f} s' if late > _JOINED_S else ''})")
    rest = f" and {len(shown) - _NAMED} more" if len(shown) > _NAMED else ""
    return ", ".join(shown[:_NAMED]) + rest


def _pushes(log: RunLog) -> Iterator[Event]:
    for push in push_intervals(log):
        x, y, z = push.impulse
        size = float(np.linalg.norm(push.impulse))
        words = f"push of {size:.3g} N.s [{x:.3g}, {y:.3g}, {z:.3g}] for {1e3 * (push.end - push.start):.0f} ms"
        yield Event(push.start, push.end, EventKind.CAUSE, "push", words)


def _commands(log: RunLog) -> Iterator[Event]:
    """Yield the ends of the ramps of the motion command, with the command reached."""
    moving = np.zeros(log.ticks, dtype=bool)
    moving[1:] = np.any(np.diff(log.command, axis=0) != 0.0, axis=1)
    for span in _episodes(log.time, moving):
        ahead, left, turn = log.command[span[1] - 1]
        words = f"command of {ahead:.3g} m/s ahead, {left:.3g} m/s to the left, {turn:.3g} rad/s"
        yield _event(log, span, EventKind.CAUSE, "command", words)


def _contacts(log: RunLog) -> Iterator[Event]:
    """Yield the intervals in which feet are unloaded although the controller assumes contact."""
    feet = [*log.feet]
    if not feet:
        return
    on_feet = np.isin(log.mode, [MODES.index(mode) for mode in ("stand", "locomote", "recover")])
    missing = (log.stance != 0) & on_feet[:, None] & ~log.touching
    for foot in range(len(feet)):
        for a, b in intervals(missing[:, foot]):
            if log.time[b - 1] - log.time[a] < _OPEN_S:
                missing[a:b, foot] = False
    for span in _episodes(log.time, missing.any(axis=1)):
        words = f"without contact where the controller relies on it: {_involved(log, missing, feet, span)}"
        yield _event(log, span, EventKind.CONTACT, "contact lost", words)


def _solvers(log: RunLog) -> Iterator[Event]:
    failed: BoolArray = log.wbc_status != 0
    for span in _episodes(log.time, failed):
        part = log.wbc_status[slice(*span)]
        unsolved, replaced = np.count_nonzero((part != 0) & (part != 2)), np.count_nonzero(part == 2)
        if unsolved:
            words = f"whole-body QP without a solution in {unsolved} ticks: fallback torques"
            yield _event(log, span, EventKind.SOLVER, "whole-body QP", words)
        if replaced:
            words = f"commands that were not finite in {replaced} ticks: joints damped"
            yield _event(log, span, EventKind.SOLVER, "command", words)
    failed = log.mpc_status != 0
    for a, b in intervals(failed):
        plan = f"the plan of {log.mpc_time[max(a - 1, 0)]:.3f} s remained in use"
        words = f"{b - a} MPC updates without a solution: {plan}"
        yield Event(float(log.mpc_time[a]), float(log.mpc_time[b - 1]), EventKind.SOLVER, "MPC", words)


def _missed(log: RunLog) -> Iterator[Event]:
    """Yield the gaps of the log: ticks that were due while an earlier one was computed."""
    period = _period(log)
    gaps: BoolArray = np.diff(log.time) > 1.5 * period
    for span in _episodes(log.time[:-1], gaps):
        longest = 1e3 * float(np.diff(log.time)[span[0] : span[1]].max())
        words = f"{int(gaps[span[0] : span[1]].sum())} times ticks were missed, for up to {longest:.3g} ms"
        yield _event(log, (span[0], span[1] + 1), EventKind.TIMING, "missed ticks", words)


def _estimates(log: RunLog) -> Iterator[Event]:
    if log.estimate_q is None or log.estimate_v is None:
        return
    tilt, _ = tilt_and_yaw_deg(log.estimate_q[:, 3:7], log.q[:, 3:7])
    velocity = np.linalg.norm(log.estimate_v[:, :3] - log.v[:, :3], axis=1)
    off: BoolArray = (tilt > _TILT_OFF_DEG) | (velocity > _VELOCITY_OFF_M_S)
    for span in _episodes(log.time, off):
        part = slice(*span)
        words = f"estimate off by up to {tilt[part].max():.3g} deg of tilt and {velocity[part].max():.3g} m/s"
        yield _event(log, span, EventKind.ESTIMATE, "estimate", words)


def _sensors(log: RunLog) -> Iterator[Event]:
    if log.sensor_faults is None:
        return
    for span in _episodes(log.time, log.sensor_faults != 0):
        part = log.sensor_faults[slice(*span)]
        found = int(np.bitwise_or.reduce(part))
        names = " and ".join(name for bit, name in enumerate(SENSOR_FAULTS) if found & 1 << bit)
        words = f"readings of {names} that cannot be true, replaced in {np.count_nonzero(part)} ticks"
        yield _event(log, span, EventKind.ESTIMATE, "sensors", words)


def _motors(log: RunLog) -> Iterator[Event]:
    if log.motor_shares is None:
        return
    for tick, joint in np.argwhere(np.diff(log.motor_shares, axis=0) != 0.0).tolist():
        share = float(log.motor_shares[tick + 1, joint])
        words = f"the motor of {log.joint_names[joint]} detected to give {100.0 * share:.0f} % of its torque"
        yield _event(log, (tick + 1, tick + 2), EventKind.LIMIT, "motor", words)


def _modes(log: RunLog) -> Iterator[Event]:
    for tick in (np.flatnonzero(np.diff(log.mode)) + 1).tolist():
        words = f"mode {MODES[log.mode[tick - 1]]} became {MODES[log.mode[tick]]}"
        yield _event(log, (tick, tick + 1), EventKind.MODE, "mode", words)


_BALANCE = ("capture point", "tilt", "base height", "displacement")


def _reached(log: RunLog, quantity: Limited) -> Iterator[Event]:
    used = quantity.used
    with np.errstate(invalid="ignore"):
        reached = used >= 1.0 - _AT_LIMIT
    kind = EventKind.LIMIT
    if quantity.name in _BALANCE:
        kind = EventKind.BALANCE
        reached = _held(reached, np.isnan(used))
    elif quantity.name == "slip":
        kind = EventKind.CONTACT
    for a, b in _episodes(log.time, np.asarray(reached.any(axis=1))):
        if kind is EventKind.LIMIT and reached[a:b].sum(axis=0).max() * _period(log) < _BRIEF_S:
            continue
        words = _beyond(log, quantity, reached, (a, b))
        yield _event(log, (a, b), kind, quantity.name, words)


def _held(flags: BoolArray, unknown: BoolArray) -> BoolArray:
    """Return (n, k) flags, unknown ones replaced by the last known: in flight no support polygon is left or entered."""
    last = np.maximum.accumulate(np.where(unknown, 0, np.arange(len(flags))[:, None]), axis=0)
    return np.take_along_axis(flags, last, axis=0)


def _beyond(log: RunLog, quantity: Limited, reached: BoolArray, span: tuple[int, int]) -> str:
    """Describe an episode at or beyond a limit by its worst tick."""
    part = np.where(np.isfinite(quantity.used), quantity.used, -np.inf)[span[0] : span[1]]
    tick, subject = np.unravel_index(int(np.argmax(part)), part.shape)
    at = (span[0] + int(tick), int(subject))
    value, limit, unit = float(quantity.values[at]), float(quantity.limits[at]), quantity.unit
    if quantity.name == "capture point":
        return f"capture point outside the support by up to {-value:.3g} {unit}"
    if quantity.subjects == ("",):
        return f"{quantity.name} beyond its limit of {limit:.3g} {unit}: {value:.3g} {unit}"
    if quantity.name == "friction":
        involved = _involved(log, log.of_feet(np.logical_or, reached), [*log.feet], span)
        return f"friction cone (coefficient {log.friction_of_feet[at]:.3g}) used up: {involved}"
    involved = _involved(log, reached, quantity.subjects, span)
    if quantity.name == "slip":
        return f"feet slid by up to {value:.3g} {unit}: {involved}"
    worst = f", up to {value:.3g}" if abs(value) > (1.0 + _AT_LIMIT) * abs(limit) else ""
    return f"{quantity.name} at its limit of {limit:.3g} {unit}{worst}: {involved}"
