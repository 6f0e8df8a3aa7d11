"""A simulated robot at the end of a link, with its controller in another process, as for a real robot."""

import logging
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from signal import Signals
from time import perf_counter
from typing import Protocol

import numpy as np

from lgmpc.control.interface import Command, Measurement, RobotState
from lgmpc.errors import Interrupted, LgmpcError
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Hardware, Loop, Sensing, Tick
from lgmpc.simulation.plant import Plant
from lgmpc.simulation.sensors import Sensors
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array
from lgmpc.world import Terrain

_LOG = logging.getLogger(__name__)

_FIRST_S = 60.0
"""Longest time until the first command, s: a controller may compile before it."""

_GONE_S = 2.0
"""Time without a command after which a controller is assumed to have ended, s."""

_WATCHDOG_S = 0.05
"""Age of the last command beyond which the drives damp the joints by themselves, s, as those of real robots do."""

_WATCHDOG_DAMPING = 0.1  # N.m.s

_MOST_SENT = 4096
"""Measurements whose times are kept; commands for older ones are as good as none."""


class NoControllerError(LgmpcError):
    """No controller is connected to the other end of the link."""

    exit_code = 1


class RobotLink(Protocol):
    """The robot's end of a link."""

    @property
    def place(self) -> str:
        """The address for controllers, in words."""

    def wait_for_controller(self, timeout_s: float) -> bool:
        """Wait for a controller, and return whether one came."""

    def send(self, measurement: Measurement) -> None:
        """Send the next measurement."""

    def receive(self) -> tuple[int, Command] | None:
        """Return the newest command that has arrived, if any, and how many measurements ago its own was sent."""

    def receive_answer(self, timeout_s: float) -> Command | None:
        """Wait for the command to the last measurement; None if it does not arrive."""

    def close(self) -> None:
        """Close the link."""


class LockStep:
    """The robot waits for the command to each measurement: simulated time is independent of the clock.

    Args:
        link: the robot's end of the link.
        timeout_s: longest time to wait, s.
    """

    def __init__(self, link: RobotLink, timeout_s: float = _FIRST_S) -> None:
        self._link, self._timeout = link, timeout_s
        self.behind = self.unanswered = 0

    def answer(self, measurement: Measurement) -> Command:
        """Send the measurement and wait for its command."""
        self._link.send(measurement)
        command = self._link.receive_answer(self._timeout)
        if command is None:
            raise NoControllerError(f"no command within {self._timeout:g} s")
        return command


class RealTime:
    """Simulated time follows the clock from the first command on; a command acts from the tick after its arrival.

    Before the first command the robot is held, and measures that with the time of its clock.

    Args:
        link: the robot's end of the link.
        period_s: period of the ticks, s.

    Attributes:
        behind: ticks that began more than a period late, because the simulation or the machine was too slow; the
            robot's clock is set back by that time.
        unanswered: ticks at which the measurement of the last command was older than the drives' watchdog allows.
    """

    def __init__(self, link: RobotLink, period_s: float) -> None:
        self._link, self._period = link, period_s
        self._start, self._held = math.nan, 0.0  # of the clock; before the first command
        self._command: Command | None = None
        self._sent: deque[float] = deque(maxlen=_MOST_SENT)
        self._answered = 0.0  # when the measurement was taken from which the command was computed
        self.behind = self.unanswered = 0

    def answer(self, measurement: Measurement) -> Command:
        """Wait for the measurement's time, send it, and return the newest command that has arrived."""
        if self._command is None:
            return self._hold(measurement)
        measurement = measurement._replace(time=measurement.time + self._held)
        now = self._wait(self._start + measurement.time) - self._start
        if now > measurement.time + self._period:
            self.behind += 1
            self._start += now - measurement.time
        self._exchange(measurement)
        silence = measurement.time - self._answered
        if silence > _GONE_S:
            raise NoControllerError(f"no command for {silence:.1f} s")
        if silence > _WATCHDOG_S:
            self.unanswered += 1
            joints = measurement.joints
            return Command.damping(np.zeros_like(joints), joints, _WATCHDOG_DAMPING)
        return self._command

    def _hold(self, measurement: Measurement) -> Command:
        """Send the first measurement at every period until a command arrives, and return it."""
        self._start, first = perf_counter() - measurement.time, measurement.time
        while self._command is None:
            if self._held > _FIRST_S:
                raise NoControllerError(f"no command within {_FIRST_S:g} s")
            self._exchange(measurement._replace(time=first + self._held))
            if self._command is None:
                self._held += self._period
                self._wait(self._start + first + self._held)
        return self._command

    def _exchange(self, measurement: Measurement) -> None:
        self._link.send(measurement)
        self._sent.append(measurement.time)
        newest = self._link.receive()
        if newest is not None and newest[0] < len(self._sent):
            self._command, self._answered = newest[1], self._sent[-1 - newest[0]]

    @staticmethod
    def _wait(until: float) -> float:
        while (left := until - perf_counter()) > 0.0:
            time.sleep(left)
        return perf_counter()


