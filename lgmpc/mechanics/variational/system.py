"""Rigid motion on SO(3) or SE(3): kinetic energy, potential and forces, shared by all integrators of this room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError
from lgmpc.lie import checks, se3, so3
from lgmpc.lie.symbolic import se3 as symbolic_se3
from lgmpc.lie.symbolic import so3 as symbolic_so3
from lgmpc.mechanics.rigid_body import check_positive_definite
from lgmpc.typing import Array

__all__ = ["GroupSystem", "Potential", "Trajectory", "Wrench", "heavy_top_system"]

Potential = Callable[[Any], Any]
"""From a group element, a CasADi matrix, to the potential energy, J."""

Wrench = Callable[[Any, Any], Any]
"""From a group element and a velocity to the generalised force in the body frame, as CasADi expressions."""


class GroupSystem:
    r"""A body whose configuration is a matrix group, with left-invariant kinetic energy.

        L(g, xi) = 1/2 xi . G xi - V(g),        g' = g hat(xi)

    whose Euler-Poincare equations are ``mu' = coadjoint(xi) mu + F``, ``mu = G xi``, with the body force
    ``F = -(T_e L_g)^* dV + w`` (chapter 4.7.5, errata). On SO(3) the tangent is the angular velocity and mu the angular
    momentum, both in the body frame; on SE(3) they are twist and momentum, linear first, about the body's origin, which
    need not be the centre of mass: G then couples.

    A state is a row ``x``: the entries of the matrix g, column after column, then mu.

    Args:
        inertia: G, (3, 3) for SO(3), kg.m2, or (6, 6) for SE(3), linear first; symmetric, positive definite. Where the
            fluid around a submerged body moves along, it holds the added mass too.
        potential: V, J; none unless given.
        wrench: w, further forces in the body frame, N and N.m; none unless given.

    Attributes:
        size: of the matrices g: 3 or 4.
        nv: dimension of the group: 3 or 6.
        nx: size of a state.

    Raises:
        InputError: an inertia of another shape, not finite, not symmetric or not positive definite.
    """

    def __init__(self, inertia: ArrayLike, potential: Potential | None = None, wrench: Wrench | None = None) -> None:
        matrix = check_positive_definite("inertia", inertia, 6 if np.shape(inertia) == (6, 6) else 3)
        self.inertia = matrix
        self.potential = potential
        self.wrench = wrench
        self.nv = len(matrix)
        self.size = 3 if self.nv == 3 else 4
        self.nx = self.size**2 + self.nv
        self.group: ModuleType = symbolic_so3 if self.nv == 3 else symbolic_se3

    def start(self, element: ArrayLike, velocity: ArrayLike) -> Array:
        """Return (nx,) the state at ``element`` with velocity ``velocity`` (nv,).

        Raises:
            InputError: no rotation or placement, or arrays of the wrong shape.
        """
        check = checks.rotation if self.nv == 3 else checks.placement
        g = check("element", element)
        xi = checks.tangent(self.nv)("velocity", velocity)
        if g.ndim != 2 or xi.ndim != 1:
            raise InputError("element, velocity", f"shapes {g.shape}, {xi.shape}", "one element and one velocity")
        return np.concatenate((g.ravel(order="F"), self.inertia @ xi))

    def split(self, x: Any) -> tuple[Any, Any]:
        """Return the element (size, size) and the momentum (nv,) of a symbolic state."""
        n = self.size**2
        return ca.reshape(x[:n], self.size, self.size), x[n:]

    def join(self, g: Any, mu: Any) -> Any:
        """Return the symbolic state of an element and a momentum."""
        return ca.vertcat(ca.vec(ca.densify(g)), mu)

    def velocity(self, mu: Any) -> Any:
        """Return ``G^-1 mu``."""
        return ca.DM(np.linalg.inv(self.inertia)) @ mu

    def force(self, g: Any, xi: Any) -> Any:
        """Return (nv,) the generalised force in the body frame: that of the potential and the wrench."""
        total = ca.SX.zeros(self.nv) if self.wrench is None else self.wrench(g, xi)
        if self.potential is None:
            return total
        entries = ca.SX.sym("g", self.size, self.size)
        slope = ca.substitute(ca.gradient(self.potential(entries), entries), entries, g)
        generators = (self.group.hat(ca.DM.eye(self.nv)[:, i]) for i in range(self.nv))
        return total - ca.vertcat(*(ca.trace(slope.T @ (g @ generator)) for generator in generators))

    def rate(self, g: Any, mu: Any) -> tuple[Any, Any]:
        """Return the velocity xi and the rate mu' of the momentum: the Euler-Poincare equations."""
        xi = self.velocity(mu)
        return xi, self.group.coadjoint(xi) @ mu + self.force(g, xi)


