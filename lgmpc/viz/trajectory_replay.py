"""The replay of a solved trajectory: robot, contact forces and cones, targets, paths; as a page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog
from lgmpc.runs.figures import figure_number, figure_words
from lgmpc.runs.intervals import intervals
from lgmpc.runs.metrics import tilt_deg
from lgmpc.typing import Array
from lgmpc.viz.body import Body, load_body
from lgmpc.viz.marks import COLORS, Scale
from lgmpc.viz.page import Readout, page_of, time_line
from lgmpc.viz.scene import Scene
from lgmpc.viz.stage import FLOOR_COLOR, add_stage, frame_camera
from lgmpc.viz.trajectory_overlay import Pictures, add_trajectory_overlay, path_names, thrusters

__all__ = ["trajectory_page"]

_FACTS = 11
"""Number of figures on the card; all are in run.json."""
_WIDE = 2.5
"""Length of a motion, in lengths of the robot, above which the camera follows it; shorter ones fit into the picture."""

_TALL = 2.5
"""Ratio of a motion's height to its width, and to the robot's size, above which the camera follows it too."""
_CLEARANCE = 0.25
"""Height above the floor of robots that never touch it, in lengths of the robot or of its path."""


def trajectory_page(robot: Robot, run: SolvedRun) -> str:
    """Return the page's HTML.

    Raises:
        InputError: if the trajectory is not finite or is of another robot.
        MissingDependencyError: if meshcat is not installed.
    """
    log = run.trajectory
    if not log.finite:
        raise InputError("run", f"{run.path}, whose trajectory contains NaN or infinity", "a trajectory to show")
    if log.nq != robot.nq:
        raise InputError("run", f"{run.path} with nq = {log.nq}", f"a run of {robot.name} (nq = {robot.nq})")
    pictures = Pictures.of(robot, log)
    body = load_body(robot)
    frame = _Framing.of(body, log, pictures)
    weight = robot.mass * float(np.linalg.norm(robot.gravity))
    carriers = max(len(log.contact_frames), len(thrusters(robot, log)))
    scale = Scale.of(max(frame.height, 0.4 * frame.size, 0.12 * frame.seen), weight, carriers)
    scene = Scene()
    fog = add_stage(scene, frame.lowest + frame.lift, frame.highest + frame.lift, frame.travel + frame.lift)
    for group in ("/robot", "/overlay"):
        scene.place(group, frame.lift)
    body.add_to(scene)
    body.animate(scene, pictures.times, pictures.q)
    add_trajectory_overlay(scene, robot, log, pictures, scale, max(0.15 * frame.size, 0.05 * frame.seen), frame.lift)
    camera = frame_camera(frame.lowest + frame.lift, frame.highest + frame.lift, frame.travel, np.zeros((0, 3)))
    content = _description(run, robot, pictures, scale) | {"fog": [FLOOR_COLOR, *fog], "camera": camera}
    return page_of(f"{run.result.name} · lgmpc replay", scene, content)


@dataclass(frozen=True)
class _Framing:
    """The camera's framing of the motion.

    Attributes:
        lowest: (3,) lowest corner of the visible volume at the start.
        highest: (3,) highest corner.
        travel: (k, 3) positions that the camera follows; constant if it does not move.
        lift: (3,) displacement of the scene above the floor.
        size: diagonal of the robot.
        height: of the robot at the start.
    """

    lowest: Array
    highest: Array
    travel: Array
    lift: Array
    size: float
    height: float

    @property
    def seen(self) -> float:
        """Diagonal of the visible volume at the start."""
        return float(np.linalg.norm(self.highest - self.lowest))

    @classmethod
    def of(cls, body: Body, log: TrajectoryLog, pictures: Pictures) -> _Framing:
        """Return the framing of the whole motion or, if it is long, of the moving robot."""
        chosen = np.unique(np.linspace(0, len(pictures.q) - 1, 24).astype(int))
        corners = np.array([body.bounds(q) for q in pictures.q[chosen]])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        if len(log.waypoint_positions):
            low = np.minimum(low, log.waypoint_positions.min(axis=0))
            high = np.maximum(high, log.waypoint_positions.max(axis=0))
        start_low, start_high = corners[0]
        size = float(np.linalg.norm(start_high - start_low))
        grounded = bool(log.contact_flags.any()) or not log.floating_base
        extent = float((high - low).max())
        lift = np.zeros(3)
        if not grounded and not _CLEARANCE * size <= low[2] <= extent:  # below the floor, or far above it
            lift[2] = max(_CLEARANCE * size, _CLEARANCE * extent) - low[2]
        height = float(start_high[2] - start_low[2])
        width, tall = float(np.linalg.norm((high - low)[:2])), float((high - low)[2])
        far = log.floating_base and width > _WIDE * size if grounded else tall > _TALL * max(width, size)
        if far:
            return cls(start_low, start_high, pictures.q[:, :3], lift, size, height)
        if not grounded:
            low = np.array([low[0], low[1], -lift[2]])  # down to the floor, which shows the shadows
        still = np.tile(0.5 * (low + high), (len(pictures.times), 1))
        return cls(low, high, still, lift, size, height)


def _description(run: SolvedRun, robot: Robot, pictures: Pictures, scale: Scale) -> dict[str, object]:
    """Return the contents of the page's panels."""
    log, result = run.trajectory, run.result
    return {
        "name": result.name,
        "created": f"{result.when} · {robot.name} · {result.method}",
        "verdict": result.verdict.outcome.value,
        "reasons": list(result.verdict.reasons),
        "facts": _facts(run),
        "legend": _legend(robot, log, scale),
        "pushes": [],
        "phases": _phases(log),
        "marks": sorted({float(time - log.times[0]) for time in log.waypoint_times}),
        "start": float(log.times[0]),
        "series": time_line(pictures.times, _readouts(log, pictures)),
    }


