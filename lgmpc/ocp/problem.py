"""An optimal control problem on a grid: an action repeated over a horizon, a parameter vector a node, a first state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.actions import Action
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
    """Minimise the action's cost over N intervals from a given first state, subject to its dynamics and constraints.

    It holds data only; any solver takes it. The arrays are written in place between solves, through :meth:`set` (which
    checks) or, in a loop that must not spend time on checks, through :meth:`view`.

    Args:
        action: the interval.
        nodes: N, number of intervals.

    Attributes:
        action: the interval.
        nodes: N.
        parameters: (N+1, np) parameter vector of every node; the last one belongs to the terminal cost.
        x0: (nx,) first state.

    Raises:
        InputError: no interval.
    """

    def __init__(self, action: Action, nodes: int) -> None:
        if nodes < 1:
            raise InputError("nodes", nodes, "at least one interval")
        self.action = action
        self.nodes = nodes
        self.parameters: Array = np.zeros((nodes + 1, action.parameters.size))
        self.x0: Array = np.zeros(action.state.nx)

    def view(self, name: str) -> Array:
        """Return a writable view (N+1, size) of one parameter at all nodes.

        Raises:
            InputError: no such parameter; names the nearest.
        """
        return self.action.parameters.view(self.parameters, name)

    def set(self, name: str, value: ArrayLike) -> None:
        """Set one parameter at all nodes.

        Args:
            name: of the parameter.
            value: finite; one value for all nodes (size,), one a node (N+1, size), or a number.

        Raises:
            InputError: no such parameter, wrong shape, or not finite.
        """
        view = self.view(name)
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), view.shape[1:], view.shape):
            raise InputError(name, f"shape {array.shape}", f"a number, shape {view.shape[1:]} or {view.shape}")
        if not np.isfinite(array).all():
            raise InputError(name, "NaN or infinity", "finite values")
        view[...] = array

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

    def rollout(self, us: ArrayLike) -> Trajectory:
        """Simulate the dynamics from the first state under given controls (N, nu).

        Raises:
            InputError: wrong shape.
        """
        controls = np.array(us, dtype=np.float64)
        if controls.shape != (self.nodes, self.action.nu):
            raise InputError("us", f"shape {controls.shape}", f"shape {(self.nodes, self.action.nu)}")
        xs = np.empty((self.nodes + 1, self.x0.size))
        xs[0] = self.x0
        for k in range(self.nodes):
            xs[k + 1] = self.action.evaluate(xs[k], controls[k], self.parameters[k]).x_next
        return Trajectory(xs, controls)