class _Sent:
    """Takes the place of the estimator in the loop of a simulation: stores the measurement for :class:`_Answered`."""

    def __init__(self) -> None:
        self.measurement: Measurement | None = None
        self._nothing = np.empty(0)

    def update(self, measurement: Measurement) -> RobotState:
        self.measurement = measurement
        return RobotState(measurement.time, self._nothing, self._nothing)


class _Answered:
    """Takes the place of the controller in the loop of a simulation: exchanges measurement and command by the link."""

    def __init__(self, sent: _Sent, pace: LockStep | RealTime) -> None:
        self._sent, self._pace = sent, pace

    def update(self, state: RobotState) -> Command:
        assert self._sent.measurement is not None
        return self._pace.answer(self._sent.measurement)


@dataclass(frozen=True)
class Served:
    """The true motion of a robot at the end of a link.

    Attributes:
        time: (n,) times of the ticks, s.
        q: (n, nq) configuration.
        v: (n, nv) velocity.
        normals: (n, 3) of the ground below the base.
        ending: cause of the end, in words.
        signal: the signal that ended it; None if none did.
        behind: see :class:`RealTime`.
        unanswered: see :class:`RealTime`.
    """

    time: Array
    q: Array
    v: Array
    normals: Array
    ending: str
    behind: int = 0
    unanswered: int = 0
    signal: Signals | None = None

    @property
    def max_tilt_deg(self) -> float:
        """Largest angle between the base's vertical axis and the normal of the ground, degrees."""
        x, y, z, w = self.q[:, 3:7].T
        axis = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)
        return math.degrees(math.acos(float(np.clip(np.vecdot(axis, self.normals), -1.0, 1.0).min())))

    @property
    def final_displacement_m(self) -> float:
        """Horizontal distance of the base from its initial position, m."""
        return float(np.linalg.norm(self.q[-1, :2] - self.q[0, :2]))


def serve(
    plant: Plant,
    sensors: Sensors,
    pushes: PushSchedule,
    ticks: TimeGrid,
    pace: LockStep | RealTime,
    ground: Terrain,
    hardware: Hardware | None = None,
    on_tick: Callable[[float], None] = lambda time: None,
) -> Served:
    """Simulate a robot until its duration is over, its controller has ended, or a signal stops it.

    Args:
        plant: plant, reset to the initial state.
        sensors: sensors of the robot.
        pushes: disturbances.
        ticks: at which they exchange.
        pace: timing of the exchange with the controller.
        ground: of the plant's world.
        hardware: drives and delays that commands pass through besides the link; none unless given.
        on_tick: called at every tick with the simulated time.
    """
    sent, stopped = _Sent(), None
    states: list[tuple[float, Array, Array]] = []

    def record(tick: Tick) -> bool:
        states.append((tick.sample.time, tick.sample.q, tick.sample.v))
        on_tick(tick.sample.time)
        return True

    ending = "the duration is over"
    try:
        Loop(plant, _Answered(sent, pace), pushes, ticks, Sensing(sensors, sent), hardware).run(record)
    except NoControllerError as error:
        if not states:
            raise
        ending = str(error)
        _LOG.info("the robot ends: %s", ending)
    except KeyboardInterrupt as error:
        if not states:
            raise
        stopped = error.signal if isinstance(error, Interrupted) else Signals.SIGINT
        ending = f"it was stopped by {stopped.name}"
    times, qs, vs = (np.array(each) for each in zip(*states, strict=True))
    return Served(times, qs, vs, ground.normal(qs[:, :2]), ending, pace.behind, pace.unanswered, stopped)
