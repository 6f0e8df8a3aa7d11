"""The closed loop: plant, controller and disturbances, each at its own rate.

The loop depends on no particular controller; it drives any that has the :class:`Controller` protocol, and calls an
observer (a recorder, a progress bar) at every control tick.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lgmpc.control.interface import Command, CommandGuard, Controller, Estimator, Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.drives import ActuatorSettings, Computing, Drives, LinkSettings, Spent, StateLink, TimingSettings
from lgmpc.simulation.plant import Plant, PlantSample
from lgmpc.simulation.sensors import Sensors
from lgmpc.timegrid import TimeGrid, periods_in
from lgmpc.typing import Array, BoolArray

_SAME_TIME = 1e-9  # s


@dataclass(frozen=True)
class Sensing:
    """Source of the controller's state other than the plant itself.

    Attributes:
        sensors: sensors of the simulated robot; read once per control tick.
        estimator: computes the state from the measurements.
        link: delays and losses of the measurements; none if they arrive at once.
    """

    sensors: Sensors
    estimator: Estimator
    link: StateLink[Measurement] | None = None

    def state(self, sample: PlantSample) -> RobotState:
        """Return the estimate for the plant's present state."""
        measurement = self.sensors.read(sample)
        if self.link is not None:
            measurement = self.link.pass_on(measurement, sample.time)
        return self.estimator.update(measurement)


@dataclass(frozen=True)
class TrueState:
    """The plant's own state as the controller receives it, over a link that delays and disturbs it."""

    link: StateLink[RobotState]
    nu: int

    def state(self, sample: PlantSample) -> RobotState:
        """Return the state that has arrived."""
        return self.link.pass_on(self.link.disturb(true_state(sample), self.nu), sample.time)


def control_ticks(plant_dt: float, control_rate: float, duration: float) -> TimeGrid:
    """Return the control ticks of a run, each of a whole number of plant steps ``plant_dt``, s.

    Raises:
        InputError: if the control rate does not divide the plant's, or the run is shorter than a tick.
    """
    period = plant_dt * periods_in("wbc.rate_hz", control_rate, "plant.rate_hz", 1.0 / plant_dt)
    ticks = TimeGrid(period, TimeGrid(period).nearest(duration))
    if ticks.count < 1:
        raise InputError("duration_s", duration, f"at least one control tick ({period:g} s)")
    return ticks


class Disturbance(NamedTuple):
    """The push that acts during a tick.

    Attributes:
        wrench: (6,) [force; torque], world axes, at ``point``.
        point: (3,) point of application, world axes, m.
    """

    wrench: Array
    point: Array


class Tick(NamedTuple):
    """One control tick, as the observers of a run receive it.

    Attributes:
        number: counted from 0.
        sample: true state for which the command was computed, with the torques and forces of the step before.
        state: input of the controller: the true state, or its estimate.
        command: command to the drives.
        replaced: whether the controller's command was not finite, and damping of the joints took its place.
        torque: (nu,) torque that the drives request of the joints at this state, before clipping, N.m.
        disturbance: the push during this tick.
    """

    number: int
    sample: PlantSample
    state: RobotState
    command: Command
    replaced: bool
    torque: Array
    disturbance: Disturbance


@dataclass(frozen=True)
class Hardware:
    """The path from controller to joints.

    Attributes:
        drives: link and drives that commands pass through.
        computing: the time that an update takes in simulated time. Ticks until its end are missed.
        measured: returns what the last update spent on this machine.
        guard: replaces commands that are not finite.
    """

    drives: Drives
    computing: Computing
    measured: Callable[[], Spent]
    guard: CommandGuard = field(default_factory=lambda: CommandGuard(0.1))


