"""Overlays of a replay: forces, friction cones, centre of mass and target, prediction, pushes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.runs import RunLog
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.marks import COLORS, Arrow, Scale, add_ball, add_cone, add_plumb_line
from lgmpc.viz.mesh import sphere
from lgmpc.viz.scene import Material, Scene

__all__ = ["Frames", "add_overlay"]

_NEAR_SLIP = 0.1
"""A cone has the warning colour if the friction margin is less than this fraction of ``mu f_n``."""


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
    def of(cls, log: RunLog, rate_hz: float = 50.0, limit: int = 3000) -> Frames:
        """Return pictures at ``rate_hz``, at most ``limit``, up to the first state that is not finite."""
        finite = np.isfinite(log.q).all(axis=1)
        end = log.ticks if finite.all() else int(np.argmin(finite))
        elapsed = log.time[:end] - log.time[0]
        count = min(int(elapsed[-1] * rate_hz) + 1, limit)
        if count < 2:
            return cls(np.zeros(1), np.zeros(1, dtype=np.int64))
        wanted = np.linspace(0.0, elapsed[-1], count)
        ticks = np.unique(np.clip(np.searchsorted(elapsed, wanted), 0, end - 1)).astype(np.int64)
        return cls(elapsed[ticks], ticks)

    def mean(self, values: Array) -> Array:
        """Return the mean of a channel from each picture to the next."""
        return np.add.reduceat(values[: self.ticks[-1] + 1], self.ticks, axis=0) / np.diff(
            self.ticks, append=self.ticks[-1] + 1
        ).reshape(-1, *[1] * (values.ndim - 1))


def add_overlay(scene: Scene, log: RunLog, frames: Frames, scale: Scale, trunk_half_sides: Array) -> None:
    """Add the overlays below ``/overlay``, one folder for each that the page can show or hide."""
    _add_contacts(scene, log, frames, scale)
    _add_com(scene, log, frames, scale)
    if len(log.mpc_time):
        _add_horizon(scene, log, frames, scale)
    _add_push(scene, log, frames, scale, trunk_half_sides)


def _add_contacts(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    measured, planned = frames.mean(log.contact_forces), frames.mean(log.contact_forces_desired)
    limit = log.friction_over_time[:, None] * log.contact_forces[..., 2]
    near = limit - np.linalg.norm(log.contact_forces[..., :2], axis=2) < _NEAR_SLIP * limit
    closed = log.contact_forces[..., 2] > 0.02 * scale.newtons
    slipping = frames.mean((near & closed).astype(np.float64)) > 0.0
    touching = frames.mean(closed.astype(np.float64)) > 0.0
    floor = log.friction_over_time[frames.ticks]
    frictions = np.unique(floor).tolist()
    for k, name in enumerate(log.contact_frames.tolist()):
        point = log.contact_points[frames.ticks, k]
        for folder, warn, shown in (
            ("cones", False, touching[:, k] & ~slipping[:, k]),
            ("slipping", True, touching[:, k] & slipping[:, k]),
        ):
            for friction in frictions:
                path = f"/overlay/cones/{folder}/{name}" + (f"/{friction:g}" if len(frictions) > 1 else "")
                add_cone(scene, path, friction, scale, frames.times, point, shown & (floor == friction), warn=warn)
        for folder, force, width in (("forces", measured[:, k], 1.0), ("planned", planned[:, k], 0.7)):
            arrow = Arrow(f"/overlay/{folder}/{name}", COLORS[folder], width, scale)
            arrow.add(scene)
            arrow.animate(scene, frames.times, point, force)


def _add_com(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    com, target = log.com[frames.ticks], log.com_reference[frames.ticks]
    known: BoolArray = np.asarray(np.isfinite(target).all(axis=1))
    target = np.where(known[:, None], target, com)
    add_ball(scene, "/overlay/com/com", scale, frames.times, com, None, target=False)
    add_ball(scene, "/overlay/com/target", scale, frames.times, target, known, target=True)
    add_plumb_line(scene, "/overlay/com/plumb", scale, frames.times, com)


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
        clearance = np.empty(len(force))
        for k, (along, pose) in enumerate(zip(direction, log.q[frames.ticks, :7], strict=True)):
            in_body = np.abs(pin.XYZQUATToSE3(pose).rotation.T @ along)
            clearance[k] = np.min(trunk_half_sides / np.maximum(in_body, 1e-9)) if size[k] else 0.0
        point = point - (clearance + 0.03 * scale.length)[:, None] * direction
    arrow = Arrow("/overlay/push/force", COLORS["push"], 2.0, scale)
    arrow.add(scene)
    arrow.animate(scene, frames.times, point - scale.metres_per_newton * force, force)
