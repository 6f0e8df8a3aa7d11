"""The configuration space of a ``pin.Model`` as a product of groups: blocks, their operations in numpy and in CasADi.

Free-flyer, spherical and continuous (unbounded revolute) joints have one block each; neighbouring revolute and
prismatic joints, whose coordinates add, share one block. Tangent vectors are Pinocchio's: body frame, linear
first. Values agree with ``pin.integrate`` and ``pin.difference``, the sign of the resulting quaternions included.

Functions of a block's kind are on arrays, single or batched over leading axes, with the Jacobians of :mod:`lgmpc.lie`.
Pinocchio 4.1's are not used: its ``dIntegrate`` and ``dDifference`` of the free-flyer differ from the exponential of
``ad`` by 3e-5 at an angle of 2e-4 rad, by 1e-7 at 1e-3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc import lie
from lgmpc.errors import ModelError
from lgmpc.lie.components import parts, vector
from lgmpc.lie.symbolic import quaternion, se3, so3
from lgmpc.state.base import Array

__all__ = [
    "Block",
    "BlockKind",
    "configuration_blocks",
    "difference",
    "difference_jacobians",
    "difference_jacobians_symbolic",
    "difference_symbolic",
    "integrate",
    "integrate_configuration_symbolic",
    "integrate_jacobians",
    "integrate_jacobians_symbolic",
    "linear_difference",
    "moved",
]


class BlockKind(Enum):
    """The Lie group of a block."""

    VECTOR = "vector"
    """R^n: revolute with limits, prismatic."""
    CIRCLE = "circle"
    """SO(2) as (cos, sin): continuous."""
    ROTATION = "rotation"
    """SO(3) as a quaternion x y z w: spherical."""
    PLACEMENT = "placement"
    """SE(3) as (position, quaternion x y z w): free-flyer."""


@dataclass(frozen=True)
class Block:
    """A slice of the configuration that is one Lie group.

    Attributes:
        kind: the group.
        q: its entries of the configuration.
        v: its entries of the velocity.
    """

    kind: BlockKind
    q: slice
    v: slice


_KINDS = {
    "JointModelFreeFlyer": BlockKind.PLACEMENT,
    "JointModelSpherical": BlockKind.ROTATION,
    **{f"JointModel{name}": BlockKind.VECTOR for name in ("RX", "RY", "RZ", "RevoluteUnaligned")},
    **{f"JointModel{name}": BlockKind.VECTOR for name in ("PX", "PY", "PZ", "PrismaticUnaligned")},
    **{f"JointModel{name}": BlockKind.CIRCLE for name in ("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned")},
}


def configuration_blocks(model: pin.Model) -> tuple[Block, ...]:
    """Split the configuration of ``model`` into blocks, in order.

    Raises:
        ModelError: a joint is neither free-flyer, spherical, revolute, continuous nor prismatic; all such are listed.
    """
    blocks: list[Block] = []
    problems: list[str] = []
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        kind = _KINDS.get(joint.shortname())
        if kind is None:
            problems.append(
                f"joint '{name}' is a {joint.shortname()}; supported are free-flyer, spherical, revolute, continuous"
                " and prismatic joints"
            )
            continue
        q, v = slice(joint.idx_q, joint.idx_q + joint.nq), slice(joint.idx_v, joint.idx_v + joint.nv)
        if kind is BlockKind.VECTOR and blocks and blocks[-1].kind is BlockKind.VECTOR:
            q, v = slice(blocks[-1].q.start, q.stop), slice(blocks.pop().v.start, v.stop)
        blocks.append(Block(kind, q, v))
    if problems:
        raise ModelError(model.name, problems)
    return tuple(blocks)


def integrate_configuration_symbolic(model: pin.Model, q: Any, dv: Any) -> Any:
    """Return ``q (+) dv`` as a CasADi column; derivatives of any order are exact at ``dv = 0``.

    Args:
        model: any model of supported joints.
        q: (nq,) configuration, SX, MX or DM; quaternions of unit norm (kept to rounding, never renormalised).
        dv: (nv,) tangent vector: velocity times time.

    Raises:
        ModelError: unsupported joints.
    """
    blocks = configuration_blocks(model)
    return ca.vertcat(*(_INTEGRATE[block.kind](q[block.q], dv[block.v]) for block in blocks))


def difference_symbolic(model: pin.Model, q0: Any, q1: Any) -> Any:
    """Return ``q1 (-) q0`` as a CasADi column (nv,), smooth up to rotations by pi, both signs of quaternions alike.

    Args:
        model: any model of supported joints.
        q0: (nq,) configuration, SX, MX or DM.
        q1: (nq,) configuration.

    Raises:
        ModelError: unsupported joints.
    """
    blocks = configuration_blocks(model)
    return ca.vertcat(*(_DIFFERENCE[block.kind](q0[block.q], q1[block.q]) for block in blocks))


def integrate_jacobians_symbolic(kind: BlockKind, dv: Any) -> tuple[Any, Any]:
    """Return :func:`integrate_jacobians` as CasADi matrices."""
    group = _GROUPS[kind]
    jacobian = group.right_jacobian(dv)
    return ca.DM.eye(dv.shape[0]) - group.ad(dv) @ jacobian, jacobian


def difference_jacobians_symbolic(kind: BlockKind, d: Any) -> tuple[Any, Any]:
    """Return :func:`difference_jacobians` as CasADi matrices."""
    group = _GROUPS[kind]
    jacobian = group.right_jacobian_inverse(d)
    return group.ad(d) - jacobian, jacobian


def _integrate_rotation(q: Any, dv: Any) -> Any:
    return quaternion.compose(q, quaternion.exp(dv))


def _rotation_difference(q0: Any, q1: Any) -> Any:
    return quaternion.log(quaternion.compose(quaternion.inverse(q0), q1))


def _integrate_circle(q: Any, dv: Any) -> Any:
    cosine, sine = ca.cos(dv), ca.sin(dv)
    return ca.vertcat(q[0] * cosine - q[1] * sine, q[1] * cosine + q[0] * sine)


def _circle_difference(q0: Any, q1: Any) -> Any:
    return ca.atan2(q0[0] * q1[1] - q0[1] * q1[0], q0[0] * q1[0] + q0[1] * q1[1])


def _integrate_placement(q: Any, dv: Any) -> Any:
    moved = q[:3] + quaternion.act(q[3:], so3.left_jacobian_product(dv[3:], dv[:3]))
    step = quaternion.exp(dv[3:])
    # For the free-flyer (only), Pinocchio keeps the result in the hemisphere of its argument: q . (q step) = step_w.
    return ca.vertcat(moved, quaternion.compose(q[3:], ca.if_else(step[3] < 0, -step, step)))


def _placement_difference(q0: Any, q1: Any) -> Any:
    phi = _rotation_difference(q0[3:], q1[3:])
    step = quaternion.act(quaternion.inverse(q0[3:]), q1[:3] - q0[:3])
    return ca.vertcat(so3.left_jacobian_inverse_product(phi, step), phi)


_GROUPS: dict[BlockKind, Any] = {BlockKind.ROTATION: so3, BlockKind.PLACEMENT: se3}

_INTEGRATE: dict[BlockKind, Callable[[Any, Any], Any]] = {
    BlockKind.VECTOR: lambda q, dv: q + dv,
    BlockKind.CIRCLE: _integrate_circle,
    BlockKind.ROTATION: _integrate_rotation,
    BlockKind.PLACEMENT: _integrate_placement,
}
_DIFFERENCE: dict[BlockKind, Callable[[Any, Any], Any]] = {
    BlockKind.VECTOR: lambda q0, q1: q1 - q0,
    BlockKind.CIRCLE: _circle_difference,
    BlockKind.ROTATION: _rotation_difference,
    BlockKind.PLACEMENT: _placement_difference,
}


_multiply = lie.quaternion.compose.unchecked
_conjugate = lie.quaternion.inverse.unchecked


def integrate(kind: BlockKind, q: Array, dv: Array) -> Array:
    """Return ``q (+) dv``, quaternions renormalised, signed as Pinocchio signs them."""
    if kind is BlockKind.VECTOR:
        return q + dv
    if kind is BlockKind.CIRCLE:
        cosine, sine, angle = q[..., 0], q[..., 1], dv[..., 0]
        turned = (np.cos(angle) * cosine - np.sin(angle) * sine, np.cos(angle) * sine + np.sin(angle) * cosine)
        return _unit(np.stack(turned, axis=-1))
    if kind is BlockKind.ROTATION:
        return _unit(_multiply(q, lie.quaternion.exp.unchecked(dv)))
    step = lie.quaternion.exp.unchecked(dv[..., 3:])
    step = np.where(step[..., 3:] < 0.0, -step, step)  # the result stays in the hemisphere of q
    return np.concatenate((moved(q, dv), _unit(_multiply(q[..., 3:], step))), axis=-1)


def difference(kind: BlockKind, q0: Array, q1: Array) -> Array:
    """Return ``q1 (-) q0``; ``q`` and ``-q`` alike, sign at half a turn as in :func:`lgmpc.lie.quaternion.log`."""
    if kind is BlockKind.VECTOR:
        return q1 - q0
    if kind is BlockKind.CIRCLE:
        sine = q0[..., 0] * q1[..., 1] - q0[..., 1] * q1[..., 0]
        return np.arctan2(sine, q0[..., 0] * q1[..., 0] + q0[..., 1] * q1[..., 1])[..., None]
    if kind is BlockKind.ROTATION:
        return lie.quaternion.log.unchecked(_multiply(_conjugate(q0), q1))
    phi = lie.quaternion.log.unchecked(_multiply(_conjugate(q0[..., 3:]), q1[..., 3:]))
    return np.concatenate((linear_difference(q0, q1, phi), phi), axis=-1)


def moved(q: Array, dv: Array) -> Array:
    """Return the position (..., 3) of the placement ``q (+) dv``."""
    twist, (x, y, z, *turn) = parts(dv), parts(q)
    a, b, c = lie.quaternion.act_entries(turn, lie.so3.left_jacobian_product_entries(twist[3:], twist[:3]))
    return vector((x + a, y + b, z + c))


def linear_difference(q0: Array, q1: Array, phi: Array) -> Array:
    """Return the linear part (..., 3) of ``q1 (-) q0`` of placements, whose angular part is ``phi``."""
    (a, b, c, x, y, z, w), (d, e, f, *_) = parts(q0), parts(q1)
    step = lie.quaternion.act_entries((-x, -y, -z, w), (d - a, e - b, f - c))
    return vector(lie.so3.left_jacobian_inverse_product_entries(parts(phi), step))


def integrate_jacobians(kind: BlockKind, dv: Array) -> tuple[Array, Array]:
    """Return the derivatives of ``q (+) dv`` with respect to ``q`` and ``dv``, for a rotation or a placement.

    The second is the right Jacobian ``J``; the first ``exp(-ad) = I - ad J``, because ``J = (I - exp(-ad)) / ad``.
    """
    group = _NUMERIC[kind]
    jacobian = group.right_jacobian.unchecked(dv)
    return _IDENTITY[kind] - group.ad.unchecked(dv) @ jacobian, jacobian


def difference_jacobians(kind: BlockKind, d: Array) -> tuple[Array, Array]:
    """Return the derivatives of ``d = q1 (-) q0`` with respect to ``q0`` and ``q1``, for a rotation or a placement.

    The second is the inverse right Jacobian; the first minus the inverse left one, which differs from it by ``ad``.
    """
    group = _NUMERIC[kind]
    jacobian = group.right_jacobian_inverse.unchecked(d)
    return group.ad.unchecked(d) - jacobian, jacobian


_NUMERIC: dict[BlockKind, lie.Group] = {BlockKind.ROTATION: lie.so3, BlockKind.PLACEMENT: lie.se3}
_IDENTITY = {BlockKind.ROTATION: np.eye(3), BlockKind.PLACEMENT: np.eye(6)}


def _unit(array: Array) -> Array:
    scaled: Array = array / np.sqrt(np.einsum("...i,...i->...", array, array))[..., None]
    return scaled
