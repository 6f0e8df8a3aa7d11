"""The replay of a run or of a solved trajectory: its scene, and the contents of the page's panels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Metrics, Run, RunLog, SolvedRun, TrajectoryLog, flat_metrics, push_intervals
from lgmpc.runs.figures import figure_number, figure_words, length_unit
from lgmpc.runs.intervals import intervals
from lgmpc.runs.log import MODES, tilt_deg
from lgmpc.runs.walking import body_velocity
from lgmpc.typing import Array
from lgmpc.viz import overlay
from lgmpc.viz.body import Body, load_body
from lgmpc.viz.marks import COLORS, Scale
from lgmpc.viz.page import Readout, page_of, time_line
from lgmpc.viz.scene import Scene
from lgmpc.viz.series import friction_words
from lgmpc.viz.stage import FLOOR_COLOR, add_stage, frame_camera
from lgmpc.world import World

_FACTS = 11
"""Number of figures of a solution on the card; all are in run.json."""
_WIDE = 2.5
"""Length of a motion, in lengths of the robot, above which the camera follows it; shorter ones fit into the picture."""

_TALL = 2.5
"""Ratio of a motion's height to its width, and to the robot's size, above which the camera follows it too."""
_CLEARANCE = 0.25
"""Height above the floor of robots that never touch it, in lengths of the robot or of its path."""
_FACTS_OF_RUNS = (
    "survived_s",
    "max_tilt_deg",
    "max_slip_m",
    "max_abs_torque_nm",
    "mpc_ms.p50",
    "wbc_ms.p50",
    "real_time_factor",
)
_FACTS_OF_STANDING = ("max_displacement_m", "final_position_error_m", "min_friction_margin_n")
_FACTS_OF_WALKING = (
    "walking.steps",
    "walking.velocity_rmse_m_s",
    "walking.cost_of_transport",
    "walking.recovery_time_s",
)
"""Metrics on the card."""
_Content = dict[str, object]


def replay_page(robot: Robot, run: Run | SolvedRun, ground: World | None = None) -> str:
    """Return the page's HTML.

    Args:
        robot: the robot.
        run: contents of the run folder.
        ground: of the run's world; the level floor at height 0 unless given.

    Raises:
        InputError: if the run has no finite tick, the trajectory is not finite, or it is of another robot.
        MissingDependencyError: if meshcat is not installed.
    """
    nq = run.log.nq if isinstance(run, SolvedRun) else run.log.q.shape[1]
    if nq != robot.nq:
        raise InputError("run", f"{run.path} with nq = {nq}", f"a run of {robot.name} (nq = {robot.nq})")
    scene, ground, result = Scene(), World() if ground is None else ground, run.result
    created = [result.when, robot.name]
    if isinstance(run, SolvedRun):
        content = _add_trajectory(scene, robot, run, ground)
        created.append(run.result.method)
    else:
        content = _add_run(scene, robot, run, ground)
    content |= {
        "name": result.name,
        "created": " · ".join(created),
        "verdict": result.verdict.outcome.value,
        "reasons": list(result.verdict.reasons),
    }
    return page_of(f"{result.name} · lgmpc replay", scene, content)


def _add_run(scene: Scene, robot: Robot, run: Run, ground: World) -> _Content:
    """Add a closed loop to the scene, and return the contents of the page's panels."""
    log = run.log
    if log.finite_ticks == 0:
        raise InputError("run", f"{run.path} with {log.ticks} ticks, none finite", "a run of at least one finite tick")
    frames = overlay.Frames.of(log)
    body = load_body(robot)
    travel = log.base_pose[frames.ticks, :3]
    lowest, highest = _bounds(body, log.q[frames.ticks], travel, ground)
    height = float(np.subtract(*body.bounds(robot.q_reference)[::-1])[2])  # that of a start on a slope is larger
    scale = Scale.of(height, robot.weight, robot.nf)
    fog = add_stage(scene, lowest, highest, travel, ground)
    body.add_to(scene)
    body.animate(scene, frames.times, log.q[frames.ticks])
    overlay.add_overlay(scene, log, frames, scale, ground, height, body.trunk_half_sides())
    impulses = np.array([push.impulse for push in push_intervals(log)]).reshape(-1, 3)
    notes = {"cones": f"µ = {friction_words(log)}", "com": "orange: target"}
    notes["command"] = f"{100.0 * scale.length:.2g} cm = {overlay.SPEED_SHOWN_M_S:g} m/s"
    names = dict(enumerate(MODES))
    modes = [names.get(mode, "") for mode in log.mode[frames.ticks].tolist()]
    return {
        "fog": [FLOOR_COLOR, *fog],
        "camera": frame_camera(lowest, highest, travel, impulses, ground),
        "facts": [] if run.result.metrics is None else _facts(run.result.metrics),
        "legend": _legend(scene, scale, **notes),
        "pushes": _pushes(log),
        "start": float(log.time[0]),
        "series": time_line(frames.times, _readouts(log, frames), modes),
    }


