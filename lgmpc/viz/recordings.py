"""Recordings for other viewers: MCAP with Foxglove's schemas, and .rrd of rerun.

Both have the robot's meshes on moving links, the ground, contact forces, the push, the centre of mass and its target,
and every channel of the log as a time series. Poses and marks have at most :data:`RATE_HZ` pictures a second, channels
every tick of the log. Times are those of the log: seconds since the start of the run.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, required
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunLog
from lgmpc.runs.atomic import atomic_write, json_values
from lgmpc.runs.recorded import Column, columns_of
from lgmpc.typing import Array, IntArray
from lgmpc.viz.body import load_body
from lgmpc.viz.marks import COLORS, Scale, turns_to
from lgmpc.viz.overlay import Frames
from lgmpc.viz.stage import BOX_COLOR, BOX_SIDES, FLOOR_COLOR, field_triangles
from lgmpc.world import Box, HeightField, Plane, World

RATE_HZ = 100.0
"""Largest number of poses and marks a second."""

_FLOOR_M = 10.0
"""Half the side of the floor around the path, m."""

_UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Piece:
    """Triangles of one colour on a link; on the ground if its name is "world"."""

    link: str
    name: str
    positions: Array
    faces: IntArray
    rgb: int
    opacity: float = 1.0


@dataclass(frozen=True)
class _Arrows:
    """Arrows of one kind: tails and vectors (k, n, 3), m."""

    name: str
    tails: Array
    vectors: Array
    labels: tuple[str, ...]


@dataclass(frozen=True)
class _Recording:
    """The content of both formats.

    Attributes:
        times: (k,) of the pictures, s since the start of the run.
        poses: (k, 7) world pose [position, quaternion x y z w] of each link.
        pieces: meshes.
        arrows: forces.
        points: (k, 3) centre of mass and its target, m.
        size: of marks, m.
        channels: columns of the log by channel, first the time.
    """

    times: Array
    poses: dict[str, Array]
    pieces: list[_Piece]
    arrows: list[_Arrows]
    points: dict[str, Array]
    size: float
    channels: dict[str, list[Column]]

    @classmethod
    def of(cls, robot: Robot, run: Run, ground: World) -> "_Recording":
        """Return the contents of a run's recording.

        Raises:
            InputError: the run has no finite tick, or is of another robot.
        """
        log = run.log
        if log.finite_ticks == 0 or log.q.shape[1] != robot.nq:
            got = f"{run.path}, with {log.finite_ticks} finite ticks of nq = {log.q.shape[1]}"
            raise InputError("run", got, f"a run of {robot.name} (nq = {robot.nq}) that has begun")
        frames = Frames.of(log, RATE_HZ, limit=log.ticks)
        ticks, body = frames.ticks, load_body(robot)
        height = float(np.subtract(*body.bounds(robot.q_reference)[::-1])[2])
        scale = Scale.of(height, robot.weight, robot.nf)
        feet, points = tuple(log.contact_frames.tolist()), log.contact_points[ticks]
        arrows = [
            _Arrows(name, points, scale.metres_per_newton * frames.mean(forces), feet)
            for name, forces in (("forces", log.contact_forces), ("planned", log.contact_forces_desired))
        ]
        push = scale.metres_per_newton * log.push[ticks, None, :3]
        arrows.append(_Arrows("push", log.push_point[ticks, None] - push, push, ("push",)))
        poses = _link_poses(robot, log.q[ticks])
        channels: dict[str, list[Column]] = {}
        for table in log.tables():
            time, *columns = sorted(columns_of(log, table), key=lambda each: not each.name.endswith("time"))
            for column in columns:
                channels.setdefault(column.name.partition(".")[0], [time]).append(column)
        com = {"com": log.com[ticks], "target": log.com_reference[ticks]}
        pieces = [*_robot_pieces(robot), *_ground_pieces(ground, log.base_pose[ticks, :3])]
        return cls(log.time[ticks], poses, pieces, arrows, com, 0.06 * scale.length, channels)


def write_mcap(file: Path, robot: Robot, run: Run, ground: World) -> None:
    """Write a run as MCAP for Foxglove.

    Topics: ``/tf`` (foxglove.FrameTransforms, every link relative to ``world``), ``/joint_states``
    (foxglove.JointStates), ``/robot``, ``/world``, ``/marks`` (foxglove.SceneUpdate), and ``/log/<channel>`` (JSON with
    its schema, which has unit, frame and meaning). The record ``lgmpc`` of the metadata has config and verdict.

    Args:
        file: the file.
        robot: of the run.
        run: the run.
        ground: of its world.

    Raises:
        MissingDependencyError: foxglove-sdk is not installed.
        RunFolderError: the file cannot be written.
        InputError: the run has no finite tick, or is of another robot.
    """
    foxglove, topics = (required(name, "an MCAP file", "data") for name in ("foxglove", "foxglove.channels"))
    data, messages = _Recording.of(robot, run, ground), _Foxglove()
    context, verdict = foxglove.Context(), run.result.verdict
    reasons = "; ".join(verdict.reasons)
    about = {"name": run.result.name, "verdict": verdict.outcome.value, "reasons": reasons, "config": run.config}
    with atomic_write(file) as stream, foxglove.open_mcap(stream, context=context) as writer:
        tf = topics.FrameTransformsChannel("/tf", context=context)
        states = topics.JointStatesChannel("/joint_states", context=context)
        scenes = {each: topics.SceneUpdateChannel(f"/{each}", context=context) for each in ("robot", "world", "marks")}
        writer.write_metadata("lgmpc", about)
        for topic in ("robot", "world"):
            pieces = [each for each in data.pieces if (each.link == "world") == (topic == "world")]
            scenes[topic].log(messages.meshes(pieces, data.times[0]), log_time=_ns(data.times[0]))
        for k, time in enumerate(data.times.tolist()):
            tf.log(messages.transforms(data, k), log_time=_ns(time))
            scenes["marks"].log(messages.marks(data, k), log_time=_ns(time))
        for tick, time in enumerate(run.log.time.tolist()):
            states.log(messages.joints(robot, run.log, tick), log_time=_ns(time))
        for name, (clock, *columns) in data.channels.items():
            channel = foxglove.Channel(f"/log/{name}", schema=_schema(name, columns), context=context)
            keys = [each.name.partition(".")[2] or "value" for each in columns]
            for time, *values in zip(clock.values.tolist(), *(c.values.tolist() for c in columns), strict=True):
                channel.log(json_values(dict(zip(keys, values, strict=True))), log_time=_ns(time))


class _Foxglove:
    """Messages in Foxglove's schemas."""

    def __init__(self) -> None:
        self._types = required("foxglove.messages", "an MCAP file", "data")

    def meshes(self, pieces: Iterable[_Piece], time: float) -> Any:
        """Return the scene of links that move with their frames."""
        m, here = self._types, self._pose(np.zeros(3))
        entities = []
        for each in pieces:
            points, indices = [m.Point3(**_xyz(p)) for p in each.positions], each.faces.ravel().tolist()
            color = self._color(each.rgb, each.opacity)
            mesh = m.TriangleListPrimitive(pose=here, points=points, color=color, indices=indices)
            entity = {"frame_id": each.link, "id": f"{each.link}/{each.name}", "frame_locked": True}
            entities.append(m.SceneEntity(**self._at(time), **entity, triangles=[mesh]))
        return m.SceneUpdate(entities=entities)

    def transforms(self, data: _Recording, k: int) -> Any:
        """Return the poses of all links in a picture."""
        m, stamp = self._types, self._at(data.times[k])
        moved = []
        for link, poses in data.poses.items():
            place, turn = m.Vector3(**_xyz(poses[k, :3])), m.Quaternion(**_xyz(poses[k, 3:]))
            frames = {"parent_frame_id": "world", "child_frame_id": link}
            moved.append(m.FrameTransform(**stamp, **frames, translation=place, rotation=turn))
        return m.FrameTransforms(transforms=moved)

    def marks(self, data: _Recording, k: int) -> Any:
        """Return the scene of centre of mass, target and forces in a picture."""
        m, stamp = self._types, {**self._at(data.times[k]), "frame_id": "world"}
        size = m.Vector3(x=data.size, y=data.size, z=data.size)
        balls = [
            m.SpherePrimitive(pose=self._pose(each[k]), size=size, color=self._color(COLORS[name]))
            for name, each in data.points.items()
            if np.isfinite(each[k]).all()
        ]
        entities = [m.SceneEntity(**stamp, id="com", spheres=balls)]
        for kind in data.arrows:
            drawn = [
                self._arrow(tail, vector, data.size, COLORS[kind.name])
                for tail, vector in zip(kind.tails[k], kind.vectors[k], strict=True)
                if np.linalg.norm(vector) > 0.01 * data.size
            ]
            entities.append(m.SceneEntity(**stamp, id=kind.name, arrows=drawn))
        return m.SceneUpdate(entities=entities)

    def joints(self, robot: Robot, log: RunLog, tick: int) -> Any:
        """Return the joints' positions, velocities and torques at a tick."""
        q, v, tau = log.q[tick, robot.joint_q], log.v[tick, robot.joint_v], log.tau[tick]
        rows = zip(robot.joint_names, q.tolist(), v.tolist(), tau.tolist(), strict=True)
        state = self._types.JointState
        joints = [state(name=name, position=a, velocity=b, effort=c) for name, a, b, c in rows]
        return self._types.JointStates(**self._at(log.time[tick]), joints=joints)

    def _arrow(self, tail: Array, vector: Array, size: float, rgb: int) -> Any:
        length, pose, color = float(np.linalg.norm(vector)), self._pose(tail, _x_along(vector)), self._color(rgb)
        shaft = {"shaft_length": 0.8 * length, "shaft_diameter": 0.3 * size}
        head = {"head_length": 0.2 * length, "head_diameter": 0.7 * size}
        return self._types.ArrowPrimitive(pose=pose, color=color, **shaft, **head)

    def _at(self, time: float) -> dict[str, Any]:
        return {"timestamp": self._types.Timestamp(*divmod(_ns(time), 10**9))}

    def _color(self, rgb: int, opacity: float = 1.0) -> Any:
        red, green, blue = (((rgb >> shift) & 255) / 255.0 for shift in (16, 8, 0))
        return self._types.Color(r=red, g=green, b=blue, a=opacity)

    def _pose(self, position: Array, turn: Array = _UNTURNED) -> Any:
        m = self._types
        return m.Pose(position=m.Vector3(**_xyz(position)), orientation=m.Quaternion(**_xyz(turn)))


