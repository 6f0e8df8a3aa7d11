r"""Elroy's beanie: two bodies in a plane on one pivot, the simplest example of a geometric phase.

Marsden, Montgomery and Ratiu, "Reduction, symmetry and phases in mechanics", Memoirs AMS 436 (1990), chapter 1; chapter
4.16. theta is the angle of the first body, psi that of the second one relative to it; the angular momentum is

    mu = (I1 + I2) theta' + I2 psi'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lgmpc.mechanics.checks import check_positive
from lgmpc.mechanics.phases.connection import Connection

__all__ = ["Beanie"]


@dataclass(frozen=True)
class Beanie:
    """Two bodies whose centres of mass are on the pivot.

    Attributes:
        first: I1, kg.m2.
        second: I2, kg.m2.

    Raises:
        InputError: an inertia that is not positive.
    """

    first: float
    second: float

    def __post_init__(self) -> None:
        for name in ("first", "second"):
            check_positive(name, getattr(self, name), "kg.m2")

    def energy(self, r: Any, xi: Any, speed: Any) -> Any:
        """Return the kinetic energy, J, at shape r = psi (1,), rates xi = theta' (1,) and speed = psi' (1,)."""
        return 0.5 * self.first * xi[0] ** 2 + 0.5 * self.second * (xi[0] + speed[0]) ** 2

    def connection(self) -> Connection:
        """The mechanical connection, SO(2) over the line of angles psi; it is flat: ``A = I2 / (I1 + I2)``."""
        return Connection(self.energy, shapes=1, dimension=1)

    def geometric_phase(self, change: float) -> float:
        """Return the rotation of the first body while psi changes by ``change``, at zero momentum, rad."""
        return -self.second / (self.first + self.second) * change

    def dynamic_phase(self, momentum: float, duration: float) -> float:
        """Return the rotation of the locked bodies with a momentum (N.m.s) over ``duration`` (s), rad."""
        return momentum / (self.first + self.second) * duration
