r"""The rotation of a free rigid body in a period of its angular velocity: Montgomery's formula.

Montgomery, "How much does the rigid body rotate? A Berry's phase from the 18th century", Am. J. Phys. 59 (1991): in a
period of its body momentum Pi, the body rotates about its constant spatial momentum by

    2 E T / L - Omega        (mod 2 pi)

E the energy, L = |Pi|, T the period, Omega the solid angle that Pi encloses on its sphere, signed by the sense of its
motion: a dynamic phase minus a geometric one (the integral of the sphere's curvature). Chapter 4.16.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie.checks import typed
from lgmpc.mechanics.tops.torque_free import EulerTop
from lgmpc.typing import Array

__all__ = ["RigidBodyPhase", "rigid_body_phase"]


@dataclass(frozen=True)
class RigidBodyPhase:
    """One period of a free rigid body.

    Attributes:
        period: T of the body momentum, s.
        dynamic: ``2 E T / L``, rad.
        solid_angle: Omega, signed, of the cap around the axis about which Pi revolves, sr.
    """

    period: float
    dynamic: float
    solid_angle: float

    @property
    def angle(self) -> float:
        """``dynamic - solid_angle``: the rotation about the spatial momentum, right-handed, modulo 2 pi, rad."""
        return self.dynamic - self.solid_angle


@typed
def rigid_body_phase(top: EulerTop, nodes: int = 2000) -> RigidBodyPhase:
    """Evaluate Montgomery's formula: the solid angle by quadrature along the orbit of the body momentum.

    The orbit is in closed form; the trapezoidal rule over a period converges faster than any power of ``nodes``.

    Args:
        top: the body and its motion.
        nodes: of the quadrature.

    Raises:
        InputError: a motion without a period: about a principal axis, or on the separatrix.
    """
    period = top.period
    if not np.isfinite(period):
        raise InputError("velocity", top.velocity, "one that is not on the separatrix, where the motion has no period")
    times: Array = np.arange(nodes, dtype=np.float64) * np.float64(period / nodes)
    velocities = top.velocities(times)
    momenta = velocities @ top.inertia
    unit = momenta / top.momentum
    rates = np.cross(unit, velocities)  # Euler: Pi' = Pi x omega
    axis = top.circled_axis
    # (1 - cos(colatitude)) d(longitude) about the axis.
    swept = np.cross(unit, rates) @ axis / (1.0 + unit @ axis)
    return RigidBodyPhase(period, 2.0 * top.energy * period / top.momentum, float(swept.mean()) * period)
