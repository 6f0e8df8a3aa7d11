"""The drawn robot: its visual meshes, or a stick figure if it has none, attached to its joints."""

import logging
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.robot.collision import read_geometry
from lgmpc.typing import Array, IntArray
from lgmpc.viz.mesh import Mesh, mesh_of, shade, triangles_of
from lgmpc.viz.scene import Material, Scene

_LOG = logging.getLogger(__name__)

_SCHEMA = "http://www.collada.org/2005/11/COLLADASchema"
_SPACE = f"{{{_SCHEMA}}}"
_PRIMITIVES = tuple(_SPACE + kind for kind in ("triangles", "polylist", "polygons", "tristrips", "trifans"))

# Colours of models without their own, from the trunk outwards.
_PALETTE = (0x34414F, 0xC9D1D9, 0x8794A3, 0x5D6B7A)


@dataclass(frozen=True)
class Part:
    """One rigid mesh.

    Attributes:
        joint: index of the joint that moves it.
        name: its name, unique.
        mesh: its geometry in its own frame.
        placement: its frame in the joint's.
        material: colour, opacity and shine.
    """

    joint: int
    name: str
    mesh: Mesh
    placement: pin.SE3
    material: Material


@dataclass(frozen=True)
class Body:
    """A drawn robot.

    Attributes:
        robot: the robot.
        parts: its meshes.
    """

    robot: Robot
    parts: tuple[Part, ...]

    def add_to(self, scene: Scene) -> None:
        """Add every part to the scene, below ``/robot/<joint>``."""
        for part in self.parts:
            path = f"{self._path(part.joint)}/{part.name}"
            scene.add_mesh(path, part.mesh, part.material)
            scene.place(path, part.placement.translation, pin.Quaternion(part.placement.rotation).coeffs())

    def animate(self, scene: Scene, times: Array, q: Array) -> None:
        """Animate the parts through the (n, nq) configurations ``q`` at ``times`` (n,), s."""
        model, data = self.robot.model, self.robot.create_data()
        joints = sorted({part.joint for part in self.parts})
        poses = np.empty((len(q), len(joints), 7))
        for row, configuration in zip(poses, q, strict=True):
            pin.forwardKinematics(model, data, configuration)
            for column, joint in enumerate(joints):
                row[column] = pin.SE3ToXYZQUAT(data.oMi[joint])
        for column, joint in enumerate(joints):
            pose = poses[:, column]
            scene.animate(self._path(joint), times, position=pose[:, :3], quaternion=pose[:, 3:])

    def bounds(self, q: Array) -> tuple[Array, Array]:
        """Return the lowest and highest corner (3,) of all parts at configuration ``q``, world axes."""
        data = self.robot.create_data()
        pin.forwardKinematics(self.robot.model, data, q)
        clouds = []
        for part in self.parts:
            placement = data.oMi[part.joint] * part.placement
            clouds.append(part.mesh.positions @ placement.rotation.T + placement.translation)
        cloud = np.concatenate(clouds)
        return cloud.min(axis=0), cloud.max(axis=0)

    def trunk_half_sides(self) -> Array:
        """Return half the extents (3,) of the parts on the first joint, in its axes, m; zero if there are none."""
        points = [
            p.mesh.positions @ p.placement.rotation.T + p.placement.translation for p in self.parts if p.joint == 1
        ]
        return 0.5 * np.ptp(np.concatenate(points), axis=0).astype(np.float64) if points else np.zeros(3)

    def _path(self, joint: int) -> str:
        return f"/robot/{self.robot.model.names[joint]}"


@lru_cache(maxsize=4)  # a notebook or a report shows the same robot several times
def load_body(robot: Robot) -> Body:
    """Return the robot with the visual meshes of its URDF, or as a stick figure if there are none."""
    parts = _visual_parts(robot)
    return Body(robot, tuple(parts) if parts else tuple(_stick_figure(robot)))


def _visual_parts(robot: Robot) -> list[Part]:
    try:
        visuals = read_geometry(robot.model, robot.source, pin.GeometryType.VISUAL)
    except (ValueError, RuntimeError) as error:  # a missing mesh must not prevent the replay
        remedy = "give the folder that contains the package as robot.package_dirs"
        _LOG.warning("%s is drawn as a stick figure: %s: %s", robot.name, " ".join(str(error).split()), remedy)
        return []
    depth = _depths(robot.model)
    plain = len({tuple(np.round(g.meshColor, 3)) for g in visuals.geometryObjects}) == 1
    meshes: dict[tuple[object, ...], Mesh | None] = {}
    parts = []
    for geometry in visuals.geometryObjects:
        key = (geometry.meshPath or geometry.name, tuple(geometry.meshScale))
        if key not in meshes:
            meshes[key] = _mesh(geometry)
        mesh = meshes[key]
        if mesh is None:
            continue
        joint = int(geometry.parentJoint)
        color = _PALETTE[min(depth[joint], len(_PALETTE) - 1)] if plain else _rgb(geometry.meshColor)
        opacity = 1.0 if plain else float(geometry.meshColor[3])
        parts.append(Part(joint, geometry.name, mesh, geometry.placement, Material(color, opacity, shininess=40.0)))
    return parts


