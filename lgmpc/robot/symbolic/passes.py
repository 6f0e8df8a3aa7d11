"""The common recursions over a tree: placements, velocities, accelerations, composite inertias.

All quantities of a joint are in the joint's own frame, so that zeros of the model's constants remain zeros and CasADi
simplifies them. Accelerations are classical: the second derivative of the joint origin's position, expressed in the
joint's frame. With them the recursions need no linear velocities (Luh, Walker and Paul 1980), and

    B = [alpha]x + [omega]x [omega]x

gives the acceleration ``a + B r`` of any point ``r`` of the body.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.lie.symbolic import quaternion
from lgmpc.robot.symbolic.tree import Joint, Tree
from lgmpc.state.configuration import BlockKind

_ORIGIN = ca.DM.zeros(3)
_STILL = ca.DM.zeros(3, 3)


@dataclass(frozen=True)
class Placement:
    """A frame in another: ``point_there = rotation @ point_here + translation``.

    Attributes:
        rotation: (3, 3).
        translation: (3,), m.
    """

    rotation: Any
    translation: Any

    def compose(self, other: "Placement") -> "Placement":
        """Return the placement of ``other``'s frame in the frame in which this one is placed."""
        return Placement(
            ca.mtimes(self.rotation, other.rotation), ca.mtimes(self.rotation, other.translation) + self.translation
        )


WORLD = Placement(ca.DM.eye(3), _ORIGIN)


def joint_steps(tree: Tree, q: Any) -> list[Placement]:
    """Return the placement of each joint's frame in its parent's, (njoints,) with that of the world first."""
    return [WORLD, *(_step(joint, q[joint.q]) for joint in tree.joints)]


def _step(joint: Joint, q: Any) -> Placement:
    fixed, offset = ca.DM(joint.rotation), ca.DM(joint.translation)
    if joint.slides:
        return Placement(fixed, offset + ca.mtimes(fixed, ca.DM(joint.axis)) * q[0])
    if joint.kind is BlockKind.ROTATION:
        return Placement(ca.mtimes(fixed, quaternion.to_matrix(q)), offset)
    if joint.kind is BlockKind.PLACEMENT:
        return Placement(ca.mtimes(fixed, quaternion.to_matrix(q[3:])), offset + ca.mtimes(fixed, q[:3]))
    cosine, sine = (q[0], q[1]) if joint.kind is BlockKind.CIRCLE else (ca.cos(q[0]), ca.sin(q[0]))
    # Rodrigues' formula, times the fixed rotation, as a sum of constant matrices: their zeros cost no operations.
    axis = ca.DM(joint.axis)
    along = ca.mtimes(axis, axis.T)
    across = ca.mtimes(fixed, ca.DM.eye(3) - along)
    turn = ca.mtimes(fixed, ca.skew(axis))
    return Placement(ca.mtimes(fixed, along) + cosine * across + sine * turn, offset)


def world_placements(tree: Tree, steps: list[Placement]) -> list[Placement]:
    """Return the placement of each joint's frame in the world."""
    placed = [WORLD]
    for joint, step in zip(tree.joints, steps[1:], strict=True):
        placed.append(step if joint.parent == 0 else placed[joint.parent].compose(step))
    return placed


@dataclass(frozen=True)
class Rotation:
    """Angular velocity of a body.

    Attributes:
        omega: (3,) angular velocity, rad/s.
        carried: (3,) the parent's part.
        relative: (3,) the joint's part.
        square: (3, 3) ``[omega]x [omega]x``.
    """

    omega: Any
    carried: Any
    relative: Any
    square: Any


def rotations(tree: Tree, steps: list[Placement], v: Any) -> list[Rotation]:
    """Return the angular velocity of each body, that of the world first."""
    passed = [Rotation(_ORIGIN, _ORIGIN, _ORIGIN, _STILL)]
    for joint, step in zip(tree.joints, steps[1:], strict=True):
        relative = ca.mtimes(joint.angular, v[joint.v])
        if joint.parent == 0:
            carried, omega = _ORIGIN, relative
        else:
            carried = ca.mtimes(step.rotation.T, passed[joint.parent].omega)
            omega = carried + relative
        passed.append(Rotation(omega, carried, relative, _square(omega)))
    return passed


def linear_velocities(tree: Tree, steps: list[Placement], turning: list[Rotation], v: Any) -> list[Any]:
    """Return (3,) the velocity of each joint's origin, that of the world first."""
    passed = [_ORIGIN]
    for joint, step in zip(tree.joints, steps[1:], strict=True):
        own = ca.mtimes(joint.linear, v[joint.v])
        if joint.parent:
            carrier = passed[joint.parent] + ca.cross(turning[joint.parent].omega, step.translation)
            own = ca.mtimes(step.rotation.T, carrier) + own
        passed.append(own)
    return passed


