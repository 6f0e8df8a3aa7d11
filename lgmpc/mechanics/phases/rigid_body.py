r"""How far a free rigid body turns in a period of its angular velocity: Montgomery's formula.

Montgomery, "How much does the rigid body rotate? A Berry's phase from the 18th century", Am. J. Phys. 59 (1991): when
the body momentum Pi has come back, the body has turned about its fixed spatial momentum by

    2 E T / L - Omega        (mod 2 pi)

E the energy, L = |Pi|, T the period, Omega the solid angle that Pi encloses on its sphere, signed by the sense of its
motion: a dynamic phase less a geometric one (the sphere's curvature over the area). Chapter 4.16.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipj, ellipk

from lgmpc.errors import InputError
from lgmpc.lie import checks

__all__ = ["RigidBodyPhase", "rigid_body_phase"]


@dataclass(frozen=True)
class RigidBodyPhase:
    """One period of a free rigid body.

    Attributes:
        period: T of the body momentum, s.
        dynamic: ``2 E T / L``, rad.
        solid_angle: Omega, signed, of the cap around the axis that Pi circles, sr.
        angle: ``dynamic - solid_angle``: the turn about the spatial momentum, right-handed, up to full turns, rad.
    """

    period: float
    dynamic: float
    solid_angle: float

    @property
    def angle(self) -> float:
        """Turn about the spatial momentum in a period, up to full turns, rad."""
        return self.dynamic - self.solid_angle


def rigid_body_phase(moments: ArrayLike, velocity: ArrayLike, nodes: int = 2000) -> RigidBodyPhase:
    """Evaluate Montgomery's formula: the period by elliptic integrals, the solid angle by quadrature along the orbit.

    The orbit is Jacobi's solution of Euler's equations (Landau and Lifshitz, Mechanics, 37), so that nothing is
    integrated step by step; the trapezoidal rule over a period converges faster than any power of ``nodes``.

    Args:
        moments: (3,) principal moments of inertia, all different, kg.m2.
        velocity: (3,) angular velocity in principal axes, rad/s.
        nodes: of the quadrature.

    Raises:
        InputError: moments that are not positive and different, or a motion without a period: about a principal axis,
            or on the separatrix.
    """
    inertia, omega = checks.finite("moments", moments), checks.tangent(3)("velocity", velocity)
    if inertia.shape != (3,) or inertia.min() <= 0.0 or len(set(inertia.tolist())) < 3:
        raise InputError("moments", moments, "three positive numbers, all different")
    if omega.shape != (3,) or not omega.any():
        raise InputError("velocity", velocity, "three numbers, not all zero")
    momentum = inertia * omega
    twice, square = float(momentum @ omega), float(momentum @ momentum)
    # Pi circles the axis of the largest moment (last) or, where the energy is above the separatrix's, of the smallest.
    order = np.argsort(inertia)
    if square < twice * inertia[order[1]]:
        order = order[::-1]
    j1, j2, j3 = inertia[order]
    above, below = square - twice * j1, twice * j3 - square
    if min(abs(above), abs(below), abs(square - twice * j2)) <= 1e-12 * square:
        raise InputError("velocity", velocity, "a motion neither about a principal axis nor on the separatrix")
    rate = float(np.sqrt((j3 - j2) * above / (j1 * j2 * j3)))
    modulus = float((j2 - j1) * below / ((j3 - j2) * above))
    period = 4.0 * float(ellipk(modulus)) / rate

    # Points of the orbit, equally spaced in time; that it may be run through backwards does not matter for them.
    sn, cn, dn, _ = ellipj(np.arange(nodes) * (rate * period / nodes), modulus)
    orbit = np.empty((nodes, 3))
    orbit[:, order[0]] = np.sqrt(below * j1 / (j3 - j1)) * cn
    orbit[:, order[1]] = np.sqrt(below * j2 / (j3 - j2)) * sn
    orbit[:, order[2]] = np.sqrt(above * j3 / (j3 - j1)) * dn * np.sign(momentum[order[2]])
    axis = np.zeros(3)
    axis[order[2]] = np.sign(momentum[order[2]])
    unit = orbit / np.sqrt(square)
    velocities = np.cross(unit, orbit / inertia)  # Euler: Pi' = Pi x omega
    # (1 - cos(colatitude)) d(longitude) about the axis.
    swept = np.cross(unit, velocities) @ axis / (1.0 + unit @ axis)
    return RigidBodyPhase(period, twice * period / float(np.sqrt(square)), float(swept.mean()) * period)
