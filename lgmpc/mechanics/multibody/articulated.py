"""A tree of rigid bodies on SE(3) x T^n, as expressions: placements, body velocities, kinetic and potential energy.

Only the constants of Pinocchio's models are used, none of its algorithms, so that the equations derived from the
energies (:mod:`lgmpc.mechanics.multibody.floating_base`) are an independent check of these.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.errors import ModelError
from lgmpc.lie.symbolic import se3, so3
from lgmpc.typing import Array

__all__ = ["ArticulatedBody", "Kinematics", "Link"]

_TURNS, _SLIDES = "JointModelR", "JointModelP"


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body and its joint to the parent, of one degree of freedom.

    Attributes:
        parent: index of the body before it; -1 is the world, or the free base's own frame.
        placement: (4, 4) of the joint in the parent's frame.
        axis: (3,) unit axis in the joint's frame.
        slides: whether the joint is prismatic rather than revolute.
        inertia: (6, 6) spatial inertia in the joint's frame, linear first.
        armature: inertia of its rotor, reflected to the joint, kg.m2 (kg).
    """

    parent: int
    placement: Array
    axis: Array
    slides: bool
    inertia: Array
    armature: float

    @property
    def twist(self) -> Array:
        """(6,) the joint's motion per unit of speed, in its own frame."""
        zero = np.zeros(3)
        return np.concatenate([self.axis, zero] if self.slides else [zero, self.axis])

    def moved(self, position: Any) -> Any:
        """Return (4, 4) the placement in the parent's frame at a joint position, rad (m)."""
        turn, shift = np.eye(3), np.zeros(3)
        if self.slides:
            shift = self.axis * position
        else:
            hat = so3.hat(ca.DM(self.axis))
            turn = np.eye(3) + ca.sin(position) * hat + (1 - ca.cos(position)) * (hat @ hat)
        moved = ca.vertcat(ca.horzcat(turn, shift), ca.DM([[0, 0, 0, 1]]))
        return ca.DM(self.placement) @ moved


@dataclass(frozen=True)
class Kinematics:
    """Expressions of the placements and velocities of all bodies.

    Attributes:
        placements: (4, 4) each, world from body; the free base first if there is one.
        twists: (6,) each, body velocity ``g^-1 g'`` (chapter 4.2.1).
    """

    placements: tuple[Any, ...]
    twists: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class ArticulatedBody:
    """The constants of a tree of rigid bodies.

    Attributes:
        name: of the robot.
        base_inertia: (6, 6) of the free base; none if the base is fixed.
        links: the other bodies, parents before children.
        gravity: (3,) world axes, m/s2.
    """

    name: str
    base_inertia: Array | None
    links: tuple[Link, ...]
    gravity: Array

    @classmethod
    def from_model(cls, model: pin.Model) -> ArticulatedBody:
        """Return the tree of a Pinocchio model: an optional free-flyer first, then revolute and prismatic joints.

        Raises:
            ModelError: another kind of joint; all are listed.
        """
        floating = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
        first = 2 if floating else 1
        links, problems = [], []
        for j in range(first, model.njoints):
            kind = model.joints[j].shortname()
            if model.joints[j].nq != 1 or not kind.startswith((_TURNS, _SLIDES)):
                problems.append(
                    f"joint '{model.names[j]}' is a {kind}; expected one that turns or slides by one number"
                )
                continue
            subspace = np.asarray(model.joints[j].createData().S).reshape(6)
            slides = bool(np.any(subspace[:3]))
            links.append(
                Link(
                    parent=int(model.parents[j]) - first,
                    placement=np.array(model.jointPlacements[j].homogeneous),
                    axis=subspace[:3] if slides else subspace[3:],
                    slides=slides,
                    inertia=np.array(model.inertias[j].matrix()),
                    armature=float(model.armature[model.joints[j].idx_v]),
                )
            )
        if problems:
            raise ModelError(model.name, problems)
        base = np.array(model.inertias[1].matrix()) if floating else None
        return cls(model.name, base, tuple(links), np.array(model.gravity.linear))

    @property
    def floating(self) -> bool:
        """True for a free base."""
        return self.base_inertia is not None

    @property
    def nv(self) -> int:
        """Number of velocities: six of a free base, one a joint."""
        return 6 * self.floating + len(self.links)

    @cached_property
    def inertias(self) -> tuple[Array, ...]:
        """(6, 6) of every body, in the order of :class:`Kinematics`."""
        links = tuple(link.inertia for link in self.links)
        return links if self.base_inertia is None else (self.base_inertia, *links)

    def kinematics(self, pose: Any, joints: Any, velocity: Any) -> Kinematics:
        """Return the placements and velocities of the bodies.

        The body velocity of a child is its parent's, in the child's frame, plus the joint's:
        ``xi_i = Ad(T_i^-1) xi_parent + S_i q'_i`` (chapter 4.9; Featherstone 2008, 4.3).

        Args:
            pose: (4, 4) of the base.
            joints: (n,) joint positions.
            velocity: (nv,) [body twist of a free base; joint speeds].
        """
        placements, twists = [pose], [velocity[:6] if self.floating else ca.SX.zeros(6)]
        rates = velocity[6:] if self.floating else velocity
        for i, link in enumerate(self.links):
            step, before = link.moved(joints[i]), link.parent + 1
            placements.append(placements[before] @ step)
            twists.append(se3.adjoint(se3.inverse(step)) @ twists[before] + ca.DM(link.twist) * rates[i])
        skip = 0 if self.floating else 1
        return Kinematics(tuple(placements[skip:]), tuple(twists[skip:]))

    def kinetic_energy(self, pose: Any, joints: Any, velocity: Any) -> Any:
        """Return the kinetic energy, J, rotors included: left-invariant, so independent of the pose (chapter 4.2.4)."""
        twists = self.kinematics(pose, joints, velocity).twists
        bodies = sum(ca.dot(xi, ca.DM(inertia) @ xi) for xi, inertia in zip(twists, self.inertias, strict=True))
        rates = velocity[6:] if self.floating else velocity
        rotors = sum(link.armature * rates[i] ** 2 for i, link in enumerate(self.links))
        return 0.5 * (bodies + rotors)

    def potential_energy(self, pose: Any, joints: Any) -> Any:
        """Return the potential energy of gravity, J, zero with all centres of mass at the world's origin."""
        placements = self.kinematics(pose, joints, ca.SX.zeros(self.nv)).placements
        total = 0
        for placement, inertia in zip(placements, self.inertias, strict=True):
            # A spatial inertia contains the mass, and mass times the centre's position as a cross product.
            mass, moment = inertia[0, 0], np.array([inertia[5, 1], inertia[3, 2], inertia[4, 0]])
            total -= ca.dot(ca.DM(self.gravity), mass * placement[:3, 3] + placement[:3, :3] @ ca.DM(moment))
        return total
