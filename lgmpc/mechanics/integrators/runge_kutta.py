"""Runge-Kutta methods for Euler-Poincare systems: on the group, and on the entries of its matrices for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

from lgmpc.mechanics.integrators.rollout import runge_kutta4, step_of

if TYPE_CHECKING:
    from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare
    from lgmpc.mechanics.reduction.terms import Symbols

__all__ = ["matrix_runge_kutta", "munthe_kaas", "projected_runge_kutta"]

_PROJECTIONS = 3
"""Newton-Schulz iterations; the error of each is the square of the one before."""


def munthe_kaas(system: EulerPoincare) -> ca.Function:
    """The classical fourth-order method in the exponential chart around each step's first pose.

    With ``g = g0 exp(z)`` (left), ``z' = Jr^-1(z) xi``, for (z, xi); the advected quantity is carried by exp(z) itself,
    so that poses and advected quantities never leave the group and its orbit. Munthe-Kaas, "High order Runge-Kutta
    methods on manifolds", Applied Numerical Mathematics 29 (1999).

    Args:
        system: any.
    """
    s, h, dim = system.symbols(), ca.SX.sym("step"), system.group.dim

    def slope(elapsed: Any, y: Any) -> Any:
        z, velocity = y[:dim], y[dim:]
        pose, advected = system.move(s.pose, z), system.carry(s.advected, z)
        rate = system.acceleration(s.time + elapsed, pose, velocity, advected, s.parameters)
        return ca.vertcat(system.chart_rate(z, velocity), rate)

    end = runge_kutta4(slope, ca.vertcat(ca.SX.zeros(dim), s.velocity), h)
    z, velocity = end[:dim], end[dim:]
    return step_of("munthe_kaas", system, s, h, system.move(s.pose, z), velocity, system.carry(s.advected, z))


def matrix_runge_kutta(system: EulerPoincare) -> ca.Function:
    """The classical fourth-order method on the entries of the pose, as if they were numbers (chapter 4.18).

    Args:
        system: any.
    """
    s, h = system.symbols(), ca.SX.sym("step")
    return step_of("matrix_runge_kutta", system, s, h, *_by_entries(system, s, h))


def projected_runge_kutta(system: EulerPoincare) -> ca.Function:
    """The same, the rotation replaced after each step by the nearest one (chapter 4.18, "SVD projection").

    That is the orthogonal polar factor, the product U V^T of its singular vectors; here by Newton-Schulz iterations,
    which find it to rounding. The advected quantity is carried along from pose to pose.

    Args:
        system: on a group whose elements begin with a rotation.
    """
    s, h, group = system.symbols(), ca.SX.sym("step"), system.group.symbolic
    pose, velocity, _ = _by_entries(system, s, h)
    rotation = pose[:3, :3]
    for _ in range(_PROJECTIONS):
        rotation = rotation @ (3 * ca.DM.eye(3) - rotation.T @ rotation) / 2
    pose[:3, :3] = rotation
    moved = (
        group.compose(group.inverse(s.pose), pose) if system.sign > 0 else group.compose(pose, group.inverse(s.pose))
    )
    advected = s.advected
    if system.advected is not None:
        advected = system.advected.act(group.inverse(moved) if system.sign > 0 else moved, s.advected)
    return step_of("projected_runge_kutta", system, s, h, pose, velocity, advected)


def _by_entries(system: EulerPoincare, s: Symbols, h: Any) -> tuple[Any, Any, Any]:
    """Return pose, velocity and advected quantity after a step."""
    size, dim, group = system.group.size, system.group.dim, system.group.symbolic

    def parts(y: Any) -> tuple[Any, Any, Any]:
        return ca.reshape(y[: size * size], size, size), y[size * size : size * size + dim], y[size * size + dim :]

    def slope(elapsed: Any, y: Any) -> Any:
        pose, velocity, advected = parts(y)
        hat = group.hat(velocity)
        turned = pose @ hat if system.sign > 0 else hat @ pose
        rate = system.acceleration(s.time + elapsed, pose, velocity, advected, s.parameters)
        return ca.vertcat(ca.vec(turned), rate, -system.sign * system.generator(advected) @ velocity)

    return parts(runge_kutta4(slope, ca.vertcat(ca.vec(s.pose), s.velocity, s.advected), h))
