"""The path from controller to joints: a link with delays, drives with lag and saturation, computing time.

The plant advances in steps: commands that arrive within a step act from the next one on, so ``plant.rate_hz`` is the
resolution of delays.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import Field, model_validator

from lgmpc.control.interface import Command, Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.settings import Fraction, Noise, NonNegative, Positive, Problem, Settings, key, problems
from lgmpc.typing import Array

Delay = Annotated[float, Field(strict=True, ge=0.0, le=0.1, allow_inf_nan=False)]
Milliseconds = Annotated[tuple[NonNegative, ...], Field(min_length=2)]
T = TypeVar("T")
S = TypeVar("S", RobotState, Measurement)

_SAME_TIME = 1e-9  # s


class LinkSettings(Settings):
    """The link between the robot and its controller. Neither the controller's model nor its estimator contains it."""

    command_latency_s: Delay = key(0.0, "Time from a command's completion to the drives, s.")
    command_jitter_s: Delay = key(0.0, "Largest random addition to it, uniform from 0, s.")
    measurement_latency_s: Delay = key(0.0, "Time from a measurement to the controller, s.")
    measurement_jitter_s: Delay = key(0.0, "Largest random addition to it, uniform from 0, s.")
    dropped_commands: Fraction = key(0.0, "Share of commands that are lost, 0 to 1; the drives keep the last one.")
    joint_position_noise_rad: Noise = key(
        0.0, "Standard deviation of joint angles that a controller without an estimator receives, rad."
    )
    joint_velocity_noise_rad_s: Noise = key(
        0.0, "Standard deviation of joint speeds that a controller without an estimator receives, rad/s."
    )
    base_velocity_noise_m_s: Noise = key(
        0.0, "Standard deviation of the base's velocity that a controller without an estimator receives, m/s."
    )

    @property
    def noise(self) -> tuple[float, float, float]:
        """Standard deviations of joint angles, joint speeds and base velocity."""
        return self.joint_position_noise_rad, self.joint_velocity_noise_rad_s, self.base_velocity_noise_m_s

    @property
    def transparent(self) -> bool:
        """Whether measurements arrive at once and unchanged."""
        return self.measurement_latency_s == self.measurement_jitter_s == 0.0 and not any(self.noise)


class JointFault(Settings):
    """A motor that from some time on gives less torque than it is commanded, or none."""

    joint: str = Field(min_length=1, description="Name of the joint.")
    at_s: NonNegative = Field(description="Time from which it does, s.")
    torque_share: Fraction = key(
        0.0, "Share of the commanded torque, and of its limit, that the motor gives: 0 if dead."
    )


class ActuatorSettings(Settings):
    """The drives of the joints, all alike but for faults; no controller's model contains them."""

    bandwidth_hz: Positive | None = key(None, "Corner frequency of the torque's first-order lag, Hz; null: none.")
    torque_limit_nm: Positive | None = key(
        None, "Actual torque limit, N.m; null: the robot's, which controllers assume."
    )
    stall_torque_nm: Positive | None = key(
        None, "Torque that the supply allows at rest, N.m: with no_load_speed_rad_s."
    )
    no_load_speed_rad_s: Positive | None = key(
        None, "Speed at which the supply allows no driving torque, rad/s; linear in between."
    )

    faults: tuple[JointFault, ...] = key((), "Motors that fail; the last one of a joint holds.")

    @model_validator(mode="after")
    def _line_is_whole(self) -> "ActuatorSettings":
        if (self.stall_torque_nm is None) != (self.no_load_speed_rad_s is None):
            name = "stall_torque_nm" if self.stall_torque_nm is None else "no_load_speed_rad_s"
            raise problems([Problem(name, None, "a number, because the other end of the torque-speed line is given")])
        return self


