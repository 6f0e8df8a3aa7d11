"""Overlays of replays: contacts, centre of mass, prediction, pushes, footholds, swings, thrusts, targets, paths."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.lie import attitude, quaternion
from lgmpc.robot import Robot
from lgmpc.runs import RunLog, TrajectoryLog
from lgmpc.runs.ground import along_ground
from lgmpc.runs.intervals import intervals
from lgmpc.runs.walking import heading
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.marks import (
    COLORS,
    ContactMarks,
    Scale,
    add_arrow,
    add_ball,
    add_path,
    add_place,
    add_plumb_line,
    turns_to,
)
from lgmpc.viz.mesh import disc, sphere
from lgmpc.viz.scene import Material, Scene
from lgmpc.world import Terrain

SPEED_SHOWN_M_S = 0.5
"""Velocity whose arrow has the scale's length, m/s."""

_NEAR_SLIP = 0.1
"""A cone has the warning colour if the friction margin is less than this fraction of ``mu f_n``."""

_BEADS = 9


@dataclass(frozen=True)
class Frames:
    """The pictures of a replay, as ticks of the log.

    Attributes:
        times: (k,) times from the replay's start, s.
        ticks: (k,) indices into the log.
    """

    times: Array
    ticks: IntArray

    @classmethod
    def of(cls, log: RunLog, rate_hz: float = 50.0, limit: int = 3000) -> "Frames":
        """Return pictures at ``rate_hz``, at most ``limit``, up to the first state that is not finite."""
        end = max(log.finite_ticks, 1)
        elapsed = log.time[:end] - log.time[0]
        count = min(int(elapsed[-1] * rate_hz) + 1, limit)
        if count < 2:
            return cls(np.zeros(1), np.zeros(1, dtype=np.int64))
        wanted = np.linspace(0.0, elapsed[-1], count)
        ticks = np.unique(np.clip(np.searchsorted(elapsed, wanted), 0, end - 1)).astype(np.int64)
        return cls(elapsed[ticks], ticks)

    def mean(self, values: Array) -> Array:
        """Return the mean of a channel from each picture to the next."""
        ends = np.append(self.ticks[1:], self.ticks[-1] + 1)
        sums = np.add.reduceat(values[: ends[-1]], self.ticks, axis=0)
        return sums / (ends - self.ticks).reshape(-1, *[1] * (values.ndim - 1))


def add_overlay(
    scene: Scene, log: RunLog, frames: Frames, scale: Scale, ground: Terrain, height: float, trunk_half_sides: Array
) -> None:
    """Add the overlays below ``/overlay``, one folder for each that the page can show or hide.

    Args:
        scene: the scene.
        log: the run.
        frames: the pictures.
        scale: sizes.
        ground: ground of the run's world.
        height: of the robot, m; the command's arrow is above it.
        trunk_half_sides: (3,) half extents of the trunk, at whose surface pushes are shown, m.
    """
    _add_contacts(scene, log, frames, scale)
    _add_com(scene, log, frames, scale, ground)
    if len(log.mpc_time):
        _add_horizon(scene, log, frames, scale)
    _add_push(scene, log, frames, scale, trunk_half_sides)
    for point, foot in enumerate(log.foot_of.tolist()):
        if not log.stance[:, foot].all():
            _add_foothold(scene, log, frames, scale, ground, point)
            _add_swing(scene, log, frames, scale, point)
    if log.believed_ground is not None:
        _add_belief(scene, log, log.believed_ground, frames, scale)
    if log.commanded:
        _add_command(scene, log, frames, scale, ground, height)


