"""The contact forces of a trajectory whose actions have contacts, for figures and replays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions import Action, MultibodyAction
from lgmpc.actions.implicit import Unknowns
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["contact_forces_of"]


def contact_forces_of(robot: Robot, problem: ShootingProblem) -> Callable[[Trajectory], Array]:
    """Return the function from a trajectory to its forces (N, nc, 3) on the robot's contact frames, world axes, N.

    They are those of the actions' own dynamics, with the problem's parameters as they are when it is called; zero over
    an interval whose action has no such contact, and over an impact, which has impulses.
    """
    known: dict[int, ca.Function] = {}

    def forces(trajectory: Trajectory) -> Array:
        found = np.zeros((problem.nodes, robot.nc, 3))
        for k, (action, x, u) in enumerate(zip(problem.actions, trajectory.xs[:-1], trajectory.us, strict=True)):
            if id(action) not in known:
                known[id(action)] = _function(robot, action)
            function = known[id(action)]
            p = problem.parameters[k, : action.parameters.size]
            found[k] = function(x, u[: action.nu], p).full().T
        return found

    return forces


def _function(robot: Robot, action: Action) -> ca.Function:
    """``(x, u, p) -> (3, nc)`` forces."""
    sizes = {"x": action.state.nx, "u": action.nu, "p": action.parameters.size}
    x, u, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    forces: Mapping[int | str, Any] = {}
    if isinstance(action, MultibodyAction):
        values = action.parameters.split(p)
        forces = action.dynamics.motion(x[: robot.nq], x[robot.nq :], u, values, Unknowns()).forces
    columns = [_force(forces, *contact) for contact in zip(robot.contact_frames, robot.contact_ids, strict=True)]
    return ca.Function(f"{action.name}_forces", [x, u, p], [ca.densify(ca.horzcat(*columns))])


def _force(forces: Mapping[int | str, Any], name: str, index: int) -> Any:
    """The force at a frame, which dynamics know by name or by index; zero if it is no contact of theirs."""
    found = forces.get(name, forces.get(index))
    return ca.SX.zeros(3) if found is None else found[:3]