class Loop:
    """A closed loop: the plant at its present state, the next tick, the time from which the computer is free.

    Args:
        plant: plant, reset to the initial state.
        controller: computes a command at every control tick.
        pushes: disturbances.
        ticks: see :func:`control_ticks`.
        sensing: source of the controller's state; the plant's true state unless given.
        hardware: delays and drives that commands pass through; ideal unless given.

    Attributes:
        index: number of the next tick.
        samples: the plant's state at every step so far, if a list is given before the first one; None otherwise.
    """

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        pushes: PushSchedule,
        ticks: TimeGrid,
        sensing: Sensing | TrueState | None = None,
        hardware: Hardware | None = None,
    ) -> None:
        self.index = 0
        self.samples: list[PlantSample] | None = None
        self._plant, self._controller, self._ticks, self._sensing = plant, controller, ticks, sensing
        self._substeps = TimeGrid(plant.dt).nearest(ticks.period)
        self._hardware = _ideal(plant) if hardware is None else hardware
        self._pushes, self._disturber = pushes, _Disturber(plant, pushes)
        self._ready = -math.inf

    def follow(self, samples: Sequence[PlantSample]) -> None:
        """Compute what this loop's controller commands at the states of another loop's plant, which act on nothing.

        Sensors, estimator, controller and drives are then in the state in which they are after watching that run; the
        loop continues from there with its own plant.

        Args:
            samples: of every step of the other plant, from the first one on; whole ticks.
        """
        plant = self._plant
        self._plant = recorded = _Recorded(samples, plant)
        self._disturber = _Disturber(recorded, self._pushes)
        try:
            self.run(lambda tick: True, len(samples) // self._substeps)
        finally:
            self._plant, self._disturber = plant, _Disturber(plant, self._pushes)

    def run(self, on_tick: Callable[[Tick], bool], until: int | None = None) -> bool:
        """Simulate tick after tick.

        Args:
            on_tick: called after every command, before the plant advances; returns whether the run continues after this
                tick.
            until: number of the tick before which to stop; after the last one unless given.

        Returns:
            Whether all these ticks were simulated, and ``on_tick`` did not end the run.
        """
        plant, hardware, disturber = self._plant, self._hardware, self._disturber
        drives, kept = hardware.drives, self.samples
        while self.index < (self._ticks.count if until is None else until):
            sample = plant.sense()
            if kept is not None:
                kept.append(sample)
            state = true_state(sample) if self._sensing is None else self._sensing.state(sample)
            disturbance = disturber.apply(sample.time)
            continues = True
            if sample.time > self._ready - _SAME_TIME:
                output = self._controller.update(state)
                command = hardware.guard.check(output, sample.time, sample.q)
                self._ready = sample.time + hardware.computing.spent(hardware.measured)
                drives.send(command, self._ready)
                torque = drives.torque(sample.time, sample.q, sample.v)
                continues = on_tick(
                    Tick(self.index, sample, state, command, command is not output, torque, disturbance)
                )
            else:  # an earlier tick is still being computed: this one is missed
                torque = drives.torque(sample.time, sample.q, sample.v)
            plant.step(torque)
            for _ in range(self._substeps - 1):
                now = plant.sense()
                if kept is not None:
                    kept.append(now)
                disturber.apply(now.time)
                plant.step(drives.torque(now.time, now.q, now.v))
            self.index += 1
            if not continues:
                return False
        return True


def _ideal(plant: Plant) -> Hardware:
    rng = np.random.default_rng(0)  # nothing is drawn
    drives = Drives(LinkSettings(), ActuatorSettings(), plant.dt, rng)
    return Hardware(drives, Computing(TimingSettings(), rng), lambda: Spent(0.0, False, False))


_UPWARD = 0.64
"""Square of the least ratio of vertical to horizontal force of a foot that stands."""


def true_state(sample: PlantSample) -> RobotState:
    """Return the exact state of the plant; a foot is in contact if the ground pushes it, rather up than aside.

    A foot that hits a riser does not stand there.
    """
    forces = sample.contact_forces.tolist()  # plain numbers: faster than NumPy's calls for a handful of feet
    pushed = tuple([z > 0.0 and z * z >= _UPWARD * (x * x + y * y) for x, y, z in forces])
    return RobotState(sample.time, sample.q, sample.v, _flags(pushed), sample.tau)


@lru_cache(maxsize=256)
def _flags(flags: tuple[bool, ...]) -> BoolArray:
    """Return the read-only array of some flags."""
    array = np.array(flags, dtype=np.bool_)
    array.flags.writeable = False
    return array


class _Recorded:
    """A plant that has been simulated: its steps lead from sample to sample, whatever the torques and wrenches are."""

    def __init__(self, samples: Sequence[PlantSample], plant: Plant) -> None:
        self._samples, self._index = samples, 0
        self.dt, self.bodies, self.reset, self.resume = plant.dt, plant.bodies, plant.reset, plant.resume

    def step(self, tau: Array) -> None:
        self._index += 1

    def sense(self) -> PlantSample:
        return self._samples[self._index]

    def set_wrench(self, body: str, wrench: Array) -> None:
        pass

    def body_point(self, body: str) -> Array:
        return np.zeros(3)


class _Disturber:
    """Applies the pushes of a schedule; calls the plant only while there are any."""

    def __init__(self, plant: Plant, pushes: PushSchedule) -> None:
        self._plant, self._pushes = plant, pushes
        self._nothing = Disturbance(np.zeros(6), np.zeros(3))
        self._pushing = True  # the plant may have a wrench from before

    def apply(self, time: float) -> Disturbance:
        """Apply the pushes of the step that begins now; of several bodies pushed at once, return the first."""
        first = self._nothing
        active = self._pushes.is_active(time)
        if active or self._pushing:
            for body, wrench in self._pushes.wrenches(time).items():
                self._plant.set_wrench(body, wrench)
                if first is self._nothing and wrench.any():
                    first = Disturbance(wrench, self._plant.body_point(body))
        self._pushing = active
        return first
