"""Motion commands: velocity, height, attitude, gait and mode; from a timeline, a function, or any other source."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Annotated, Literal, Protocol, get_args

from pydantic import AfterValidator, Field, field_validator

from lgmpc.errors import InputError
from lgmpc.lie import attitude
from lgmpc.settings import Finite, NonNegative, Positive, Problem, Settings, Vector3, key, problem, problems

ModeRequest = Literal["stand", "lie", "damp"]
"""Modes that a command can request."""

_REST = 1e-6  # m/s and rad/s


@dataclass(frozen=True, slots=True)
class MotionCommand:
    """A command of motion; velocities in the horizontal frame that turns with the base.

    Attributes:
        vx: velocity ahead, m/s.
        vy: to the left, m/s.
        yaw_rate: to the left, rad/s.
        height: of the base above the feet relative to the reference posture, m.
        pitch: of the base, rad.
        roll: of the base, rad.
        gait: name of the gait.
        mode: requested mode: ``stand`` (on the feet, moving as commanded), ``lie`` (on the belly), or ``damp`` (no
            torque: the emergency stop).
        maneuver: name of a planned motion to perform once, and the time at which it is commanded, s; a robot that
            walks comes to rest before. None for none.
    """

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0
    height: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    gait: str = "trot"
    mode: ModeRequest = "stand"
    maneuver: tuple[str, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether any velocity is commanded."""
        return not (-_REST <= self.vx <= _REST and -_REST <= self.vy <= _REST and -_REST <= self.yaw_rate <= _REST)


class CommandSource(Protocol):
    """A source of commands."""

    def at(self, t: float) -> MotionCommand:
        """Return the command at time ``t``, s."""


@dataclass(frozen=True)
class CommandFunction:
    """A source that calls a function of time.

    Attributes:
        function: from s to a command.
    """

    function: Callable[[float], MotionCommand]

    def at(self, t: float) -> MotionCommand:
        """Return the command at time ``t``, s.

        Raises:
            InputError: the function does not return a command of finite numbers.
        """
        command = self.function(t)
        if not isinstance(command, MotionCommand):
            raise InputError("command", type(command).__name__, "a MotionCommand")
        for name in ("vx", "vy", "yaw_rate", "height", "pitch", "roll"):
            if not (isinstance(value := getattr(command, name), Real) and math.isfinite(value)):
                raise InputError(f"command.{name}", value, "a finite number")
        if command.mode not in get_args(ModeRequest):
            raise InputError("command.mode", command.mode, "a mode to request", get_args(ModeRequest))
        return command


