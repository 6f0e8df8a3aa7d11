"""Noether's theorem, checked: a system's symmetries, and the drift of its momentum map.

For a left-reduced system, moving the whole motion by ``exp(e zeta)`` from the left changes the Lagrangian at the rate
``dL . zeta``; along every motion without further forces

    d/dt <J, zeta> = dL . zeta,        J = Ad*_{g^-1} mu the spatial momentum,

so J is conserved along exactly the directions that leave L alone: all six for a body in free space, and translation in
the plane and rotation about the vertical, three, under gravity.

The chapter's table 4.13.4 agrees, but for two entries: under gravity the vertical translation ("SE(2) x R") is no
symmetry, p_z falls; and "gravity and a plane" keeps three (a frictionless plane is as symmetric as gravity). One, L_z,
is what remains where the plane is replaced by a fixed point or by a bowl of revolution. Marsden and Ratiu (1999), 11.4;
Noether, "Invariante Variationsprobleme" (1918); chapter 4.13.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.reduction.euler_poincare import LeftEulerPoincare
from lgmpc.mechanics.reduction.terms import Motion
from lgmpc.typing import Array

__all__ = ["LeftSymmetry"]


@dataclass(frozen=True, eq=False)
class LeftSymmetry:
    """How a left-reduced system's Lagrangian answers to left translations.

    Attributes:
        system: whose Lagrangian, potential included; other forces are not considered.
    """

    system: LeftEulerPoincare

    @functools.cached_property
    def rate(self) -> ca.Function:
        """(time, pose, velocity, advected, parameters) -> (dim,) ``dL . zeta`` for each basis vector zeta."""
        system, group = self.system, self.system.group
        s = system.symbols()
        z = ca.SX.sym("z", group.dim)
        moved = replace(s, pose=group.symbolic.compose(group.symbolic.exp(z), s.pose))
        if system.advected is not None:
            # a = act(g^-1, a0): what the world holds fixed stays where it is while the body is moved.
            seen = system.advected.act(s.pose, s.advected)
            moved = replace(moved, advected=system.advected.act(group.symbolic.inverse(moved.pose), seen))
        lagrangian = system.reduced(moved)
        if system.potential is not None:
            lagrangian -= system.potential(moved)
        slope = ca.substitute(ca.gradient(lagrangian, z), z, 0)
        arguments = [s.time, s.pose, s.velocity, s.advected, s.parameters]
        return ca.Function(f"{system.name}_symmetry", arguments, [ca.densify(slope)])

    def rates(self, motion: Motion) -> Array:
        """Return (n, dim) the rate of change of the spatial momentum that Noether's theorem predicts on a motion."""
        count, size = len(motion.times), self.system.group.size
        parameters = np.tile(self.system.parameters, (count, 1)).T
        poses = motion.poses.transpose(1, 0, 2).reshape(size, count * size)
        arguments = motion.times[None], poses, motion.velocities.T, motion.advected.T, parameters
        return np.asarray(self.rate.map(count)(*arguments).full().T, dtype=np.float64)

    def directions(self, motions: Sequence[Motion], tolerance: float = 1e-9) -> Array:
        """Return (k, dim) an orthonormal basis of the directions that are symmetries in all states of some motions.

        Args:
            motions: whose states are examined: several, and general ones, as for
                :func:`~lgmpc.mechanics.conserved_dimension`.
            tolerance: rate that counts as none, as a part of the largest.

        Raises:
            InputError: no motions.
        """
        if not motions:
            raise InputError("motions", "none", "at least one")
        _, sizes, basis = np.linalg.svd(np.vstack([self.rates(motion) for motion in motions]))
        broken = np.count_nonzero(sizes > tolerance * max(float(sizes[0]), np.finfo(float).tiny))
        return np.asarray(basis[broken:], dtype=np.float64)
