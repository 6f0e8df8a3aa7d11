"""Protection of a robot beside its controller: limits, a slow start, and the person who watches it."""

import math
import os
import select
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lgmpc.control.interface import Command, Measurement
from lgmpc.settings import NonNegative, Positive, Settings, key
from lgmpc.typing import Array

_SERIES = 3
"""Consecutive measurements beyond a limit that stop a robot: one may be a fault of a sensor."""


class DeploymentSettings(Settings):
    """Limits of the loop that runs a controller on a robot in real time, and the loop's rights on this machine."""

    silence_s: Positive = key(0.02, "Time without a measurement after which the joints are damped, s.")
    lost_s: Positive = key(1.0, "Time without a measurement after which the run ends, s.")
    damping_nms: Positive = key(0.1, "Damping of each joint, N.m.s, while there is no valid command and after the run.")
    soft_start_s: NonNegative = key(0.0, "Time in which torques and gains rise from damped joints' at the start, s.")
    lie_down_s: NonNegative = key(
        0.0,
        "Time for lying down after the duration, or at the user's request, before the joints are damped, s."
        " Not part of the run that is judged.",
    )
    max_torque_share: Positive = key(1.0, "Feed-forward torque over the joint's limit; a greater one is cut.")
    max_speed_share: Positive | None = key(2.0, "Speed of a joint over its limit that stops the robot; null: any.")
    max_temperature_c: Positive = key(80.0, "Temperature of a motor that stops the robot, where measured, Celsius.")
    max_rms_torque_share: Positive | None = key(
        None,
        "RMS of a joint's torque over its limit that stops the robot, averaged over rms_torque_s; null: any"
        " torque for any time.",
    )
    rms_torque_s: Positive = key(10.0, "Time constant of that average, s.")
    priority: Annotated[int, Field(strict=True, ge=0, le=99)] = key(
        0, "Real-time priority (SCHED_FIFO) of the loop, whose memory is locked then; 0: that of any program."
    )
    planning: Literal["in_tick", "after_command", "own_process"] = key(
        "after_command",
        "When the MPC plans: before the command of its tick, as in a simulation; after that command, which"
        " follows the plan before, except where steps against pushes are forecast (locomotion.reaction), which need the"
        " plan at once; or in a process of its own, for which the loop does not wait: for models whose update takes"
        " longer than a tick.",
    )
    cores: tuple[Annotated[int, Field(strict=True, ge=0)], ...] = key(
        (), "Processor cores that the loop may use; none named: all."
    )


class JointLimits(NamedTuple):
    """Limits of a robot's joints.

    Attributes:
        names: (nu,) of the joints.
        effort: (nu,) N.m.
        speed: (nu,) rad/s.
    """

    names: Sequence[str]
    effort: Array
    speed: Array


class Safety:
    """Limits of measurements and commands.

    Args:
        settings: see :class:`DeploymentSettings`.
        limits: of the robot's joints; None if they are unknown: temperatures alone are limited then.
        period: of the measurements, s.
    """

    def __init__(self, settings: DeploymentSettings, limits: JointLimits | None, period: float) -> None:
        self._settings, self._limits, self._fast, self._hot = settings, limits, 0, 0
        self._start = math.nan
        self._forget = period / settings.rms_torque_s
        self._square: Array | float = 0.0

    def restart(self) -> None:
        """Let torques and gains rise again from the next command on."""
        self._start = math.nan

    def exceeded(self, reading: Measurement) -> str:
        """Return which limit of the section ``deployment`` a measurement exceeds, in words; empty if none."""
        settings, limits = self._settings, self._limits
        hot = reading.motor_temperature
        self._hot = self._hot + 1 if hot is not None and hot.max() > settings.max_temperature_c else 0
        if self._hot >= _SERIES and hot is not None:
            joint = int(hot.argmax())
            return (
                f"{self._name(joint)} has {hot[joint]:.3g} degrees (max_temperature_c {settings.max_temperature_c:g})"
            )
        if limits is None:
            return ""
        if settings.max_speed_share is not None:
            most = settings.max_speed_share
            shares = np.abs(reading.speeds) / limits.speed
            self._fast = self._fast + 1 if shares.max() > most else 0
            if self._fast >= _SERIES:
                joint = int(shares.argmax())
                what = f"{reading.speeds[joint]:.3g} rad/s, not at most {most * limits.speed[joint]:.3g}"
                return f"{self._name(joint)} turns at {what} (max_speed_share {most:g})"
        if settings.max_rms_torque_share is not None:
            most = settings.max_rms_torque_share
            self._square += self._forget * (np.square(reading.torques / limits.effort) - self._square)
            if (self._square > most**2).any():
                joint = int(np.argmax(self._square))
                return (
                    f"the RMS torque of {self._name(joint)} is more than {most:g} of its limit (max_rms_torque_share)"
                )
        return ""

    def shaped(self, command: Command, time: float) -> Command:
        """Return the command of ``time`` (s) with its torques cut, and a share of it during the soft start."""
        settings, limits = self._settings, self._limits
        if limits is not None:
            most = settings.max_torque_share * limits.effort
            if (np.abs(command.tau) > most).any():
                command = command._replace(tau=np.clip(command.tau, -most, most))
        if settings.soft_start_s > 0.0:
            self._start = time if math.isnan(self._start) else self._start
            share = (time - self._start) / settings.soft_start_s
            if share < 1.0:
                kd = share * command.kd + (1.0 - share) * settings.damping_nms
                command = command._replace(tau=share * command.tau, kp=share * command.kp, kd=kd)
        return command

    def _name(self, joint: int) -> str:
        return f"joint {joint}" if self._limits is None else str(self._limits.names[joint])


class Operator:
    """The wishes of the person who watches a robot; this one wishes it to run.

    Attributes:
        armed: whether commands may be sent. Before the first time nothing is sent; later the joints are damped.
        lies: whether the robot shall lie down, and the run end then.
        stop: reason of an emergency stop; empty if there is none.
        listen: called by :meth:`poll`: sets the others to what a person elsewhere wants, such as on a page.
    """

    def __init__(self, armed: bool = True) -> None:
        self.armed, self.lies, self.stop = armed, False, ""
        self.listen: Callable[[], None] = lambda: None

    def poll(self) -> None:
        """Read what the person has asked for since the last call, without waiting."""
        self.listen()


class Keys(Operator):
    """The keys of a terminal: space stops, ``l`` lies down and ends, ``a`` arms, ``d`` disarms."""

    def __init__(self, armed: bool = True) -> None:
        super().__init__(armed)
        self._input = sys.stdin.fileno()

    def poll(self) -> None:
        """Read the keys that were pressed since the last call."""
        super().poll()
        if not select.select([self._input], [], [], 0.0)[0]:
            return
        for pressed in os.read(self._input, 64).decode(errors="ignore").lower():
            if pressed == " ":
                self.stop = "emergency stop by key"
            elif pressed in "ad":
                self.armed = pressed == "a"
            elif pressed == "l":
                self.lies = True

    @classmethod
    @contextmanager
    def of_terminal(cls, armed: bool) -> Iterator[Operator]:
        """Read single keys from the terminal, without echo; without a terminal there are no keys."""
        if not sys.stdin.isatty():
            yield Operator(armed)
            return
        import termios
        import tty

        before = termios.tcgetattr(sys.stdin)
        tty.setcbreak(sys.stdin)
        try:
            yield cls(armed)
        finally:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
