"""The loop that runs a controller on a robot in real time, through a driver.

The loop is clocked by the robot: each measurement that arrives is a tick. After any failure the last command written
is one that damps the joints.
"""

import enum
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np

from lgmpc.control import interface
from lgmpc.errors import cause_of
from lgmpc.hardware.realtime import real_time
from lgmpc.hardware.safety import DeploymentSettings, JointLimits, Operator, Safety
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import IntArray, typed

_LOG = logging.getLogger(__name__)
_MOST_LATE = 0.1
"""Share of late or unanswered measurements from which on a machine is too slow."""
_LIE_DOWN_S = 5.0
"""Time for lying down at the user's request where the settings have none."""


class Driver(Protocol):
    """The interface of a robot's drives and sensors to the loop."""

    def read(self, timeout_s: float) -> Sequence[interface.Measurement]:
        """Return the measurements that have arrived since the last call, oldest first.

        Waits for the first one, at most ``timeout_s``; empty if none arrived. Measurements are taken at the control
        rate; ``Measurement.time`` is the robot's clock.
        """

    def write(self, command: interface.Command) -> None:
        """Send the command computed from the newest measurement; the drives apply it until the next one."""

    def close(self) -> None:
        """Close the link. From here on the robot is protected by its own watchdog only."""


class StopReason(enum.Enum):
    """Cause of the end of a run."""

    DURATION = "its duration is over"
    LOST = "no measurements arrive"
    CLOCK = "the robot's clock jumped or stands still"
    LIMIT = "a limit of the section deployment was exceeded"
    STOPPED = "emergency stop"
    INTERRUPTED = "it was stopped by the user"
    FAILED = "an exception of driver, estimator or controller"


@dataclass(frozen=True)
class DeployedTick:
    """One tick, after its command has been written.

    Attributes:
        index: number of the tick.
        measurement: the newest measurement.
        state: the estimate that the controller received.
        command: the command written.
        replaced: whether the controller's command was refused, and damping of the joints took its place.
        spent: time from the measurement's arrival until the command was written, s.
    """

    index: int
    measurement: interface.Measurement
    state: interface.RobotState
    command: interface.Command
    replaced: bool
    spent: float


@dataclass(frozen=True)
class Deployment:
    """Figures of a run on a robot.

    Attributes:
        ending: cause of the end.
        ticks: number of measurements followed by a command.
        overtaken: number of measurements read together with a newer one, processed by the estimator but without a
            command of their own.
        missing: number of measurements that never arrived, by the robot's clock.
        misdated: number of measurements that were ignored because of their time: before the last one, or far after it.
        late: number of commands written later than one period after their measurement's arrival.
        silences: number of times that the joints were damped because no measurement arrived.
        refused: number of commands that were not finite or beyond all bounds, replaced by damping of the joints.
        spent: (ticks,) time from each measurement's arrival until its command was written, s.
        failure: the exception, limit, clock or emergency stop that ended the run, in words; empty if none did.
        lowest_supply_v: lowest supply voltage; None where it was not measured.
        highest_temperature_c: highest temperature of a motor; None where it was not measured.
        error_flags: (nu,) all error flags that the drives reported; None where they report none.
    """

    ending: StopReason
    ticks: int
    overtaken: int
    missing: int
    misdated: int
    late: int
    silences: int
    refused: int
    spent: np.ndarray
    failure: str = ""
    lowest_supply_v: float | None = None
    highest_temperature_c: float | None = None
    error_flags: IntArray | None = None

    @property
    def too_slow(self) -> str:
        """Statement that this machine is too slow, with the remedy; empty if most commands were in time.

        A robot whose measurements are never overtaken has waited for its commands: in lock step none is too late.
        """
        unanswered, count = self.late + self.overtaken, self.ticks + self.overtaken
        if unanswered <= _MOST_LATE * count or not self.overtaken:
            return ""
        median = 1e3 * float(np.median(self.spent))
        return (
            f"this machine is too slow: {unanswered} of {count} measurements were answered later than a period,"
            f" or never (median {median:.2g} ms): lower wbc.rate_hz and mpc.rate_hz, end other programs, or set"
            " deployment.priority"
        )


