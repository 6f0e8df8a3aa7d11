"""The replay of a closed-loop run: its scene, and the contents of the page's panels."""

from __future__ import annotations

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Metrics, Run, WalkingMetrics, push_intervals
from lgmpc.runs.figures import length_unit
from lgmpc.runs.log import MODES
from lgmpc.runs.metrics import tilt_deg
from lgmpc.runs.walking import body_velocity
from lgmpc.typing import Array
from lgmpc.viz.body import Body, load_body
from lgmpc.viz.log_axes import friction_words
from lgmpc.viz.marks import COLORS, Scale
from lgmpc.viz.overlay import Frames, add_overlay
from lgmpc.viz.page import Readout, page_of, time_line
from lgmpc.viz.scene import Scene
from lgmpc.viz.stage import FLOOR_COLOR, add_stage, frame_camera
from lgmpc.viz.walking_overlay import SPEED_SHOWN_M_S, add_walking_overlay

__all__ = ["replay_page"]


def replay_page(robot: Robot, run: Run) -> str:
    """Return the page's HTML.

    Raises:
        InputError: if the log has no finite tick or is of another robot.
        MissingDependencyError: if meshcat is not installed.
    """
    log = run.log
    if log.ticks == 0 or not (np.isfinite(log.q[0]).all() and np.isfinite(log.v[0]).all()):
        raise InputError("run", f"{run.path} with {log.ticks} ticks, none finite", "a run of at least one finite tick")
    if log.q.shape[1] != robot.nq:
        raise InputError("run", f"{run.path} with nq = {log.q.shape[1]}", f"a run of {robot.name} (nq = {robot.nq})")
    frames = Frames.of(log)
    body = load_body(robot)
    lowest, highest = _bounds(body, log.q[frames.ticks], log.base_pose[frames.ticks, 2])
    height = float(highest[2] - lowest[2])
    weight = robot.mass * float(np.linalg.norm(robot.gravity))
    scale = Scale.of(height, weight, len(log.contact_frames))

    scene = Scene()
    travel = log.base_pose[frames.ticks, :3]
    fog = add_stage(scene, lowest, highest, travel)
    body.add_to(scene)
    body.animate(scene, frames.times, log.q[frames.ticks])
    add_overlay(scene, log, frames, scale, body.trunk_half_sides())
    add_walking_overlay(scene, log, frames, scale, height)
    impulses = np.array([push.impulse for push in push_intervals(log)]).reshape(-1, 3)
    camera = frame_camera(lowest, highest, travel, impulses)
    content = _description(run, frames, scale, body) | {"fog": [FLOOR_COLOR, *fog], "camera": camera}
    return page_of(f"{run.result.name} · lgmpc replay", scene, content)


def _bounds(body: Body, q: Array, base_height: Array) -> tuple[Array, Array]:
    """Return the corners of the robot's bounding box at the start, extended to the largest height of its base; m.

    A robot that starts on its belly is then also in the picture when it stands.
    """
    lowest, highest = body.bounds(q[0])
    low, high = body.bounds(q[int(np.argmax(base_height))])
    return np.append(lowest[:2], min(lowest[2], low[2])), np.append(highest[:2], max(highest[2], high[2]))


def _description(run: Run, frames: Frames, scale: Scale, body: Body) -> dict[str, object]:
    """Return the contents of the page's panels."""
    log, result = run.log, run.result
    base = log.base_pose[frames.ticks]
    origin = float(log.time[0])
    if log.commanded:
        first = Readout("speed", " m/s", np.linalg.norm(body_velocity(log)[frames.ticks, :2], axis=1), 2)
    else:
        moved = np.linalg.norm(base[:, :3] - base[0, :3], axis=1)
        unit, factor = length_unit(float(moved.max()))
        first = Readout("moved", f" {unit}", factor * moved, 1 if unit == "mm" else 2)
    tilt = tilt_deg(base[:, 3:], log.base_reference[0, 3:])
    names = dict(enumerate(MODES))
    modes = [] if log.mode is None else [names.get(mode, "") for mode in log.mode[frames.ticks].tolist()]
    pushes = []
    for push in push_intervals(log):
        size, lasts = float(np.linalg.norm(push.impulse)), push.end - push.start
        impulse = f"{size:.3g} N·s"
        label = f"push {size / lasts:.3g} N for {lasts:.2g} s"
        pushes.append({"start": push.start - origin, "end": push.end - origin, "impulse": impulse, "label": label})
    return {
        "name": result.name,
        "created": f"{result.when} · {body.robot.name}",
        "verdict": result.verdict.outcome.value,
        "reasons": list(result.verdict.reasons),
        "facts": _facts(run),
        "legend": _legend(run, scale),
        "pushes": pushes,
        "start": origin,
        "series": time_line(frames.times, (first, Readout("tilt", "°", tilt, 2)), modes),
    }


