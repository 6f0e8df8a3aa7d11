r"""The torque-free body in closed form, by Jacobi's functions, and Poinsot's construction.

With principal moments ordered so that the body momentum revolves about axis c and b is the middle one
(``|pi|^2 > 2 E I_b``: c has the largest moment, otherwise the smallest), and s the sign of w_c,

    w_a = A cn u,   w_b = s B sn u,   w_c = s C dn u,      u = u0 + rate t

    A^2 = p / (I_a (I_c - I_a)),  B^2 = p / (I_b (I_c - I_b)),  C^2 = q / (I_c (I_c - I_a))
    p = 2 E I_c - |pi|^2,  q = |pi|^2 - 2 E I_a,  rate^2 = (I_c - I_b) q / (I_a I_b I_c),
    m = (I_b - I_a) p / ((I_c - I_b) q)

Jacobi, "Sur la rotation d'un corps" (1849); Whittaker, "Analytical dynamics" (1904), 69; Landau and Lifshitz,
"Mechanics", section 37; chapter 4.5 and 4.12.1.
"""

import functools
import math
from dataclasses import dataclass, field

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks, so3
from lgmpc.mechanics.checks import check_inertia, frozen
from lgmpc.mechanics.elliptic import Modulus
from lgmpc.mechanics.groups import SO3
from lgmpc.typing import Array

_STEADY = 1e-15
"""Rounding error of the torque relative to |w| |pi|: below it the rotation about a principal axis is steady."""


@dataclass(frozen=True, eq=False)
class EulerTop:
    """The motion of a torque-free body through one state, for all times. The arrays are read-only copies.

    Attributes:
        inertia: (3, 3) in any body axes, kg.m^2.
        velocity: (3,) body angular velocity at time 0, rad/s.
        rotation: (3, 3) world from body at time 0.

    Raises:
        InputError: an inertia that no body has, a velocity that is zero or not finite, or no rotation.
    """

    inertia: Array
    velocity: Array
    rotation: Array = field(default_factory=so3.identity)

    def __post_init__(self) -> None:
        object.__setattr__(self, "inertia", frozen(check_inertia("inertia", self.inertia)))
        object.__setattr__(self, "velocity", frozen(SO3.check_tangent("velocity", self.velocity)))
        object.__setattr__(self, "rotation", frozen(SO3.check_element("rotation", self.rotation)))
        if not self.velocity.any():
            raise InputError("velocity", "zero", "a body that turns")

    @property
    def energy(self) -> float:
        """Kinetic energy, J."""
        return 0.5 * float(self.velocity @ self.inertia @ self.velocity)

    @property
    def momentum(self) -> float:
        """Length of the angular momentum, N.m.s."""
        return float(np.linalg.norm(self.inertia @ self.velocity))

    @property
    def steady(self) -> bool:
        """True for a steady rotation, stable or not, about a principal axis."""
        torque = np.cross(self.inertia @ self.velocity, self.velocity)
        return bool(np.linalg.norm(torque) <= _STEADY * self.momentum * np.linalg.norm(self.velocity))

    @property
    def period(self) -> float:
        """Period of the body angular velocity, s: four quarter periods; infinite on the separatrix.

        Raises:
            InputError: the rotation is steady, without a period.
        """
        return 4.0 * self._solution.modulus.quarter_period / self._solution.rate

    @property
    def flip_interval(self) -> float:
        """Time between flips of the middle axis, s: half the period (Dzhanibekov's effect, chapter 4.12.1)."""
        return 0.5 * self.period

    def flips(self, end: float) -> Array:
        """Return the times in [0, end] at which the angular velocity about the middle axis changes sign."""
        solution, interval = self._solution, self.flip_interval
        phase = solution.phase / solution.rate
        first, last = math.ceil(phase / interval), math.floor((phase + end) / interval)
        return np.arange(first, last + 1, dtype=np.float64) * interval - phase

    def velocities(self, times: Array) -> Array:
        """Return (n, 3) body angular velocities at some times, rad/s."""
        t = _times(times)
        if self.steady:
            return np.tile(self.velocity, (len(t), 1))
        s = self._solution
        sn, cn, dn = s.modulus.jacobi(s.phase + s.rate * t)
        return np.stack((s.amplitudes[0] * cn, s.amplitudes[1] * sn, s.amplitudes[2] * dn), axis=1) @ s.axes.T

    @functools.cached_property
    def _solution(self) -> "_Solution":
        if self.steady:
            raise InputError(
                "velocity", self.velocity, "one that is not along a principal axis: that rotation is steady"
            )
        return _solve(self.inertia, self.velocity)


