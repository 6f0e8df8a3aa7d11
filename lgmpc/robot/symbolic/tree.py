"""The constants of a ``pin.Model`` used by the symbolic algorithms."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.state.configuration import JOINT_KINDS, BlockKind, configuration_blocks
from lgmpc.typing import Array


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint and the rigid body after it; vectors and matrices are constants, in the joint's own (child) frame.

    Attributes:
        kind: its group.
        slides: whether it is prismatic.
        parent: index of the joint before it; 0 is the world.
        q: its entries of the configuration.
        v: its entries of the velocity.
        rotation: (3, 3) constant rotation, parent to joint at zero position.
        translation: (3,) constant position in the parent's frame.
        axis: (3,) unit axis; zero unless revolute, continuous or prismatic.
        linear: (3, nv) linear part of the motion subspace.
        angular: (3, nv) angular part.
        armature: (nv,) rotor inertia.
        mass: of the body, kg.
        moment: (3,) first moment, mass times centre of mass.
        inertia: (3, 3) rotational inertia about the joint's origin.
        second_moment: (3, 3) integral of ``r r^T dm`` about the joint's origin.
    """

    kind: BlockKind
    slides: bool
    parent: int
    q: slice
    v: slice
    rotation: Array
    translation: Array
    axis: Array
    linear: Any
    angular: Any
    armature: Array
    mass: float
    moment: Any
    inertia: Any
    second_moment: Any


@dataclass(frozen=True, eq=False)
class Tree:
    """All joints of a model, parents before children; ``joints[i - 1]`` is Pinocchio's joint ``i``.

    Attributes:
        joints: in Pinocchio's order.
        gravity: (3,) world axes, m/s2.
        nq: size of the configuration.
        nv: size of the velocity.
        mass: of all moving bodies, kg.
    """

    joints: tuple[Joint, ...]
    gravity: Any
    nq: int
    nv: int
    mass: float

    def support(self, joint: int) -> list[int]:
        """Return ``joint`` and the joints between it and the world, in this order."""
        chain = []
        while joint > 0:
            chain.append(joint)
            joint = self.joints[joint - 1].parent
        return chain

    @property
    def roots(self) -> list[int]:
        """The joints whose parent is the world."""
        return [index for index, joint in enumerate(self.joints, start=1) if joint.parent == 0]


def read_tree(model: pin.Model) -> Tree:
    """Read the constants of ``model``.

    Raises:
        ModelError: a joint is of a kind that :func:`configuration_blocks` does not support; all such are listed.
    """
    configuration_blocks(model)  # raises for other joints
    joints = tuple(_read_joint(model, index) for index in range(1, model.njoints))
    gravity = ca.DM(np.asarray(model.gravity.linear))
    return Tree(joints, gravity, int(model.nq), int(model.nv), sum(joint.mass for joint in joints))


def _read_joint(model: pin.Model, index: int) -> Joint:
    joint, placement, body = model.joints[index], model.jointPlacements[index], model.inertias[index]
    kind, slides = JOINT_KINDS[joint.shortname()], False
    linear, angular, axis = np.zeros((3, joint.nv)), np.zeros((3, joint.nv)), np.zeros(3)
    if kind is BlockKind.PLACEMENT:
        linear[:, :3], angular[:, 3:] = np.eye(3), np.eye(3)
    elif kind is BlockKind.ROTATION:
        angular = np.eye(3)
    else:
        subspace = _motion_subspace(joint)
        slides = bool(subspace[:3].any())
        axis = _snap(subspace[:3] if slides else subspace[3:])
        (linear if slides else angular)[:, 0] = axis
    lever, mass = np.asarray(body.lever), float(body.mass)
    inertia = np.asarray(body.inertia) + mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    return Joint(
        kind=kind,
        slides=slides,
        parent=int(model.parents[index]),
        q=slice(joint.idx_q, joint.idx_q + joint.nq),
        v=slice(joint.idx_v, joint.idx_v + joint.nv),
        rotation=_snap(placement.rotation),
        translation=np.array(placement.translation),
        axis=axis,
        linear=ca.DM(linear),
        angular=ca.DM(angular),
        armature=np.array(model.armature[joint.idx_v : joint.idx_v + joint.nv]),
        mass=mass,
        moment=ca.DM(mass * lever),
        inertia=ca.DM(inertia),
        second_moment=ca.DM(0.5 * np.trace(inertia) * np.eye(3) - inertia),
    )


def _motion_subspace(joint: Any) -> Array:
    """Return (6,) the twist, in the child's frame, of unit velocity of a joint with one axis; it is constant."""
    data = joint.createData()
    q = np.zeros(joint.idx_q + joint.nq)
    if joint.nq == 2:
        q[joint.idx_q] = 1.0
    joint.calc(data, q)
    return np.array(data.S, dtype=np.float64).reshape(6)


def _snap(values: Array) -> Array:
    """Round entries that differ from -1, 0 or 1 by rounding errors only, so that they drop out of expressions."""
    values = np.array(values, dtype=np.float64)
    nearest = np.clip(np.round(values), -1, 1)
    return np.where(np.abs(values - nearest) < 4e-16, nearest, values)