@dataclass(frozen=True)
class Acceleration:
    """Acceleration of a body.

    Attributes:
        linear: (3,) classical acceleration of the joint's origin, m/s2.
        angular: (3,) rad/s2.
        field: (3, 3) the matrix B: a point ``r`` accelerates by ``linear + field @ r``.
    """

    linear: Any
    angular: Any
    field: Any


def accelerations(
    tree: Tree, steps: list[Placement], turning: list[Rotation], v: Any, a: Any, base: Any
) -> list[Acceleration]:
    """Return the acceleration of each body, that of the world first.

    Args:
        tree: the model.
        steps: from :func:`joint_steps`.
        turning: from :func:`rotations`.
        v: (nv,) velocity.
        a: (nv,) joint accelerations, or None for zero.
        base: (3,) acceleration of the world; minus gravity includes gravity in the bodies' accelerations.
    """
    passed = [Acceleration(base, _ORIGIN, _STILL)]
    for index, (joint, step) in enumerate(zip(tree.joints, steps[1:], strict=True), start=1):
        turn, before = turning[index], passed[joint.parent]
        slide = ca.mtimes(joint.linear, v[joint.v])
        linear = ca.mtimes(step.rotation.T, before.linear + ca.mtimes(before.field, step.translation))
        linear += ca.cross(turn.relative + 2.0 * turn.carried, slide)
        angular = ca.cross(turn.carried, turn.relative)
        if joint.parent:
            angular += ca.mtimes(step.rotation.T, before.angular)
        if a is not None:
            linear += ca.mtimes(joint.linear, a[joint.v])
            angular += ca.mtimes(joint.angular, a[joint.v])
        passed.append(Acceleration(linear, angular, turn.square + ca.skew(angular)))
    return passed


@dataclass(frozen=True)
class Composite:
    """Inertia of a body and its descendants, about the joint's origin.

    Attributes:
        mass: kg.
        moment: (3,) first moment, kg.m.
        inertia: (3, 3) rotational inertia, kg.m2.
    """

    mass: float
    moment: Any
    inertia: Any


def composites(tree: Tree, steps: list[Placement]) -> list[Composite]:
    """Return the composite inertia of each joint's subtree; the entry of the world is empty."""
    bodies = [Composite(joint.mass, joint.moment, joint.inertia) for joint in tree.joints]
    gathered = [Composite(0.0, _ORIGIN, _STILL), *bodies]
    for index in range(len(tree.joints), 0, -1):
        parent = tree.joints[index - 1].parent
        if parent:
            child, there = gathered[index], gathered[parent]
            moment, inertia = _move(child, steps[index])
            gathered[parent] = Composite(there.mass + child.mass, there.moment + moment, there.inertia + inertia)
    return gathered


def _move(child: Composite, step: Placement) -> tuple[Any, Any]:
    """Return first moment and inertia of ``child`` about the parent's origin, in the parent's frame."""
    r, turned = step.translation, ca.mtimes(step.rotation, child.moment)
    # The integral of |x|^2 I - x x^T at x = r + y: with s = 2 turned + m r, it is r.s I - (r s^T + s r^T) / 2.
    s = 2.0 * turned + child.mass * r
    xx, yy, zz = r[0] * s[0], r[1] * s[1], r[2] * s[2]
    xy, xz, yz = (0.5 * (r[i] * s[j] + r[j] * s[i]) for i, j in ((0, 1), (0, 2), (1, 2)))
    shift = _symmetric(yy + zz, xx + zz, xx + yy, -xy, -xz, -yz)
    return turned + child.mass * r, _rotate_symmetric(step.rotation, child.inertia) + shift


def _rotate_symmetric(rotation: Any, matrix: Any) -> Any:
    """Return ``rotation @ matrix @ rotation.T`` of a symmetric (3, 3) matrix: six entries computed, three copied."""
    half = ca.mtimes(rotation, matrix)

    def entry(i: int, j: int) -> Any:
        return ca.dot(half[i, :], rotation[j, :])

    return _symmetric(entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2))


def _symmetric(xx: Any, yy: Any, zz: Any, xy: Any, xz: Any, yz: Any) -> Any:
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def _square(omega: Any) -> Any:
    x, y, z = omega[0], omega[1], omega[2]
    xx, yy, zz = x * x, y * y, z * z
    return _symmetric(-(yy + zz), -(xx + zz), -(xx + yy), x * y, x * z, y * z)
