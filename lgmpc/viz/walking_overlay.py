"""Overlays of the replay of a walking run: footholds, swing paths, and the commanded velocity."""

from __future__ import annotations

import numpy as np

from lgmpc.runs import RunLog
from lgmpc.runs.intervals import intervals
from lgmpc.runs.walking import heading
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.marks import COLORS, Arrow, Scale
from lgmpc.viz.mesh import disc, sphere
from lgmpc.viz.overlay import Frames
from lgmpc.viz.scene import Material, Scene

__all__ = ["SPEED_SHOWN_M_S", "add_walking_overlay"]

SPEED_SHOWN_M_S = 0.5
"""Velocity whose arrow has the scale's length, m/s."""

_BEADS = 9


def add_walking_overlay(scene: Scene, log: RunLog, frames: Frames, scale: Scale, height: float) -> None:
    """Add the steps and commands of a run below ``/overlay``; nothing where there are none.

    Args:
        scene: the scene.
        log: the run.
        frames: the pictures.
        scale: sizes.
        height: of the robot, m; the command's arrow is above it.
    """
    for foot, name in enumerate(log.contact_frames.tolist()):
        if log.stance is not None and not log.stance[:, foot].all():
            _add_foothold(scene, log, frames, scale, foot, name)
            _add_swing(scene, log, frames, scale, foot, name)
    if log.commanded:
        _add_command(scene, log, frames, scale, height)


def _add_foothold(scene: Scene, log: RunLog, frames: Frames, scale: Scale, foot: int, name: str) -> None:
    """Add a disc at the foothold of a foot while it swings."""
    assert log.footholds is not None and log.stance is not None
    path = f"/overlay/footholds/{name}"
    scene.add_mesh(path, disc(0.16 * scale.length, 0.003), Material(COLORS["footholds"], 0.8, flat=True))
    place = log.footholds[frames.ticks, foot] + [0.0, 0.0, 0.001]
    scene.animate(path, frames.times, position=place, visible=log.stance[frames.ticks, foot] == 0)


def _add_swing(scene: Scene, log: RunLog, frames: Frames, scale: Scale, foot: int, name: str) -> None:
    """Add beads along the reference of the current swing, from lift-off to touchdown."""
    assert log.swing_targets is not None and log.stance is not None
    beads = np.zeros((len(frames.ticks), _BEADS, 3))
    shown: BoolArray = np.zeros(len(frames.ticks), dtype=np.bool_)
    for begin, end in intervals(log.stance[:, foot] == 0):
        pictures = (frames.ticks >= begin) & (frames.ticks < end)
        along: IntArray = np.round(np.linspace(begin, end - 1, _BEADS)).astype(np.int64)
        beads[pictures] = log.swing_targets[along, foot]
        shown |= pictures
    # Visibility is a step function of time, the rest is interpolated: a bead must not move until it is hidden.
    beads = beads[np.maximum.accumulate(np.where(shown, np.arange(len(shown)), 0))]
    for bead in range(_BEADS):
        path = f"/overlay/swings/{name}/{bead}"
        scene.add_mesh(path, sphere(0.032 * scale.length), Material(COLORS["swings"], 0.9, on_top=True))
        scene.animate(path, frames.times, position=beads[:, bead], visible=shown)


def _add_command(scene: Scene, log: RunLog, frames: Frames, scale: Scale, height: float) -> None:
    """Add an arrow above the base along the commanded velocity."""
    assert log.command is not None
    base = log.base_pose[frames.ticks]
    yaw = heading(base[:, 3:])
    command = log.command[frames.ticks]
    tail = np.column_stack((base[:, :2], np.full(len(base), base[:, 2].max() + 0.3 * height)))
    arrow = Arrow("/overlay/command/velocity", COLORS["command"], 1.4, Scale(scale.length, SPEED_SHOWN_M_S))
    arrow.add(scene)
    arrow.animate(scene, frames.times, tail, _world(command, yaw))


def _world(command: Array, yaw: Array) -> Array:
    """Return velocities ahead and to the left in world axes (k, 3)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = c * command[:, 0] - s * command[:, 1], s * command[:, 0] + c * command[:, 1]
    return np.column_stack((x, y, 0.0 * x))
