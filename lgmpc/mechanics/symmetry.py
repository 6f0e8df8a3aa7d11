"""Noether's theorem: a system's symmetries, and the rate of its momentum map.

For a left-reduced system, left multiplication of the motion by ``exp(e zeta)`` changes the Lagrangian at the rate
``dL . zeta``; along every motion without further forces

    d/dt <J, zeta> = dL . zeta,        J = Ad*_{g^-1} mu the spatial momentum,

so that J is conserved exactly along the directions in which L is invariant: all six for a body in free space; under
gravity, or on a frictionless level plane, the three of horizontal translation and rotation about the vertical; with a
fixed point or in a bowl of revolution L_z alone. (Table 4.13.4 of the chapter counts the vertical translation under
gravity, and one symmetry on a plane.) Marsden and Ratiu (1999), 11.4; Noether, "Invariante Variationsprobleme" (1918).
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.mechanics.euler_poincare import EulerPoincare, Motion
from lgmpc.typing import Array

CONSERVED = 1e-9
"""Tolerance of conserved components, relative to the largest momentum along the motion."""


@dataclass(frozen=True, eq=False)
class LeftSymmetry:
    """The rate of a left-reduced system's Lagrangian under left translations.

    Attributes:
        system: Lagrangian and potential are considered, other forces are not.
    """

    system: EulerPoincare

    @functools.cached_property
    def rate(self) -> ca.Function:
        """(time, pose, velocity, advected, parameters) -> (dim,) ``dL . zeta`` for each basis vector zeta."""
        system, group = self.system, self.system.group
        s = system.symbols()
        z = ca.SX.sym("z", group.dim)
        moved = replace(s, pose=group.symbolic.compose(group.symbolic.exp(z), s.pose))
        if system.advected is not None:
            # a = act(g^-1, a0): quantities fixed in the world stay constant while the body is moved.
            seen = system.advected.act(s.pose, s.advected)
            moved = replace(moved, advected=system.advected.act(group.symbolic.inverse(moved.pose), seen))
        lagrangian = system.reduced(moved)
        if system.potential is not None:
            lagrangian -= system.potential(moved)
        slope = ca.substitute(ca.gradient(lagrangian, z), z, 0)
        return system.function("symmetry", s, rate=slope)

    def rates(self, motion: Motion) -> Array:
        """Return (n, dim) the rate of the spatial momentum along a motion by Noether's theorem."""
        return self.system.along(motion, self.rate)[0]

    def directions(self, motions: Sequence[Motion], tolerance: float = 1e-9) -> Array:
        """Return (k, dim) an orthonormal basis of the directions that are symmetries in all states of some motions.

        Args:
            motions: several general motions, as for :func:`~lgmpc.mechanics.conserved_dimension`.
            tolerance: largest rate along a symmetry, relative to the largest rate.

        Raises:
            InputError: no motions.
        """
        if not motions:
            raise InputError("motions", "none", "at least one")
        # The triangular factor has the same row space and singular values, whatever the number of states.
        triangle = np.linalg.qr(np.vstack([self.rates(motion) for motion in motions]), mode="r")
        _, sizes, basis = np.linalg.svd(triangle)
        broken = np.count_nonzero(sizes > tolerance * max(float(sizes[0]), np.finfo(float).tiny))
        return np.asarray(basis[broken:], dtype=np.float64)


def conserved_dimension(momenta: Sequence[Array], tolerance: float = CONSERVED) -> int:
    """Return the number of independent directions along which a momentum is constant in several motions.

    One motion is not enough: a falling body conserves a fourth component of its spatial momentum, in a direction that
    depends on the motion, because its centre of mass stays in a vertical plane.

    Args:
        momenta: for each motion, (n, dim) momentum along it.
        tolerance: largest change of a constant component, relative to the largest momentum.

    Raises:
        InputError: not tables of finite numbers, or none.
    """
    if not isinstance(momenta, Sequence):
        raise InputError("momenta", f"{momenta!r:.80}", "one table (n, dim) a motion, n at least 2")
    tables = [checks.finite("momenta", table) for table in momenta]
    if not tables or any(t.ndim != 2 or len(t) < 2 or t.shape[1] != tables[0].shape[1] for t in tables):
        raise InputError("momenta", [t.shape for t in tables], "one table (n, dim) a motion, n at least 2")
    scale = max(float(np.abs(table).max()) for table in tables) or 1.0
    moved = np.vstack([table - table[0] for table in tables])
    sizes = np.linalg.svd(moved, compute_uv=False) / np.sqrt(len(moved))
    broken = np.count_nonzero(sizes > tolerance * scale)
    return int(moved.shape[1] - broken)
