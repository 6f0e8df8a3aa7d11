"""The robot that every room works with: a ``pin.Model`` with contact frames, actuator limits and a posture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot.collision import Box, Capsule, CollisionShape, Sphere, shapes_of
from lgmpc.robot.names import degree_names, frame_index, is_floating
from lgmpc.typing import Array

if TYPE_CHECKING:
    from lgmpc.robot.symbolic import SymbolicModel

__all__ = ["ModelSource", "Robot"]


@dataclass(frozen=True)
class ModelSource:
    """Where a model came from, for whoever needs its meshes.

    Attributes:
        urdf: the URDF file.
        srdf: the SRDF file, if there is one.
        package_dirs: folders in which ``package://`` addresses are looked up.
    """

    urdf: Path
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot model, complete and checked; made by :func:`lgmpc.robot.load_robot`.

    The arrays are read-only. ``model`` holds the same armature, effort, velocity and position limits; treat it as
    read-only too. "Actuated" are all degrees of freedom but the floating base's.

    Attributes:
        name: name in example-robot-data, or the URDF's.
        model: Pinocchio model; joint 1 is the free-flyer if the base floats.
        contact_frames: (nc,) names of the frames that touch the ground.
        contact_ids: (nc,) their frame indices in ``model``.
        contact_radius: radius of the spherical feet, m; 0 for point feet. A contact point is its frame's origin minus
            ``contact_radius`` times the world's z axis.
        q_reference: (nq,) reference posture; with contact frames, the base is so high that the lowest contact point
            touches z = 0, and level if the contact points lie in one plane.
        effort_limit: (nu,) largest actuator torque, N.m (N for prismatic joints).
        velocity_limit: (nu,) largest joint speed, rad/s (m/s).
        joint_lower: (nu,) lowest joint position, rad (m); -inf where a joint has none (continuous, spherical).
        joint_upper: (nu,) highest joint position; inf where a joint has none.
        armature: (nu,) reflected rotor inertia, kg.m2 (kg).
        source: the files the model came from.
        notes: what the checks found worth knowing but not wrong.
        given_shapes: what besides the feet touches the floor; None for the URDF's collision geometry.
    """

    name: str
    model: pin.Model
    contact_frames: tuple[str, ...]
    contact_ids: tuple[int, ...]
    contact_radius: float
    q_reference: Array
    effort_limit: Array
    velocity_limit: Array
    joint_lower: Array
    joint_upper: Array
    armature: Array
    source: ModelSource
    notes: tuple[str, ...] = ()
    given_shapes: tuple[Sphere | Box | Capsule, ...] | None = None

    def __post_init__(self) -> None:
        for name in ("q_reference", "effort_limit", "velocity_limit", "joint_lower", "joint_upper", "armature"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def create_data(self) -> pin.Data:
        """Return a new workspace for Pinocchio's algorithms on ``model``."""
        return self.model.createData()

    @cached_property
    def symbolic(self) -> SymbolicModel:
        """The rigid-body algorithms of this robot as CasADi expressions."""
        from lgmpc.robot.symbolic import SymbolicModel

        return SymbolicModel(self.model)

    @cached_property
    def collision_shapes(self) -> tuple[CollisionShape, ...]:
        """What besides the feet touches the floor; read from the URDF's collision geometry unless it was given.

        Raises:
            ModelError: a mesh of the collision geometry cannot be read.
        """
        return shapes_of(self)

    @property
    def nq(self) -> int:
        """Size of the configuration."""
        return int(self.model.nq)

    @property
    def nv(self) -> int:
        """Size of the velocity."""
        return int(self.model.nv)

    @property
    def nu(self) -> int:
        """Number of actuated degrees of freedom."""
        return self.nv - int(self.joint_v.start)

    @property
    def nc(self) -> int:
        """Number of contact frames."""
        return len(self.contact_frames)

    @cached_property
    def floating_base(self) -> bool:
        """Whether the first joint is a free-flyer."""
        return is_floating(self.model)

    @property
    def joint_q(self) -> slice:
        """The actuated joints' entries of the configuration."""
        return slice(7 if self.floating_base else 0, self.nq)

    @property
    def joint_v(self) -> slice:
        """The actuated joints' entries of the velocity."""
        return slice(6 if self.floating_base else 0, int(self.model.nv))

    @cached_property
    def mass(self) -> float:
        """Mass of everything that moves, kg."""
        return float(pin.computeTotalMass(self.model))

    @cached_property
    def gravity(self) -> Array:
        """(3,) gravity, world axes, m/s2."""
        gravity = np.array(self.model.gravity.linear)
        gravity.flags.writeable = False
        return gravity

    @cached_property
    def x_reference(self) -> Array:
        """(nq + nv,) reference posture at rest."""
        x = np.concatenate([self.q_reference, np.zeros(self.nv)])
        x.flags.writeable = False
        return x

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """(nu,) names of the actuated degrees of freedom, in the order of the torques."""
        return degree_names(self.model)[self.joint_v]

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names of the URDF's links that move: the bodies that can be pushed."""
        return tuple(f.name for f in self.model.frames if f.type == pin.BODY and f.parentJoint > 0)

    def body_frame(self, name: str) -> int:
        """Return the index of the frame of link ``name``.

        Its ``parentJoint`` is the rigid body that the link is part of, and ``model.inertias[parentJoint].lever`` that
        body's centre of mass in the joint's frame.

        Raises:
            InputError: no moving link has this name; the nearest are named.
        """
        if name not in self.body_names:
            raise InputError("body", name, f"a moving link of {self.name}", self.body_names)
        return int(self.model.getFrameId(name, pin.BODY))

    def frame(self, name: str, key: str = "frame") -> int:
        """Return the index of frame ``name``.

        Args:
            name: of the frame.
            key: what an error calls the argument.

        Raises:
            InputError: there is no such frame; the nearest are named.
        """
        return frame_index(self.model, name, key)
