"""Runge-Kutta methods on the entries of a group's matrices, to compare those that stay on the group with."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare
from lgmpc.mechanics.reduction.terms import Symbols
from lgmpc.mechanics.rollout import runge_kutta4

__all__ = ["matrix_runge_kutta", "projected_runge_kutta"]

_PROJECTIONS = 3
"""Newton-Schulz iterations; the error of each is the square of the one before."""


def matrix_runge_kutta(system: EulerPoincare) -> ca.Function:
    """The classical fourth-order method on the entries of the pose, as if they were numbers (chapter 4.18).

    Args:
        system: any.
    """
    s, h = system.symbols(), ca.SX.sym("step")
    return system.step("matrix_runge_kutta", s, h, *_by_entries(system, s, h))


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