class TimingSettings(Settings):
    """Simulated duration of the computations. A tick that is due while an earlier one is computed is missed.

    Where it is not ``ideal``, a command acts from the next tick on.
    """

    computing: Literal["ideal", "measured", "modelled"] = key(
        "ideal", "ideal: none. measured: measured on this machine. modelled: drawn from the quantiles."
    )
    tick_ms: Milliseconds = key(
        (0.08, 0.1, 0.11, 0.13, 0.4),
        "Quantiles, at equal steps of probability from 0 to 1, of a tick without planning, ms.",
    )
    plan_ms: Milliseconds = key((0.5, 0.7, 0.8, 1.0, 3.0), "Quantiles of planning, in addition in ticks that plan, ms.")
    forecast_ms: Milliseconds = key(
        (0.4, 0.6, 0.7, 0.8, 1.0), "Quantiles of a forecast of steps, in addition in ticks with one, ms."
    )

    @model_validator(mode="after")
    def _quantiles_grow(self) -> "TimingSettings":
        found = [
            Problem(name, values, "quantiles that do not decrease")
            for name in ("tick_ms", "plan_ms", "forecast_ms")
            if list(values := getattr(self, name)) != sorted(values)
        ]
        if found:
            raise problems(found)
        return self


class DelayLine(Generic[T]):
    """Delivers the newest of the values that have arrived; a value that a newer one overtakes is lost.

    Args:
        latency: s.
        jitter: largest random addition, s.
        rng: of the additions.
    """

    def __init__(self, latency: float, jitter: float, rng: np.random.Generator) -> None:
        self._latency, self._jitter, self._rng = latency, jitter, rng
        self._flying: deque[tuple[float, T]] = deque()
        self._last: T | None = None

    def send(self, value: T, time: float) -> None:
        """Send a value; the first one arrives at once, because the values before the run are assumed equal to it."""
        if self._last is None:
            self._last = value
            return
        delay = self._latency + (self._jitter * self._rng.random() if self._jitter > 0.0 else 0.0)
        self._flying.append((time + delay, value))

    def receive(self, time: float) -> T:
        """Return the newest value that has arrived at ``time``."""
        flying, now = self._flying, time + _SAME_TIME
        if flying and flying[-1][0] <= now:
            self._last = flying[-1][1]
            flying.clear()
        for newest in range(len(flying) - 1, -1, -1):
            if flying[newest][0] <= now:
                self._last = flying[newest][1]
                for _ in range(newest + 1):
                    flying.popleft()
                break
        assert self._last is not None
        return self._last


class StateLink(Generic[S]):
    """The link of measurements, or of true states, to the estimator or the controller.

    A delayed value has the time of its arrival: the controller does not receive its age.
    """

    def __init__(self, settings: LinkSettings, rng: np.random.Generator) -> None:
        self._noise, self._rng = settings.noise, rng
        self._line: DelayLine[S] = DelayLine(settings.measurement_latency_s, settings.measurement_jitter_s, rng)

    def pass_on(self, value: S, time: float) -> S:
        """Send the value of ``time`` and return the newest one that has arrived."""
        self._line.send(value, time)
        return self._line.receive(time)._replace(time=time)

    def disturb(self, state: RobotState, nu: int) -> RobotState:
        """Return a state with noise on the ``nu`` joints and the base's velocity."""
        angles, speeds, base = self._noise
        if not any(self._noise):
            return state
        noise = self._rng.normal(size=(2, nu))
        q, v = state.q.copy(), state.v.copy()
        q[-nu:] += angles * noise[0]
        v[-nu:] += speeds * noise[1]
        if base > 0.0:
            v[:3] += base * self._rng.normal(size=3)
        return state._replace(q=q, v=v)


