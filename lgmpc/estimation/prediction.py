"""The state at which a command will act, from one that is already old and the commands that are still on their way."""

import math
from typing import Annotated

import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.control.interface import RobotState
from lgmpc.estimation.checks import duration_of
from lgmpc.robot import Robot
from lgmpc.settings import Settings, key
from lgmpc.typing import Array, instance

_SAME_TIME = 1e-9  # s
Delay = Annotated[float, Field(strict=True, ge=0.0, le=0.1, allow_inf_nan=False)]


class DelaySettings(Settings):
    """Delays that the controller assumes and compensates, whatever those of the robot are."""

    measurement_s: Delay = key(0.0, "Age of a state when the controller receives it, s.")
    command_s: Delay = key(
        0.0,
        "Time from a state's arrival until the command computed from it acts, s: computing, the link to the"
        " drives, and the lag of the drives.",
    )

    @property
    def total_s(self) -> float:
        """Time from a measurement until the command that it leads to acts, s."""
        return self.measurement_s + self.command_s


class StatePredictor:
    """Integrates the accelerations of commands in flight, from the measured state to that in which the next one acts.

    The command of the tick at t_k acts from t_k + lead on, with the acceleration ``a_k`` that the controller predicted
    for it (held over a tick): a velocity measured at ``t - age`` becomes ``v + sum_k a_k d_k``, with the durations
    ``d_k`` between ``t - age`` and ``t + lead``, and the configuration follows by its integral. This is a Smith
    predictor that begins anew at every tick: errors do not accumulate, and with an exact model there are none.

    Args:
        robot: the controller's model.
        period: time between two ticks, s.
        delays: age and lead; above zero in total.
    """

    def __init__(self, robot: Robot, period: float, delays: DelaySettings) -> None:
        instance("robot", robot, Robot)
        instance("delays", delays, DelaySettings)
        self._model = robot.model
        self._period = duration_of("period", period)
        self._lead, self._total = delays.command_s, duration_of("delays", delays.total_s)
        count = math.ceil(self._total / period - _SAME_TIME)
        newest_first = period * np.arange(count)
        self._durations = np.minimum(period, self._total - newest_first)
        # What an interval of duration d gains in speed moves the robot for d / 2 within it and all the time after it.
        self._levers = self._durations * (0.5 * self._durations + newest_first)
        self._accelerations = np.zeros((count, robot.nv))
        self._next = np.zeros(robot.nv)
        self._time = math.nan

    def reset(self) -> None:
        """Clear the history: the robot is assumed to keep its velocity."""
        self._accelerations[:] = 0.0
        self._next[:] = 0.0
        self._time = math.nan

    def state(self) -> tuple[float, Array, Array]:
        """Return a copy of the state: time of the last prediction, next acceleration, and those in flight."""
        return self._time, self._next.copy(), self._accelerations.copy()

    def set_state(self, state: tuple[float, Array, Array]) -> None:
        """Continue from another predictor's state; commands further back than its memory accelerate nothing."""
        self._time, self._next[:], rows = state
        self._accelerations[:] = 0.0
        count = min(len(rows), len(self._accelerations))
        self._accelerations[:count] = rows[:count]

    def predict(self, state: RobotState) -> RobotState:
        """Return the state ``lead`` after the arrival of a measured one, with its contacts; call once a tick."""
        rows, period = self._accelerations, self._period
        # A command stays until the next one: where ticks were missed, it acted for longer.
        ticks = 1 if math.isnan(self._time) else max(1, round((state.time - self._time) / period))
        for _ in range(min(ticks, len(rows))):
            rows[1:] = rows[:-1]
            rows[0] = self._next
        self._time = state.time
        self._next[:] = 0.0
        v = state.v + self._durations @ rows
        q = pin.integrate(self._model, state.q, self._total * state.v + self._levers @ rows)
        return RobotState(state.time + self._lead, q, v, state.contacts)

    def expect(self, acceleration: Array) -> None:
        """Store the acceleration (nv,) of the command that was just computed; without, none is assumed."""
        self._next[:] = acceleration