@dataclass(frozen=True, eq=False)
class _Solution:
    """The constants of the module's formulas; axes in the order a, b, c."""

    axes: Array
    amplitudes: tuple[float, float, float]
    rate: float
    phase: float
    modulus: Modulus


def _solve(inertia: Array, velocity: Array) -> _Solution:
    ascending, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.linalg.det(axes)  # right-handed in ascending order
    w = axes.T @ velocity
    side = float(np.sum(ascending * (ascending - ascending[1]) * w**2))  # |pi|^2 - 2 E I_b without cancellation
    order = [0, 1, 2] if side >= 0.0 else [2, 1, 0]
    moments, w = ascending[order], w[order]
    ia, ib, ic = (float(moment) for moment in moments)
    p = float(np.sum(moments * (ic - moments) * w**2))
    q = float(np.sum(moments * (moments - ia) * w**2))
    m = min(1.0, (ib - ia) * p / ((ic - ib) * q))
    modulus = Modulus(m, max(0.0, (ic - ia) * side / ((ic - ib) * q)))
    sign = math.copysign(1.0, w[2])
    a, b, c = math.sqrt(p / (ia * (ic - ia))), math.sqrt(p / (ib * (ic - ib))), math.sqrt(q / (ic * (ic - ia)))
    rate = math.sqrt((ic - ib) * q / (ia * ib * ic))
    phase = modulus.first_kind(sign * w[1] / b, w[0] / a)
    return _Solution(axes[:, order], (a, sign * b, sign * c), rate, phase, modulus)


def _times(times: Array) -> Array:
    array = checks.finite("times", times)
    if array.ndim != 1:
        raise InputError("times", f"shape {array.shape}", "shape (n,)")
    return array


@dataclass(frozen=True, eq=False)
class Poinsot:
    """Poinsot's construction: the ellipsoid of inertia of a motion rolls, without slipping, on a fixed plane.

    The ellipsoid ``x^T J x = 1`` is fixed in the body, with its centre at the fixed point. It touches the plane at
    ``w / sqrt(2 E)``; its normal there is along the angular momentum, which is constant in space, as is the plane's
    distance ``sqrt(2 E) / |pi|``. The point of contact lies on the instantaneous axis: its velocity is zero. It traces
    the polhode on the ellipsoid, where this meets ``x^T J^2 x = |pi|^2 / (2 E)``, and the herpolhode on the plane. In
    momenta, the polhode is the intersection of the sphere ``|pi|`` = const, a coadjoint orbit, with the energy
    ellipsoid ``pi^T J^-1 pi = 2 E``. Lengths are in 1 / sqrt(kg.m^2).

    Poinsot, "Theorie nouvelle de la rotation des corps" (1834); chapter 4.5.3 and 4.10.5.

    Attributes:
        top: the motion.
    """

    top: EulerTop

    @property
    def semi_axes(self) -> tuple[Array, Array]:
        """Semi-axes (3,) of the ellipsoid, the longest first, and their directions in the body, columns of (3, 3)."""
        moments, axes = np.linalg.eigh(self.top.inertia)
        axes[:, 2] *= np.linalg.det(axes)
        return 1.0 / np.sqrt(moments), axes

    @property
    def normal(self) -> Array:
        """(3,) unit normal of the invariable plane, from the centre to the plane, in the world."""
        return self.top.rotation @ self.top.inertia @ self.top.velocity / self.top.momentum

    @property
    def distance(self) -> float:
        """Distance of the plane from the centre."""
        return math.sqrt(2.0 * self.top.energy) / self.top.momentum

    def polhode(self, times: Array) -> Array:
        """Return (n, 3) points of contact in the body."""
        return self.top.velocities(times) / math.sqrt(2.0 * self.top.energy)

    @property
    def radii(self) -> tuple[float, float]:
        """Smallest and largest distance of the herpolhode from the foot of the plane's normal.

        Extremes are where the body momentum crosses the planes of its principal axes: a quarter of a period apart.
        """
        if self.top.steady:
            return 0.0, 0.0
        crossing = float(self.top.flips(self.top.flip_interval)[0])
        points = self.polhode(np.array([crossing, crossing + 0.5 * self.top.flip_interval]))
        low, high = sorted(np.sqrt(np.maximum(0.0, (points**2).sum(axis=1) - self.distance**2)).tolist())
        return low, high
