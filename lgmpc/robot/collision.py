"""Collision shapes of a robot, besides its feet: spheres, boxes and capsules fixed to its links."""

import fnmatch
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, Union

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.errors import InputError, ModelError, nearest
from lgmpc.robot.names import frame_index
from lgmpc.robot.native_stderr import native_stderr
from lgmpc.settings import Positive, Settings, Vector3, key

if TYPE_CHECKING:
    from lgmpc.robot.model import ModelSource, Robot

Size = Annotated[Positive, Field(ge=1e-4, le=100.0)]
"""m."""


class _Shape(Settings):
    """A shape fixed to links."""

    link: str = Field(min_length=1, description="Link to which it is fixed; a glob pattern adds one to each match.")
    center_m: Vector3 = key((0.0, 0.0, 0.0), "[x, y, z] of its centre in the link's frame, m.")


class Sphere(_Shape):
    """A sphere."""

    kind: Literal["sphere"] = key("sphere", "A sphere.")
    radius_m: Size = Field(description="Radius, m.")


class _Turned(_Shape):
    rpy_deg: Vector3 = key((0.0, 0.0, 0.0), "[roll, pitch, yaw] of its axes in the link's frame, degrees.")


class Box(_Turned):
    """A cuboid."""

    kind: Literal["box"] = key("box", "A cuboid.")
    half_size_m: tuple[Size, Size, Size] = Field(description="Half of its size along each of its axes, m.")


class Capsule(_Turned):
    """A cylinder along its z axis with hemispherical ends."""

    kind: Literal["capsule"] = key("capsule", "A cylinder along its z axis with hemispherical ends.")
    radius_m: Size = Field(description="Radius, m.")
    half_length_m: Size = Field(description="Half of the cylinder's length, m.")


AnyShape = Annotated[Union[Sphere, Box, Capsule], Field(discriminator="kind")]  # noqa: UP007


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A shape on a moving body.

    Attributes:
        name: for messages and engines; unique within a robot.
        joint: index of the joint that moves it.
        placement: of its axes in that joint's frame, m.
        shape: its geometry; the shape's own link and placement are not used.
    """

    name: str
    joint: int
    placement: pin.SE3
    shape: Sphere | Box | Capsule

    @property
    def corners(self) -> tuple[tuple[pin.SE3, float], ...]:
        """Spheres whose convex hull is the shape: placements in the joint's frame, and radii, m."""
        shape = self.shape
        if isinstance(shape, Sphere):
            return ((self.placement, shape.radius_m),)
        if isinstance(shape, Capsule):
            offsets, radius = [np.array([0.0, 0.0, side * shape.half_length_m]) for side in (-1.0, 1.0)], shape.radius_m
        else:
            signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij")).reshape(3, -1).T
            offsets, radius = list(signs * np.array(shape.half_size_m)), 0.0
        return tuple((self.placement * pin.SE3(np.eye(3), offset), radius) for offset in offsets)


def check_shapes(model: pin.Model, shapes: tuple[Sphere | Box | Capsule, ...] | None) -> list[str]:
    """Return a problem for each shape on a link that the model lacks."""
    links = [frame.name for frame in model.frames if _is_moving_link(frame)]
    return [
        f"collision_shapes.{i}.link: '{shape.link}' matches no moving link; there are "
        f"{', '.join(nearest(shape.link, links) or tuple(links))}"
        for i, shape in enumerate(shapes or ())
        if not fnmatch.filter(links, shape.link)
    ]


def shapes_of(robot: "Robot") -> tuple[CollisionShape, ...]:
    """Return the robot's given shapes or, if there are none, those of its URDF's collision geometry.

    Cylinders of the URDF become capsules of the same length if they are longer than wide, spheres stay spheres, and all
    else is enclosed in boxes. Bodies with a contact frame have none: their contact points represent them.

    Raises:
        ModelError: a mesh of the collision geometry cannot be read, or a radius is below 0.1 mm or above 100 m.
    """
    if robot.given_shapes is None:
        return tuple(_shapes_of_urdf(robot))
    found = []
    for i, shape in enumerate(robot.given_shapes):
        local = _local(shape)
        found += [
            CollisionShape(f"{shape.kind} {i} {frame.name}", int(frame.parentJoint), frame.placement * local, shape)
            for frame in robot.model.frames
            if _is_moving_link(frame) and fnmatch.fnmatchcase(frame.name, shape.link)
        ]
    return tuple(found)


