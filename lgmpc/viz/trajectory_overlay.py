"""Overlays of the replay of a solved trajectory: contacts, thrusts, targets, paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.runs import TrajectoryLog
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.marks import COLORS, Arrow, Scale, add_ball, add_cone, add_path, add_place, add_plumb_line
from lgmpc.viz.scene import Scene

__all__ = ["Pictures", "add_trajectory_overlay", "path_names", "thrusters"]

_RATE_HZ, _MOST = 100.0, 3000
_ROUNDING = 1e-9
"""Largest difference between the times of a picture and of its node, s."""


@dataclass(frozen=True)
class Pictures:
    """The pictures of a replay.

    Attributes:
        times: (k,) times from the start, s.
        intervals: (k,) index of the interval of each picture.
        q: (k, nq) configurations, interpolated between those of the nodes.
    """

    times: Array
    intervals: IntArray
    q: Array

    @classmethod
    def of(cls, robot: Robot, log: TrajectoryLog, rate_hz: float = _RATE_HZ, limit: int = _MOST) -> Pictures:
        """Return pictures at ``rate_hz``, at most ``limit``, with configurations interpolated on their manifold."""
        count = max(2, min(int(np.ceil((log.times[-1] - log.times[0]) * rate_hz)) + 1, limit))
        times = np.linspace(log.times[0], log.times[-1], count)
        # After an impact, whose two nodes have the same time, the next interval begins.
        intervals = np.clip(np.searchsorted(log.times, times + _ROUNDING, side="right") - 1, 0, log.nodes - 1)
        start, length = log.times[intervals], np.diff(log.times)[intervals]
        share = np.clip((times - start) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        states = log.xs[:, : log.nq]
        q = [pin.interpolate(robot.model, states[k], states[k + 1], s) for k, s in zip(intervals, share, strict=True)]
        return cls(times - log.times[0], intervals.astype(np.int64), np.array(q))


def add_trajectory_overlay(
    scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, scale: Scale, size: float, lift: Array
) -> None:
    """Add the overlays below ``/overlay``, one folder for each that the page can show or hide.

    Args:
        scene: the scene.
        robot: the robot.
        log: the trajectory.
        pictures: of the replay.
        scale: of forces.
        size: length of a target's axes, m.
        lift: (3,) displacement of the robot above the floor, m.
    """
    _add_contacts(scene, log, pictures, scale)
    _add_com(scene, robot, log, pictures, scale, lift)
    _add_thrusts(scene, robot, log, pictures, scale)
    for k, (position, rotation) in enumerate(zip(log.waypoint_positions, log.waypoint_rotations, strict=True)):
        turned = rotation if np.isfinite(rotation).all() else None
        add_place(scene, f"/overlay/places/{k:03d}", size, position, turned)
    _add_paths(scene, robot, log, pictures, 0.025 * size)


def thrusters(robot: Robot, log: TrajectoryLog) -> list[str]:
    """Return the controls that are thrusts along the z axes of frames of the robot."""
    return [name for name in log.control_names.tolist() if log.control_unit == "N" and robot.model.existFrame(name)]


def path_names(robot: Robot, log: TrajectoryLog) -> list[str]:
    """Return the frames with targets; none if the targets are not of frames."""
    return [name for name in dict.fromkeys(log.waypoint_names.tolist()) if robot.model.existFrame(name)]


def _add_contacts(scene: Scene, log: TrajectoryLog, pictures: Pictures, scale: Scale) -> None:
    """Add forces, constant over each interval, and their cones during contact."""
    share = _shares(log, pictures)
    for k, name in enumerate(log.contact_frames.tolist()):
        points = log.contact_points[pictures.intervals, k]
        point = points + share[:, None] * (log.contact_points[pictures.intervals + 1, k] - points)
        force, touching = log.contact_forces[pictures.intervals, k], log.contact_flags[pictures.intervals, k]
        force = np.where(touching[:, None], force, 0.0)
        arrow = Arrow(f"/overlay/forces/{name}", COLORS["forces"], 1.0, scale)
        arrow.add(scene)
        arrow.animate(scene, pictures.times, point, force)
        if np.isfinite(log.friction):
            outside: BoolArray = np.linalg.norm(force[:, :2], axis=1) > 1.001 * log.friction * force[:, 2] + 1e-9
            for folder, warn, shown in (
                ("cones", False, touching & ~outside),
                ("slipping", True, touching & outside),
            ):
                path = f"/overlay/cones/{folder}/{name}"
                add_cone(scene, path, log.friction, scale, pictures.times, point, shown, warn=warn)


def _add_com(scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, scale: Scale, lift: Array) -> None:
    """Add the centre of mass with a plumb line to the floor, for robots with contacts."""
    if not (log.floating_base and log.contact_flags.any()):
        return
    data = robot.create_data()
    com = np.array([pin.centerOfMass(robot.model, data, q).copy() for q in pictures.q])
    add_ball(scene, "/overlay/com/com", scale, pictures.times, com, None, target=False)
    add_plumb_line(scene, "/overlay/com/plumb", scale, pictures.times, com + lift)


def _add_thrusts(scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, scale: Scale) -> None:
    data, names = robot.create_data(), thrusters(robot, log)
    frames = [robot.model.getFrameId(name) for name in names]
    points, axes = np.empty((2, len(frames), len(pictures.q), 3))
    for k, q in enumerate(pictures.q):
        pin.forwardKinematics(robot.model, data, q)
        for i, frame in enumerate(frames):
            place = pin.updateFramePlacement(robot.model, data, frame)
            points[i, k], axes[i, k] = place.translation, place.rotation[:, 2]
    columns = [log.control_names.tolist().index(name) for name in names]
    for i, (name, column) in enumerate(zip(names, columns, strict=True)):
        arrow = Arrow(f"/overlay/thrusts/{name}", COLORS["thrusts"], 1.0, scale)
        arrow.add(scene)
        arrow.animate(scene, pictures.times, points[i], log.us[pictures.intervals, column, None] * axes[i])


def _add_paths(scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, radius: float) -> None:
    """Add the paths of the frames with targets or, without targets, of the centre of mass."""
    names, data = path_names(robot, log), robot.create_data()
    lines = np.empty((max(len(names), 1), len(pictures.q), 3))
    for k, q in enumerate(pictures.q):
        lines[:, k] = pin.centerOfMass(robot.model, data, q)  # computes the forward kinematics too
        for i, name in enumerate(names):
            lines[i, k] = pin.updateFramePlacement(robot.model, data, robot.model.getFrameId(name)).translation
    for i, line in enumerate(lines):
        add_path(scene, f"/overlay/path/{i}", line, radius, COLORS["path"])


def _shares(log: TrajectoryLog, pictures: Pictures) -> Array:
    """Return the position of each picture in its interval, 0 to 1."""
    length = np.diff(log.times)[pictures.intervals]
    into = pictures.times + log.times[0] - log.times[pictures.intervals]
    share: Array = np.clip(into / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return share