def _mesh(visual: pin.GeometryObject) -> Mesh | None:
    """Return the mesh of a visual geometry; ``None`` for a kind that is not drawn."""
    if _is_misread(visual.geometry, visual.meshPath):
        try:
            return Mesh.joined(_read_parts(visual.meshPath, visual.meshScale))
        except (ValueError, RuntimeError) as error:
            _LOG.warning("%s is drawn incompletely: %s", visual.name, " ".join(str(error).split()))
    return mesh_of(visual.geometry)


def _depths(model: Any) -> IntArray:
    """Return how many joints lie between each joint and the trunk (the first joint, or the fixed base)."""
    depth = np.zeros(model.njoints, dtype=np.int64)
    for joint in range(2, model.njoints):
        depth[joint] = depth[model.parents[joint]] + 1
    return depth


def _rgb(color: Sequence[float]) -> int:
    red, green, blue = (round(255.0 * min(max(channel, 0.0), 1.0)) for channel in list(color)[:3])
    return red << 16 | green << 8 | blue


def _stick_figure(robot: Robot) -> list[Part]:
    """Return balls at the joints and bars to their children and to the contact frames."""
    model = robot.model
    ends = [(model.parents[j], model.names[j], model.jointPlacements[j].translation) for j in range(2, model.njoints)]
    for frame_id in robot.contact_ids:
        frame = model.frames[frame_id]
        ends.append((frame.parentJoint, frame.name, frame.placement.translation))
    size = max([float(np.linalg.norm(end)) for _, _, end in ends], default=0.1)
    depth = _depths(model)
    found = [
        (joint, f"ball_{model.names[joint]}", coal.Sphere(0.06 * size), pin.SE3.Identity())
        for joint in range(1, model.njoints)
    ]
    for joint, name, end in ends:
        length = float(np.linalg.norm(end))
        if length > 1e-9:
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
            found.append((int(joint), f"bar_{name}", coal.Cylinder(0.035 * size, length), pin.SE3(turn, 0.5 * end)))
    parts = []
    for joint, name, geometry, placement in found:
        mesh = mesh_of(geometry)
        assert mesh is not None
        parts.append(Part(joint, name, mesh, placement, Material(_PALETTE[min(depth[joint], len(_PALETTE) - 1)])))
    return parts


def _is_misread(geometry: Any, path: str) -> bool:
    """Return whether a coal mesh was read from a COLLADA file of several parts: its last vertices have no triangle.

    coal 3.0 appends the parts of a node without shifting their vertex indices: all but the first have wrong vertices.
    """
    if not isinstance(geometry, coal.BVHModelBase) or Path(path).suffix.lower() != ".dae":
        return False
    return bool(triangles_of(geometry).max(initial=-1) + 1 < geometry.num_vertices)


def _read_parts(path: str, scale: Array) -> list[Mesh]:
    """Return a mesh for each primitive of a COLLADA file, scaled by (3,) factors, each read from a file of its own.

    Raises:
        ValueError: the file is no COLLADA.
        RuntimeError: coal cannot read a part.
    """
    try:
        document = ElementTree.parse(path)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is no COLLADA file: {error}") from error
    meshes = list(document.iter(f"{_SPACE}mesh"))
    parts = [(mesh, part) for mesh in meshes for part in mesh if part.tag in _PRIMITIVES]
    for mesh, part in parts:
        mesh.remove(part)
    ElementTree.register_namespace("", _SCHEMA)  # coal's reader does not support prefixes
    read = []
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder, "part.dae")
        for mesh, part in parts:
            mesh.append(part)
            document.write(alone, encoding="utf-8", xml_declaration=True)
            loaded = coal.MeshLoader().load(str(alone), np.asarray(scale, dtype=np.float64))
            read.append(shade(np.array(loaded.vertices(), dtype=np.float64).reshape(-1, 3), triangles_of(loaded)))
            mesh.remove(part)
    return read
