"""Forward dynamics: the articulated-body algorithm (Featherstone 1983), in classical accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.robot.symbolic.dynamics import Wrench, carried, mirrored, moment_of_field
from lgmpc.robot.symbolic.passes import Placement, Rotation, rotate_symmetric
from lgmpc.robot.symbolic.tree import Tree

__all__ = ["articulated_body"]


@dataclass(frozen=True)
class _Inertia:
    """A symmetric map from (linear, angular) acceleration to (force, moment), in (3, 3) blocks.

    Attributes:
        mass: symmetric.
        cross: force per angular acceleration.
        inertia: symmetric.
    """

    mass: Any
    cross: Any
    inertia: Any

    def __add__(self, other: _Inertia) -> _Inertia:
        return _Inertia(self.mass + other.mass, self.cross + other.cross, self.inertia + other.inertia)

    def apply(self, linear: Any, angular: Any) -> Wrench:
        return (
            ca.mtimes(self.mass, linear) + ca.mtimes(self.cross, angular),
            ca.mtimes(self.cross.T, linear) + ca.mtimes(self.inertia, angular),
        )

    def without(self, force: Any, moment: Any, pivot: _Pivot) -> _Inertia:
        """Return the inertia without the joint's direction of motion: minus ``U D^-1 U^T`` with U = (force, moment)."""
        over_force, over_moment = pivot.solve(force.T), pivot.solve(moment.T)
        return _Inertia(
            mirrored(self.mass - ca.mtimes(force, over_force)),
            self.cross - ca.mtimes(force, over_moment),
            mirrored(self.inertia - ca.mtimes(moment, over_moment)),
        )

    def carried(self, step: Placement) -> _Inertia:
        """Return the same map about the parent's origin, in the parent's frame."""
        mass = rotate_symmetric(step.rotation, self.mass)
        cross = ca.mtimes(ca.mtimes(step.rotation, self.cross), step.rotation.T)
        arm = ca.skew(step.translation)
        moved = cross - ca.mtimes(mass, arm)
        inertia = rotate_symmetric(step.rotation, self.inertia) + ca.mtimes(arm, moved) + ca.mtimes(arm, cross).T
        return _Inertia(mass, moved, mirrored(inertia))


class _Pivot:
    """The inverse of a joint's own inertia D, as a factor: a number for one degree of freedom, else L D L^T."""

    def __init__(self, matrix: Any) -> None:
        self._reciprocal = 1.0 / matrix if matrix.is_scalar() else None
        self._factor = () if matrix.is_scalar() else ca.ldl(matrix, False)

    def solve(self, right: Any) -> Any:
        return self._reciprocal * right if self._reciprocal is not None else ca.ldl_solve(right, *self._factor)


@dataclass(frozen=True)
class _Solved:
    """The backward pass's results for a joint: U = (force, moment), D, and tau - S^T p."""

    force: Any
    moment: Any
    pivot: _Pivot
    torque: Any


def articulated_body(
    tree: Tree, steps: list[Placement], turning: list[Rotation], v: Any, tau: Any, external: Mapping[int, Wrench]
) -> Any:
    """Return (nv,) the joint accelerations under torques ``tau`` and external wrenches (by joint, in its frame)."""
    inertias = [_Inertia(None, None, None)]
    biases: list[Wrench] = [(None, None)]
    velocity_terms: list[Wrench] = [(None, None)]
    for index, (joint, step) in enumerate(zip(tree.joints, steps[1:], strict=True), start=1):
        turn = turning[index]
        force, moment = ca.mtimes(turn.square, joint.moment), moment_of_field(turn.square, joint.second_moment)
        if index in external:
            force, moment = force - external[index][0], moment - external[index][1]
        biases.append((force, moment))
        inertias.append(_Inertia(joint.mass * ca.DM.eye(3), -ca.skew(joint.moment), joint.inertia))
        slide = ca.mtimes(joint.linear, v[joint.v])
        swept = ca.mtimes(step.rotation.T, ca.mtimes(turning[joint.parent].square, step.translation))
        velocity_terms.append(
            (
                swept + ca.cross(turn.relative + 2.0 * turn.carried, slide),
                ca.cross(turn.carried, turn.relative),
            )
        )

    solved: list[_Solved] = []
    for index in range(len(tree.joints), 0, -1):
        joint, step, inertia = tree.joints[index - 1], steps[index], inertias[index]
        (force, moment), (c_linear, c_angular) = biases[index], velocity_terms[index]
        u_force = ca.mtimes(inertia.mass, joint.linear) + ca.mtimes(inertia.cross, joint.angular)
        u_moment = ca.mtimes(inertia.cross.T, joint.linear) + ca.mtimes(inertia.inertia, joint.angular)
        block = ca.mtimes(joint.linear.T, u_force) + ca.mtimes(joint.angular.T, u_moment)
        pivot = _Pivot(block + ca.diag(ca.DM(joint.armature)))
        torque = tau[joint.v] - ca.mtimes(joint.linear.T, force) - ca.mtimes(joint.angular.T, moment)
        solved.append(_Solved(u_force, u_moment, pivot, torque))
        if joint.parent:
            rest = inertia.without(u_force, u_moment, pivot)
            given = pivot.solve(torque)
            extra = rest.apply(c_linear, c_angular)
            force = force + extra[0] + ca.mtimes(u_force, given)
            moment = moment + extra[1] + ca.mtimes(u_moment, given)
            inertias[joint.parent] += rest.carried(step)
            force, moment = carried(step, (force, moment))
            biases[joint.parent] = (biases[joint.parent][0] + force, biases[joint.parent][1] + moment)
    solved.reverse()

    moving: list[Wrench] = [(-tree.gravity, ca.DM.zeros(3))]
    accelerations = []
    for joint, step, kept, terms in zip(tree.joints, steps[1:], solved, velocity_terms[1:], strict=True):
        linear, angular = moving[joint.parent]
        linear = ca.mtimes(step.rotation.T, linear + ca.cross(angular, step.translation)) + terms[0]
        angular = ca.mtimes(step.rotation.T, angular) + terms[1]
        load = ca.mtimes(kept.force.T, linear) + ca.mtimes(kept.moment.T, angular)
        own = kept.pivot.solve(kept.torque - load)
        accelerations.append(own)
        moving.append((linear + ca.mtimes(joint.linear, own), angular + ca.mtimes(joint.angular, own)))
    return ca.vertcat(*accelerations)
