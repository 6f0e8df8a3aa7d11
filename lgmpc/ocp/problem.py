"""An optimal control problem on a grid: an action for each interval, a parameter vector a node, a first state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.actions import Action, StageValue
from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["ShootingProblem", "Trajectory"]


@dataclass(frozen=True)
class Trajectory:
    """States and controls over a horizon.

    Attributes:
        xs: (N+1, nx) states at the nodes.
        us: (N, nu) controls, each constant from its node to the next.
    """

    xs: Array
    us: Array


class ShootingProblem:
    """Minimise the cost of N intervals and of the last state, from a given first state, subject to the actions.

    It holds data only; any solver takes it. The arrays are written in place between solves, through :meth:`set` (which
    checks) or, in a loop without time for checks, through :meth:`view`.

    The intervals may differ (flight, impact, stance): give a sequence of actions on the same state. Use one object for
    what is the same, so that it is compiled once. Controls and parameters have as many columns as the largest action
    needs; those that a node's own action does not use are ignored.

    Args:
        action: the interval, or one action an interval.
        nodes: N, number of intervals; may be left out where a sequence is given.
        terminal: the action whose terminal cost the last state pays; that of the last interval unless given.

    Attributes:
        actions: (N) of them, one an interval.
        terminal: see above.
        nodes: N.
        state: the space of all states.
        nu: dimension of the largest control.
        parameters: (N+1, np) parameter vector of every node, its action's defaults at first; the last one belongs to
            the terminal cost.
        x0: (nx,) first state, the neutral one at first.

    Raises:
        InputError: no interval, as many actions as there are not intervals, or actions on different states.
    """

    def __init__(
        self, action: Action | Sequence[Action], nodes: int | None = None, terminal: Action | None = None
    ) -> None:
        self.actions = _one_each(action, nodes)
        self.terminal = self.actions[-1] if terminal is None else terminal
        self.nodes = len(self.actions)
        self.state = self.actions[0].state
        every = (*self.actions, self.terminal)
        for k, other in enumerate(every):
            if (other.state.nx, other.state.ndx) != (self.state.nx, self.state.ndx):
                expected = f"an action on states of nx = {self.state.nx}, ndx = {self.state.ndx}, as at node 0"
                got = f"'{other.name}' on nx = {other.state.nx}, ndx = {other.state.ndx}"
                raise InputError(f"actions[{k}]" if k < self.nodes else "terminal", got, expected)
        self.nu = max(action.nu for action in self.actions)
        self.parameters: Array = np.zeros((self.nodes + 1, max(action.parameters.size for action in every)))
        for k, each in enumerate(every):
            self.parameters[k, : each.parameters.size] = each.parameters.default
        self.x0: Array = self.state.neutral()

    @property
    def uniform(self) -> bool:
        """Whether all nodes have the same action."""
        return all(action is self.terminal for action in self.actions)

    @property
    def action(self) -> Action:
        """The action of all nodes.

        Raises:
            InputError: they differ.
        """
        if not self.uniform:
            names = sorted({action.name for action in (*self.actions, self.terminal)})
            raise InputError("problem", f"actions that differ ({', '.join(names)})", "the same action at all nodes")
        return self.terminal

    def action_at(self, node: int) -> Action:
        """The action of a node, 0 to N."""
        return self.terminal if node == self.nodes else self.actions[node]

    def view(self, name: str) -> Array:
        """Return a writable view (N+1, size) of one parameter at all nodes.

        Raises:
            InputError: no such parameter (names the nearest), or not at the same place at all nodes.
        """
        places = [self.action_at(k).parameters[name] for k in range(self.nodes + 1)]
        if any(place != places[0] for place in places):
            raise InputError(name, "actions that store it differently", "set(name, value), which finds each place")
        view: Array = self.parameters[..., places[0]]
        return view

    def set(self, name: str, value: ArrayLike, nodes: Sequence[int] | None = None) -> None:
        """Set one parameter.

        Args:
            name: of the parameter.
            value: one value for all nodes (size,), one for each of the nodes (n, size), or a number; finite, but for a
                bound (a name that ends in ``lower`` or ``upper``), which may be infinite.
            nodes: which, 0 to N (n of them); all whose action has the parameter unless given.

        Raises:
            InputError: no such parameter or node, wrong shape, or not finite.
        """
        chosen = self._having(name) if nodes is None else list(nodes)
        for k in chosen:
            if not 0 <= k <= self.nodes:
                raise InputError("nodes", k, f"0 to {self.nodes}")
        places = [self.action_at(k).parameters[name] for k in chosen]
        array = np.asarray(value, dtype=np.float64)
        sizes = {place.stop - place.start for place in places}
        size = sizes.pop() if len(sizes) == 1 else -1
        if array.shape not in ((), (size,), (len(chosen), size)):
            raise InputError(name, f"shape {array.shape}", f"a number, shape {(size,)} or {(len(chosen), size)}")
        is_bound = name.endswith(("lower", "upper"))
        if np.isnan(array).any() or not (is_bound or np.isfinite(array).all()):
            raise InputError(name, "NaN or infinity", "no NaN" if is_bound else "finite values")
        for i, (k, place) in enumerate(zip(chosen, places, strict=True)):
            self.parameters[k, place] = array[i] if array.ndim == 2 else array

    def set_initial_state(self, x0: ArrayLike) -> None:
        """Set the first state.

        Raises:
            InputError: wrong shape, or not finite.
        """
        array = np.asarray(x0, dtype=np.float64)
        if array.shape != self.x0.shape:
            raise InputError("x0", f"shape {array.shape}", f"shape {self.x0.shape}")
        if not np.isfinite(array).all():
            raise InputError("x0", "NaN or infinity", "finite values")
        self.x0[:] = array

    def evaluate(self, node: int, x: Array, u: Array) -> StageValue:
        """Evaluate the action of one interval (interpreted: for inspection and tests, not for loops).

        Args:
            node: 0 to N-1.
            x: (nx,) state.
            u: (nu,) control; what the action does not use is ignored.
        """
        action = self.actions[node]
        return action.evaluate(x, u[: action.nu], self.parameters[node, : action.parameters.size])

    def copy(self) -> ShootingProblem:
        """A problem with the same actions and data of its own."""
        twin = ShootingProblem(self.actions, terminal=self.terminal)
        twin.parameters[...] = self.parameters
        twin.x0[...] = self.x0
        return twin

    def hold(self) -> Trajectory:
        """The plainest guess: the first state at all nodes, no control."""
        return Trajectory(np.tile(self.x0, (self.nodes + 1, 1)), np.zeros((self.nodes, self.nu)))

    def rollout(self, us: ArrayLike) -> Trajectory:
        """Simulate the dynamics from the first state under given controls (N, nu).

        Raises:
            InputError: wrong shape.
        """
        controls = np.array(us, dtype=np.float64)
        if controls.shape != (self.nodes, self.nu):
            raise InputError("us", f"shape {controls.shape}", f"shape {(self.nodes, self.nu)}")
        xs = np.empty((self.nodes + 1, self.x0.size))
        xs[0] = self.x0
        for k in range(self.nodes):
            xs[k + 1] = self.evaluate(k, xs[k], controls[k]).x_next
        return Trajectory(xs, controls)

    def check(self, guess: Trajectory) -> Trajectory:
        """Return a guess as float64 arrays, once it fits.

        Raises:
            InputError: wrong shapes.
        """
        arrays = []
        for name, value, shape in (
            ("xs", guess.xs, (self.nodes + 1, self.state.nx)),
            ("us", guess.us, (self.nodes, self.nu)),
        ):
            array = np.asarray(value, dtype=np.float64)
            if array.shape != shape:
                raise InputError(name, f"shape {array.shape}", f"shape {shape}")
            arrays.append(array)
        return Trajectory(*arrays)

    def _having(self, name: str) -> list[int]:
        """Nodes whose action has a parameter; the error that names the nearest where there is none."""
        chosen = [k for k in range(self.nodes + 1) if name in tuple(self.action_at(k).parameters)]
        if not chosen:
            known = {key: None for k in range(self.nodes + 1) for key in self.action_at(k).parameters}
            raise InputError("parameter", name, "a parameter of an action", tuple(known))
        return chosen


def _one_each(action: Action | Sequence[Action], nodes: int | None) -> tuple[Action, ...]:
    if isinstance(action, Action):
        if nodes is None or nodes < 1:
            raise InputError("nodes", nodes, "at least one interval")
        return (action,) * nodes
    actions = tuple(action)
    if not actions:
        raise InputError("action", "an empty sequence", "at least one interval")
    if nodes is not None and nodes != len(actions):
        raise InputError("nodes", nodes, f"{len(actions)}, one for each action, or nothing")
    return actions