def _readouts(log: TrajectoryLog, pictures: Pictures) -> tuple[Readout, ...]:
    """Return the readouts: load of the actuators, and tilt or the fastest joint."""
    found = []
    limit = np.where(log.us > 0.0, log.control_upper, log.control_lower)
    if log.us.size and np.isfinite(limit).all():
        effort = 100.0 * np.max(np.abs(log.us) / np.maximum(np.abs(limit), 1e-12), axis=1)
        found.append(Readout("effort", " %", effort[pictures.intervals], 0))
    if log.floating_base:
        found.append(Readout("tilt", "°", tilt_deg(pictures.q[:, 3:7], np.array([0.0, 0.0, 0.0, 1.0])), 1))
    else:
        speed = np.abs(log.xs[:, log.nq :]).max(axis=1)
        found.append(Readout("fastest joint", " rad/s", speed[pictures.intervals], 2))
    return tuple(found)


def _phases(log: TrajectoryLog) -> list[dict[str, object]]:
    """Return the phases of ground contact of each foot, if any foot swings."""
    if log.contact_flags.all() or not log.contact_flags.any():
        return []
    phases: list[dict[str, object]] = []
    for k, name in enumerate(log.contact_frames.tolist()):
        spans = [[float(log.times[a]), float(log.times[b])] for a, b in intervals(log.contact_flags[:, k])]
        phases.append({"name": name, "spans": [[a, b] for a, b in spans if b > a]})
    return phases


def _facts(run: SolvedRun) -> list[tuple[str, str]]:
    facts = []
    for name, value in run.result.figures.items():
        words, unit, scale = figure_words(name, value)
        if not np.isnan(value) and name not in ("complementarity", "constraint_violation"):
            facts.append((words, f"{figure_number(scale * value, unit)} {unit}".rstrip()))
    return facts[:_FACTS]


def _legend(robot: Robot, log: TrajectoryLog, scale: Scale) -> list[dict[str, object]]:
    def entry(key: str, label: str, note: str = "") -> dict[str, object]:
        color = COLORS["target" if key == "places" else key]
        return {"path": f"/overlay/{key}", "label": label, "note": note, "color": f"#{color:06x}", "on": True}

    entries = []
    if log.contact_flags.any():
        entries.append(entry("forces", "contact forces", f"{100.0 * scale.length:.2g} cm = {scale.newtons:g} N"))
        if np.isfinite(log.friction):
            entries.append(entry("cones", "friction cones", f"µ = {log.friction:g}"))
        entries.append(entry("com", "centre of mass"))
    if thrusters(robot, log):
        entries.append(entry("thrusts", "thrusts", f"{100.0 * scale.length:.2g} cm = {scale.newtons:g} N"))
    if len(log.waypoint_names):
        entries.append(entry("places", "places to reach"))
    entries.append(entry("path", "path", ", ".join(path_names(robot, log)) or "centre of mass"))
    entries.append(
        {"path": "/robot", "label": "see through the robot", "color": "#8794a3", "on": False, "action": "see-through"}
    )
    return entries
