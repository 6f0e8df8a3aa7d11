"""Rigid bodies as Euler-Poincare systems: free rotation, heavy top, free motion.

SI units. Body axes are fixed in the body; the world's third axis points up.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.lie import so3
from lgmpc.lie.symbolic import se3 as symbolic_se3, so3 as symbolic_so3
from lgmpc.mechanics.checks import check_inertia, check_positive, frozen
from lgmpc.mechanics.euler_poincare import Advected, EulerPoincare, Expression
from lgmpc.mechanics.groups import SE3, SO3
from lgmpc.typing import GRAVITY, Array, numbers, typed

UP = frozen([0.0, 0.0, 1.0])
"""The upward direction, world axes."""

HEIGHT = frozen([0.0, 0.0, 1.0, 0.0])
"""The height of a point above the ground as a covector on [point; 1] in the world, m."""


@dataclass(frozen=True, eq=False)
class SpatialInertia:
    """Mass distribution of a body, relative to the origin of its frame. The arrays are read-only copies.

    Attributes:
        mass: kg.
        center: (3,) centre of mass in body axes, m.
        rotational: (3, 3) inertia about the centre of mass in body axes, kg.m^2.

    Raises:
        InputError: a mass that is not positive, or an inertia that no body has.
    """

    mass: float
    center: Array
    rotational: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", check_positive("mass", self.mass, "kg"))
        object.__setattr__(self, "center", frozen(numbers("center", self.center, (3,), finite=True)))
        object.__setattr__(self, "rotational", frozen(check_inertia("rotational", self.rotational)))

    @property
    def matrix(self) -> Array:
        """(6, 6) with kinetic energy ``xi^T G xi / 2``, twist linear first (chapter 4.6.3, its blocks swapped)."""
        c = so3.hat(self.center)
        return np.block([[self.mass * np.eye(3), -self.mass * c], [self.mass * c, self.rotational - self.mass * c @ c]])

    @property
    def about_origin(self) -> Array:
        """(3, 3) rotational inertia about the frame's origin, kg.m^2 (Huygens and Steiner)."""
        return self.matrix[3:, 3:]


def torque_free_body(inertia: Array, *, body_force: Expression | None = None) -> EulerPoincare:
    """Euler's equations on SO(3), ``J w' = (J w) x w + tau``, from ``l = w^T J w / 2``.

    Chapter 4.5; Euler, "Du mouvement de rotation des corps solides autour d'un axe variable" (1765).

    Args:
        inertia: (3, 3) about the centre of mass or the fixed point, body axes, kg.m^2.
        body_force: torque in body axes, N.m.

    Raises:
        InputError: an inertia that no body has.
    """
    return EulerPoincare(
        "torque_free_body",
        SO3,
        lambda s: _quadratic(s.velocity, s.parameters, 3),
        body_force=body_force,
        parameters=check_inertia("inertia", inertia).ravel(),
    )


def heavy_top(inertia: Array, moment: Array, gravity: float = GRAVITY) -> EulerPoincare:
    """A body with a fixed point under gravity: ``pi' = pi x w + g Gamma x (m c)``, ``Gamma' = Gamma x w``.

    On SO(3), from ``l = w^T J w / 2 - g (m c) . Gamma``; the advected quantity is ``Gamma = R^T e_3``, the
    upward direction in body axes, initially ``R.T @ UP``. Chapter 4.17; Holm, Marsden, Ratiu (1998), section 7.

    Args:
        inertia: (3, 3) about the fixed point, body axes, kg.m^2.
        moment: (3,) mass times centre of mass, from that point, body axes, kg.m.
        gravity: m/s^2.

    Raises:
        InputError: an inertia that no body has, a moment of another shape, or gravity that is no finite number.
    """
    weight = numbers("gravity", gravity, (), finite=True) * SO3.check_tangent("moment", moment)
    return EulerPoincare(
        "heavy_top",
        SO3,
        lambda s: _quadratic(s.velocity, s.parameters, 3) - ca.dot(s.parameters[9:], s.advected),
        advected=Advected(3, symbolic_so3.act),
        parameters=np.concatenate((check_inertia("inertia", inertia).ravel(), weight)),
    )


@typed
def free_body(
    inertia: SpatialInertia,
    gravity: float = 0.0,
    *,
    potential: Expression | None = None,
    body_force: Expression | None = None,
) -> EulerPoincare:
    """Newton's and Euler's equations on SE(3), about any origin: ``G xi' = ad(xi)^T G xi + F``.

    From ``l = xi^T G xi / 2 - m g h``. The advected quantity is the height of points above the ground as a covector on
    [point; 1] in body coordinates: ``HEIGHT`` in the world, initially ``g^T @ HEIGHT``.
    Chapter 4.6; Marsden, Ratiu, Weinstein (1984) for the semidirect product SE(3) with (R^4)*.

    Args:
        inertia: of the body.
        gravity: m/s^2, downwards.
        potential: further potential energy, J.
        body_force: wrench [force; moment about the body frame's origin] in body axes, N, N.m.

    Raises:
        InputError: gravity that is no finite number.
    """
    weight = inertia.mass * numbers("gravity", gravity, (), finite=True) * np.append(inertia.center, 1.0)
    return EulerPoincare(
        "free_body",
        SE3,
        lambda s: _quadratic(s.velocity, s.parameters, 6) - ca.dot(s.parameters[36:], s.advected),
        advected=Advected(4, lambda g, a: symbolic_se3.inverse(g).T @ a),
        potential=potential,
        body_force=body_force,
        parameters=np.concatenate((inertia.matrix.ravel(), weight)),
    )


def _quadratic(velocity: Any, parameters: Any, size: int) -> Any:
    matrix = ca.reshape(parameters[: size * size], size, size)
    return 0.5 * ca.dot(velocity, matrix @ velocity)