@dataclass(frozen=True)
class Trajectory:
    """States of a :class:`GroupSystem` at equal intervals, and what is measured on them.

    Attributes:
        system: what moved.
        step: interval between the states, s.
        states: (n, nx).
    """

    system: GroupSystem
    step: float
    states: Array

    @property
    def times(self) -> Array:
        """(n,) s."""
        return np.arange(len(self.states), dtype=np.float64) * np.float64(self.step)

    @property
    def elements(self) -> Array:
        """(n, size, size) the group elements, as they are: a method may have left the group."""
        size = self.system.size
        return np.swapaxes(self.states[:, : size**2].reshape(-1, size, size), 1, 2)

    @property
    def momenta(self) -> Array:
        """(n, nv) body momentum."""
        return self.states[:, self.system.size**2 :]

    @property
    def velocities(self) -> Array:
        """(n, nv) body velocity."""
        return np.linalg.solve(self.system.inertia, self.momenta.T).T.astype(np.float64)

    def energy(self) -> Array:
        """(n,) kinetic and potential energy, J."""
        kinetic: Array = np.einsum("ni,ni->n", self.momenta, self.velocities) / 2.0
        if self.system.potential is None:
            return kinetic
        x = ca.SX.sym("x", self.system.nx)
        height = ca.Function("potential", [x], [self.system.potential(self.system.split(x)[0])], ["x"], ["energy"])
        potential = np.zeros((len(self.states), 1))
        StageKernel(height).bind(len(self.states), x=self.states, energy=potential)()
        total: Array = kinetic + potential[:, 0]
        return total

    def spatial_momentum(self) -> Array:
        """(n, nv) ``Ad^{-T}_g mu``: what Noether's theorem keeps where nothing breaks the symmetry (chapter 4.13).

        On SO(3) the angular momentum, on SE(3) linear momentum and angular momentum about the world's origin, all in
        world axes. Computed from g as it is, so that what is lost of orthogonality shows.
        """
        g = self.elements
        linear = (g[:, :3, :3] @ self.momenta[:, :3, None])[..., 0]
        if self.system.nv == 3:
            return linear
        angular = (g[:, :3, :3] @ self.momenta[:, 3:, None])[..., 0]
        return np.concatenate((linear, angular + np.cross(g[:, :3, 3], linear)), axis=1)

    def orthogonality(self) -> Array:
        """(n,) Frobenius norm of ``R^T R - I``."""
        r = self.elements[:, :3, :3]
        defect: Array = np.linalg.norm(np.swapaxes(r, 1, 2) @ r - np.eye(3), axis=(1, 2))
        return defect

    def difference(self, other: Trajectory) -> float:
        """Return the distance of the last states: norm of the logarithm between the elements and of the momenta."""
        group = so3 if self.system.nv == 3 else se3
        step = group.log(group.compose(group.inverse(self.elements[-1]), other.elements[-1]))
        return float(np.hypot(np.linalg.norm(step), np.linalg.norm(self.momenta[-1] - other.momenta[-1])))


def heavy_top_system(inertia: ArrayLike, weight: float, center: ArrayLike) -> GroupSystem:
    """Return the heavy top: a body that turns about a fixed point under gravity (chapter 4.17).

    Args:
        inertia: (3, 3) about the fixed point, body axes, kg.m2.
        weight: mass times gravity, N; it pulls along -z.
        center: (3,) centre of mass from the fixed point, body axes, m.

    Raises:
        InputError: as :class:`GroupSystem`, or a centre of another shape.
    """
    pull = float(checks.finite("weight", weight)) * checks.tangent(3)("center", center)
    return GroupSystem(inertia, lambda rotation: rotation[2, :] @ ca.DM(pull))
