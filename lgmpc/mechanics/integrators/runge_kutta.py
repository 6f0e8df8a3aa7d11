"""Runge-Kutta methods on matrix entries, for comparison with methods on the group."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare
from lgmpc.mechanics.reduction.terms import Symbols
from lgmpc.mechanics.rollout import runge_kutta4

__all__ = ["matrix_runge_kutta", "projected_runge_kutta"]

_PROJECTIONS = 3
"""Number of Newton-Schulz iterations, which converge quadratically."""


def matrix_runge_kutta(system: EulerPoincare) -> ca.Function:
    """Return the classical fourth-order step on the entries of the pose, ignoring the group (chapter 4.18).

    Args:
        system: any.
    """
    s, h = system.symbols(), ca.SX.sym("step")
    return system.step("matrix_runge_kutta", s, h, *_by_entries(system, s, h))


def projected_runge_kutta(system: EulerPoincare) -> ca.Function:
    """Return the same step with the rotation projected to the nearest one (chapter 4.18, "SVD projection").

    The nearest rotation is the orthogonal polar factor, the product U V^T of the singular vectors, computed to rounding
    by Newton-Schulz iterations. The advected quantity follows from the poses.

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
    return system.step("projected_runge_kutta", s, h, pose, velocity, advected)


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
