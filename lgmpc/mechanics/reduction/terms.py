"""Symbols of reduced systems, advected quantities, and computed motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.typing import Array

__all__ = ["Advected", "Expression", "Motion", "Symbols", "state_of"]


@dataclass(frozen=True)
class Symbols:
    """The arguments of Lagrangians, forces and potentials: CasADi expressions.

    Attributes:
        time: s.
        pose: (size, size) group element; not for the Lagrangian, which is reduced.
        velocity: (dim,) body velocity under left reduction, spatial under right.
        advected: (m,) advected quantity.
        parameters: (p,) constants of the system.
    """

    time: Any
    pose: Any
    velocity: Any
    advected: Any
    parameters: Any

    @property
    def state(self) -> Any:
        """The column ``[vec(pose); velocity; advected]``."""
        return state_of(self.pose, self.velocity, self.advected)


def state_of(pose: Any, velocity: Any, advected: Any) -> Any:
    """Return the column ``[vec(pose); velocity; advected]``."""
    return ca.densify(ca.vertcat(ca.vec(pose), velocity, advected))


Expression = Callable[[Symbols], Any]
"""A Lagrangian, potential or force: CasADi symbols to a CasADi expression."""


@dataclass(frozen=True)
class Advected:
    """A quantity in the Lagrangian that is constant in the world (left reduction) or in the body (right reduction).

    Attributes:
        size: number of components.
        act: (element, a) -> a, a linear left action of the group, as an expression: the quantity ``a0`` in the world
            is ``act(g^-1, a0)`` in the body.
    """

    size: int
    act: Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Motion:
    """A computed motion; a row per stored time.

    Attributes:
        times: (n,) s.
        poses: (n, size, size) group elements.
        velocities: (n, dim) in the trivialisation of the system.
        advected: (n, m).
    """

    times: Array
    poses: Array
    velocities: Array
    advected: Array