def write_rrd(file: Path, robot: Robot, run: Run, ground: World) -> None:
    """Write a run as .rrd for rerun.

    Entities: ``world/<link>`` with the meshes below it, ``world/ground``, ``world/forces`` and the like, and
    ``log/<channel>``, whose series are named and whose ``about`` has unit, frame and meaning. The timeline is ``time``.

    Arguments and errors as :func:`write_mcap`.
    """
    rr = required("rerun", "an .rrd file", "data")
    data = _Recording.of(robot, run, ground)
    recording = rr.RecordingStream("lgmpc", recording_id=run.path.name)
    stream = recording.binary_stream()
    pictures = [rr.TimeColumn("time", duration=data.times)]
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("about", rr.TextDocument(f"{run.result.name}: {run.result.verdict.outcome.value}"), static=True)
    recording.log("config", rr.TextDocument(run.config, media_type="text/plain"), static=True)
    for link, poses in data.poses.items():
        columns = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
        recording.send_columns(f"world/{link}", pictures, columns)
    for piece in data.pieces:
        mesh = rr.Mesh3D(
            vertex_positions=piece.positions,
            triangle_indices=piece.faces,
            albedo_factor=(piece.rgb << 8) + round(255 * piece.opacity),
        )
        path = f"world/ground/{piece.name}" if piece.link == "world" else f"world/{piece.link}/{piece.name}"
        recording.log(path, mesh, static=True)
    for kind in data.arrows:
        count, each = kind.tails.shape[:2]
        columns = rr.Arrows3D.columns(origins=kind.tails.reshape(-1, 3), vectors=kind.vectors.reshape(-1, 3))
        recording.send_columns(f"world/{kind.name}", pictures, columns.partition([each] * count))
        style = rr.Arrows3D.from_fields(colors=(COLORS[kind.name] << 8) + 255, radii=0.15 * data.size)
        recording.log(f"world/{kind.name}", style, static=True)
    for name, points in data.points.items():
        recording.send_columns(f"world/{name}", pictures, rr.Points3D.columns(positions=points))
        style = rr.Points3D.from_fields(colors=(COLORS[name] << 8) + 255, radii=0.5 * data.size)
        recording.log(f"world/{name}", style, static=True)
    for name, (clock, *columns) in data.channels.items():
        values = np.column_stack([each.values.astype(np.float64) for each in columns])
        scalars = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
        recording.send_columns(f"log/{name}", [rr.TimeColumn("time", duration=clock.values)], scalars)
        titles = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in columns]
        recording.log(f"log/{name}", rr.SeriesLines(names=titles), static=True)
        recording.log(f"log/{name}/about", rr.TextDocument(_about(columns[0])), static=True)
    content = stream.read()
    recording.disconnect()
    with atomic_write(file) as target:
        target.write(content)


