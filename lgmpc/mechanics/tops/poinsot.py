"""Poinsot's construction: a torque-free body's ellipsoid of inertia rolls, without slipping, on a fixed plane.

The ellipsoid ``x^T J x = 1`` is fixed in the body, with its centre at the fixed point. It touches the plane at
``w / sqrt(2 E)``; its normal there is along the angular momentum, which is constant in space, as is the plane's
distance ``sqrt(2 E) / |pi|``. The point of contact lies on the instantaneous axis: its velocity is zero. It traces the
polhode on the ellipsoid, where this meets ``x^T J^2 x = |pi|^2 / (2 E)``, and the herpolhode on the plane. In momenta,
the polhode is the intersection of the sphere ``|pi|`` = const, a coadjoint orbit, with the energy ellipsoid
``pi^T J^-1 pi = 2 E``.

Poinsot, "Theorie nouvelle de la rotation des corps" (1834); chapter 4.5.3 and 4.10.5. Lengths are in 1 / sqrt(kg.m^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lgmpc.mechanics.tops.torque_free import EulerTop
from lgmpc.typing import Array

__all__ = ["Poinsot"]


@dataclass(frozen=True, eq=False)
class Poinsot:
    """Poinsot's construction for one motion.

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
        normal: Array = self.top.rotation @ self.top.inertia @ self.top.velocity / self.top.momentum
        return normal

    @property
    def distance(self) -> float:
        """Distance of the plane from the centre."""
        return math.sqrt(2.0 * self.top.energy) / self.top.momentum

    def polhode(self, times: Array) -> Array:
        """Return (n, 3) points of contact in the body."""
        return self.top.velocities(times) / math.sqrt(2.0 * self.top.energy)

    def herpolhode(self, times: Array) -> Array:
        """Return (n, 3) points of contact in the world, from the centre."""
        points: Array = np.einsum("nij,nj->ni", self.top.rotations(times), self.polhode(times))
        return points

    def momenta(self, times: Array) -> Array:
        """Return (n, 3) body angular momenta, on the momentum sphere, N.m.s."""
        momenta: Array = self.top.velocities(times) @ self.top.inertia
        return momenta

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