@typed
def deploy(
    driver: Driver,
    controller: interface.Controller,
    estimator: interface.Estimator,
    *,
    ticks: TimeGrid,
    settings: DeploymentSettings | None = None,
    after_command: Callable[[], None] = lambda: None,
    on_tick: Callable[[DeployedTick], None] = lambda tick: None,
    limits: JointLimits | None = None,
    operator: Operator | None = None,
) -> Deployment:
    """Run ``controller`` on a robot until ``ticks`` are over by the robot's clock.

    The joints are damped at the end, also after Ctrl-C or an exception. Times that estimator and controller receive are
    counted from the first measurement. Garbage collection is disabled during the run.

    Args:
        driver: driver of the robot; closed at the end.
        controller: computes a command for every measurement.
        estimator: estimator of the state.
        ticks: of the measurements.
        settings: see :class:`DeploymentSettings`.
        after_command: called after each command has been written, to compute what only the next one needs.
        on_tick: called after that; it may raise KeyboardInterrupt to end the run.
            Not called while the robot lies down at the end.
        limits: of the joints; without them speeds, torques and gains are not limited.
        operator: emergency stop, arming and lying down; the controller's source of commands reads ``operator.lies``.

    Returns:
        Figures of the run; an exception of driver, estimator, controller or ``on_tick`` is named in them and logged.
    """
    settings = DeploymentSettings() if settings is None else settings
    operator = Operator() if operator is None else operator
    loop = _Loop(driver, controller, estimator, ticks.period, settings, after_command, on_tick, limits, operator)
    failure = ""
    try:
        with real_time(settings.priority, settings.cores):
            ending = loop.run(ticks.end)
    except KeyboardInterrupt:
        ending = StopReason.INTERRUPTED
    except _Stop as stop:
        ending, failure = stop.ending, stop.reason
        if failure:
            _LOG.error("the run ended: %s", failure)
    except (Exception, SystemExit) as error:
        ending, failure = StopReason.FAILED, f"ended early, after {loop.ticks} ticks: {cause_of(error)}"
        _LOG.error("the run %s", failure, exc_info=error)
    try:
        loop.damp()
    except OSError as error:
        _LOG.error("the joints could not be damped: %s", error)
    finally:
        driver.close()
    figures = loop.figures(ending, failure)
    if figures.too_slow:
        _LOG.warning("%s", figures.too_slow)
    return figures


class _Stop(Exception):
    """The end of a run before its duration is over."""

    def __init__(self, ending: StopReason, reason: str = "") -> None:
        super().__init__(reason)
        self.ending, self.reason = ending, reason