def _ns(time: float) -> int:
    """Return a time of the log in nanoseconds."""
    return round(1e9 * float(time))


def _about(column: Column) -> str:
    parts = (column.channel.about, column.channel.frame and f"{column.channel.frame} axes", column.channel.units)
    return "; ".join(part for part in parts if part)


def _schema(name: str, columns: list[Column]) -> dict[str, Any]:
    """Return the JSON schema of a channel's messages."""
    properties = {
        each.name.partition(".")[2] or "value": {"type": "number", "description": each.unit} for each in columns
    }
    return {"type": "object", "title": f"lgmpc.{name}", "description": _about(columns[0]), "properties": properties}


def _xyz(values: Array) -> dict[str, float]:
    return dict(zip("xyzw", values.tolist(), strict=False))


def _x_along(vector: Array) -> Array:
    """Return (4,) the rotation, x y z w, from the x axis to a vector."""
    toward_z = np.array([0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)])  # from x to z
    turn = turns_to((vector / np.linalg.norm(vector))[None])[0]
    return (pin.Quaternion(turn) * pin.Quaternion(toward_z)).coeffs()


def _links(robot: Robot) -> Iterator[tuple[int, Any]]:
    """Yield index and frame of every link."""
    frames = enumerate(robot.model.frames)
    return ((i, each) for i, each in frames if each.type == pin.FrameType.BODY and each.name != "universe")


