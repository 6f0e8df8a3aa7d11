"""Centroidal momentum from the mass matrix, and its balance (chapter 4.8).

Orin, Goswami and Lee, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35 (2013); Wensing and Orin,
"Improved computation of the humanoid centroidal dynamics and application for whole-body control", Int. J. Humanoid
Robotics 13 (2016).

Wrenches and momenta are [linear; angular] about the centre of mass, world axes, as Pinocchio's ``hg`` and ``Ag``; in
the chapter they are [angular; linear].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks, quaternion, se3
from lgmpc.mechanics.checks import check_vector
from lgmpc.mechanics.multibody.floating_base import EquationsOfMotion
from lgmpc.typing import Array

__all__ = ["CentroidalTerms", "centroidal_terms", "wrench_about"]


@dataclass(frozen=True)
class CentroidalTerms:
    """Momentum, its rate and gravity of the whole robot, from the six rows of the base.

    Attributes:
        mass: of the robot, kg.
        com: (3,) centre of mass, world, m.
        matrix: (6, nv) A_G: momentum ``h = A_G v``.
        rate: (6, nv) dA_G/dt, so that ``h' = A_G v' + dA_G/dt v``.
        gravity: (6,) wrench of gravity about the centre of mass: [m g; 0].
    """

    mass: float
    com: Array
    matrix: Array
    rate: Array
    gravity: Array

    def momentum(self, v: ArrayLike) -> Array:
        """Return (6,) h for a velocity (nv,).

        Raises:
            InputError: another shape, or not finite.
        """
        found: Array = self.matrix @ check_vector("v", v, self.matrix.shape[1])
        return found

    def momentum_rate(self, v: ArrayLike, acceleration: ArrayLike) -> Array:
        """Return (6,) h' for a velocity and an acceleration (nv,); equals the sum of all external wrenches.

        Raises:
            InputError: another shape, or not finite.
        """
        size = self.matrix.shape[1]
        found: Array = self.matrix @ check_vector("acceleration", acceleration, size)
        found += self.rate @ check_vector("v", v, size)
        return found


def centroidal_terms(equations: EquationsOfMotion, q: ArrayLike, v: ArrayLike) -> CentroidalTerms:
    """Return A_G and its rate from the first six rows of M and C (Wensing and Orin 2016; chapter 4.8.3).

    ``A_G = Phi^T M_b``, where Phi^T maps a wrench from the base's frame to the centre of mass. ``dA_G/dt = Phi^T C_b``
    holds only for the products with v (unlike in the chapter). The matrix itself is

        dA_G/dt = Phi^T (M_b' - ad*_zeta M_b),        M' = C + C^T,

    with zeta the twist of the base relative to the centre of mass.

    Args:
        equations: of a floating robot at a state.
        q: (nq,) the configuration of that state.
        v: (nv,) its velocity.

    Raises:
        InputError: a fixed base, or a state of another shape.
    """
    if not equations.free:
        raise InputError("equations", "a robot with a fixed base", "a robot whose first joint is a free-flyer")
    configuration = check_vector("q", q, len(equations.mass) + 1)
    velocity = check_vector("v", v, len(equations.mass))
    locked = equations.locked_inertia
    mass = float(locked[0, 0])
    rotation = quaternion.to_matrix(configuration[3:7])
    from_base = rotation @ (np.array([locked[5, 1], locked[3, 2], locked[4, 0]]) / mass)
    # The base's frame relative to the centre of mass, world axes.
    base = se3.from_parts(rotation, -from_base)
    carry = se3.adjoint(se3.inverse(base)).T
    matrix = carry @ equations.mass[:6]
    zeta = velocity[:6].copy()
    zeta[:3] -= rotation.T @ (matrix[:3] @ velocity) / mass
    mass_rate = equations.coriolis[:6] + equations.coriolis[:, :6].T
    return CentroidalTerms(
        mass=mass,
        com=configuration[:3] + from_base,
        matrix=matrix,
        rate=carry @ (mass_rate - se3.coadjoint(zeta) @ equations.mass[:6]),
        gravity=-carry @ equations.gravity[:6],
    )


def wrench_about(com: ArrayLike, points: ArrayLike, forces: ArrayLike, moments: ArrayLike = 0.0) -> Array:
    """Return (6,) the sum of forces at points, and of pure moments, as one wrench about the centre of mass.

    Args:
        com: (3,) m.
        points: (k, 3) where the forces act, world, m.
        forces: (k, 3) world axes, N.
        moments: (k, 3) world axes, N.m; none if omitted.

    Raises:
        InputError: inconsistent shapes, or numbers that are not finite.
    """
    places, pulls = checks.finite("points", points), checks.finite("forces", forces)
    if places.ndim != 2 or places.shape[1] != 3:
        raise InputError("points", f"shape {places.shape}", "shape (k, 3)")
    if pulls.shape != places.shape:
        raise InputError("forces", f"shape {pulls.shape}", f"shape {places.shape}, as the points")
    couples = checks.finite("moments", moments)
    if couples.ndim and couples.shape != places.shape:
        raise InputError("moments", f"shape {couples.shape}", f"shape {places.shape}, as the points")
    turns = np.cross(places - check_vector("com", com, 3), pulls) + couples
    return np.concatenate([pulls.sum(axis=0), turns.sum(axis=0)])