def _facts(run: Run) -> list[tuple[str, str]]:
    metrics = run.result.metrics
    if metrics is None:
        return []
    limit = float(run.log.effort_limit_over_time.max(initial=0.0))
    facts = [("stayed up", f"{metrics.survived_s:.1f} s"), ("largest tilt", f"{metrics.max_tilt_deg:.2f}°")]
    facts += _standing_facts(metrics) if metrics.walking is None else _walking_facts(metrics.walking)
    facts.append(("largest slip", f"{1e3 * metrics.max_slip_m:.2f} mm"))
    facts.append(("peak torque", f"{metrics.max_abs_torque_nm:.3g} of {limit:g} N·m"))
    if metrics.mpc_ms is not None:
        facts.append(("MPC update", f"{metrics.mpc_ms.p50:.2f} ms"))
    if metrics.wbc_ms is not None:
        facts.append(("whole-body tick", f"{1e3 * metrics.wbc_ms.p50:.0f} µs"))
    if metrics.real_time_factor is not None:
        facts.append(("real-time factor", f"{metrics.real_time_factor:.1f}"))
    return facts


def _standing_facts(metrics: Metrics) -> list[tuple[str, str]]:
    facts = [
        ("base moved", f"{1e3 * metrics.max_displacement_m:.1f} mm"),
        ("ended off by", f"{1e3 * metrics.final_position_error_m:.1f} mm, {metrics.final_tilt_deg:.2f}°"),
    ]
    if metrics.min_friction_margin_n is not None:
        facts.append(("friction margin", f"{round(metrics.min_friction_margin_n, 2) + 0.0:.2f} N"))
    return facts


def _walking_facts(walking: WalkingMetrics) -> list[tuple[str, str]]:
    facts = [("steps", f"{walking.steps}")]
    if walking.velocity_rmse_m_s is not None:
        facts.append(("velocity RMSE", f"{1e3 * walking.velocity_rmse_m_s:.1f} mm/s"))
    if walking.cost_of_transport is not None:
        facts.append(("cost of transport", f"{walking.cost_of_transport:.2f}"))
    if walking.recovery_time_s is not None:
        facts.append(("recovered within", f"{walking.recovery_time_s:.2f} s"))
    return facts


def _legend(run: Run, scale: Scale) -> list[dict[str, object]]:
    size = f"{100.0 * scale.length:.2g} cm = {scale.newtons:g} N"

    def entry(key: str, label: str, note: str = "", on: bool = True) -> dict[str, object]:
        return {"path": f"/overlay/{key}", "label": label, "note": note, "color": f"#{COLORS[key]:06x}", "on": on}

    entries = []
    if len(run.log.contact_frames):
        entries.append(entry("forces", "contact forces", size))
        entries.append(entry("planned", "planned forces", on=False))
        entries.append(entry("cones", "friction cones", f"µ = {friction_words(run.log)}"))
    entries.append(entry("com", "centre of mass", "orange: target"))
    if len(run.log.mpc_time):
        entries.append(entry("horizon", "predicted path"))
    if run.log.stepped:
        entries.append(entry("footholds", "next footholds"))
        entries.append(entry("swings", "swing paths"))
    if run.log.commanded:
        entries.append(
            entry("command", "commanded velocity", f"{100.0 * scale.length:.2g} cm = {SPEED_SHOWN_M_S:g} m/s")
        )
    if run.log.push.any():
        entries.append(entry("push", "push", size))
    entries.append(
        {"path": "/robot", "label": "see through the robot", "color": "#8794a3", "on": False, "action": "see-through"}
    )
    return entries
