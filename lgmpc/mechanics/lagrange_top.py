r"""Lagrange's top, a symmetric body with a fixed point on its axis under gravity: precession, nutation, sleeping.

With tilt theta from the upward vertical, axial angular velocity w3 (constant) and precession Omega,

    steady:    I1 cos(theta) Omega^2 - I3 w3 Omega + m g l = 0                    (slow and fast)
    nutation:  u = cos(theta),  u'^2 = beta (u - u1) (u - u2) (u - u3),  -1 <= u1 <= u <= u2 <= 1,  beta = 2 m g l / I1
               u = u1 + (u2 - u1) sn^2(kappa t + phase | m)
               kappa = sqrt(beta (u3 - u1)) / 2,  m = (u2 - u1) / (u3 - u1)
    sleeping:  theta = 0 is stable for w3^2 > 4 m g l I1 / I3^2; slower, a tilt grows at the rate
               sqrt(beta / 2 - (I3 w3 / (2 I1))^2)

Lagrange, "Mecanique analytique" (1788); Goldstein, "Classical mechanics" (1980), 5.7; Whittaker, "Analytical dynamics"
(1904), 71; chapter 4.17. Moments of inertia are about the fixed point.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks, so3
from lgmpc.mechanics.checks import check_inertia, check_positive
from lgmpc.mechanics.elliptic import Modulus
from lgmpc.mechanics.euler_poincare import EulerPoincare
from lgmpc.mechanics.groups import SO3
from lgmpc.mechanics.rigid_body import heavy_top
from lgmpc.typing import Array, typed


@dataclass(frozen=True)
class Nutation:
    """The nutation of the axis, in closed form.

    Attributes:
        cosine: of the tilt at time 0.
        offsets: of the cubic's roots u1 <= u2 <= u3 from that cosine; the cosine stays between the first two.
        tilts: smallest and largest tilt from the upward vertical, rad.
        rate: kappa, rad/s.
        phase: argument of sn at time 0.
    """

    cosine: float
    offsets: tuple[float, float, float]
    tilts: tuple[float, float]
    rate: float
    phase: float

    @property
    def modulus(self) -> Modulus:
        """Parameter of the elliptic function; 1 for a triple root, which is the upright top at its critical spin."""
        s1, s2, s3 = self.offsets
        return Modulus((s2 - s1) / (s3 - s1), (s3 - s2) / (s3 - s1)) if s3 > s1 else Modulus(1.0, 0.0)

    @property
    def period(self) -> float:
        """Period of the tilt, s; infinite for an axis that approaches the vertical asymptotically."""
        return 2.0 * self.modulus.quarter_period / self.rate if self.rate else math.inf

    def cosines(self, times: Array) -> Array:
        """Return (n,) cosines of the tilt at some times."""
        sn = self.modulus.jacobi(self.phase + self.rate * checks.finite("times", times))[0]
        s1, s2, _ = self.offsets
        return self.cosine + s1 + (s2 - s1) * sn**2


@dataclass(frozen=True)
class LagrangeTop:
    """A symmetric top.

    Attributes:
        transverse: I1 = I2 about the fixed point, kg.m^2.
        axial: I3, kg.m^2.
        weight: m g l, weight times distance of the centre of mass along the third axis, N.m.

    Raises:
        InputError: moments that no body has, or a weight that is not positive.
    """

    transverse: float
    axial: float
    weight: float

    def __post_init__(self) -> None:
        first, third = (check_positive(name, getattr(self, name), "kg.m^2") for name in ("transverse", "axial"))
        check_inertia("axial", np.diag([first, first, third]))
        check_positive("weight", self.weight, "N.m")

    @property
    def inertia(self) -> Array:
        """(3, 3) inertia about the fixed point, kg.m^2."""
        return np.diag([self.transverse, self.transverse, self.axial])

    @functools.cached_property
    def system(self) -> EulerPoincare:
        """The equations of motion; the initial advected direction is ``rotation.T @ UP``."""
        return heavy_top(self.inertia, np.array([0.0, 0.0, self.weight]), 1.0)

    @typed
    def start(self, tilt: float, spin: float, precession: float = 0.0) -> tuple[Array, Array]:
        """Return rotation (3, 3) and body angular velocity (3,) of a top at a turning point of its tilt.

        Args:
            tilt: from the upward vertical, about the world's first axis, rad.
            spin: axial component w3 of the angular velocity, rad/s.
            precession: of the axis about the vertical, rad/s.
        """
        rotation = so3.exp(np.array([tilt, 0.0, 0.0]))
        return rotation, np.array([0.0, precession * math.sin(tilt), spin])

    @typed
    def steady_precession(self, tilt: float, spin: float) -> tuple[float, float]:
        """Return the slow and the fast rate of precession at a constant tilt, rad/s; the fast one may be infinite.

        Args:
            tilt: from the upward vertical, rad.
            spin: w3, rad/s, not zero.

        Raises:
            InputError: the top spins too slowly to precess steadily at this tilt.
        """
        momentum, cosine = self.axial * spin, math.cos(tilt)
        discriminant = momentum**2 - 4.0 * self.transverse * self.weight * cosine
        if discriminant < 0.0 or momentum == 0.0:
            slowest = 2.0 * math.sqrt(self.transverse * self.weight * max(cosine, 0.0)) / self.axial
            raise InputError("spin", f"{spin:g} rad/s", f"at least {slowest:.6g} rad/s for steady precession")
        # The two roots without cancellation: their product is m g l / (I1 cos).
        large = momentum + math.copysign(math.sqrt(discriminant), momentum)
        fast = large / (2.0 * self.transverse * cosine) if cosine else math.copysign(math.inf, large)
        return 2.0 * self.weight / large, fast

    def nutation(self, rotation: Array, velocity: Array) -> Nutation:
        """Return the closed form of the tilt from a state.

        The cubic is expanded around the current tilt, where value and slope follow from the state without cancellation:
        a steady precession has a double root to rounding.

        Args:
            rotation: (3, 3) world from body.
            velocity: (3,) body angular velocity, rad/s.

        Raises:
            InputError: no rotation, or a velocity of another shape.
        """
        up = SO3.check_element("rotation", rotation)[2]
        w = SO3.check_tangent("velocity", velocity)
        beta, a = 2.0 * self.weight / self.transverse, self.axial * w[2] / self.transverse
        climbing, turning = up[0] * w[1] - up[1] * w[0], w[0] * up[0] + w[1] * up[1]
        across, sine = w[0] ** 2 + w[1] ** 2, math.hypot(up[0], up[1])
        u = math.cos(math.atan2(sine, up[2]))
        slope = 2.0 * a * turning - 2.0 * u * across - beta * sine**2
        cubic = [beta, 2.0 * beta * u - across - a**2, slope, climbing**2]
        s1, s2, s3 = sorted(float(root.real) for root in np.roots(cubic))
        s1, s2 = min(0.0, s1), max(0.0, s2)  # rounding must not exclude the current tilt

        tilts = (math.acos(min(1.0, u + s2)), math.acos(max(-1.0, u + s1)))
        rate = math.sqrt(beta * (s3 - s1)) / 2.0
        still = Nutation(u, (s1, s2, s3), tilts, rate, 0.0)
        if s2 <= s1:
            return still
        phase = still.modulus.first_kind(math.copysign(math.sqrt(-s1), climbing), math.sqrt(s2))
        return replace(still, phase=phase)

    @property
    def critical_spin(self) -> float:
        """Spin above which the upright top is stable, ``2 sqrt(m g l I1) / I3``, rad/s."""
        return 2.0 * math.sqrt(self.weight * self.transverse) / self.axial

    @typed
    def sleeping_growth(self, spin: float) -> float:
        """Return the growth rate of a small tilt of the upright top, 1/s: zero from the critical spin on."""
        square = self.weight / self.transverse - (self.axial * spin / (2.0 * self.transverse)) ** 2
        return math.sqrt(max(0.0, square))

    @typed
    def fall(self, spin: float) -> float:
        """Return the largest tilt of an upright top after an infinitesimal disturbance, rad: 0 above the critical spin.

        With the sleeping top's energy and momenta the cubic is ``(1 - u)^2 (beta (1 + u) - (I3 w3 / I1)^2)``.
        """
        cosine = (self.axial * spin) ** 2 / (2.0 * self.transverse * self.weight) - 1.0
        return math.acos(max(-1.0, min(1.0, cosine)))