def _bounds(body: Body, q: Array, base: Array, ground: World) -> tuple[Array, Array]:
    """Return the corners of the robot's bounding box at the start, extended to its base's largest height above ground.

    A robot that starts on its belly is then also in the picture when it stands.
    """
    lowest, highest = body.bounds(q[0])
    below = ground.height(base[:, :2])
    highest_at = int(np.argmax(base[:, 2] - below))
    low, high = (corner - [0.0, 0.0, below[highest_at] - below[0]] for corner in body.bounds(q[highest_at]))
    return np.append(lowest[:2], min(lowest[2], low[2])), np.append(highest[:2], max(highest[2], high[2]))


def _readouts(log: RunLog, frames: overlay.Frames) -> tuple[Readout, ...]:
    """Return the readouts: speed of a robot that walks or distance of one that stands, and tilt."""
    base = log.base_pose[frames.ticks]
    if log.commanded:
        first = Readout("speed", " m/s", np.linalg.norm(body_velocity(log)[frames.ticks, :2], axis=1), 2)
    else:
        moved = np.linalg.norm(base[:, :3] - base[0, :3], axis=1)
        unit, factor = length_unit(float(moved.max()))
        first = Readout("moved", f" {unit}", factor * moved, 1 if unit == "mm" else 2)
    return first, Readout("tilt", "°", log.tilt_deg[frames.ticks], 2)


def _pushes(log: RunLog) -> list[_Content]:
    pushes: list[_Content] = []
    for push in push_intervals(log):
        start, end = (float(each - log.time[0]) for each in (push.start, push.end))
        size = float(np.linalg.norm(push.impulse))
        label = f"push {size / (end - start):.3g} N for {end - start:.2g} s"
        pushes.append({"start": start, "end": end, "impulse": f"{size:.3g} N·s", "label": label})
    return pushes


def _facts(metrics: Metrics) -> list[tuple[str, str]]:
    values = flat_metrics(metrics)
    shown = (*_FACTS_OF_RUNS, *(_FACTS_OF_STANDING if metrics.walking is None else _FACTS_OF_WALKING))
    return [_fact(name, value) for name in shown if (value := values.get(name)) is not None]


def _solved_facts(figures: Mapping[str, float]) -> list[tuple[str, str]]:
    hidden = ("complementarity", "constraint_violation")
    facts = [_fact(name, value) for name, value in figures.items() if not np.isnan(value) and name not in hidden]
    return facts[:_FACTS]


def _fact(name: str, value: float) -> tuple[str, str]:
    words, unit, scale = figure_words(name, value)
    return words, f"{figure_number(scale * value, unit)} {unit}".rstrip()


_SEE_THROUGH: _Content = {
    "path": "/robot",
    "label": "see through the robot",
    "color": "#8794a3",
    "on": False,
    "action": "see-through",
}


_LEGEND = {
    "forces": "contact forces",
    "planned": "planned forces",
    "cones": "friction cones",
    "com": "centre of mass",
    "horizon": "predicted path",
    "footholds": "next footholds",
    "belief": "ground as the robot believes",
    "swings": "swing paths",
    "command": "commanded velocity",
    "push": "push",
    "thrusts": "thrusts",
    "places": "places to reach",
    "path": "path",
}
"""Folders of the overlay, in the order of the legend, and their labels."""
_HIDDEN = ("planned",)
"""Folders that are hidden at first."""


