r"""A rigid body under water, on SE(3) (chapter 4.12.4).

    M nu' + C(nu) nu + D(nu) nu + g(eta) = tau,        M = M_RB + M_A

Fossen, "Handbook of Marine Craft Hydrodynamics and Motion Control" (2011), 6 and 8; Lamb, "Hydrodynamics" (1932), 114
to 126, for Kirchhoff's equations, the undamped case; Leonard, "Stability of a bottom-heavy underwater
vehicle", Automatica 33 (1997), for their reduction.

nu is the body twist, linear first (Fossen's order), eta the pose, tau a wrench on the body about its frame's origin, in
body axes; SI units. The world's z points up (Fossen's, down).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from lgmpc.errors import InputError
from lgmpc.mechanics.checks import check_positive, frozen
from lgmpc.mechanics.euler_poincare import EulerPoincare, Expression, Symbols
from lgmpc.mechanics.groups import SE3
from lgmpc.mechanics.rigid_body import SpatialInertia
from lgmpc.typing import GRAVITY, Array, numbers, typed


def _zeros(*shape: int) -> Callable[[], Array]:
    return lambda: np.zeros(shape)


@dataclass(frozen=True, eq=False)
class UnderwaterVehicle:
    """Mass, added mass, damping and buoyancy of a vehicle. The arrays are read-only copies.

    Attributes:
        body: its own mass distribution.
        added_mass: (6, 6) M_A of the fluid, about the frame's origin, kg, kg.m, kg.m2; symmetric, positive semidefinite
            (ideal fluid); a vector (6,) is its diagonal.
        linear_damping: (6, 6) D_l, N per m/s and so on; a vector (6,) is its diagonal.
        quadratic_damping: (6,) of ``D_q = diag(d |nu|)``, entry by entry.
        buoyancy: weight of the displaced water, N.
        center_of_buoyancy: (3,) its point of application, body axes, m.
        gravity: m/s2.

    Raises:
        InputError: arrays of other shapes or not finite, an added mass that is not symmetric or has a negative
            eigenvalue, negative damping, buoyancy or gravity.
    """

    body: SpatialInertia
    added_mass: Array = field(default_factory=_zeros(6, 6))
    linear_damping: Array = field(default_factory=_zeros(6, 6))
    quadratic_damping: Array = field(default_factory=_zeros(6))
    buoyancy: float = 0.0
    center_of_buoyancy: Array = field(default_factory=_zeros(3))
    gravity: float = GRAVITY

    def __post_init__(self) -> None:
        added, linear = (_square(name, getattr(self, name)) for name in ("added_mass", "linear_damping"))
        asymmetry = float(np.abs(added - added.T).max())
        if asymmetry > 1e-9 * float(np.abs(added).max()):
            raise InputError("added_mass", f"a matrix A with |A - A^T| = {asymmetry:.3g}", "a symmetric matrix")
        for name, matrix in (("added_mass", added), ("linear_damping", linear + linear.T)):
            least = float(np.linalg.eigvalsh(matrix)[0])
            if least < -1e-9 * float(np.abs(matrix).max()):
                raise InputError(name, f"smallest eigenvalue {least:.3g}", "no negative eigenvalue")
        quadratic = numbers("quadratic_damping", self.quadratic_damping, (6,), finite=True)
        if quadratic.min() < 0.0:
            raise InputError("quadratic_damping", quadratic, "no negative entry")
        for name in ("buoyancy", "gravity"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(name, getattr(self, name), "a number that is not negative")
        center = numbers("center_of_buoyancy", self.center_of_buoyancy, (3,), finite=True)
        for name, value in (
            ("added_mass", added),
            ("linear_damping", linear),
            ("quadratic_damping", quadratic),
            ("center_of_buoyancy", center),
        ):
            object.__setattr__(self, name, frozen(value))

    @property
    def mass_matrix(self) -> Array:
        """(6, 6) M, the body's and the added mass."""
        return self.body.matrix + self.added_mass

    @property
    def weight(self) -> float:
        """Weight of the body in air, N."""
        return self.body.mass * self.gravity

    def system(self, wrench: Expression | None = None) -> EulerPoincare:
        """Return the vehicle as an Euler-Poincare system on SE(3); its constants are parameters of the compiled code.

        Args:
            wrench: tau (6,), N and N.m; none unless given.
        """
        lever = self.weight * self.body.center - self.buoyancy * self.center_of_buoyancy
        net = [self.weight - self.buoyancy]
        matrices = np.concatenate((self.mass_matrix.ravel(), self.linear_damping.ravel(order="F")))

        def lagrangian(s: Symbols) -> Any:
            return 0.5 * ca.dot(s.velocity, ca.reshape(s.parameters[:36], 6, 6) @ s.velocity)

        def potential(s: Symbols) -> Any:
            return s.parameters[81] * s.pose[2, 3] + s.pose[2, :3] @ s.parameters[78:81]

        def push(s: Symbols) -> Any:
            drag = ca.reshape(s.parameters[36:72], 6, 6) @ s.velocity
            drag += s.parameters[72:78] * ca.fabs(s.velocity) * s.velocity
            return -drag if wrench is None else wrench(s) - drag

        return EulerPoincare(
            "underwater_vehicle",
            SE3,
            lagrangian,
            potential=potential,
            body_force=push,
            parameters=np.concatenate((matrices, self.quadratic_damping, lever, net)),
        )


@typed
def spheroid_added_mass(length: float, diameter: float, density: float = 1000.0) -> Array:
    """Return (6,) the added mass of a prolate spheroid about its centre, its long axis x, kg and kg.m2.

    Lamb (1932), 114 and 115; Fossen (2011), 8.2; Carlson, "Numerical computation of real or complex elliptic
    integrals", Numerical Algorithms 10 (1995).

    Args:
        length: of the long axis, m.
        diameter: of the round section, m; shorter.
        density: of the fluid, kg/m3.

    Raises:
        InputError: lengths or a density that are not positive, or a diameter that is not below the length.
    """
    a, b = check_positive("length", length, "m") / 2.0, check_positive("diameter", diameter, "m") / 2.0
    if b >= a:
        raise InputError("diameter", diameter, f"less than the length, {length} m")
    # Lamb's integrals, alpha_0 and beta_0, as Carlson's: without cancellation where the spheroid is nearly round.
    alpha = 2.0 / 3.0 * a * b**2 * float(special.elliprd(b**2, b**2, a**2))
    beta = 2.0 / 3.0 * a * b**2 * float(special.elliprd(a**2, b**2, b**2))
    displaced = 4.0 / 3.0 * math.pi * check_positive("density", density, "kg/m3") * a * b**2
    across = displaced * beta / (2.0 - beta)
    flat = a**2 - b**2
    turning = displaced / 5.0 * flat**2 * (beta - alpha) / (2.0 * flat - (a**2 + b**2) * (beta - alpha))
    return np.array([displaced * alpha / (2.0 - alpha), across, across, 0.0, turning, turning])


def _square(name: str, value: ArrayLike) -> Array:
    array = numbers(name, value, (6, 6), (6,), finite=True)
    return np.diag(array) if array.ndim == 1 else array
