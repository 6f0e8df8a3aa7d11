"""Problems whose phases have free durations, made of problems whose phases have given ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lgmpc.actions import Action, ChooseStretch, Stretched
from lgmpc.errors import InputError
from lgmpc.ocp.problem import ShootingProblem, Trajectory
from lgmpc.typing import Array, BoolArray, IntArray, instance, numbers


@dataclass(frozen=True)
class FreePhase:
    """A phase that may become shorter or longer.

    Attributes:
        start: its first interval; it ends where the next phase begins, or at the end of the horizon.
        lower: least ratio of its duration to the given one.
        upper: largest ratio.

    Raises:
        InputError: ratios that are not positive, or in the wrong order.
    """

    start: int
    lower: float
    upper: float

    def __post_init__(self) -> None:
        instance("start", self.start, (int, np.integer), "the number of an interval")
        for name in ("lower", "upper"):
            numbers(name, getattr(self, name), ())
        if not 0.0 < self.lower <= self.upper < np.inf:
            raise InputError("phase", f"[{self.lower:g}, {self.upper:g}]", "0 < lower <= upper, ratios of durations")


class FreeDurations:
    """A problem with free durations of its phases; its states have the stretch of the current phase as last entry.

    Args:
        problem: with given durations, the parameter ``duration`` of its actions; its data are copied.
        phases: the free ones; the first begins with interval 0.

    Attributes:
        problem: the new one: in front of each phase an interval of no length whose control is the phase's stretch.
        chosen: (N',) whether each of its intervals is one of these.
        nominal: (N,) given duration of each interval of the old one, s; 0 where the action has none.

    Raises:
        InputError: no phase, phases out of order, or actions that are not made of items.
    """

    def __init__(self, problem: ShootingProblem, phases: Sequence[FreePhase]) -> None:
        instance("problem", problem, ShootingProblem, "a ShootingProblem")
        instance("phases", phases, (tuple, list), "a list of FreePhase")
        for i, phase in enumerate(phases):
            instance(f"phases[{i}]", phase, FreePhase, "a FreePhase")
        starts = [phase.start for phase in phases]
        if starts[:1] != [0] or sorted(set(starts)) != starts or starts[-1] >= problem.nodes:
            raise InputError("phases", f"starts {starts}", f"increasing, from 0, below {problem.nodes}")
        self._base = problem
        lifted: dict[int, Stretched] = {}
        for action in (*problem.actions, problem.terminal):
            if id(action) not in lifted:
                lifted[id(action)] = Stretched(action)  # type: ignore[arg-type] # which it checks
        terminal = lifted[id(problem.terminal)]
        choose = ChooseStretch(f"{problem.terminal.name}_stretch", terminal.state)
        actions: list[Action] = []
        places: list[int] = []
        for k, action in enumerate(problem.actions):
            if k in starts:
                actions.append(choose)
            places.append(len(actions))
            actions.append(lifted[id(action)])
        self._places: IntArray = np.array(places, dtype=np.int64)
        self.chosen: BoolArray = np.ones(len(actions), dtype=np.bool_)
        self.chosen[self._places] = False
        self.problem = ShootingProblem(actions, terminal=terminal)
        width = problem.parameters.shape[1]
        self.problem.parameters[[*places, len(actions)], :width] = problem.parameters
        self.problem.set_initial_state(np.concatenate([problem.x0, [1.0]]))
        gates = np.flatnonzero(self.chosen).tolist()
        for name in ("lower", "upper"):
            self.problem.set(f"stretch_{name}", [[getattr(phase, name)] for phase in phases], gates)
        self.nominal: Array = np.zeros(problem.nodes)
        for k, action in enumerate(problem.actions):
            if "duration" in tuple(action.parameters):
                self.nominal[k] = problem.parameters[k, action.parameters["duration"]][0]

    def lift(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory of the old problem as one of the new, with the given durations."""
        nodes, nu = self.problem.nodes, self.problem.nu
        before = np.concatenate([np.cumsum(~self.chosen) - ~self.chosen, [self._base.nodes]])
        xs = np.column_stack([trajectory.xs[before], np.ones(nodes + 1)])
        us = np.zeros((nodes, nu))
        us[self._places, : trajectory.us.shape[1]] = trajectory.us
        us[self.chosen, 0] = 1.0
        return Trajectory(xs, us)

    def plain(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory of the new problem without stretches and the intervals that choose them."""
        nodes = [*self._places, self.problem.nodes]
        return Trajectory(trajectory.xs[nodes, :-1].copy(), trajectory.us[self._places, : self._base.nu].copy())

    def durations(self, trajectory: Trajectory) -> Array:
        """Return the length (N,) of each interval of the old problem in a trajectory of the new, s."""
        return self.nominal * trajectory.xs[self._places, -1]