def _legend(scene: Scene, scale: Scale, **notes: str) -> list[_Content]:
    """Return an entry for each folder of the overlay, which shows or hides it; notes by folder."""
    notes |= dict.fromkeys(("forces", "push", "thrusts"), f"{100.0 * scale.length:.2g} cm = {scale.newtons:g} N")
    present = [key for key in _LEGEND if scene.has(f"/overlay/{key}/")]
    entries: list[_Content] = [
        {
            "path": f"/overlay/{key}",
            "label": _LEGEND[key],
            "note": notes.get(key, ""),
            "color": f"#{COLORS[key]:06x}",
            "on": key not in _HIDDEN,
        }
        for key in present
    ]
    return [*entries, _SEE_THROUGH]


def _add_trajectory(scene: Scene, robot: Robot, run: SolvedRun, ground: World) -> _Content:
    """Add a solved trajectory to the scene, and return the contents of the page's panels."""
    log = run.log
    if not log.finite:
        raise InputError("run", f"{run.path}, whose trajectory contains NaN or infinity", "a trajectory to show")
    pictures = overlay.Pictures.of(robot, log)
    body = load_body(robot)
    frame = _Framing.of(body, log, pictures)
    carriers = max(len(log.contact_frames), len(overlay.thrusters(robot, log)))
    scale = Scale.of(max(frame.height, 0.4 * frame.size, 0.12 * frame.seen), robot.weight, carriers)
    corners = frame.lowest + frame.lift, frame.highest + frame.lift
    fog = add_stage(scene, *corners, frame.travel + frame.lift, ground)
    for group in ("/robot", "/overlay"):
        scene.place(group, frame.lift)
    body.add_to(scene)
    body.animate(scene, pictures.times, pictures.q)
    size = max(0.15 * frame.size, 0.05 * frame.seen)
    overlay.add_trajectory_overlay(scene, robot, log, pictures, scale, size, ground)
    path = ", ".join(overlay.path_names(robot, log)) or "centre of mass"
    return {
        "fog": [FLOOR_COLOR, *fog],
        "camera": frame_camera(*corners, frame.travel, np.zeros((0, 3)), ground),
        "facts": _solved_facts(run.result.figures),
        "legend": _legend(scene, scale, cones=f"µ = {log.friction:g}", path=path),
        "pushes": [],
        "phases": _phases(log),
        "marks": sorted({float(time - log.times[0]) for time in log.waypoint_times}),
        "start": float(log.times[0]),
        "series": time_line(pictures.times, _solved_readouts(log, pictures)),
    }


@dataclass(frozen=True)
class _Framing:
    """The camera's framing of a trajectory.

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
    def of(cls, body: Body, log: TrajectoryLog, pictures: overlay.Pictures) -> "_Framing":
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


def _solved_readouts(log: TrajectoryLog, pictures: overlay.Pictures) -> tuple[Readout, ...]:
    """Return the readouts: load of the actuators, and tilt or the fastest joint."""
    found = []
    limit = np.where(log.us > 0.0, log.control_upper, log.control_lower)
    if log.us.size and np.isfinite(limit).all():
        effort = 100.0 * np.max(np.abs(log.us) / np.maximum(np.abs(limit), 1e-12), axis=1)
        found.append(Readout("effort", " %", effort[pictures.intervals], 0))
    if log.floating_base:
        found.append(Readout("tilt", "°", tilt_deg(pictures.q[:, 3:7]), 1))
    else:
        speed = np.abs(log.xs[:, log.nq :]).max(axis=1)
        found.append(Readout("fastest joint", " rad/s", speed[pictures.intervals], 2))
    return tuple(found)


def _phases(log: TrajectoryLog) -> list[_Content]:
    """Return the phases of ground contact of each foot, if any foot swings."""
    if log.contact_flags.all() or not log.contact_flags.any():
        return []
    phases: list[_Content] = []
    for k, name in enumerate(log.contact_frames.tolist()):
        spans = [[float(log.times[a]), float(log.times[b])] for a, b in intervals(log.contact_flags[:, k])]
        phases.append({"name": name, "spans": [[a, b] for a, b in spans if b > a]})
    return phases
