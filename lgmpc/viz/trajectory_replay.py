"""The replay of a solved trajectory: robot, contact forces and cones, places to reach, paths; as a page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog
from lgmpc.runs.figures import figure_words
from lgmpc.runs.metrics import tilt_deg
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.body import Body, load_body
from lgmpc.viz.marks import COLORS, Arrow, Scale, add_ball, add_cone, add_path, add_place, add_plumb_line
from lgmpc.viz.page import Readout, page_of, time_line
from lgmpc.viz.scene import Scene
from lgmpc.viz.stage import FLOOR_COLOR, add_stage, frame_camera

__all__ = ["Pictures", "trajectory_page"]

_RATE_HZ, _MOST = 100.0, 3000
_FACTS = 11
"""Figures that fit the card; all are in run.json."""
_WIDE = 2.5
"""Motions of more than this many lengths of the robot are followed by the camera, smaller ones seen as a whole."""
_CLEARANCE = 0.25
"""How far above the floor what never touches it stays, in lengths of the robot."""


@dataclass(frozen=True)
class Pictures:
    """The pictures of a replay.

    Attributes:
        times: (k,) s from the start.
        intervals: (k,) the interval that each lies in.
        q: (k, nq) configurations, along the shortest way between the nodes'.
    """

    times: Array
    intervals: IntArray
    q: Array

    @classmethod
    def of(cls, robot: Robot, log: TrajectoryLog, rate_hz: float = _RATE_HZ, limit: int = _MOST) -> Pictures:
        """Choose pictures at ``rate_hz``, at most ``limit``, and interpolate the configurations on their manifold."""
        count = max(2, min(int(np.ceil((log.times[-1] - log.times[0]) * rate_hz)) + 1, limit))
        times = np.linspace(log.times[0], log.times[-1], count)
        # Behind an impact, whose two nodes have the same time, begins the next interval.
        intervals = np.clip(np.searchsorted(log.times, times, side="right") - 1, 0, log.nodes - 1)
        start, length = log.times[intervals], np.diff(log.times)[intervals]
        share = np.clip((times - start) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        states = log.xs[:, : log.nq]
        q = [pin.interpolate(robot.model, states[k], states[k + 1], s) for k, s in zip(intervals, share, strict=True)]
        return cls(times - log.times[0], intervals.astype(np.int64), np.array(q))


def trajectory_page(robot: Robot, run: SolvedRun) -> str:
    """Return the page's HTML.

    Raises:
        InputError: if the trajectory is not finite or belongs to another robot.
        MissingDependencyError: if meshcat is not installed.
    """
    log = run.trajectory
    if not log.finite:
        raise InputError("run", f"{run.path}, whose trajectory holds NaN or infinity", "a trajectory to show")
    if log.nq != robot.nq:
        raise InputError("run", f"{run.path} with nq = {log.nq}", f"a run of {robot.name} (nq = {robot.nq})")
    pictures = Pictures.of(robot, log)
    body = load_body(robot)
    frame = _Framing.of(body, log, pictures)
    scale = Scale.of(frame.height, robot.mass * float(np.linalg.norm(robot.gravity)), len(log.contact_frames))
    scene = Scene()
    fog = add_stage(scene, frame.lowest + frame.lift, frame.highest + frame.lift, frame.travel + frame.lift)
    for group in ("/robot", "/overlay"):
        scene.place(group, frame.lift)
    body.add_to(scene)
    body.animate(scene, pictures.times, pictures.q)
    _add_contacts(scene, log, pictures, scale)
    _add_com(scene, robot, log, pictures, scale, frame.lift)
    _add_places(scene, log, 0.22 * frame.size)
    paths = _add_paths(scene, robot, log, pictures, 0.004 * frame.size)
    camera = frame_camera(frame.lowest + frame.lift, frame.highest + frame.lift, frame.travel, np.zeros((0, 3)))
    content = _description(run, robot, pictures, scale, paths) | {"fog": [FLOOR_COLOR, *fog], "camera": camera}
    return page_of(f"{run.result.name} · lgmpc replay", scene, content)


@dataclass(frozen=True)
class _Framing:
    """What the camera looks at.

    Attributes:
        lowest: (3,) lowest corner of what should be seen at the start.
        highest: (3,) highest corner.
        travel: (k, 3) what the camera follows; all the same where it stays.
        lift: (3,) by which everything is raised above the floor.
        size: diagonal of the robot.
        height: of the robot at the start.
    """

    lowest: Array
    highest: Array
    travel: Array
    lift: Array
    size: float
    height: float

    @classmethod
    def of(cls, body: Body, log: TrajectoryLog, pictures: Pictures) -> _Framing:
        """See the whole motion or, if it leads far, the robot on its way."""
        chosen = np.unique(np.linspace(0, len(pictures.q) - 1, 24).astype(int))
        corners = np.array([body.bounds(q) for q in pictures.q[chosen]])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        if len(log.waypoint_positions):
            low = np.minimum(low, log.waypoint_positions.min(axis=0))
            high = np.maximum(high, log.waypoint_positions.max(axis=0))
        start_low, start_high = corners[0]
        size = float(np.linalg.norm(start_high - start_low))
        grounded = bool(log.contact_flags.any()) or not log.floating_base
        lift = np.zeros(3) if grounded else np.array([0.0, 0.0, max(_CLEARANCE * size - float(low[2]), 0.0)])
        height = float(start_high[2] - start_low[2])
        if grounded and log.floating_base and float(np.linalg.norm((high - low)[:2])) > _WIDE * size:
            return cls(start_low, start_high, pictures.q[:, :3], lift, size, height)
        still = np.tile(0.5 * (low + high), (len(pictures.times), 1))
        return cls(low, high, still, lift, size, height)


def _add_contacts(scene: Scene, log: TrajectoryLog, pictures: Pictures, scale: Scale) -> None:
    """Forces, held over each interval, and their cones while there is contact."""
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
    """Centre of mass with a plumb line to the floor, for robots that could fall over."""
    if not (log.floating_base and log.contact_flags.any()):
        return
    data = robot.create_data()
    com = np.array([pin.centerOfMass(robot.model, data, q).copy() for q in pictures.q])
    add_ball(scene, "/overlay/com/com", scale, pictures.times, com, None, target=False)
    add_plumb_line(scene, "/overlay/com/plumb", scale, pictures.times, com + lift)


def _add_places(scene: Scene, log: TrajectoryLog, size: float) -> None:
    for k, (position, rotation) in enumerate(zip(log.waypoint_positions, log.waypoint_rotations, strict=True)):
        place = rotation if np.isfinite(rotation).all() else None
        add_place(scene, f"/overlay/places/{k:03d}", size, position, place)


def _add_paths(scene: Scene, robot: Robot, log: TrajectoryLog, pictures: Pictures, radius: float) -> str:
    """Lines along which the frames go that have places to reach or, if none has, the centre of mass; say whose."""
    names = [name for name in dict.fromkeys(log.waypoint_names.tolist()) if robot.model.existFrame(name)]
    data = robot.create_data()
    lines = {name: np.empty((len(pictures.q), 3)) for name in names or ["centre of mass"]}
    for k, q in enumerate(pictures.q):
        com = pin.centerOfMass(robot.model, data, q)  # computes the forward kinematics too
        for name, line in lines.items():
            frame = pin.updateFramePlacement(robot.model, data, robot.model.getFrameId(name)) if names else None
            line[k] = com if frame is None else frame.translation
    for i, line in enumerate(lines.values()):
        add_path(scene, f"/overlay/path/{i}", line, radius, COLORS["path"])
    return ", ".join(lines)


def _shares(log: TrajectoryLog, pictures: Pictures) -> Array:
    """How far each picture is into its interval, 0 to 1."""
    length = np.diff(log.times)[pictures.intervals]
    into = pictures.times + log.times[0] - log.times[pictures.intervals]
    share: Array = np.clip(into / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return share


def _description(run: SolvedRun, robot: Robot, pictures: Pictures, scale: Scale, paths: str) -> dict[str, object]:
    """Return what the page's panels say."""
    log, result = run.trajectory, run.result
    when = result.created.replace("T", " ").replace("+00:00", " UTC")
    return {
        "name": result.name,
        "created": f"{when} · {robot.name} · {result.method}",
        "verdict": result.verdict.outcome.value,
        "reasons": list(result.verdict.reasons),
        "facts": _facts(run),
        "legend": _legend(log, scale, paths),
        "pushes": [],
        "phases": _phases(log),
        "marks": sorted({float(time - log.times[0]) for time in log.waypoint_times}),
        "start": float(log.times[0]),
        "series": time_line(pictures.times, _readouts(log, pictures)),
    }


