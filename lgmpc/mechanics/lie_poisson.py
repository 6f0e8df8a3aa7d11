r"""Lie-Poisson mechanics: the bracket on the dual of a Lie algebra, Casimirs and symplectic leaves.

    {F, G}(mu) = -<mu, [dF, dG]>,      mu' = coadjoint(dH) mu

after left reduction; after reduction from the right both have the opposite sign.

Functions of mu are Python functions from a CasADi column to a CasADi scalar; so are brackets, which may be nested.
Momenta are in the coordinates of the group: on se(3)*, [linear; angular]; on SE_k(3)* rotation first: on SE_1(3)* the
heavy top's (body angular momentum, advected direction).

Coadjoint orbits are ``Ad*_g mu``, :func:`~lgmpc.mechanics.body_momentum`.

Chapter 4.10 and 4.17; Lie, "Theorie der Transformationsgruppen" (1890); Marsden and Ratiu, "Introduction to mechanics
and symmetry" (1999), chapters 13 and 14; Marsden, Ratiu, Weinstein, Trans. AMS 281 (1984).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.mechanics.groups import SE3, SEMIDIRECT, SO3, LieGroup
from lgmpc.typing import Array

Function = Callable[[Any], Any]
"""Of mu: a CasADi column (dim,) to a scalar expression, smooth."""


@dataclass(frozen=True)
class LiePoisson:
    """The dual of a Lie algebra with its Poisson structure.

    Attributes:
        group: of the algebra.
        casimirs: functions whose bracket with any other is zero, by name.
    """

    group: LieGroup
    casimirs: tuple[tuple[str, Function], ...]

    def differential(self, function: Function, mu: Any) -> Any:
        """Return (dim,) the derivative of a function at ``mu``, an element of the algebra (DM if ``mu`` is numeric)."""
        symbol = ca.SX.sym("mu", self.group.dim)
        slope = ca.densify(ca.gradient(ca.SX(function(symbol)), symbol))
        return ca.Function("differential", [symbol], [slope])(mu)

    def bracket(self, f: Function, g: Function) -> Function:
        """Return the function ``{f, g} = -<mu, [df, dg]>`` (chapter 4.10.1)."""

        def value(mu: Any) -> Any:
            return -ca.dot(mu, self.group.symbolic.ad(self.differential(f, mu)) @ self.differential(g, mu))

        return value

    def field(self, hamiltonian: Function, mu: Any) -> Any:
        """Return (dim,) ``mu' = coadjoint(dH) mu``, for which ``F' = {F, H}`` (chapter 4.10.2)."""
        return self.group.symbolic.coadjoint(self.differential(hamiltonian, mu)) @ mu

    def tensor(self, mu: Array) -> Array:
        """Return (dim, dim) the Poisson tensor B: ``{F, G} = dF^T B dG``, skew.

        Raises:
            InputError: ``mu`` of another shape or not finite.
        """
        here = self.group.check_tangent("mu", mu)
        return (self.group.numeric.coadjoint(np.eye(self.group.dim)) @ here).T

    def orbit_dimension(self, mu: Array, tolerance: float = 1e-9) -> int:
        """Return the dimension of the symplectic leaf through ``mu``, the rank of the Poisson tensor (chapter 4.10.5).

        Raises:
            InputError: ``mu`` of another shape or not finite.
        """
        sizes = np.linalg.svd(self.tensor(mu), compute_uv=False)
        return int(np.count_nonzero(sizes > tolerance * max(float(np.abs(mu).max()), np.finfo(float).tiny)))


SO3_DUAL = LiePoisson(SO3, (("|pi|^2", lambda mu: ca.dot(mu, mu)),))
"""so(3)*: body angular momentum pi; leaves are spheres (chapter 4.10.3 to 4.10.5)."""

SE3_DUAL = LiePoisson(SE3, (("l . k", lambda mu: ca.dot(mu[:3], mu[3:])), ("|l|^2", lambda mu: ca.dot(mu[:3], mu[:3]))))
"""se(3)*: [linear l; angular k] body momentum; generic leaves have dimension 4 (chapter 4.10.6)."""


SEMIDIRECT_DUAL = LiePoisson(
    SEMIDIRECT, (("pi . Gamma", lambda mu: ca.dot(mu[:3], mu[3:])), ("|Gamma|^2", lambda mu: ca.dot(mu[3:], mu[3:])))
)
"""(so(3) x R^3)*, semidirect: the heavy top's (pi, Gamma), with its two Casimirs (chapter 4.17)."""
