"""Inverse dynamics, mass matrix and momentum: recursive Newton-Euler and composite rigid bodies.

Centroidal momentum is [linear; angular] about the centre of mass, world axes.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from lgmpc.robot.symbolic.passes import Acceleration, Composite, Placement, Rotation
from lgmpc.robot.symbolic.tree import Joint, Tree

Wrench = tuple[Any, Any]
"""(force, moment about the joint's origin) in a joint's frame."""


def net_wrenches(
    tree: Tree, steps: list[Placement], accelerating: list[Acceleration], external: Mapping[int, Wrench]
) -> list[Wrench]:
    """Return the wrench that each joint transmits to its body; the first entry is the world's on all root joints.

    Luh, Walker and Paul (1980), with the rate of angular momentum of a body about its joint's origin as the integral of
    ``r x (a + B r) dm``, whose entries need only B and the constant second moments.

    Args:
        tree: the model.
        steps: placements of the joints in their parents.
        accelerating: accelerations of the bodies.
        external: by joint index, the external wrench on the body.
    """
    wrenches: list[Wrench] = [(ca.DM.zeros(3), ca.DM.zeros(3))]
    for index, (joint, motion) in enumerate(zip(tree.joints, accelerating[1:], strict=True), start=1):
        force = joint.mass * motion.linear + ca.mtimes(motion.field, joint.moment)
        moment = _moment_of_field(motion.field, joint.second_moment) + ca.cross(joint.moment, motion.linear)
        if index in external:
            force, moment = force - external[index][0], moment - external[index][1]
        wrenches.append((force, moment))
    for index in range(len(tree.joints), 0, -1):
        parent = tree.joints[index - 1].parent
        if parent:
            force, moment = carried(steps[index], wrenches[index])
            wrenches[parent] = (wrenches[parent][0] + force, wrenches[parent][1] + moment)
    return wrenches


def joint_torques(tree: Tree, wrenches: list[Wrench], a: Any) -> Any:
    """Return (nv,) the torques that transmit ``wrenches`` and accelerate the rotors by ``a`` (None for zero)."""
    torques = []
    for joint, wrench in zip(tree.joints, wrenches[1:], strict=True):
        torque = _project(joint, wrench)
        torques.append(torque if a is None else torque + ca.DM(joint.armature) * a[joint.v])
    return ca.vertcat(*torques)


def composite_forces(tree: Tree, gathered: list[Composite]) -> list[list[Wrench]]:
    """Return, for each joint, the momentum of its subtree per unit joint velocity: one wrench a degree of freedom."""
    forces: list[list[Wrench]] = [[]]
    for joint, body in zip(tree.joints, gathered[1:], strict=True):
        columns = []
        for k in range(joint.v.stop - joint.v.start):
            linear, angular = joint.linear[:, k], joint.angular[:, k]
            columns.append(
                (
                    body.mass * linear + ca.cross(angular, body.moment),
                    ca.cross(body.moment, linear) + ca.mtimes(body.inertia, angular),
                )
            )
        forces.append(columns)
    return forces


def mass_matrix(tree: Tree, steps: list[Placement], forces: list[list[Wrench]], like: Any) -> tuple[Any, list[Any]]:
    """Return (nv, nv) the mass matrix with armature, and by degree of freedom its momentum wrench at the root's origin.

    Composite rigid bodies (Walker and Orin 1982). Entries between branches are structurally zero.

    Args:
        tree: the model.
        steps: placements of the joints in their parents.
        forces: from :func:`composite_forces`.
        like: the configuration, whose CasADi type the matrix has.
    """
    matrix = type(like)(tree.nv, tree.nv)
    at_root: list[Any] = []
    for index, joint in enumerate(tree.joints, start=1):
        columns = forces[index]
        block = ca.horzcat(*(_project(joint, column) for column in columns)) + ca.diag(ca.DM(joint.armature))
        matrix[joint.v, joint.v] = ca.triu2symm(ca.triu(block))  # both halves are the same expressions
        here = index
        while tree.joints[here - 1].parent:
            columns = [carried(steps[here], column) for column in columns]
            here = tree.joints[here - 1].parent
            ancestor = tree.joints[here - 1]
            block = ca.horzcat(*(_project(ancestor, column) for column in columns))
            matrix[ancestor.v, joint.v] = block
            matrix[joint.v, ancestor.v] = block.T
        at_root += [(here, column) for column in columns]
    return matrix, at_root


def center_of_mass(tree: Tree, gathered: list[Composite], steps: list[Placement]) -> Any:
    """Return (3,) the centre of mass, world axes, m."""
    total = ca.DM.zeros(3)
    for root in tree.roots:
        body, step = gathered[root], steps[root]
        total = total + ca.mtimes(step.rotation, body.moment) + body.mass * step.translation
    return total / tree.mass


def root_momenta(tree: Tree, steps: list[Placement], turning: list[Rotation], moving: list[Any]) -> dict[int, Wrench]:
    """Return the momentum of each root's subtree, (linear, angular about its origin) in its frame."""
    momenta: list[Wrench] = [(ca.DM.zeros(3), ca.DM.zeros(3))]
    for joint, turn, linear in zip(tree.joints, turning[1:], moving[1:], strict=True):
        momenta.append(
            (
                joint.mass * linear + ca.cross(turn.omega, joint.moment),
                ca.mtimes(joint.inertia, turn.omega) + ca.cross(joint.moment, linear),
            )
        )
    for index in range(len(tree.joints), 0, -1):
        parent = tree.joints[index - 1].parent
        if parent:
            linear, angular = carried(steps[index], momenta[index])
            momenta[parent] = (momenta[parent][0] + linear, momenta[parent][1] + angular)
    return {root: momenta[root] for root in tree.roots}


def momentum_at_center(
    tree: Tree, gathered: list[Composite], steps: list[Placement], momenta: dict[int, Wrench]
) -> Any:
    """Return (6,) the sum of ``momenta`` (by root, about its origin, in its frame) about the centre of mass."""
    total = ca.DM.zeros(6)
    for root, momentum in momenta.items():
        total = total + _at_center(tree, gathered, steps, root, momentum)
    return total


def momentum_columns(
    tree: Tree, gathered: list[Composite], steps: list[Placement], at_root: list[tuple[int, Wrench]]
) -> Any:
    """Return (6, nv) the centroidal momentum matrix from the momentum of each degree of freedom at its root."""
    return ca.horzcat(*(_at_center(tree, gathered, steps, root, column) for root, column in at_root))


def _at_center(tree: Tree, gathered: list[Composite], steps: list[Placement], root: int, momentum: Wrench) -> Any:
    step, body = steps[root], gathered[root]
    if len(tree.roots) == 1:  # Shift in the root's frame: exact far from the world's origin, and fewer operations.
        linear = ca.mtimes(step.rotation, momentum[0])
        angular = ca.mtimes(step.rotation, momentum[1] - ca.cross(body.moment / tree.mass, momentum[0]))
        return ca.vertcat(linear, angular)
    arm = step.translation - center_of_mass(tree, gathered, steps)
    linear = ca.mtimes(step.rotation, momentum[0])
    return ca.vertcat(linear, ca.mtimes(step.rotation, momentum[1]) + ca.cross(arm, linear))


def _moment_of_field(field: Any, second: Any) -> Any:
    """Return (3,) the integral of ``r x (field r) dm`` over a body with second moments ``second`` (symmetric)."""

    def pair(i: int, j: int) -> Any:
        return ca.dot(field[i, :].T, second[:, j])

    return ca.vertcat(pair(2, 1) - pair(1, 2), pair(0, 2) - pair(2, 0), pair(1, 0) - pair(0, 1))


def carried(step: Placement, wrench: Wrench) -> Wrench:
    """Return ``wrench`` about the parent's origin, in the parent's frame."""
    force = ca.mtimes(step.rotation, wrench[0])
    return force, ca.mtimes(step.rotation, wrench[1]) + ca.cross(step.translation, force)


def _project(joint: Joint, wrench: Wrench) -> Any:
    return ca.mtimes(joint.linear.T, wrench[0]) + ca.mtimes(joint.angular.T, wrench[1])