def _readouts(log: TrajectoryLog, pictures: Pictures) -> tuple[Readout, ...]:
    """How hard the machine works, and how far it leans or how fast its joints are."""
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
    """When each foot is on the ground, if any ever leaves it."""
    if log.contact_flags.all() or not log.contact_flags.any():
        return []
    phases: list[dict[str, object]] = []
    for k, name in enumerate(log.contact_frames.tolist()):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], log.contact_flags[:, k].astype(np.int8), [0]))))
        spans = [[float(log.times[a]), float(log.times[b])] for a, b in zip(edges[::2], edges[1::2], strict=True)]
        phases.append({"name": name, "spans": [[a, b] for a, b in spans if b > a]})
    return phases


def _facts(run: SolvedRun) -> list[tuple[str, str]]:
    facts = []
    for name, value in run.result.figures.items():
        words, unit, scale = figure_words(name)
        if not np.isnan(value) and name not in ("complementarity", "constraint_violation"):
            shown = f"{scale * value:.0f}" if 1e3 <= abs(scale * value) < 1e6 else f"{scale * value:.3g}"
            facts.append((words, f"{shown} {unit}".rstrip()))
    return facts[:_FACTS]


def _legend(log: TrajectoryLog, scale: Scale, paths: str) -> list[dict[str, object]]:
    def entry(key: str, label: str, note: str = "") -> dict[str, object]:
        color = COLORS["target" if key == "places" else key]
        return {"path": f"/overlay/{key}", "label": label, "note": note, "color": f"#{color:06x}", "on": True}

    entries = []
    if log.contact_flags.any():
        entries.append(entry("forces", "contact forces", f"{100.0 * scale.length:.2g} cm = {scale.newtons:g} N"))
        if np.isfinite(log.friction):
            entries.append(entry("cones", "friction cones", f"µ = {log.friction:g}"))
        entries.append(entry("com", "centre of mass"))
    if len(log.waypoint_names):
        entries.append(entry("places", "places to reach"))
    entries.append(entry("path", "path", paths))
    entries.append(
        {"path": "/robot", "label": "see through the robot", "color": "#8794a3", "on": False, "action": "see-through"}
    )
    return entries
