"""Heavy-top benchmarks of the literature, with a reference solution by quaternions.

Their equations are those of chapter 4.17.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from lgmpc.lie import checks, quaternion, so3
from lgmpc.mechanics.reduction.euler_poincare import LeftEulerPoincare
from lgmpc.mechanics.reduction.terms import Motion
from lgmpc.mechanics.rigid_body import UP, heavy_top
from lgmpc.typing import GRAVITY, Array

__all__ = ["BRULS_TOP", "SIMO_WONG_TOP", "HeavyTopBenchmark"]


@dataclass(frozen=True, eq=False)
class HeavyTopBenchmark:
    """A top and its initial state.

    Attributes:
        name: of the benchmark.
        inertia: (3, 3) about the fixed point, body axes, kg.m^2.
        moment: (3,) mass times centre of mass from that point, body axes, kg.m.
        gravity: m/s^2.
        rotation: (3, 3) world from body at the start.
        velocity: (3,) body angular velocity at the start, rad/s.
        duration: as in the literature, s.
    """

    name: str
    inertia: Array
    moment: Array
    gravity: float
    rotation: Array
    velocity: Array
    duration: float

    @functools.cached_property
    def system(self) -> LeftEulerPoincare:
        """Its equations of motion."""
        return heavy_top(self.inertia, self.moment, self.gravity)

    def simulate(self, step: float, steps: int, every: int = 1) -> Motion:
        """Integrate its equations on SO(3); see :meth:`EulerPoincare.simulate`."""
        return self.system.simulate(
            self.rotation, self.velocity, self.rotation.T @ UP, step=step, steps=steps, every=every
        )

    def reference(self, times: Array) -> tuple[Array, Array]:
        """Return rotations (n, 3, 3) and body angular velocities (n, 3) by DOP853 on quaternion and velocity.

        Relative tolerance 1e-13 a step; Hairer, Norsett, Wanner, "Solving ordinary differential equations I" (1993).

        Args:
            times: (n,) increasing, from 0 on, s.
        """
        grid = checks.tangent(np.size(times))("times", times)

        def rate(_: float, y: Array) -> Array:
            x, w = y[:4], y[4:]
            direction = np.array([*w, 0.0])
            up = quaternion.to_matrix.unchecked(x / np.linalg.norm(x))[2]
            torque = np.cross(self.inertia @ w, w) + self.gravity * np.cross(up, self.moment)
            vector = x[3] * direction[:3] + np.cross(x[:3], w)
            return np.concatenate((vector / 2, [-x[:3] @ w / 2], np.linalg.solve(self.inertia, torque)))

        start = np.concatenate((quaternion.from_matrix(self.rotation), self.velocity))
        found = solve_ivp(rate, (0.0, float(grid[-1])), start, "DOP853", grid, rtol=1e-13, atol=1e-14).y.T
        turns = found[:, :4] / np.linalg.norm(found[:, :4], axis=1, keepdims=True)
        return quaternion.to_matrix(turns), np.asarray(found[:, 4:], dtype=np.float64)


SIMO_WONG_TOP = HeavyTopBenchmark(
    "Simo and Wong",
    inertia=np.diag([5.0, 5.0, 1.0]),
    moment=np.array([0.0, 0.0, 20.0]),
    gravity=1.0,
    rotation=so3.exp(np.array([0.3, 0.0, 0.0])),
    velocity=np.array([0.0, 0.0, 50.0]),
    duration=10.0,
)
"""Fast symmetric top, m g l = 20 N.m, released at a tilt of 0.3 rad: nutation with cusps.

Simo and Wong, "Unconditionally stable algorithms for rigid body dynamics that exactly preserve energy and momentum",
Int. J. Numer. Methods Eng. 31 (1991); the tilt as in Krysl and Endres, "Explicit Newmark/Verlet algorithm for time
integration of the rotational dynamics of rigid bodies", ibid. 62 (2005).
"""

BRULS_TOP = HeavyTopBenchmark(
    "Bruls, Cardona, Arnold",
    # A disc of 15 kg, 0.234375 and 0.46875 kg.m^2 about its centre, at 1 m along its second axis, the axis of symmetry.
    inertia=np.diag([15.234375, 0.46875, 15.234375]),
    moment=np.array([0.0, 15.0, 0.0]),
    gravity=GRAVITY,
    rotation=np.eye(3),
    velocity=np.array([0.0, 150.0, -4.61538]),
    duration=2.0,
)
"""Fast disc on a horizontal arm with an initial precession.

Bruls, Cardona, Arnold, "Lie group generalized-alpha time integration of constrained flexible multibody systems",
Mechanism and Machine Theory 48 (2012), where a constraint fixes the point.
"""