def place_shape(model: pin.Model, shape: Sphere | Box | Capsule) -> CollisionShape:
    """Return a shape on the frame that its ``link`` names; ``universe`` is the world.

    Raises:
        InputError: no such frame; names the nearest.
    """
    if not isinstance(shape, (Sphere, Box, Capsule)):
        raise InputError("shape", type(shape).__name__, "a Sphere, Box or Capsule")
    if not isinstance(model, pin.Model):
        raise InputError("model", type(model).__name__, "a pin.Model")
    frame = model.frames[frame_index(model, shape.link)]
    return CollisionShape(
        f"{shape.kind} on {shape.link}", int(frame.parentJoint), frame.placement * _local(shape), shape
    )


_MESHES = coal.CachedMeshLoader(coal.NODE_TYPE.BV_OBBRSS)  # reads a file again only after it was changed


def read_collision_geometry(model: pin.Model, source: "ModelSource") -> pin.GeometryModel:
    """Return the collision geometry of a URDF; its meshes are read once a process.

    Raises:
        ValueError: a mesh cannot be read, or the geometry does not fit ``model``.
    """
    folders = [str(folder) for folder in source.package_dirs]
    kind, meshes = pin.GeometryType.COLLISION, _MESHES
    return pin.buildGeomFromUrdf(model, str(source.urdf), kind, package_dirs=folders, mesh_loader=meshes)


def shape_of(part: pin.GeometryObject) -> CollisionShape:
    """Return the shape of an object of a geometry model: spheres and capsules as they are, all else enclosed.

    Cylinders become capsules of the same length if they are longer than wide, other objects boxes.
    """
    centre, shape = _enclosed(part.geometry)
    return CollisionShape(
        f"{shape.kind} {part.name}", int(part.parentJoint), part.placement * pin.SE3(np.eye(3), centre), shape
    )


def _local(shape: Sphere | Box | Capsule) -> pin.SE3:
    turn = np.eye(3) if isinstance(shape, Sphere) else pin.rpy.rpyToMatrix(*np.radians(shape.rpy_deg))
    return pin.SE3(turn, np.array(shape.center_m))


def _is_moving_link(frame: pin.Frame) -> bool:
    return bool(frame.type == pin.FrameType.BODY and frame.parentJoint > 0)


def _shapes_of_urdf(robot: "Robot") -> Iterator[CollisionShape]:
    feet = {int(robot.model.frames[index].parentJoint) for index in robot.contact_ids}
    try:
        with native_stderr():  # the parser's messages are notes of the robot
            geometry = read_collision_geometry(robot.model, robot.source)
    except ValueError as error:
        reason = f"its collision geometry cannot be read ({' '.join(str(error).split())}): give collision_shapes"
        raise ModelError(robot.name, [reason]) from error
    for part in geometry.geometryObjects:
        if part.parentJoint > 0 and part.parentJoint not in feet:
            try:
                shape = shape_of(part)
            except InputError as error:
                reason = f"its collision geometry '{part.name}': {error}: give collision_shapes"
                raise ModelError(robot.name, [reason]) from error
            yield shape


def _enclosed(geometry: coal.CollisionGeometry) -> tuple[np.ndarray, Sphere | Box | Capsule]:
    """Return the centre of a geometry in its own axes, and the shape that encloses it."""
    if isinstance(geometry, coal.Sphere):
        return np.zeros(3), Sphere(link="*", radius_m=geometry.radius)
    if isinstance(geometry, (coal.Cylinder, coal.Capsule)):
        ends = geometry.radius if isinstance(geometry, coal.Cylinder) else 0.0
        if geometry.halfLength > ends:
            length = geometry.halfLength - ends
            return np.zeros(3), Capsule(link="*", radius_m=geometry.radius, half_length_m=max(length, 1e-4))
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    half = np.maximum((high - low) / 2.0, 1e-4)
    return (low + high) / 2.0, Box(link="*", half_size_m=tuple(half.tolist()))