def _link_poses(robot: Robot, q: Array) -> dict[str, Array]:
    data, links = robot.create_data(), list(_links(robot))
    poses = np.empty((len(links), len(q), 7))
    for k, configuration in enumerate(q):
        pin.framesForwardKinematics(robot.model, data, configuration)
        for i, (index, _) in enumerate(links):
            poses[i, k] = pin.SE3ToXYZQUAT(data.oMf[index])
    return {frame.name: pose for (_, frame), pose in zip(links, poses, strict=True)}


def _robot_pieces(robot: Robot) -> Iterator[_Piece]:
    first: dict[int, Any] = {}
    for _, frame in _links(robot):
        first.setdefault(frame.parentJoint, frame)
    for part in load_body(robot).parts:
        if part.joint not in first or not len(part.mesh.positions):
            continue
        link = first[part.joint]
        placement = link.placement.actInv(part.placement)
        points = part.mesh.positions @ placement.rotation.T + placement.translation
        yield _Piece(
            link.name, part.name, points, part.mesh.faces.astype(np.int64), part.material.color, part.material.opacity
        )


def _ground_pieces(ground: World, travel: Array) -> Iterator[_Piece]:
    low, high = travel[:, :2].min(axis=0) - _FLOOR_M, travel[:, :2].max(axis=0) + _FLOOR_M
    for i, surface in enumerate(ground.surfaces):
        if isinstance(surface, Plane):
            places = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
            corners = np.column_stack([places, surface.height(places)])
            yield _Piece("world", f"floor_{i}", corners, np.array([[0, 1, 2], [0, 2, 3]]), FLOOR_COLOR)
        elif isinstance(surface, Box):
            yield _Piece("world", f"box_{i}", surface.corners, BOX_SIDES, BOX_COLOR)
        elif isinstance(surface, HeightField):
            yield _Piece("world", f"heights_{i}", *field_triangles(surface), BOX_COLOR)