class _Loop:
    """The state of a run."""

    def __init__(
        self,
        driver: Driver,
        controller: interface.Controller,
        estimator: interface.Estimator,
        period: float,
        settings: DeploymentSettings,
        after_command: Callable[[], None],
        on_tick: Callable[[DeployedTick], None],
        limits: JointLimits | None,
        operator: Operator,
    ) -> None:
        self._driver, self._controller, self._estimator = driver, controller, estimator
        self._period, self._settings, self._operator = period, settings, operator
        self._after_command, self._on_tick = after_command, on_tick
        self._guard = interface.CommandGuard(
            settings.damping_nms, None if limits is None else interface.command_limits(limits.effort)
        )
        self._safety = Safety(settings, limits, period)
        self._overtaken = self._missing = self._silences = self._misdated = 0
        self._volts, self._degrees = np.inf, -np.inf
        self._errors: IntArray | None = None
        self._spent: list[float] = []
        self._last: interface.Measurement | None = None  # by the robot's clock
        self._heard = perf_counter()
        self._begun = math.nan  # by the robot's clock
        self._wrong_clock = ""

    def run(self, duration: float) -> StopReason:
        """Answer measurements until the duration is over, and the robot has lain down, unless a _Stop ends it."""
        silent, operator, settings = False, self._operator, self._settings
        end, lying, by_user = duration - 1.5 * self._period, False, False
        waiting: list[interface.Measurement] = []  # of a robot that waits for the answer to its first one
        while True:
            found = self._driver.read(settings.silence_s)
            now = perf_counter()
            operator.poll()
            if operator.stop:
                raise _Stop(StopReason.STOPPED, operator.stop)
            readings = self._dated(found, now)
            if operator.armed and not readings:
                readings, waiting = waiting, []
            if not readings:
                silence = now - self._heard
                if silence > settings.lost_s:
                    raise self._lost(silence)
                if self._spent and not silent and silence >= settings.silence_s:
                    silent = True
                    self._silences += 1
                    _LOG.warning("no measurement for %.0f ms: the joints are damped", 1e3 * silence)
                    self.damp()
                continue
            self._heard, silent = now, False
            if not (self._spent or operator.armed):
                waiting = readings[-1:]
                continue  # nothing is sent before
            waiting = []
            self._begun = readings[0].time if math.isnan(self._begun) else self._begun
            elapsed = readings[-1].time - self._begun
            if operator.lies and not lying:
                lying = by_user = True
                end = elapsed + (settings.lie_down_s or _LIE_DOWN_S)
            self._tick([_since(self._begun, each) for each in readings], now, recorded=not lying)
            if elapsed <= end:
                continue
            if lying or settings.lie_down_s == 0.0:
                return StopReason.INTERRUPTED if by_user else StopReason.DURATION
            lying = operator.lies = True
            end = elapsed + settings.lie_down_s

    def damp(self) -> None:
        """Write the command that damps the joints."""
        if self._spent and self._last is not None:
            joints = self._last.joints
            self._driver.write(interface.Command.damping(np.zeros_like(joints), joints, self._settings.damping_nms))

    @property
    def ticks(self) -> int:
        """Number of commands written."""
        return len(self._spent)

    def figures(self, ending: StopReason, failure: str) -> Deployment:
        """Return the figures of the run so far."""
        spent = np.array(self._spent)
        late = int((spent > self._period).sum())
        counts = self._overtaken, self._missing, self._misdated, late, self._silences, self._guard.faults
        volts, degrees = self._volts, self._degrees
        status = volts if volts < np.inf else None, degrees if degrees > -np.inf else None, self._errors
        return Deployment(ending, spent.size, *counts, spent, failure, *status)

    def _dated(self, readings: Sequence[interface.Measurement], now: float) -> list[interface.Measurement]:
        """Return the readings whose times follow the last one's, as this machine's clock confirms, and log others."""
        valid = []
        for reading in readings:
            if self._last is not None:
                gap = reading.time - self._last.time
                if not 0.25 * self._period <= gap <= now - self._heard + self._settings.lost_s:
                    self._misdated += 1
                    if not self._wrong_clock:
                        self._wrong_clock = (
                            f"the robot's clock {'jumped' if gap else 'stands still'}: a measurement at"
                            f" {reading.time:.6g} s follows one at {self._last.time:.6g} s"
                        )
                        _LOG.warning("%s; it is ignored", self._wrong_clock)
                    continue
                self._missing += max(0, round(gap / self._period) - 1)
            self._last, self._wrong_clock = reading, ""
            valid.append(reading)
        return valid

    def _lost(self, silence: float) -> _Stop:
        """Return the end of a run after a time without a valid measurement."""
        _LOG.error("no measurement for %.1f s: the run ends", silence)
        if self._wrong_clock:
            return _Stop(StopReason.CLOCK, self._wrong_clock)
        never = "no measurement arrived: is the robot on, and is this its address?"
        return _Stop(StopReason.LOST, never if self._last is None else "")

    def _tick(self, readings: Sequence[interface.Measurement], arrived: float, *, recorded: bool) -> None:
        """Answer the newest of some measurements."""
        for reading in readings:
            self._watch(reading)
            exceeded = self._safety.exceeded(reading)
            if exceeded:
                raise _Stop(StopReason.LIMIT, f"{exceeded}, at {reading.time:.3f} s")
            state = self._estimator.update(reading)
        self._overtaken += len(readings) - 1
        output = self._controller.update(state)
        command = self._guard.check(output, state.time, reading.joints)
        replaced = command is not output
        command = self._safety.shaped(command, state.time)
        if not self._operator.armed:
            self._safety.restart()
            command = interface.Command.damping(np.zeros_like(command.tau), reading.joints, self._settings.damping_nms)
        self._driver.write(command)
        spent = perf_counter() - arrived
        self._spent.append(spent)
        self._after_command()
        if recorded:
            self._on_tick(DeployedTick(len(self._spent) - 1, reading, state, command, replaced, spent))

    def _watch(self, reading: interface.Measurement) -> None:
        """Keep extremes of supply and temperature, and log each error flag of a drive when it first appears."""
        if reading.supply_voltage is not None:
            self._volts = min(self._volts, reading.supply_voltage)
        if reading.motor_temperature is not None:
            self._degrees = max(self._degrees, float(reading.motor_temperature.max()))
        flags = reading.error_flags
        if flags is not None:
            before = np.zeros_like(flags) if self._errors is None else self._errors
            for joint in np.flatnonzero(flags & ~before).tolist():
                _LOG.error("the drive of joint %d reports error 0x%x at %.3f s", joint, int(flags[joint]), reading.time)
            self._errors = before | flags


def _since(begun: float, reading: interface.Measurement) -> interface.Measurement:
    """Return the reading with its time counted from the first one's."""
    return reading._replace(time=reading.time - begun) if begun else reading
