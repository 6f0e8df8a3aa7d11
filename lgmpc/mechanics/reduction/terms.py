"""The vocabulary of reduced systems: what their expressions are written in, and what a computed motion is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.typing import Array

__all__ = ["Advected", "Expression", "Motion", "Symbols", "state_of"]


@dataclass(frozen=True)
class Symbols:
    """What Lagrangians, forces and potentials are written in; CasADi expressions.

    Attributes:
        time: s.
        pose: (size, size) group element; not for the Lagrangian, which is reduced.
        velocity: (dim,) body velocity under left reduction, spatial under right.
        advected: (m,) what the motion carries along.
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
    """A quantity that is constant in the world (left reduction; in the body under right) and enters the Lagrangian.

    Attributes:
        size: number of components.
        act: (element, a) -> a, a linear action of the group from the left, as an expression. What is ``a0``
            in the world is ``act(g^-1, a0)`` in the body.
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
