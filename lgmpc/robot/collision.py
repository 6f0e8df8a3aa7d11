"""Collision shapes of a robot, besides its feet: spheres, boxes and capsules fixed to its links."""

import fnmatch
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal, Union

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.errors import InputError, nearest
from lgmpc.robot.feet import UP
from lgmpc.robot.names import frame_index
from lgmpc.settings import Positive, Settings, Vector3, key
from lgmpc.typing import Array, BoolArray

Size = Annotated[Positive, Field(ge=1e-4, le=100.0)]
"""m."""


@dataclass(frozen=True)
class ModelSource:
    """The files of a model, for reading its meshes.

    Attributes:
        urdf: the URDF file.
        srdf: the SRDF file, if there is one.
        package_dirs: folders in which ``package://`` paths are resolved.
    """

    urdf: Path
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()


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
    links = [frame.name for frame in model.frames if is_moving_link(frame)]
    return [
        f"collision_shapes.{i}.link: '{shape.link}' matches no moving link; there are "
        f"{', '.join(nearest(shape.link, links) or tuple(links))}"
        for i, shape in enumerate(shapes or ())
        if not fnmatch.filter(links, shape.link)
    ]


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
        f"{shape.kind} on {shape.link}", int(frame.parentJoint), frame.placement * placement_of(shape), shape
    )


_MESHES = coal.CachedMeshLoader(coal.NODE_TYPE.BV_OBBRSS)  # reads a file again only after it was changed


def read_geometry(
    model: pin.Model, source: ModelSource, kind: pin.GeometryType = pin.GeometryType.COLLISION
) -> pin.GeometryModel:
    """Return the geometry of a URDF without that of links that ``model`` lacks; meshes are read once a process.

    Raises:
        ValueError: a mesh cannot be read.
    """
    folders, urdf = [str(folder) for folder in source.package_dirs], str(source.urdf)

    def read(parent: pin.Model) -> pin.GeometryModel:
        return pin.buildGeomFromUrdf(parent, urdf, kind, package_dirs=folders, mesh_loader=_MESHES)

    try:
        return read(model)
    except ValueError:
        whole, found = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer()), pin.GeometryModel()
    for part in read(whole).geometryObjects:
        link = whole.frames[part.parentFrame]
        if model.existFrame(link.name):
            part.parentFrame = model.getFrameId(link.name)
            here = model.frames[part.parentFrame]
            part.placement = here.placement * link.placement.inverse() * part.placement
            part.parentJoint = here.parentJoint
            found.addGeometryObject(part)
    return found


class LinkPairs:
    """The pairs of links that can touch: convex hulls of the parts of the URDF's collision geometry.

    Two parts of one link, or of two that share a joint, are no pair; nor are those that overlap in a given posture.

    Args:
        model: the robot's model.
        geometry: its collision geometry.
        q: (nq,) the posture.

    Attributes:
        names: of the two links of each pair.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, q: Array) -> None:
        parts = list(geometry.geometryObjects)
        for part in parts:
            if isinstance(part.geometry, coal.BVHModelBase):
                part.geometry.buildConvexHull(True, "Qt")
                part.geometry = part.geometry.convex
            part.geometry.computeLocalAABB()
        self._centres = [np.array(part.geometry.aabb_center) for part in parts]
        radii = np.array([part.geometry.aabb_radius for part in parts])
        self._joints = joints = np.array([part.parentJoint for part in parts], dtype=int)
        links = [model.frames[part.parentFrame].name for part in parts]
        near = {pair for i, parent in enumerate(model.parents) for pair in ((i, i), (i, parent), (parent, i))}
        pairs = [(a, b) for a, b in combinations(range(len(parts)), 2) if (joints[a], joints[b]) not in near]
        for pair in pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        self.names = tuple(f"{links[a]} and {links[b]}" for a, b in pairs)
        self._model, self._geometry = model, geometry
        self._data, self._found = model.createData(), geometry.createData()
        self._first, self._second = np.array(pairs, dtype=int).reshape(-1, 2).T
        self._reach = radii[self._first] + radii[self._second]
        bounds = self._place(q)
        touching = [pair for pair in np.flatnonzero(bounds <= 0.0).tolist() if self._distance(pair) <= 0.0]
        self._reach[touching] = -math.inf

    def distances(self, q: Array, pairs: BoolArray | bool = True) -> tuple[Array, list[str]]:
        """Return the least distances (n,) of (some) pairs in configurations (n, nq), m, and of which links they are.

        Where links overlap, it is the negative depth.
        """
        least, names = np.full(len(q), math.inf), [""] * len(q)
        for k, configuration in enumerate(q):
            bounds = np.where(pairs, self._place(configuration), math.inf)
            for pair in np.argsort(bounds).tolist():
                if bounds[pair] >= least[k]:
                    break
                distance = self._distance(pair)
                if distance < least[k]:
                    least[k], names[k] = distance, self.names[pair]
        return least, names

    def between(self, groups: Sequence[Sequence[int]]) -> BoolArray:
        """Return which pairs are of links that joints of two different groups move."""
        group = np.full(int(self._joints.max(initial=0)) + 1, -1)
        for i, joints in enumerate(groups):
            group[[joint for joint in joints if joint < len(group)]] = i
        first, second = group[self._joints[self._first]], group[self._joints[self._second]]
        return (first != second) & (first >= 0) & (second >= 0)

    def _place(self, q: Array) -> Array:
        """Place the links, and return lower bounds on the distances of the pairs, m: those of spheres around them."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._found, q)
        centres = np.array([at.act(centre) for at, centre in zip(self._found.oMg, self._centres, strict=True)] or [UP])
        return np.linalg.norm(centres[self._first] - centres[self._second], axis=1) - self._reach

    def _distance(self, pair: int) -> float:
        return float(pin.computeDistance(self._geometry, self._found, pair).min_distance)


def shape_of(part: pin.GeometryObject) -> CollisionShape:
    """Return the shape of an object of a geometry model: spheres and capsules as they are, all else enclosed.

    Cylinders become capsules of the same length if they are longer than wide, other objects boxes.
    """
    centre, shape = _enclosed(part.geometry)
    return CollisionShape(
        f"{shape.kind} {part.name}", int(part.parentJoint), part.placement * pin.SE3(np.eye(3), centre), shape
    )


def placement_of(shape: Sphere | Box | Capsule) -> pin.SE3:
    """Return the placement of a shape in its link's frame."""
    turn = np.eye(3) if isinstance(shape, Sphere) else pin.rpy.rpyToMatrix(*np.radians(shape.rpy_deg))
    return pin.SE3(turn, np.array(shape.center_m))


def is_moving_link(frame: pin.Frame) -> bool:
    """Return whether a frame is a link that a joint moves."""
    return bool(frame.type == pin.FrameType.BODY and frame.parentJoint > 0)


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
