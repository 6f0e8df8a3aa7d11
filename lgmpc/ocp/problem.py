"""An optimal control problem on a grid: an action for each interval, a parameter vector a node, a first state."""

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.actions import Action, StageValue
from lgmpc.errors import InputError
from lgmpc.typing import Array, identifier, numbers

FEASIBLE = 1e-6
"""Violation up to which a first state counts as feasible."""


@dataclass(frozen=True)
class Trajectory:
    """States and controls over a horizon.

    Attributes:
        xs: (N+1, nx) states at the nodes.
        us: (N, nu) controls, each constant from its node to the next.
    """

    xs: Array
    us: Array

    def __repr__(self) -> str:
        return f"Trajectory(xs {np.shape(self.xs)}, us {np.shape(self.us)})"


class ShootingProblem:
    """Minimise the cost of N intervals and of the last state, from a given first state, subject to the actions.

    It contains data only and is independent of solvers. The arrays are written in place between solves, by :meth:`set`
    (checked) or, in control loops, through :meth:`view` (not checked).

    The intervals may differ (flight, impact, stance): pass a sequence of actions on the same state. Every distinct
    object is compiled once. Controls and parameters have as many columns as the largest action requires; a node's
    action ignores the others.

    Args:
        action: the interval, or one action an interval.
        nodes: N, number of intervals; optional for a sequence.
        terminal: the action whose terminal cost applies to the last state; that of the last interval unless given.

    Attributes:
        actions: (N,) one an interval.
        terminal: see above.
        nodes: N.
        state: the space of all states.
        nu: dimension of the largest control.
        parameters: (N+1, np) parameter vector of every node, initially its action's defaults; the last one is that of
            the terminal cost.
        x0: (nx,) first state, initially the neutral one.

    Raises:
        InputError: no interval, a number of actions that is not ``nodes``, actions on different states, or a name that
            is no C identifier.
    """

    def __init__(
        self, action: Action | Sequence[Action], nodes: int | None = None, terminal: Action | None = None
    ) -> None:
        self.actions = _one_each(action, nodes)
        self.terminal = self.actions[-1] if terminal is None else terminal
        if not isinstance(self.terminal, Action):
            raise InputError("terminal", type(self.terminal).__name__, "an action")
        self.nodes = len(self.actions)
        self.state = self.actions[0].state
        every = (*self.actions, self.terminal)
        for k, other in enumerate(every):
            if (other.state.nx, other.state.ndx) != (self.state.nx, self.state.ndx):
                expected = f"an action on states of nx = {self.state.nx}, ndx = {self.state.ndx}, as at node 0"
                got = f"'{other.name}' on nx = {other.state.nx}, ndx = {other.state.ndx}"
                raise InputError(f"actions[{k}]" if k < self.nodes else "terminal", got, expected)
            identifier(f"actions[{k}].name" if k < self.nodes else "terminal.name", other.name)
        self.nu = max(action.nu for action in self.actions)
        self.parameters: Array = np.zeros((self.nodes + 1, max(action.parameters.size for action in every)))
        for k, each in enumerate(every):
            self.parameters[k, : each.parameters.size] = each.parameters.default
        self.x0: Array = self.state.neutral()

    def __repr__(self) -> str:
        names = [action.name for action in self.actions]
        actions = ", ".join(f"{names.count(name)} x {name}" for name in dict.fromkeys(names))
        size = f"nx = {self.state.nx}, ndx = {self.state.ndx}, nu = {self.nu}"
        return f"<ShootingProblem of {self.nodes} intervals: {size}; {actions}; terminal {self.terminal.name}>"

    @property
    def uniform(self) -> bool:
        """True if all nodes have the same action."""
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
        """Return the action of a node.

        Raises:
            InputError: no node from 0 to N.
        """
        if not isinstance(node, (int, np.integer)) or not 0 <= node <= self.nodes:
            raise InputError("node", node, f"a node, 0 to {self.nodes}")
        return self.terminal if node == self.nodes else self.actions[node]

    def view(self, name: str) -> Array:
        """Return a writable view (N+1, size) of one parameter at all nodes.

        Raises:
            InputError: no such parameter (names the nearest), or its slice differs between nodes.
        """
        places = [self.action_at(k).parameters[name] for k in range(self.nodes + 1)]
        if any(place != places[0] for place in places):
            raise InputError(name, "actions that store it differently", "set(name, value), which writes every slice")
        return self.parameters[..., places[0]]

    def set(self, name: str, value: ArrayLike, nodes: Sequence[int] | None = None) -> None:
        """Set one parameter.

        Args:
            name: of the parameter.
            value: one value for all nodes (size,), one for each of the nodes (n, size), or a number; of parameters
                with several equal parts, such as the gains of contacts, one part is enough. Finite, but for a bound
                (a name that ends in ``lower`` or ``upper``), which may be infinite.
            nodes: which, 0 to N (n of them); all whose action has the parameter unless given.

        Raises:
            InputError: no such parameter or node, wrong shape, not finite, or of a sign that it cannot have (weights,
                durations).
        """
        chosen = self._having(name) if nodes is None else self._nodes_of(nodes)
        places = [self.action_at(k).parameters[name] for k in chosen]
        array = numbers(name, value)
        actions = {id(action): action.parameters.parameter(name) for action in map(self.action_at, chosen)}
        shapes = set.intersection(*(set(parameter.shapes) for parameter in actions.values())) if actions else {()}
        each = {(len(chosen), *shape) for shape in shapes if shape}
        if array.shape not in shapes | each:
            expected = " or ".join(f"shape {shape}" for shape in sorted(shapes - {()}) + sorted(each))
            raise InputError(name, f"shape {array.shape}", f"a number, {expected}" if expected else "a number")
        is_bound = name.endswith(("lower", "upper"))
        wrong = np.isnan(array) if is_bound else ~np.isfinite(array)
        if wrong.any():
            where = f", node {chosen[int(wrong.any(axis=1).argmax())]}" if array.ndim == 2 else ""
            raise InputError(f"{name}{where}", "NaN or infinity", "no NaN" if is_bound else "finite values")
        for i, k in enumerate(chosen):
            one, where = (array[i], f", node {k}") if array.ndim == 2 else (array, "")
            actions[id(self.action_at(k))].check_sign(one, where)
        for i, (k, place) in enumerate(zip(chosen, places, strict=True)):
            parameter = actions[id(self.action_at(k))]
            self.parameters[k, place] = parameter.whole(array[i] if array.ndim == 2 else array)

    def set_initial_state(self, x0: ArrayLike) -> None:
        """Set the first state.

        Raises:
            InputError: wrong shape, or not finite.
        """
        self.x0[:] = numbers("x0", x0, self.x0.shape, finite=True)

    def evaluate(self, node: int, x: Array, u: Array) -> StageValue:
        """Evaluate the action of one interval (interpreted: for inspection and tests, not for loops).

        Args:
            node: 0 to N-1.
            x: (nx,) state.
            u: (nu,) control; what the action does not use is ignored, or (n,) of the action's own.

        Raises:
            InputError: no such interval, or wrong shapes.
        """
        if not isinstance(node, (int, np.integer)) or not 0 <= node < self.nodes:
            raise InputError("node", node, f"an interval, 0 to {self.nodes - 1}")
        action = self.actions[node]
        control = numbers("u", u, *{(self.nu,), (action.nu,)})
        return action.evaluate(x, control[: action.nu], self.parameters[node, : action.parameters.size])

    def first_violation(self) -> tuple[int, float] | None:
        """Return the row of the first node's path constraint that the first state violates most, and by how much.

        Only rows that do not depend on the control count: no solution satisfies them. None if all hold.
        """
        action, p = self.actions[0], self.parameters[0]
        function = action.value_function
        rows = function.size1_out("constraint")
        if rows == 0:
            return None
        fixed = np.ones(rows, dtype=bool)
        fixed[np.unique(function.jac_sparsity(2, 1).get_triplet()[0]).astype(np.int64)] = False
        if not fixed.any():
            return None
        point = action.evaluate(self.x0, np.zeros(action.nu), p[: action.parameters.size])
        outside = np.maximum(point.lower - point.constraint, point.constraint - point.upper)
        outside[~fixed | ~np.isfinite(outside)] = 0.0
        row = int(outside.argmax())
        return (row, float(outside[row])) if outside[row] > FEASIBLE else None

    def copy(self) -> "ShootingProblem":
        """Return a problem with the same actions and a copy of the data."""
        result = copy(self)  # the actions have been checked
        result.parameters, result.x0 = self.parameters.copy(), self.x0.copy()
        return result

    def hold(self) -> Trajectory:
        """Return the guess with the first state at all nodes and zero controls."""
        return Trajectory(np.tile(self.x0, (self.nodes + 1, 1)), np.zeros((self.nodes, self.nu)))

    def rollout(self, us: ArrayLike) -> Trajectory:
        """Simulate the dynamics from the first state under given controls (N, nu).

        Raises:
            InputError: wrong shape.
        """
        controls = numbers("us", us, (self.nodes, self.nu)).copy()
        xs = np.empty((self.nodes + 1, self.x0.size))
        xs[0] = self.x0
        for k in range(self.nodes):
            xs[k + 1] = self.evaluate(k, xs[k], controls[k]).x_next
        return Trajectory(xs, controls)

    def check(self, guess: Trajectory) -> Trajectory:
        """Return a guess as float64 arrays of the right shapes.

        Raises:
            InputError: no trajectory, wrong shapes, or a parameter of a sign that it cannot have.
        """
        if not isinstance(guess, Trajectory):
            raise InputError("guess", type(guess).__name__, "a Trajectory(xs, us), or a solution")
        self._check_signs()
        xs = numbers("xs", guess.xs, (self.nodes + 1, self.state.nx))
        return Trajectory(xs, numbers("us", guess.us, (self.nodes, self.nu)))

    def _check_signs(self) -> None:
        """Check what was written without :meth:`set`; NaN is left to the solvers' explanations."""
        for action in {id(each): each for each in (*self.actions, self.terminal)}.values():
            layout = action.parameters
            low = (self.parameters[:, layout.positive] <= 0.0).any() or (
                self.parameters[:, layout.not_negative] < 0.0
            ).any()
            for k in range(self.nodes + 1) if low else ():
                if self.action_at(k) is not action:
                    continue
                for parameter in layout.parameters:
                    values = self.parameters[k, layout[parameter.name]]
                    parameter.check_sign(np.where(np.isnan(values), np.inf, values), f", node {k}")

    def _nodes_of(self, nodes: Sequence[int]) -> list[int]:
        chosen = list(nodes) if isinstance(nodes, Iterable) else [nodes]
        for k in chosen:
            if not isinstance(k, (int, np.integer)) or not 0 <= k <= self.nodes:
                raise InputError("nodes", k, f"whole numbers from 0 to {self.nodes}")
        if not isinstance(nodes, Iterable):
            raise InputError("nodes", nodes, f"a list: [{nodes}]")
        return chosen

    def _having(self, name: str) -> list[int]:
        """Return the nodes whose action has a parameter; raise the error that names the nearest if there is none."""
        chosen = [k for k in range(self.nodes + 1) if name in tuple(self.action_at(k).parameters)]
        if not chosen:
            known = {key: None for k in range(self.nodes + 1) for key in self.action_at(k).parameters}
            raise InputError("parameter", name, "a parameter of an action", tuple(known))
        return chosen


def _one_each(action: Action | Sequence[Action], nodes: int | None) -> tuple[Action, ...]:
    if isinstance(action, Action):
        if not isinstance(nodes, (int, np.integer)) or nodes < 1:
            raise InputError("nodes", nodes, "at least one interval")
        return (action,) * int(nodes)
    actions = tuple(action) if isinstance(action, Iterable) else (action,)
    if not actions:
        raise InputError("action", "an empty sequence", "at least one interval")
    for k, each in enumerate(actions):
        if not isinstance(each, Action):
            expected = "an action, or a sequence of actions; the first state is the attribute x0"
            raise InputError("action", f"{type(each).__name__} at interval {k}", expected)
    if nodes is not None and nodes != len(actions):
        got = nodes if isinstance(nodes, int) else type(nodes).__name__
        raise InputError("nodes", got, f"{len(actions)}, one for each action, or nothing")
    return actions
