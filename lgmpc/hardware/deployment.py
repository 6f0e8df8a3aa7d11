"""The loop that runs a controller on a robot in real time, through a driver.

The loop is clocked by the robot: each measurement that arrives is a tick. After any failure the last command written
is one that damps the joints.
"""

from __future__ import annotations

import enum
import gc
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np
from pydantic import Field

from lgmpc.control.interface import Command, CommandGuard, Controller, Estimator, Measurement, RobotState
from lgmpc.errors import cause_of
from lgmpc.settings import Positive, Settings
from lgmpc.typing import IntArray

__all__ = ["DeployedTick", "Deployment", "DeploymentSettings", "Driver", "Ending", "deploy"]

_LOG = logging.getLogger(__name__)
_MOST_LATE = 0.1
"""Share of late or unanswered measurements from which on a machine is too slow."""


class Driver(Protocol):
    """The interface of a robot's drives and sensors to the loop."""

    def read(self, timeout_s: float) -> Sequence[Measurement]:
        """Return the measurements that have arrived since the last call, oldest first.

        Waits for the first one, at most ``timeout_s``; empty if none arrived. Measurements are taken at the control
        rate; ``Measurement.time`` is the robot's clock.
        """

    def write(self, command: Command) -> None:
        """Send the command computed from the newest measurement; the drives apply it until the next one."""

    def close(self) -> None:
        """Close the link. From here on the robot is protected by its own watchdog only."""


class DeploymentSettings(Settings):
    """Limits of the loop that runs a controller on a robot in real time."""

    silence_s: Positive = Field(
        default=0.02, description="Time without a measurement after which the joints are damped, s."
    )
    lost_s: Positive = Field(default=1.0, description="Time without a measurement after which the run ends, s.")
    damping_nms: Positive = Field(
        default=0.1, description="Damping of each joint, N.m.s, while there is no valid command, and after the run."
    )


class Ending(enum.Enum):
    """Cause of the end of a run."""

    DURATION = "its duration is over"
    LOST = "no measurements arrive"
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
        replaced: whether the controller's command was not finite, and damping of the joints took its place.
        spent: time from the measurement's arrival until the command was written, s.
    """

    index: int
    measurement: Measurement
    state: RobotState
    command: Command
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
        late: number of commands written later than one period after their measurement's arrival.
        silences: number of times that the joints were damped because no measurement arrived.
        not_finite: number of commands that were not finite, replaced by damping of the joints.
        spent: (ticks,) time from each measurement's arrival until its command was written, s.
        failure: the exception that ended the run, in words; empty if none did.
        lowest_supply_v: lowest supply voltage; None where it was not measured.
        highest_temperature_c: highest temperature of a motor; None where it was not measured.
        error_flags: (nu,) all error flags that the drives reported; None where they report none.
    """

    ending: Ending
    ticks: int
    overtaken: int
    missing: int
    late: int
    silences: int
    not_finite: int
    spent: np.ndarray
    failure: str = ""
    lowest_supply_v: float | None = None
    highest_temperature_c: float | None = None
    error_flags: IntArray | None = None

    @property
    def too_slow(self) -> str:
        """Statement that this machine is too slow, with the remedy; empty if most commands were in time."""
        unanswered, count = self.late + self.overtaken, self.ticks + self.overtaken
        if unanswered <= _MOST_LATE * count:
            return ""
        median = 1e3 * float(np.median(self.spent))
        return (
            f"this machine is too slow: {unanswered} of {count} measurements were answered later than a period,"
            f" or never (median {median:.2g} ms): lower wbc.rate_hz and mpc.rate_hz, end other programs, or give the"
            " process a real-time priority (chrt --fifo 80)"
        )


