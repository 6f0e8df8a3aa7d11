"""The closed loop: plant, controller and disturbances, each at its own rate.

The loop knows none of the controllers; it drives whatever keeps the :class:`Controller` protocol, and tells whoever
asks (a recorder, a progress bar) what happened at every control tick.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lgmpc.errors import InputError
from lgmpc.simulation.control import Command
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.plant import Plant, PlantSample
from lgmpc.typing import Array

__all__ = ["Controller", "Disturbance", "Rates", "Tick", "simulate"]


class Controller(Protocol):
    """Anything that turns time and measured state into a joint command; it never raises for what the robot does."""

    def update(self, time: float, q: Array, v: Array) -> Command:
        """Return the command to apply until the next control tick."""


@dataclass(frozen=True)
class Rates:
    """How many plant steps make a control tick, and how many control ticks a run.

    Attributes:
        substeps: plant steps per control tick.
        ticks: control ticks of the run.
        period: time between control ticks, s.
    """

    substeps: int
    ticks: int
    period: float

    @classmethod
    def of(cls, plant_dt: float, control_rate: float, duration: float) -> Rates:
        """Fit the control rate to the plant's step.

        Raises:
            InputError: if the control period is not a whole number of plant steps, or the run shorter than one.
        """
        ratio = 1.0 / (control_rate * plant_dt)
        substeps = round(ratio)
        if substeps < 1 or abs(ratio - substeps) > 1e-6 * ratio:
            raise InputError(
                "wbc.rate_hz", control_rate, f"a rate that divides the plant's {1.0 / plant_dt:g} Hz without remainder"
            )
        period = substeps * plant_dt
        ticks = round(duration / period)
        if ticks < 1:
            raise InputError("duration_s", duration, f"at least one control tick ({period:g} s)")
        return cls(substeps, ticks, period)


@dataclass(frozen=True)
class Disturbance:
    """What pushes the robot during a tick.

    Attributes:
        wrench: (6,) [force; torque], world axes, at ``point``.
        point: (3,) world position where it acts.
    """

    wrench: Array
    point: Array


@dataclass(frozen=True)
class Tick:
    """One control tick, as it is told to the observers of a run.

    Attributes:
        index: number of the tick.
        sample: state at which the controller decided, with the torques and forces of the step before.
        command: what it decided.
        torque: (nu,) torque asked of the joints at this state, before clipping, N.m.
        disturbance: what pushed the robot during this tick.
    """

    index: int
    sample: PlantSample
    command: Command
    torque: Array
    disturbance: Disturbance


def simulate(
    plant: Plant,
    controller: Controller,
    pushes: PushSchedule,
    rates: Rates,
    on_tick: Callable[[Tick], bool],
) -> int:
    """Run the closed loop from the plant's present state.

    Args:
        plant: reset before, at the state where the run begins.
        controller: decides at every control tick.
        pushes: disturbances.
        rates: see :meth:`Rates.of`.
        on_tick: called after every decision, before the plant moves; returns whether to go on.

    Returns:
        Number of ticks that were simulated.
    """
    disturber = _Disturber(plant, pushes)
    for index in range(rates.ticks):
        sample = plant.sense()
        command = controller.update(sample.time, sample.q, sample.v)
        disturbance = disturber.apply(sample.time)
        nu = command.tau.size
        torque = command.torque(sample.q[-nu:], sample.v[-nu:])
        if not on_tick(Tick(index, sample, command, torque, disturbance)):
            return index + 1
        plant.step(torque)
        for _ in range(rates.substeps - 1):
            now = plant.sense()
            disturber.apply(now.time)
            plant.step(command.torque(now.q[-nu:], now.v[-nu:]))
    return rates.ticks


class _Disturber:
    """Applies the pushes of a schedule, and touches the plant only while there are any."""

    def __init__(self, plant: Plant, pushes: PushSchedule) -> None:
        self._plant, self._pushes = plant, pushes
        self._nothing = Disturbance(np.zeros(6), np.zeros(3))
        self._pushing = False

    def apply(self, time: float) -> Disturbance:
        """Apply the pushes of the step that begins now; of several bodies pushed at once, tell the first."""
        told = self._nothing
        active = self._pushes.is_active(time)
        if active or self._pushing:
            for body, wrench in self._pushes.wrenches(time).items():
                self._plant.set_wrench(body, wrench)
                if told is self._nothing and wrench.any():
                    told = Disturbance(wrench, self._plant.body_point(body))
        self._pushing = active
        return told
