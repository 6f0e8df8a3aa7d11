r"""Bodies that turn by changes of shape at zero angular momentum: the falling cat, three links.

Half a turn of a cat about its spine::

    cat = Cat()
    cat.connection().holonomy(flip(cat.flipping_bend()))

Chapter 4.16; Kane and Scher, "A dynamical explanation of the falling cat phenomenon", Int. J. Solids Structures 5
(1969); Montgomery, "Gauge theory of the falling cat", Fields Inst. Commun. 1 (1993); Kelly and Murray, "Geometric
phases and robotic locomotion", J. Robotic Systems 12 (1995) (three links).
"""

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks, so3
from lgmpc.lie.symbolic import so3 as symbolic
from lgmpc.mechanics.checks import check_positive, frozen
from lgmpc.mechanics.connection import Connection, Loop
from lgmpc.timegrid import minimum_jerk
from lgmpc.typing import Array


@dataclass(frozen=True)
class Cat:
    """A cat of two equal halves, which bend but do not twist.

    The halves, round about their axes, are joined at a point. Their attitudes in a frame between them are
    ``exp(r/2)`` (front) and ``exp(-r/2)`` (rear), r = (r_x, r_y, 0) perpendicular to the spine z: a bend by ``|r|``, no
    twist. The shape is (r_x, r_y). A full turn of the bend's direction at constant size returns to the same shape and
    rotates the cat about its spine.

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
            return minimum_jerk(ca.fmin(ca.fmax(3.0 * s - start, 0.0), 1.0))[0]

        size, direction = bend * (ease(0.0) - ease(2.0)), 2.0 * ca.pi * ease(1.0)
        return ca.vertcat(size * ca.cos(direction), size * ca.sin(direction))

    return loop


@dataclass(frozen=True, eq=False)
class ThreeLink:
    """Three links in a plane (first, middle, last) with their centres of mass at half of their lengths.

    The shape r = (r_1, r_2) are the angles of the first and the last link to the middle one, whose angle in the world
    is theta.

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