def deploy(
    driver: Driver,
    controller: Controller,
    estimator: Estimator,
    *,
    period_s: float,
    duration_s: float,
    settings: DeploymentSettings | None = None,
    on_tick: Callable[[DeployedTick], None] = lambda tick: None,
) -> Deployment:
    """Run ``controller`` on a robot until ``duration_s`` of the robot's clock has passed.

    The joints are damped at the end, also after Ctrl-C or an exception; to end without a fall, command the robot to lie
    down first. Garbage collection is disabled during the run.

    Args:
        driver: driver of the robot; closed at the end.
        controller: computes a command for every measurement.
        estimator: estimator of the state.
        period_s: period of the measurements, s.
        duration_s: duration of the run, s.
        settings: see :class:`DeploymentSettings`.
        on_tick: called after each command has been written; it may raise KeyboardInterrupt to end the run.

    Returns:
        Figures of the run; an exception of driver, estimator, controller or ``on_tick`` is named in them and logged.
    """
    settings = DeploymentSettings() if settings is None else settings
    loop = _Loop(driver, controller, estimator, period_s, settings, on_tick)
    failure = ""
    try:
        with _no_garbage_collection():
            ending = loop.run(duration_s)
    except KeyboardInterrupt:
        ending = Ending.INTERRUPTED
    except (Exception, SystemExit) as error:
        ending, failure = Ending.FAILED, f"ended early, after {loop.ticks} ticks: {cause_of(error)}"
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


class _Loop:
    """The state of a run."""

    def __init__(
        self,
        driver: Driver,
        controller: Controller,
        estimator: Estimator,
        period: float,
        settings: DeploymentSettings,
        on_tick: Callable[[DeployedTick], None],
    ) -> None:
        self._driver, self._controller, self._estimator = driver, controller, estimator
        self._period, self._settings, self._on_tick = period, settings, on_tick
        self._guard = CommandGuard(settings.damping_nms)
        self._overtaken = self._missing = self._silences = 0
        self._volts, self._degrees = np.inf, -np.inf
        self._errors: IntArray | None = None
        self._spent: list[float] = []
        self._last: Measurement | None = None

    def run(self, duration: float) -> Ending:
        begun: float | None = None
        heard, silent = perf_counter(), False
        while True:
            readings = self._driver.read(self._settings.silence_s)
            now = perf_counter()
            if not readings:
                if now - heard > self._settings.lost_s:
                    _LOG.error("no measurement for %.1f s: the run ends", now - heard)
                    return Ending.LOST
                if begun is not None and not silent:
                    silent = True
                    self._silences += 1
                    _LOG.warning("no measurement for %.0f ms: the joints are damped", 1e3 * (now - heard))
                    self.damp()
                continue
            heard, silent = now, False
            begun = readings[0].time if begun is None else begun
            self._tick(readings, now)
            if readings[-1].time - begun > duration - 1.5 * self._period:
                return Ending.DURATION

    def damp(self) -> None:
        """Write the command that damps the joints."""
        if self._last is not None:
            joints = self._last.joints
            self._driver.write(Command.damping(np.zeros_like(joints), joints, self._settings.damping_nms))

    @property
    def ticks(self) -> int:
        """Number of commands written."""
        return len(self._spent)

    def figures(self, ending: Ending, failure: str) -> Deployment:
        spent = np.array(self._spent)
        late = int((spent > self._period).sum())
        counts = self._overtaken, self._missing, late, self._silences, self._guard.faults
        volts, degrees = self._volts, self._degrees
        status = volts if volts < np.inf else None, degrees if degrees > -np.inf else None, self._errors
        return Deployment(ending, spent.size, *counts, spent, failure, *status)

    def _tick(self, readings: Sequence[Measurement], arrived: float) -> None:
        for reading in readings:
            if self._last is not None:
                self._missing += max(0, round((reading.time - self._last.time) / self._period) - 1)
            self._last = reading
            self._watch(reading)
            state = self._estimator.update(reading)
        self._overtaken += len(readings) - 1
        output = self._controller.update(state)
        command = self._guard.check(output, state.time, reading.joints)
        self._driver.write(command)
        spent = perf_counter() - arrived
        self._spent.append(spent)
        self._on_tick(DeployedTick(len(self._spent) - 1, reading, state, command, command is not output, spent))

    def _watch(self, reading: Measurement) -> None:
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


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collect garbage once, then disable the collector, whose pauses would delay ticks."""
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
