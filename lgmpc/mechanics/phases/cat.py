r"""The falling cat: two halves that bend but do not twist, at zero angular momentum (chapter 4.16).

Kane and Scher, "A dynamical explanation of the falling cat phenomenon", Int. J. Solids Structures 5 (1969); Montgomery,
"Gauge theory of the falling cat", Fields Inst. Commun. 1 (1993).

Two equal halves, round about their axes, are joined at a point. Their attitudes in a frame between them are
``exp(r/2)`` (front) and ``exp(-r/2)`` (rear), r = (r_x, r_y, 0) perpendicular to the spine z: a bend by ``|r|``, no
twist. The shape is (r_x, r_y). A full turn of the bend's direction at constant size returns to the same shape and
rotates the cat about its spine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.lie.symbolic import so3 as symbolic
from lgmpc.mechanics.checks import check_positive
from lgmpc.mechanics.phases.connection import Connection, Loop
from lgmpc.typing import Array

__all__ = ["Cat", "flip"]


@dataclass(frozen=True)
class Cat:
    """A cat of two equal halves.

    Attributes:
        mass: of one half, kg.
        axial: moment of inertia of a half about the spine, kg.m2.
        transverse: moment of inertia of a half across it, about its own centre of mass, kg.m2.
        length: from the joint to the centre of mass of a half, m.

    Raises:
        InputError: a value that is not positive, or an axial inertia above twice the transverse one, which no body has.
    """

    mass: float = 2.0
    axial: float = 0.01
    transverse: float = 0.025
    length: float = 0.12

    def __post_init__(self) -> None:
        for name, unit in (("mass", "kg"), ("axial", "kg.m2"), ("transverse", "kg.m2"), ("length", "m")):
            check_positive(name, getattr(self, name), unit)
        if self.axial > 2.0 * self.transverse:
            raise InputError("axial", self.axial, f"at most twice the transverse inertia, {2.0 * self.transverse}")

    def energy(self, r: Any, xi: Any, speed: Any) -> Any:
        """Return the kinetic energy about the centre of mass, J.

        Args:
            r: (2,) bend, rad.
            xi: (3,) angular velocity of the frame between the halves, in it, rad/s.
            speed: (2,) r', rad/s.
        """
        spine, local = ca.DM([0.0, 0.0, 1.0]), ca.diag(ca.DM([self.transverse, self.transverse, self.axial]))
        total: Any = 0.0
        velocities = []
        for side in (0.5, -0.5):
            bend, rate = (ca.vertcat(side * part, 0.0) for part in (r, speed))
            turn = symbolic.exp(bend)
            own = symbolic.left_jacobian(bend) @ rate
            omega = xi + own
            total += 0.5 * ca.sumsqr(ca.sqrt(local) @ (turn.T @ omega))
            velocities.append(ca.cross(omega, math.copysign(self.length, side) * (turn @ spine)))
        # Equal masses: each half moves about the common centre by half of the difference of their velocities.
        return total + self.mass * ca.sumsqr((velocities[0] - velocities[1]) / 2)

    def connection(self) -> Connection:
        """The mechanical connection, SO(3) over the plane of bends."""
        return Connection(self.energy, shapes=2, dimension=3)

    def turn(self, bend: float) -> float:
        r"""Return the rotation about the spine by one circuit of the bend's direction, rad, in closed form.

        With c = cos(bend/2), s = sin(bend/2): ``2 pi (I c / (J s^2 + I c^2) - 1)``, I axial and J transverse. It
        depends on neither mass nor length.
        """
        c, s = math.cos(bend / 2.0), math.sin(bend / 2.0)
        return 2.0 * math.pi * (self.axial * c / (self.transverse * s**2 + self.axial * c**2) - 1.0)

    def flipping_bend(self) -> float:
        """Return the bend, rad, whose circuit rotates the cat by 180 degrees: the inverse of :meth:`turn`."""
        ratio = self.transverse / self.axial
        return 2.0 * math.acos(ratio / (1.0 + math.sqrt(1.0 - ratio * (1.0 - ratio))))

    def halves(self, r: Array, attitudes: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return position (n, 3), m, from the centre of mass, and rotation (n, 3, 3) of the front and the rear half.

        Args:
            r: (n, 2) bends.
            attitudes: (n, 3, 3) of the frame between the halves.
        """
        bends = np.concatenate((0.5 * r, np.zeros((len(r), 1))), axis=1)
        front, rear = attitudes @ so3.exp(bends), attitudes @ so3.exp(-bends)
        ahead, behind = self.length * front[:, :, 2], -self.length * rear[:, :, 2]
        center = (ahead + behind) / 2.0
        return (ahead - center, front), (behind - center, rear)


def flip(bend: float) -> Loop:
    """Return the loop that bends, turns the bend's direction once and straightens, a third of s each.

    Each third starts and ends at rest, with continuous accelerations.
    """

    def loop(s: Any) -> Any:
        def ease(start: float) -> Any:
            x = ca.fmin(ca.fmax(3.0 * s - start, 0.0), 1.0)
            return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)

        size, direction = bend * (ease(0.0) - ease(2.0)), 2.0 * ca.pi * ease(1.0)
        return ca.vertcat(size * ca.cos(direction), size * ca.sin(direction))

    return loop
