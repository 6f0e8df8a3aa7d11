"""Robots: a ``pin.Model`` with contact frames, actuator limits and a reference posture."""

import fnmatch
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, ModelError
from lgmpc.robot.collision import (
    Box,
    Capsule,
    CollisionShape,
    LinkPairs,
    ModelSource,
    Sphere,
    is_moving_link,
    placement_of,
    read_geometry,
    shape_of,
)
from lgmpc.robot.feet import UP
from lgmpc.robot.names import degree_names, frame_index, is_floating
from lgmpc.robot.native_stderr import native_stderr
from lgmpc.robot.soles import Foot, FootPoints
from lgmpc.support import support_margin
from lgmpc.typing import Array

if TYPE_CHECKING:
    from lgmpc.robot.symbolic import SymbolicModel

_SHORT_SUPPORT = 0.25
"""Distance of the centre of mass from the edge of the support, as a share of its height: 0.5 of quadrupeds, 0.1 of
humanoids."""


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A complete and checked robot model, returned by :func:`lgmpc.robot.load_robot`.

    The arrays are read-only. ``model`` has the same armature, effort, velocity and position limits; do not change it.
    All degrees of freedom but the floating base's are actuated.

    Attributes:
        name: name in example-robot-data, or the URDF's.
        model: Pinocchio model; joint 1 is the free-flyer if the base floats.
        contact_frames: (nc,) names of the frames that touch the ground: of point feet and of the corners of soles.
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
        joint_friction: (nu,) identified Coulomb friction of the joints, N.m (N).
        source: the model's files.
        notes: unusual properties found by the checks.
        soles: the feet with soles, in the order of their points; none of a robot on point feet.
        given_shapes: collision shapes besides the feet; None for the URDF's collision geometry.
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
    joint_friction: Array
    source: ModelSource
    notes: tuple[str, ...] = ()
    soles: tuple[Foot, ...] = ()
    given_shapes: tuple[Sphere | Box | Capsule, ...] | None = None

    def __post_init__(self) -> None:
        limits = ("effort_limit", "velocity_limit", "joint_lower", "joint_upper")
        for name in ("q_reference", *limits, "armature", "joint_friction"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def structural_state(self) -> dict[str, Any]:
        """Return the attributes that expressions depend on (see :mod:`lgmpc.compile`): no files, no shapes."""
        others = ("source", "notes", "given_shapes")
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in others}

    def __repr__(self) -> str:
        base = "free" if self.floating_base else "fixed"
        feet = ", ".join(self.foot_names) or "no contact frames"
        return f"<Robot {self.name}: {self.mass:.3f} kg, {base} base, {self.nu} joints, {feet}>"

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone, to be pickled: what is computed from them is computed again."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def create_data(self) -> pin.Data:
        """Return a new workspace for Pinocchio's algorithms on ``model``."""
        return self.model.createData()

    @cached_property
    def symbolic(self) -> "SymbolicModel":
        """The rigid-body algorithms of this robot as CasADi expressions."""
        from lgmpc.robot.symbolic import SymbolicModel

        return SymbolicModel(self.model)

    @cached_property
    def collision_shapes(self) -> tuple[CollisionShape, ...]:
        """The collision shapes besides the feet; read from the URDF's collision geometry unless given.

        Cylinders of the URDF become capsules of the same length if they are longer than wide, spheres stay spheres, and
        all else is enclosed in boxes. Bodies with a contact frame have none: their contact points represent them.

        Raises:
            ModelError: a mesh of the collision geometry cannot be read, or a radius is below 0.1 mm or above 100 m.
        """
        if self.given_shapes is None:
            return tuple(self._urdf_shapes())
        found = []
        for i, shape in enumerate(self.given_shapes):
            local = placement_of(shape)
            found += [
                CollisionShape(f"{shape.kind} {i} {frame.name}", int(frame.parentJoint), frame.placement * local, shape)
                for frame in self.model.frames
                if is_moving_link(frame) and fnmatch.fnmatchcase(frame.name, shape.link)
            ]
        return tuple(found)

    @cached_property
    def link_pairs(self) -> LinkPairs:
        """The pairs of links that can touch; none if the URDF's collision geometry cannot be read."""
        try:
            with native_stderr():
                geometry = read_geometry(self.model, self.source)
        except ValueError:
            geometry = pin.GeometryModel()
        return LinkPairs(self.model, geometry, self.q_reference)

    def _urdf_shapes(self) -> Iterator[CollisionShape]:
        feet = {int(self.model.frames[index].parentJoint) for index in self.contact_ids}
        try:
            with native_stderr():  # the parser's messages are notes of the robot
                geometry = read_geometry(self.model, self.source)
        except ValueError as error:
            reason = f"its collision geometry cannot be read ({' '.join(str(error).split())}): give collision_shapes"
            raise ModelError(self.name, [reason]) from error
        for part in geometry.geometryObjects:
            if part.parentJoint > 0 and part.parentJoint not in feet:
                try:
                    shape = shape_of(part)
                except InputError as error:
                    reason = f"its collision geometry '{part.name}': {error}: give collision_shapes"
                    raise ModelError(self.name, [reason]) from error
                yield shape

    @cached_property
    def nq(self) -> int:
        """Size of the configuration."""
        return int(self.model.nq)

    @cached_property
    def nv(self) -> int:
        """Size of the velocity."""
        return int(self.model.nv)

    @cached_property
    def nu(self) -> int:
        """Number of actuated degrees of freedom."""
        return self.nv - int(self.joint_v.start)

    @property
    def nc(self) -> int:
        """Number of contact points."""
        return len(self.contact_frames)

    @property
    def nf(self) -> int:
        """Number of feet."""
        return len(self.feet)

    @cached_property
    def feet(self) -> tuple[Foot, ...]:
        """The (nf,) feet: soles, or points at the contact frames."""
        return self.soles or tuple(map(Foot.point, self.contact_frames))

    @cached_property
    def foot_names(self) -> tuple[str, ...]:
        """(nf,) names of the frames that the feet are fixed to."""
        return tuple(foot.frame for foot in self.feet)

    @cached_property
    def foot_ids(self) -> tuple[int, ...]:
        """(nf,) indices of the frames at the feet's centres."""
        return tuple(int(self.model.getFrameId(foot.centre)) for foot in self.feet)

    @cached_property
    def foot_points(self) -> FootPoints:
        """Assignment of the nc contact points to the nf feet."""
        data = self.create_data()
        pin.framesForwardKinematics(self.model, data, self.q_reference)
        turn = data.oMi[1].rotation if self.floating_base else np.eye(3)
        counts = tuple(len(foot.points) for foot in self.feet)
        centres = np.repeat([data.oMf[frame].translation for frame in self.foot_ids], counts, axis=0)
        points = np.array([data.oMf[frame].translation for frame in self.contact_ids])
        return FootPoints(counts, (points - centres).reshape(-1, 3) @ turn, self.contact_radius)

    @cached_property
    def short_support(self) -> bool:
        """Whether the support is short against the height, as a humanoid's is on its soles.

        Then forces at the edges of the support turn the robot before they stop it, as those of two feet of a quadruped
        that trots: attitude and centre of mass compete for them.
        """
        data = self.create_data()
        pin.framesForwardKinematics(self.model, data, self.q_reference)
        com = pin.centerOfMass(self.model, data, self.q_reference)
        points = np.array([data.oMf[frame].translation[:2] for frame in self.contact_ids]).reshape(1, -1, 2)
        margin = support_margin(points, np.ones(points.shape[:2], dtype=np.bool_), com[None, :2])
        return not margin[0] >= _SHORT_SUPPORT * com[2]  # nor is there one without feet

    @cached_property
    def floating_base(self) -> bool:
        """Whether the first joint is a free-flyer."""
        return is_floating(self.model)

    @cached_property
    def joint_q(self) -> slice:
        """The actuated joints' entries of the configuration."""
        return slice(7 if self.floating_base else 0, self.nq)

    @cached_property
    def joint_v(self) -> slice:
        """The actuated joints' entries of the velocity."""
        return slice(6 if self.floating_base else 0, int(self.model.nv))

    @cached_property
    def mass(self) -> float:
        """Mass of all moving bodies, kg."""
        return float(pin.computeTotalMass(self.model))

    @cached_property
    def gravity(self) -> Array:
        """(3,) gravity, world axes, m/s2."""
        gravity = np.array(self.model.gravity.linear)
        gravity.flags.writeable = False
        return gravity

    @cached_property
    def weight(self) -> float:
        """Weight of all moving bodies, N."""
        return self.mass * float(np.linalg.norm(self.gravity))

    @cached_property
    def up(self) -> Array:
        """(3,) direction against gravity, world axes; z without gravity."""
        size = float(np.linalg.norm(self.gravity))
        up: Array = (0.0 - self.gravity) / size if size > 0.0 else np.array(UP)
        up.flags.writeable = False
        return up

    @cached_property
    def upright_axis(self) -> Array:
        """(3,) axis of the base that is vertical in the reference posture; z of a fixed base."""
        turned = self.floating_base
        axis = np.array(pin.Quaternion(self.q_reference[3:7]).matrix()[2]) if turned else np.array([0.0, 0.0, 1.0])
        axis.flags.writeable = False
        return axis

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
        if not isinstance(name, str) or name not in self.body_names:
            raise InputError("body", name, f"a moving link of {self.name}", self.body_names)
        return int(self.model.getFrameId(name, pin.BODY))

    def frame(self, name: str, key: str = "frame") -> int:
        """Return the index of frame ``name``.

        Args:
            name: name of the frame.
            key: name of the argument in errors.

        Raises:
            InputError: there is no such frame; the nearest are named.
        """
        return frame_index(self.model, name, key)
