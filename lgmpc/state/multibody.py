"""The state of a robot: configuration and velocity."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.state.base import State
from lgmpc.state.configuration import (
    Block,
    BlockKind,
    configuration_blocks,
    difference_jacobians,
    difference_symbolic,
    integrate_configuration_symbolic,
    integrate_jacobians,
)
from lgmpc.typing import Array

_UNIT_NORM = {BlockKind.CIRCLE: 0, BlockKind.ROTATION: 0, BlockKind.PLACEMENT: 3}
"""First entry of the part of unit norm in the blocks that have one."""


class StateMultibody(State):
    """``x = (q, v)`` of a ``pin.Model``, with tangent ``(dq, dv)``: ``nx = nq + nv``, ``ndx = 2 nv``.

    ``q`` and ``v`` are Pinocchio's: position in world axes, quaternion x y z w, joints; velocity of the base in its own
    frame, linear first. ``dq`` is expressed in the body frame at its base point.

    Limits are those of the model: joint positions and velocities. Where the model has none (free-flyer, spherical and
    continuous joints; entries at the largest float), they are infinite.

    Args:
        model: a model of free-flyer, spherical, revolute, continuous and prismatic joints.

    Attributes:
        model: the model.
        nq: size of a configuration.
        nv: size of a velocity.
        lower: (ndx,) lower limits of ``diff(neutral(), x)``, read-only.
        upper: (ndx,) upper limits.
        blocks: the groups whose product is the configuration space.
        curved: the rotations and placements among them.

    Raises:
        ModelError: joints of other types, all listed.
        InputError: crossed limits.
    """

    def __init__(self, model: pin.Model) -> None:
        if not isinstance(model, pin.Model):
            raise InputError("model", f"{model!r:.80}", "a pinocchio.Model")
        self.model = model
        self.nq: int = model.nq
        self.nv: int = model.nv
        self.blocks = configuration_blocks(model)
        lower, upper = _position_limits(model, self.blocks)
        # Not lowerVelocityLimit: Pinocchio 4.1's URDF parser sets it to plus the velocity limit.
        speed = _open_ended(model.upperVelocityLimit)
        super().__init__(self.nq + self.nv, 2 * self.nv)
        self.lower, self.upper = np.r_[lower, -speed], np.r_[upper, speed]
        for limits in (self.lower, self.upper):
            limits.flags.writeable = False
        if (self.lower > self.upper).any():
            i = int(np.flatnonzero(self.lower > self.upper)[0])
            raise InputError("lower", f"{self.lower[i]:g} at index {i}", f"at most the upper limit, {self.upper[i]:g}")
        self._neutral = np.concatenate((pin.neutral(model), np.zeros(self.nv)))
        self.curved = tuple(b for b in self.blocks if b.kind in (BlockKind.ROTATION, BlockKind.PLACEMENT))
        self._units = tuple(
            slice(b.q.start + _UNIT_NORM[b.kind], b.q.stop) for b in self.blocks if b.kind in _UNIT_NORM
        )

    def neutral(self) -> Array:
        """Return Pinocchio's neutral configuration at rest."""
        return self._neutral.copy()

    def project(self, x: Array) -> Array:
        """Return states with quaternions and (cos, sin) of unit norm."""
        moved = x.copy()
        for i in self._units:
            moved[..., i] /= np.linalg.norm(x[..., i], axis=-1, keepdims=True)
        return moved

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``(q (+) dq, v + dv)`` as a CasADi column; its derivatives at ``dx = 0`` are exact."""
        moved = integrate_configuration_symbolic(self.model, x[: self.nq], dx[: self.nv])
        return ca.vertcat(moved, x[self.nq :] + dx[self.nv :])

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``(q1 (-) q0, v1 - v0)`` as a CasADi column; its derivatives at ``x0 = x1`` are exact."""
        gap = difference_symbolic(self.model, x0[: self.nq], x1[: self.nq])
        return ca.vertcat(gap, x1[self.nq :] - x0[self.nq :])

    def Jintegrate_symbolic(self, x: Any, dx: Any) -> tuple[Any, Any]:
        """Return the derivatives of :meth:`integrate_symbolic` in tangent coordinates, as CasADi matrices."""
        return self._jacobians_symbolic(integrate_jacobians, 1.0, dx)

    def Jdiff_symbolic(self, x0: Any, x1: Any) -> tuple[Any, Any]:
        """Return the derivatives of :meth:`diff_symbolic` in tangent coordinates, as CasADi matrices."""
        return self._jacobians_symbolic(difference_jacobians, -1.0, self.diff_symbolic(x0, x1))

    def _jacobians_symbolic(
        self, of_block: Callable[[BlockKind, Any], tuple[Any, Any]], sign: float, d: Any
    ) -> tuple[Any, Any]:
        """Return both Jacobians along the tangent vector d: the identity, with a sign, except for curved blocks."""
        first, second = [], []
        end = 0
        for block in self.curved:
            flat = ca.SX.eye(block.v.start - end)
            left, right = of_block(block.kind, d[block.v])
            first += [sign * flat, left]
            second += [flat, right]
            end = block.v.stop
        flat = ca.SX.eye(self.ndx - end)
        return ca.diagcat(*first, sign * flat), ca.diagcat(*second, flat)


def _position_limits(model: pin.Model, blocks_: tuple[Block, ...]) -> tuple[Array, Array]:
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for block in blocks_:
        if block.kind is BlockKind.VECTOR:
            lower[block.v] = _open_ended(model.lowerPositionLimit[block.q])
            upper[block.v] = _open_ended(model.upperPositionLimit[block.q])
    return lower, upper


def _open_ended(limits: Array) -> Array:
    """Replace the largest float, Pinocchio's value for no limit, by infinity."""
    return np.where(np.abs(limits) < np.finfo(np.float64).max, limits, np.copysign(np.inf, limits))
