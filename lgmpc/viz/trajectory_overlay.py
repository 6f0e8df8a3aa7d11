"""Overlays of the replay of a solved trajectory: contacts, thrusts, targets, paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.runs import TrajectoryLog
from lgmpc.runs.ground import along_ground
from lgmpc.typing import Array, IntArray
from lgmpc.viz.marks import COLORS, Contacts, Scale, add_arrow, add_ball, add_path, add_place, add_plumb_line
from lgmpc.viz.scene import Scene
from lgmpc.world import Terrain

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
        shares: (k,) position of each picture in its interval, 0 to 1.
        q: (k, nq) configurations, interpolated between those of the nodes.
    """

    times: Array
    intervals: IntArray
    shares: Array
    q: Array

    @classmethod
    def of(cls, robot: Robot, log: TrajectoryLog, rate_hz: float = _RATE_HZ, limit: int = _MOST) -> Pictures:
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


def _contacts(log: TrajectoryLog, pictures: Pictures, ground: Terrain) -> Contacts:
    """Return the contacts, with forces that are constant over each interval."""
    at, shares = pictures.intervals, pictures.shares[:, None, None]
    points = log.contact_points[at] + shares * (log.contact_points[at + 1] - log.contact_points[at])
    normals = ground.normal(points[:, :, :2].reshape(-1, 2)).reshape(points.shape)
    touching = log.contact_flags[at]
    forces = np.where(touching[:, :, None], log.contact_forces[at], 0.0)
    normal, tangential = np.einsum("kci,kci->kc", forces, normals), along_ground(forces, normals)
    friction = np.full(len(at), log.friction)
    outside = np.isfinite(log.friction) & (tangential > 1.001 * np.nan_to_num(log.friction, posinf=0.0) * normal + 1e-9)
    return Contacts(log.contact_frames.tolist(), pictures.times, points, normals, forces, friction, touching, outside)
