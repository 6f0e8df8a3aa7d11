r"""Lie-Poisson mechanics: the bracket on the dual of a Lie algebra, its Casimirs, its flows and its leaves.

    {F, G}(mu) = sign <mu, [dF, dG]>,      sign = -1 after left reduction, +1 after right
    mu' = -sign coadjoint(dH) mu

Functions of mu are Python functions from a CasADi column to a CasADi scalar; so is a bracket of two, which may
therefore be nested. Momenta are in the coordinates of the group: on se(3)*, [linear; angular]; on SE_k(3)* rotation
first, so that SE_1(3)* holds the heavy top's (body angular momentum, advected direction).

Chapter 4.10 and 4.17; Lie, "Theorie der Transformationsgruppen" (1890); Marsden and Ratiu, "Introduction to mechanics
and symmetry" (1999), chapters 13 and 14; Marsden, Ratiu, Weinstein, Trans. AMS 281 (1984).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.reduction.groups import SE3, SO3, LieGroup, extended_poses
from lgmpc.mechanics.rollout import Rollout, runge_kutta4
from lgmpc.typing import Array

__all__ = ["SE3_DUAL", "SEMIDIRECT_DUAL", "SO3_DUAL", "Flow", "Function", "LiePoisson", "extended_poses_dual"]

Function = Callable[[Any], Any]
"""Of mu: a CasADi column (dim,) to a scalar expression, smooth."""


@dataclass(frozen=True)
class Flow:
    """A computed Hamiltonian flow; a row per stored time.

    Attributes:
        times: (n,) s.
        momenta: (n, dim) mu.
        poses: (n, size, size) the reconstructed motion on the group, the identity at first.
    """

    times: Array
    momenta: Array
    poses: Array


@dataclass(frozen=True)
class LiePoisson:
    """The dual of a Lie algebra with its Poisson structure.

    Attributes:
        group: whose algebra.
        casimirs: functions that commute with all others, by name.
        sign: of the bracket, -1 (left reduction) or 1 (right).

    Raises:
        InputError: another sign.
    """

    group: LieGroup
    casimirs: tuple[tuple[str, Function], ...]
    sign: int = -1

    def __post_init__(self) -> None:
        if self.sign not in (-1, 1):
            raise InputError("sign", self.sign, "-1 (left reduction) or 1 (right reduction)")

    def differential(self, function: Function, mu: Any) -> Any:
        """Return (dim,) the derivative of a function at ``mu``, an element of the algebra; DM for numbers."""
        symbol = ca.SX.sym("mu", self.group.dim)
        slope = ca.densify(ca.gradient(ca.SX(function(symbol)), symbol))
        return ca.Function("differential", [symbol], [slope])(mu)

    def bracket(self, f: Function, g: Function) -> Function:
        """Return ``{f, g} = sign <mu, [df, dg]>`` as a function again (chapter 4.10.1)."""

        def value(mu: Any) -> Any:
            commutator = self.group.symbolic.ad(self.differential(f, mu)) @ self.differential(g, mu)
            return self.sign * ca.dot(mu, commutator)

        return value

    def field(self, hamiltonian: Function, mu: Any) -> Any:
        """Return (dim,) ``mu' = -sign coadjoint(dH) mu``, for which ``F' = {F, H}`` (chapter 4.10.2)."""
        return -self.sign * self.group.symbolic.coadjoint(self.differential(hamiltonian, mu)) @ mu

    def tensor(self, mu: Array) -> Array:
        """Return (dim, dim) the Poisson tensor B: ``{F, G} = dF^T B dG``, skew.

        Raises:
            InputError: ``mu`` of another shape or not finite.
        """
        here = self.group.check_tangent("mu", mu)
        columns = self.group.numeric.coadjoint(np.eye(self.group.dim)) @ here
        tensor: Array = -self.sign * columns.T
        return tensor

    def orbit_dimension(self, mu: Array, tolerance: float = 1e-9) -> int:
        """Dimension of the symplectic leaf through ``mu``: the rank of the Poisson tensor, even (chapter 4.10.5).

        Raises:
            InputError: ``mu`` of another shape or not finite.
        """
        sizes = np.linalg.svd(self.tensor(mu), compute_uv=False)
        return int(np.count_nonzero(sizes > tolerance * max(float(np.abs(mu).max()), np.finfo(float).tiny)))

    def orbit(self, mu: Array, poses: Array) -> Array:
        """Return (..., dim) the points ``Ad*_g mu`` of the coadjoint orbit, ``Ad*_g = adjoint(g)^T``.

        Args:
            mu: (dim,) a point of the orbit.
            poses: (..., size, size) elements g.

        Raises:
            InputError: not elements of the group, or ``mu`` of another shape.
        """
        here = self.group.check_tangent("mu", mu)
        points: Array = np.einsum("...ji,j->...i", self.group.numeric.adjoint(poses), here)
        return points

    def symplectic_form(self, mu: Array, x: Array, y: Array) -> float:
        """Kirillov-Kostant-Souriau form of the leaf at ``mu`` on the tangent vectors that x and y generate.

        ``omega(X_x, X_y) = sign <mu, [x, y]>`` with ``X_x = -sign coadjoint(x) mu``: ``{F, G} = omega(X_F, X_G)``.

        Args:
            mu: (dim,) point of the leaf.
            x: (dim,) element of the algebra.
            y: (dim,) element of the algebra.

        Raises:
            InputError: an argument of another shape or not finite.
        """
        here, first, second = (self.group.check_tangent(n, v) for n, v in (("mu", mu), ("x", x), ("y", y)))
        return float(self.sign * here @ self.group.numeric.ad(first) @ second)

    def flow(self, hamiltonian: Function, mu: Array, *, step: float, steps: int, every: int = 1) -> Flow:
        """Integrate ``mu' = -sign coadjoint(dH) mu`` along the coadjoint orbit, fourth order.

        The motion ``g' = g dH(mu)`` (sign -1; ``dH(mu) g`` for 1) is integrated by Runge-Kutta-Munthe-Kaas, and ``mu =
        Ad*_g mu0`` (``Ad*_{g^-1} mu0``) moves with it: Casimirs stay to rounding, whatever the Hamiltonian and the
        step. Engo and Faltinsen, "Numerical integration of Lie-Poisson systems while preserving coadjoint orbits and
        energy", SIAM J. Numer. Anal. 39 (2001).

        Args:
            hamiltonian: H(mu), J.
            mu: (dim,) at the start.
            step: length of a step, s.
            steps: their number.
            every: number of steps between two stored ones; divides ``steps``.

        Raises:
            InputError: ``mu`` of another shape or not finite, or a step that is not positive.
            SolverError: the flow did not stay finite.
        """
        start = self.group.check_tangent("mu", mu)
        size = self.group.size
        row = np.concatenate((np.eye(size).ravel(), start))
        times, rows = Rollout(self._step(hamiltonian))(row, step, steps, every, np.zeros(0))
        poses = rows[:, : size * size].reshape(-1, size, size).transpose(0, 2, 1)
        return Flow(times, rows[:, size * size :], poses)

    def _step(self, hamiltonian: Function) -> ca.Function:
        dim, size, group = self.group.dim, self.group.size, self.group.symbolic
        mu, pose = ca.SX.sym("mu", dim), ca.SX.sym("pose", size, size)
        time, h, none = ca.SX.sym("time"), ca.SX.sym("step"), ca.SX.sym("p", 0)

        def carry(z: Any) -> Any:
            return group.adjoint(group.exp(-self.sign * z)).T @ mu

        def slope(_: Any, z: Any) -> Any:
            # exp(z) stands to the right of the pose for sign -1, to its left for 1.
            jacobian = group.right_jacobian_inverse if self.sign < 0 else group.left_jacobian_inverse
            return jacobian(z) @ self.differential(hamiltonian, carry(z))

        z = runge_kutta4(slope, ca.SX.zeros(dim), h)
        turn = group.exp(z)
        moved = group.compose(pose, turn) if self.sign < 0 else group.compose(turn, pose)
        x, x_next = ca.vertcat(ca.vec(pose), mu), ca.vertcat(ca.vec(moved), carry(z))
        name = f"lie_poisson_{self.group.name}"
        return ca.Function(name, [time, h, x, none], [x_next], ["time", "step", "x", "p"], ["x_next"])


SO3_DUAL = LiePoisson(SO3, (("|pi|^2", lambda mu: ca.dot(mu, mu)),))
"""so(3)*: body angular momentum pi; leaves are spheres (chapter 4.10.3 to 4.10.5)."""

SE3_DUAL = LiePoisson(SE3, (("l . k", lambda mu: ca.dot(mu[:3], mu[3:])), ("|l|^2", lambda mu: ca.dot(mu[:3], mu[:3]))))
"""se(3)*: [linear l; angular k] body momentum; generic leaves have dimension 4 (chapter 4.10.6)."""


def extended_poses_dual(k: int) -> LiePoisson:
    """The dual of SE_k(3)'s algebra, (pi, Gamma_1, ..., Gamma_k): so(3)* with k advected vectors.

    Casimirs: ``pi . Gamma`` and ``|Gamma|^2`` for k = 1; all ``Gamma_i . Gamma_j`` beyond, where pi enters none.

    Raises:
        InputError: ``k`` is not positive.
    """
    group = extended_poses(k)

    def product(i: int, j: int) -> Function:
        return lambda mu: ca.dot(mu[3 * i : 3 * i + 3], mu[3 * j : 3 * j + 3])

    gamma = tuple(
        (f"Gamma_{i} . Gamma_{j}", product(i, j))
        for i, j in itertools.combinations_with_replacement(range(1, k + 1), 2)
    )
    return LiePoisson(group, gamma if k > 1 else (("pi . Gamma", product(0, 1)), *gamma))


SEMIDIRECT_DUAL = extended_poses_dual(1)
"""(so(3) x R^3)*, semidirect: the heavy top's (pi, Gamma), with its two Casimirs (chapter 4.17)."""