class Drives:
    """The link of the commands, and the drives that apply them.

    Args:
        link: delays and losses of commands.
        actuators: lag and limits.
        dt: duration of the plant's steps, s.
        rng: of jitter and losses.
        joints: names of the joints, in their order, and their torque limits, N.m; of drives without faults, none.

    Raises:
        InputError: a fault of a joint that is not one of them.
    """

    def __init__(
        self,
        link: LinkSettings,
        actuators: ActuatorSettings,
        dt: float,
        rng: np.random.Generator,
        joints: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._line = DelayLine[Command](link.command_latency_s, link.command_jitter_s, rng)
        self._dropped, self._rng = link.dropped_commands, rng
        self._share = (
            1.0 if actuators.bandwidth_hz is None else 1.0 - math.exp(-2.0 * math.pi * actuators.bandwidth_hz * dt)
        )
        self._stall, self._no_load = actuators.stall_torque_nm, actuators.no_load_speed_rad_s
        self._torque: Array | None = None
        names = tuple(joints)
        for i, fault in enumerate(actuators.faults):
            if fault.joint not in joints:
                key = f"plant.actuators.faults.{i}.joint"
                raise InputError(key, repr(fault.joint), "a joint of the robot", names, word=fault.joint)
        self._faults = [
            (each.at_s, names.index(each.joint), each.torque_share, joints[each.joint])
            for each in sorted(actuators.faults, key=lambda fault: fault.at_s)
        ]

    def send(self, command: Command, time: float) -> None:
        """Send a command that is complete at ``time``."""
        if self._dropped > 0.0 and self._torque is not None and self._rng.random() < self._dropped:
            return
        self._line.send(command, time)

    def torque(self, time: float, q: Array, v: Array) -> Array:
        """Return the torque (nu,) of the step that begins now, before the limit that the plant clips at.

        Args:
            time: s.
            q: configuration, whose last nu elements are the joints'.
            v: velocity, the same.
        """
        torque = self._line.receive(time).torque(q, v)
        if self._share < 1.0 and self._torque is not None:
            torque = self._torque + self._share * (torque - self._torque)
        self._torque = torque
        if self._stall is not None and self._no_load is not None:
            # A motor at constant voltage: its torque falls linearly with the speed that it drives.
            driving = np.maximum(np.sign(torque) * v[-torque.size :], 0.0)
            available = np.maximum(self._stall * (1.0 - driving / self._no_load), 0.0)
            torque = np.minimum(np.maximum(torque, -available), available)
        failed = {j: (share, most) for at, j, share, most in self._faults if at <= time + _SAME_TIME}
        if failed:
            torque = torque.copy()
            for joint, (share, most) in failed.items():
                torque[joint] = share * min(max(torque[joint], -most), most)
        return torque


class Spent(NamedTuple):
    """Computations of a tick.

    Attributes:
        time_s: that they took on this machine, s.
        planned: whether the MPC planned.
        forecast: whether steps against a push were forecast.
    """

    time_s: float
    planned: bool
    forecast: bool


class Computing:
    """The time that a tick takes to compute, in simulated time.

    Args:
        settings: its source.
        rng: random numbers of the modelled times.
    """

    def __init__(self, settings: TimingSettings, rng: np.random.Generator) -> None:
        self._rng = rng
        quantiles = (settings.tick_ms, settings.plan_ms, settings.forecast_ms)
        self._tick, self._plan, self._forecast = (1e-3 * np.array(each) for each in quantiles)
        ways = {"ideal": self._none, "measured": self._measured, "modelled": self._drawn}
        self.spent: Callable[[Callable[[], Spent]], float] = ways[settings.computing]
        """``spent(measured)``: time of a tick, s, where ``measured()`` returns what it spent on this machine."""

    def _none(self, measured: Callable[[], Spent]) -> float:
        return 0.0

    def _measured(self, measured: Callable[[], Spent]) -> float:
        return measured().time_s

    def _drawn(self, measured: Callable[[], Spent]) -> float:
        spent = measured()
        time = self._quantile(self._tick) + (self._quantile(self._plan) if spent.planned else 0.0)
        return time + (self._quantile(self._forecast) if spent.forecast else 0.0)

    def _quantile(self, quantiles: Array) -> float:
        return float(np.interp(self._rng.random(), np.linspace(0.0, 1.0, quantiles.size), quantiles))