class CommandEntry(Settings):
    """A change of the command at a time; omitted quantities are unchanged."""

    at_s: NonNegative = Field(description="Time of the change, s.")
    velocity_m_s: Vector3 | None = key(None, "[ahead, left, 0] in the frame of the base, m/s.")
    yaw_rate_rad_s: Finite | None = key(None, "To the left, rad/s.")
    height_m: Finite | None = key(None, "Of the base above the feet relative to the reference posture, m.")
    pitch_rad: Annotated[float, Field(strict=True, ge=-1.0, le=1.0)] | None = key(None, "Of the base, rad.")
    roll_rad: Annotated[float, Field(strict=True, ge=-1.0, le=1.0)] | None = key(None, "Of the base, rad.")
    gait: Annotated[str, Field(min_length=1)] | None = key(None, "Name of the gait.")
    mode: ModeRequest | None = key(
        None, "stand: on the feet, moving as commanded; lie: on the belly; damp: no torque, the emergency stop."
    )
    maneuver: Annotated[str, Field(min_length=1)] | None = key(
        None,
        "Name of a planned motion of section maneuvers, performed once; a robot that walks comes to rest"
        " before, and goes on as commanded afterwards.",
    )

    @field_validator("velocity_m_s")
    @classmethod
    def _stay_in_the_plane(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value is not None and value[2] != 0.0:
            raise problem("[ahead, left, 0]: heights are commanded by height_m")
        return value

    def change(self, command: MotionCommand) -> MotionCommand:
        """Return ``command`` with what this entry names replaced."""
        named: dict[str, float | str | None] = {
            "vx": None if self.velocity_m_s is None else self.velocity_m_s[0],
            "vy": None if self.velocity_m_s is None else self.velocity_m_s[1],
            "yaw_rate": self.yaw_rate_rad_s,
            "height": self.height_m,
            "pitch": self.pitch_rad,
            "roll": self.roll_rad,
            "gait": self.gait,
            "mode": self.mode,
        }
        maneuver = None if self.maneuver is None else (self.maneuver, self.at_s)
        command = replace(command, maneuver=maneuver)
        return replace(command, **{key: value for key, value in named.items() if value is not None})  # type: ignore[arg-type]


def _in_order(entries: tuple[CommandEntry, ...]) -> tuple[CommandEntry, ...]:
    found = [
        Problem(f"{i}.at_s", entry.at_s, f"a time not before that of the entry ahead of it ({before.at_s:g} s)")
        for i, (before, entry) in enumerate(zip(entries, entries[1:], strict=False), start=1)
        if entry.at_s < before.at_s
    ]
    if found:
        raise problems(found)
    return entries


Timeline = Annotated[tuple[CommandEntry, ...], AfterValidator(_in_order)]
"""Entries in order of time, as a field of settings."""


class CommandTimeline:
    """A source that changes at given times.

    Args:
        entries: the changes, in order of time.
        initial: the command before the first of them.
        gaits: the names of gaits that exist; any, if omitted.

    Raises:
        InputError: entries out of order, or a gait that does not exist (also one that an entry with a velocity does not
            name); it names the entry.
    """

    def __init__(
        self,
        entries: Sequence[CommandEntry],
        initial: MotionCommand | None = None,
        gaits: Collection[str] | None = None,
    ) -> None:
        command = MotionCommand() if initial is None else initial
        self._times: list[float] = []
        self._commands = [command]
        for i, entry in enumerate(entries):
            if self._times and entry.at_s < self._times[-1]:
                raise InputError(f"commands.{i}.at_s", f"{entry.at_s:g}", f"a time from {self._times[-1]:g} s on")
            command = entry.change(command)
            named = entry.gait is not None
            if (named or command.moves) and gaits is not None and command.gait not in gaits:
                got = command.gait if named else f"no name, and so {command.gait}"
                raise InputError(f"commands.{i}.gait", got, "the name of a gait", tuple(gaits), word=command.gait)
            self._times.append(entry.at_s)
            self._commands.append(command)
        self._position = 0

    def at(self, t: float) -> MotionCommand:
        """Return the command at time ``t``, s: that of the last entry until then."""
        # Times mostly grow from call to call: search from where the last call ended.
        i, times = self._position, self._times
        while i < len(times) and times[i] <= t:
            i += 1
        while i > 0 and times[i - 1] > t:
            i -= 1
        self._position = i
        return self._commands[i]


class CommandLimits(Settings):
    """Limits of commands and of their rates."""

    speed_m_s: Positive = key(3.0, "Largest velocity in the plane, m/s.")
    yaw_rate_rad_s: Positive = key(4.0, "Largest yaw rate, rad/s.")
    acceleration_m_s2: Positive = key(1.0, "Of the velocity in the plane, m/s2.")
    yaw_acceleration_rad_s2: Positive = key(4.0, "Of the yaw rate, rad/s2.")
    height_rate_m_s: Positive = key(0.1, "Of the height, m/s.")
    attitude_rate_rad_s: Positive = key(0.5, "Of pitch and roll, rad/s.")


@dataclass(frozen=True, slots=True)
class VelocityRamp:
    """The remaining change of a limited velocity, at constant acceleration.

    Attributes:
        ax: acceleration ahead, m/s2.
        ay: to the left, m/s2.
        duration: of what is left, s.
    """

    ax: float = 0.0
    ay: float = 0.0
    duration: float = 0.0

    def turned(self, angle: float) -> "VelocityRamp":
        """Return the same in axes that are turned by minus ``angle``, rad."""
        if self.duration == 0.0:
            return self
        return VelocityRamp(*attitude.turn(angle, self.ax, self.ay), self.duration)


_NO_RAMP = VelocityRamp()


class CommandLimiter:
    """Limits commands and their rates; constant commands are reached exactly.

    Args:
        limits: see :class:`CommandLimits`.
        command: initial command.

    Attributes:
        command: the limited command of the last step.
        ramp: remaining change of its velocity for a constant command.
    """

    def __init__(self, limits: CommandLimits | None = None, command: MotionCommand | None = None) -> None:
        self.limits = CommandLimits() if limits is None else limits
        self.command = MotionCommand() if command is None else command
        self.ramp = _NO_RAMP
        self._arrived: MotionCommand | None = None  # the last one that was within the limits

    def step(self, command: MotionCommand, dt: float, acceleration: float = math.inf) -> MotionCommand:
        """Return the limited command after ``dt``, s; gait and mode are those of ``command``.

        Args:
            command: command to approach.
            dt: duration of the step, s.
            acceleration: largest horizontal acceleration that the floor allows, m/s2, if below that of the settings.
        """
        now, most = self.command, self.limits
        self.ramp = _NO_RAMP
        if command is self._arrived and command is now:
            return command
        arrived = now is command or now == command
        if arrived and math.hypot(now.vx, now.vy) <= most.speed_m_s and abs(now.yaw_rate) <= most.yaw_rate_rad_s:
            self.command = self._arrived = command
            return command
        vx, vy = command.vx, command.vy
        speed = math.hypot(vx, vy)
        if speed > most.speed_m_s:
            vx, vy = vx * most.speed_m_s / speed, vy * most.speed_m_s / speed
        dx, dy = vx - now.vx, vy - now.vy
        change, rate = math.hypot(dx, dy), min(most.acceleration_m_s2, acceleration)
        step = rate * dt
        if change > step:
            vx, vy = now.vx + dx * step / change, now.vy + dy * step / change
            self.ramp = VelocityRamp(dx * rate / change, dy * rate / change, (change - step) / rate)
        rate = max(-most.yaw_rate_rad_s, min(most.yaw_rate_rad_s, command.yaw_rate))
        self.command = MotionCommand(
            vx,
            vy,
            _approach(now.yaw_rate, rate, most.yaw_acceleration_rad_s2 * dt),
            _approach(now.height, command.height, most.height_rate_m_s * dt),
            _approach(now.pitch, command.pitch, most.attitude_rate_rad_s * dt),
            _approach(now.roll, command.roll, most.attitude_rate_rad_s * dt),
            command.gait,
            command.mode,
            command.maneuver,
        )
        return self.command


def _approach(value: float, target: float, step: float) -> float:
    """Return ``value`` moved towards ``target`` by at most ``step``; the target itself within a step."""
    return target if abs(target - value) <= step else value + math.copysign(step, target - value)
