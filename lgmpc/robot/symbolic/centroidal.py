"""Centre of mass and centroidal momentum: [linear; angular] about the centre of mass, world axes."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.robot.symbolic.dynamics import Wrench, carried
from lgmpc.robot.symbolic.passes import Composite, Placement, Rotation
from lgmpc.robot.symbolic.tree import Tree

__all__ = ["center_of_mass", "momentum_at_center", "momentum_columns", "root_momenta"]


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