def _add_contacts(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    points, names = log.contact_points[frames.ticks], log.contact_frames.tolist()
    closed = log.normal_forces > 0.02 * scale.newtons
    slipping = closed & (log.tangential_forces > (1.0 - _NEAR_SLIP) * log.friction_limits)
    flags = (frames.mean(each.astype(np.float64)) > 0.0 for each in (closed, slipping))
    forces, friction = frames.mean(log.contact_forces), log.friction_of_feet[frames.ticks]
    normals = log.contact_normals[frames.ticks]
    ContactMarks(names, frames.times, points, normals, forces, friction, *flags).add_to(scene, scale)
    planned = frames.mean(log.contact_forces_desired)
    for k, name in enumerate(names):
        path = f"/overlay/planned/{name}"
        add_arrow(scene, path, "planned", 0.7, scale, frames.times, points[:, k], planned[:, k])


def _add_com(scene: Scene, log: RunLog, frames: Frames, scale: Scale, ground: Terrain) -> None:
    com, target = log.com[frames.ticks], log.com_reference[frames.ticks]
    known: BoolArray = np.asarray(np.isfinite(target).all(axis=1))
    target = np.where(known[:, None], target, com)
    add_ball(scene, "/overlay/com/com", scale, ground, frames.times, com, None, target=False)
    add_ball(scene, "/overlay/com/target", scale, ground, frames.times, target, known, target=True)
    add_plumb_line(scene, "/overlay/com/plumb", scale, ground, frames.times, com)


def _add_horizon(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    """Add beads along the current prediction at each picture, of decreasing size."""
    update = np.searchsorted(log.mpc_time, log.time[frames.ticks], side="right") - 1
    finite: BoolArray = np.asarray(np.isfinite(log.mpc_horizon_com).all(axis=(1, 2)))
    age = log.time[frames.ticks] - log.mpc_time[np.maximum(update, 0)]
    known: BoolArray = (update >= 0) & finite[np.maximum(update, 0)] & (age < 1.5 * log.mpc_period_s)
    beads = np.where(known[:, None, None], log.mpc_horizon_com[np.maximum(update, 0)], 0.0)
    nodes = beads.shape[1]
    material = Material(COLORS["horizon"], on_top=True)
    for node in range(nodes):
        path = f"/overlay/horizon/{node:02d}"
        scene.add_mesh(path, sphere(scale.length * (0.04 - 0.022 * node / max(nodes - 1, 1))), material)
        scene.set(f"{path}/<object>", "renderOrder", 12)
        scene.animate(path, frames.times, position=beads[:, node], visible=known)


def _add_push(scene: Scene, log: RunLog, frames: Frames, scale: Scale, trunk_half_sides: Array) -> None:
    """Add an arrow that ends where the push's line of action intersects the trunk's surface."""
    force, point = log.push[frames.ticks, :3], log.push_point[frames.ticks]
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    direction = force / np.where(size, size, 1.0)[:, None]
    if log.floating_base and trunk_half_sides.any():
        in_body = np.abs(quaternion.act(quaternion.inverse(log.q[frames.ticks, 3:7]), direction))
        clearance = np.where(size, (trunk_half_sides / np.maximum(in_body, 1e-9)).min(axis=1), 0.0)
        point = point - (clearance + 0.03 * scale.length)[:, None] * direction
    tail = point - scale.metres_per_newton * force
    add_arrow(scene, "/overlay/push/force", "push", 2.0, scale, frames.times, tail, force)


def _add_foothold(scene: Scene, log: RunLog, frames: Frames, scale: Scale, ground: Terrain, point: int) -> None:
    """Add a disc at the next place of a contact point while its foot swings."""
    path = f"/overlay/footholds/{log.contact_frames[point]}"
    scene.add_mesh(path, disc(0.16 * scale.length), Material(COLORS["footholds"], 0.8, flat=True))
    place = log.footholds[frames.ticks, point]
    normals = ground.normal(place[:, :2])
    shown = log.stance[frames.ticks, log.foot_of[point]] == 0
    scene.animate(path, frames.times, position=place + 0.004 * normals, quaternion=turns_to(normals), visible=shown)


def _add_belief(scene: Scene, log: RunLog, believed: Array, frames: Frames, scale: Scale) -> None:
    """Add a patch of the plane that the controller takes the ground for, as far below the base as it believes."""
    base, (depth, along_x, along_y) = log.base_pose[frames.ticks], believed[frames.ticks].T
    normals = np.column_stack((-along_x, -along_y, np.ones_like(depth)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    place = base[:, :3] - depth[:, None] * [0.0, 0.0, 1.0] + 0.002 * normals
    known: BoolArray = np.asarray(np.isfinite(believed[frames.ticks]).all(axis=1))
    place, turns = np.where(known[:, None], place, base[:, :3]), np.where(known[:, None], normals, [0.0, 0.0, 1.0])
    scene.add_mesh("/overlay/belief/plane", disc(2.8 * scale.length), Material(COLORS["belief"], 0.35, flat=True))
    scene.animate("/overlay/belief/plane", frames.times, position=place, quaternion=turns_to(turns), visible=known)


def _add_swing(scene: Scene, log: RunLog, frames: Frames, scale: Scale, point: int) -> None:
    """Add beads along the reference of a contact point's current swing, from lift-off to touchdown."""
    beads = np.zeros((len(frames.ticks), _BEADS, 3))
    shown: BoolArray = np.zeros(len(frames.ticks), dtype=np.bool_)
    for begin, end in intervals(log.stance[:, log.foot_of[point]] == 0):
        pictures = (frames.ticks >= begin) & (frames.ticks < end)
        along: IntArray = np.round(np.linspace(begin, end - 1, _BEADS)).astype(np.int64)
        beads[pictures] = log.swing_targets[along, point]
        shown |= pictures
    # Visibility is a step function of time, the rest is interpolated: a bead must not move until it is hidden.
    beads = beads[np.maximum.accumulate(np.where(shown, np.arange(len(shown)), 0))]
    for bead in range(_BEADS):
        path = f"/overlay/swings/{log.contact_frames[point]}/{bead}"
        scene.add_mesh(path, sphere(0.032 * scale.length), Material(COLORS["swings"], 0.9, on_top=True))
        scene.animate(path, frames.times, position=beads[:, bead], visible=shown)


def _add_command(scene: Scene, log: RunLog, frames: Frames, scale: Scale, ground: Terrain, height: float) -> None:
    """Add an arrow above the base along the commanded velocity."""
    base, (ahead, left, _) = log.base_pose[frames.ticks], log.command[frames.ticks].T
    velocity = np.column_stack((*attitude.turn(heading(base[:, 3:]), ahead, left), 0.0 * ahead))
    below = ground.height(base[:, :2])
    tail = np.column_stack((base[:, :2], below + (base[:, 2] - below).max() + 0.3 * height))
    per_speed = Scale(scale.length, SPEED_SHOWN_M_S)
    add_arrow(scene, "/overlay/command/velocity", "command", 1.4, per_speed, frames.times, tail, velocity)


_RATE_HZ, _MOST = 100.0, 3000
_ROUNDING = 1e-9
"""Largest difference between the times of a picture and of its node, s."""


@dataclass(frozen=True)
class Pictures:
    """The pictures of a replay.

    Attributes:
        times: (k,) times from the start, s.
        intervals: (k,) index of the interval of each picture.
        shares: (k,) position of each picture in its interval, 0 to 1.
        q: (k, nq) configurations, interpolated between those of the nodes.
    """

    times: Array
    intervals: IntArray
    shares: Array
    q: Array

    @classmethod
    def of(cls, robot: Robot, log: TrajectoryLog, rate_hz: float = _RATE_HZ, limit: int = _MOST) -> "Pictures":
        """Return pictures at ``rate_hz``, at most ``limit``, with configurations interpolated on their manifold."""
        count = max(2, min(int(np.ceil((log.times[-1] - log.times[0]) * rate_hz)) + 1, limit))
        times = np.linspace(log.times[0], log.times[-1], count)
        # After an impact, whose two nodes have the same time, the next interval begins.
        intervals = np.clip(np.searchsorted(log.times, times + _ROUNDING, side="right") - 1, 0, log.nodes - 1)
        start, length = log.times[intervals], np.diff(log.times)[intervals]
        shares = np.clip((times - start) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        states = log.xs[:, : log.nq]
        q = [pin.interpolate(robot.model, states[k], states[k + 1], s) for k, s in zip(intervals, shares, strict=True)]
        return cls(times - log.times[0], intervals.astype(np.int64), shares, np.array(q))


def add_trajectory_overlay(
    scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, scale: Scale, size: float, ground: Terrain
) -> None:
    """Add the overlays below ``/overlay``, one folder for each that the page can show or hide.

    Args:
        scene: the scene.
        robot: the robot.
        log: the trajectory.
        pictures: of the replay.
        scale: of forces.
        size: length of a target's axes, m.
        ground: the ground.
    """
    times, data = pictures.times, robot.create_data()
    thrusting, passing = (
        [robot.model.getFrameId(name) for name in names(robot, log)] for names in (thrusters, path_names)
    )
    com, axes = np.empty((len(times), 3)), np.empty((len(thrusting), len(times), 3))
    places = np.empty((len(thrusting) + len(passing), len(times), 3))
    for k, q in enumerate(pictures.q):
        com[k] = pin.centerOfMass(robot.model, data, q)  # computes the forward kinematics too
        for i, frame in enumerate([*thrusting, *passing]):
            place = pin.updateFramePlacement(robot.model, data, frame)
            places[i, k] = place.translation
            if i < len(thrusting):
                axes[i, k] = place.rotation[:, 2]
    _contacts(log, pictures, ground).add_to(scene, scale)
    if log.floating_base and log.contact_flags.any():
        add_ball(scene, "/overlay/com/com", scale, ground, times, com, None, target=False)
        add_plumb_line(scene, "/overlay/com/plumb", scale, ground, times, com)
    controls = log.control_names.tolist()
    for name, tail, axis in zip(thrusters(robot, log), places, axes, strict=False):
        thrust = log.us[pictures.intervals, controls.index(name), None] * axis
        add_arrow(scene, f"/overlay/thrusts/{name}", "thrusts", 1.0, scale, times, tail, thrust)
    for k, (position, rotation) in enumerate(zip(log.waypoint_positions, log.waypoint_rotations, strict=True)):
        turned = rotation if np.isfinite(rotation).all() else None
        add_place(scene, f"/overlay/places/{k:03d}", size, position, turned)
    for k, line in enumerate(places[len(thrusting) :] if passing else [com]):
        add_path(scene, f"/overlay/path/{k}", line, 0.025 * size, COLORS["path"])


def thrusters(robot: Robot, log: TrajectoryLog) -> list[str]:
    """Return the controls that are thrusts along the z axes of frames of the robot."""
    return [name for name in log.control_names.tolist() if log.control_unit == "N" and robot.model.existFrame(name)]


def path_names(robot: Robot, log: TrajectoryLog) -> list[str]:
    """Return the frames with targets; none if the targets are not of frames."""
    return [name for name in dict.fromkeys(log.waypoint_names.tolist()) if robot.model.existFrame(name)]


def _contacts(log: TrajectoryLog, pictures: Pictures, ground: Terrain) -> ContactMarks:
    """Return the contacts, with forces that are constant over each interval."""
    at, shares = pictures.intervals, pictures.shares[:, None, None]
    points = log.contact_points[at] + shares * (log.contact_points[at + 1] - log.contact_points[at])
    normals = ground.normal(points[:, :, :2].reshape(-1, 2)).reshape(points.shape)
    touching = log.contact_flags[at]
    forces = np.where(touching[:, :, None], log.contact_forces[at], 0.0)
    normal, tangential = np.einsum("kci,kci->kc", forces, normals), along_ground(forces, normals)
    friction = np.full((len(at), len(log.contact_frames)), log.friction)
    outside = np.isfinite(log.friction) & (tangential > 1.001 * np.nan_to_num(log.friction, posinf=0.0) * normal + 1e-9)
    return ContactMarks(
        log.contact_frames.tolist(), pictures.times, points, normals, forces, friction, touching, outside
    )
