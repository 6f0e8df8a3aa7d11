"""Three links in a plane that rotate by changes of shape, at zero angular momentum (chapter 4.16).

Kelly and Murray, "Geometric phases and robotic locomotion", J. Robotic Systems 12 (1995).

Shape r = (r_1, r_2), the angles of the first and the last link to the middle one, whose angle in the world is theta.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.mechanics.checks import frozen
from lgmpc.mechanics.phases.connection import Connection
from lgmpc.typing import Array

__all__ = ["ThreeLink"]


@dataclass(frozen=True, eq=False)
class ThreeLink:
    """Three links (first, middle, last) with their centres of mass at half of their lengths.

    Args:
        masses: (3,) kg.
        lengths: (3,) from joint to joint, or to the free end, m.
        inertias: (3,) about the centres of mass, kg.m2; those of thin rods unless given.

    Raises:
        InputError: arrays of other shapes, or entries that are not positive.
    """

    masses: Array
    lengths: Array
    inertias: Array

    def __init__(self, masses: ArrayLike, lengths: ArrayLike, inertias: ArrayLike | None = None) -> None:
        mass, length = _three("masses", masses), _three("lengths", lengths)
        inertia = mass * length**2 / 12.0 if inertias is None else _three("inertias", inertias)
        for name, value in (("masses", mass), ("lengths", length), ("inertias", inertia)):
            object.__setattr__(self, name, frozen(value))

    def energy(self, r: Any, xi: Any, speed: Any) -> Any:
        """Return the kinetic energy about the centre of mass, J.

        Args:
            r: (2,) rad.
            xi: (1,) theta', rad/s.
            speed: (2,) r', rad/s.
        """
        points = [ca.vertcat(*point) for point in self._centers(r)]
        velocities = [xi[0] * ca.vertcat(-p[1], p[0]) + ca.jacobian(p, r) @ speed for p in points]
        masses = self.masses.tolist()
        mean = sum((m * v for m, v in zip(masses, velocities, strict=True)), ca.DM.zeros(2)) / sum(masses)
        rates = (xi[0] + speed[0], xi[0], xi[0] + speed[1])
        total: Any = 0.0
        for mass, inertia, velocity, rate in zip(masses, self.inertias.tolist(), velocities, rates, strict=True):
            total += 0.5 * mass * ca.sumsqr(velocity - mean) + 0.5 * inertia * rate**2
        return total

    def connection(self) -> Connection:
        """The mechanical connection, SO(2) over the torus of the two angles."""
        return Connection(self.energy, shapes=2, dimension=1)

    def links(self, r: Array, theta: Array) -> tuple[Array, Array]:
        """Return centres (n, 3, 2) of the links from the common centre of mass, world axes, m, and angles (n, 3), rad.

        Args:
            r: (n, 2) shapes.
            theta: (n,) angles of the middle link.
        """
        zero = np.zeros(len(r))
        local = np.array([[x + zero, y + zero] for x, y in self._centers(r.T)]).transpose(2, 0, 1)
        local = local - np.einsum("l,nlk->nk", self.masses / self.masses.sum(), local)[:, None, :]
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        centers: Array = np.einsum("ijn,nlj->nli", turn, local)
        return centers, theta[:, None] + np.stack((r[:, 0], zero, r[:, 1]), axis=1)

    def _centers(self, r: Any) -> list[tuple[Any, Any]]:
        """Return the centres of the links in the middle link's frame, relative to its own."""
        cos, sin = (np.cos, np.sin) if isinstance(r, np.ndarray) else (ca.cos, ca.sin)
        first, middle, last = (float(length) / 2.0 for length in self.lengths)
        return [
            (-middle - first * cos(r[0]), -first * sin(r[0])),
            (0.0, 0.0),
            (middle + last * cos(r[1]), last * sin(r[1])),
        ]


def _three(name: str, value: ArrayLike) -> Array:
    array = checks.finite(name, value)
    if array.shape != (3,) or array.min() <= 0.0:
        raise InputError(name, value, "three positive numbers")
    return array
