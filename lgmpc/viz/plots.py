"""Figures of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.runs import Run, RunLog
from lgmpc.runs.estimate import tilt_and_yaw_deg
from lgmpc.runs.figures import length_unit
from lgmpc.runs.metrics import rpy_deg
from lgmpc.viz.figure_files import (
    Drawing,
    Plots,
    draw_figures,
    figure_title,
    joint_kinds,
    joint_style,
    legend_above,
    legend_of_joints,
)
from lgmpc.viz.series import draw_efforts, draw_forces, draw_xyz, finish, friction_words, label_modes, label_pushes
from lgmpc.viz.style import INK, LIMIT, X, Y, Z
from lgmpc.viz.walking_plots import draw_feet, draw_gait, draw_velocity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES", "plot_run", "run_drawings"]


def plot_run(run: Run) -> Plots:
    """Draw the figures of a run: base, attitude, velocity, gait, feet, centre of mass, joints, forces, torques, ...

    Args:
        run: contents of the run folder.

    Returns:
        The figures with data.

    Raises:
        InputError: if the log has fewer than two ticks.
        MissingDependencyError: if matplotlib is not installed.
    """
    return draw_figures(run_drawings(run), figure_title(run.result))


def run_drawings(run: Run) -> dict[str, Drawing]:
    """Return the drawings of a run by their names; each returns whether there was data.

    Raises:
        InputError: if the log has fewer than two ticks.
    """
    if run.log.ticks < 2:
        raise InputError("run", f"{run.path} with {run.log.ticks} ticks", "a run of at least two ticks")
    return {name: _drawing(draw, run.log) for name, draw in FIGURES.items()}


def _drawing(draw: Callable[[Figure, RunLog], bool], log: RunLog) -> Drawing:
    return lambda figure: draw(figure, log)


def _base(figure: Figure, log: RunLog) -> bool:
    figure.set_size_inches(8.0, 6.2)
    position, height, tilt = figure.subplots(3, 1, sharex=True)
    base = log.base_pose
    moved = base[:, :2] - base[0, :2]
    unit, scale = length_unit(float(np.abs(moved).max()))
    for axis, color, name in ((0, X, "x (forward)"), (1, Y, "y (left)")):
        position.plot(log.time, scale * moved[:, axis], color=color, label=name)
    target = log.above_ground(log.base_reference[:, :3])
    height.plot(log.time, 1e3 * target, color=INK, lw=1.0, ls="--", label="target")
    height.plot(log.time, 1e3 * log.base_height, color=Z, label="base")
    tilt.plot(log.time, log.tilt_deg, color=X)
    position.set(title="Base displacement", ylabel=unit)
    height.set(title="Base height above the ground", ylabel="mm")
    tilt.set(title="Base tilt from upright", ylabel="deg", xlabel="time, s", ylim=(0.0, None))
    finish(log, position, span=2e-3 * scale)
    finish(log, height, span=2.0)
    finish(log, tilt)
    label_pushes(log, [position])
    label_modes(log, height)
    legend_above(position, height)
    return True


def _attitude(figure: Figure, log: RunLog) -> bool:
    if not log.floating_base:
        return False
    figure.set_size_inches(8.0, 4.8)
    angles, rates = figure.subplots(2, 1, sharex=True)
    draw_xyz(angles, log.time, rpy_deg(log.base_pose[:, 3:]), ("roll, x", "pitch, y", "yaw, z"))
    draw_xyz(rates, log.time, log.v[:, 3:6], lw=1.1)
    angles.set(title="Base attitude", ylabel="deg")
    rates.set(title="Angular velocity, base axes", ylabel="rad/s", xlabel="time, s")
    finish(log, angles, span=0.2)
    finish(log, rates, span=0.02)
    label_pushes(log, [angles])
    legend_above(angles)
    return True


def _com(figure: Figure, log: RunLog) -> bool:
    figure.set_size_inches(9.6, 5.6)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.7, 1.0))
    first = figure.add_subplot(grid[0, 0])
    rows = [first, *(figure.add_subplot(grid[axis, 0], sharex=first) for axis in (1, 2))]
    unit, scale = length_unit(float(np.ptp(log.com[:, :2], axis=0).max()))
    target: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": "--"}
    for axis, (axes, color, name) in enumerate(zip(rows, (X, Y, Z), "xyz", strict=True)):
        each, factor = (unit, scale) if axis < 2 else ("mm", 1e3)
        axes.plot(log.time, factor * log.com_reference[:, axis], **target, label="target")
        axes.plot(log.time, factor * log.com[:, axis], color=color, label="centre of mass")
        axes.set_ylabel(f"{name}, {each}")
        finish(log, axes, span=2e-3 * factor)
    label_pushes(log, [first])
    first.set_title("Centre of mass and its target")
    legend_above(first)
    rows[2].set_xlabel("time, s")
    above = figure.add_subplot(grid[:, 1])
    moves = bool(np.ptp(log.com_reference[:, :2], axis=0).any())
    above.plot(*scale * log.com_reference[:, :2].T, **target, marker="" if moves else ".", label="target")
    above.plot(*scale * log.com[:, :2].T, color=X, label="centre of mass")
    above.set(title="Seen from above", xlabel=f"x, {unit}", ylabel=f"y, {unit}")
    above.set_aspect("equal", adjustable="datalim")
    return True


def _joints(figure: Figure, log: RunLog) -> bool:
    """Draw positions and velocities: a row for each kind of joint that all legs have, else one for all."""
    names: list[str] = log.joint_names.tolist()
    if not names:
        return False
    kinds = joint_kinds(names)
    rows = kinds or {"": list(range(len(names)))}
    figure.set_size_inches(9.6, 1.2 + (1.7 if kinds else 3.0) * len(rows))
    grid = figure.subplots(len(rows), 2, sharex=True, squeeze=False)
    first = 7 if log.floating_base else 0
    scalar = log.q.shape[1] - first == len(names)  # a joint may have more coordinates than degrees of freedom
    for (position, velocity), (kind, joints) in zip(grid, rows.items(), strict=True):
        for count, joint in enumerate(joints):
            label = names[joint].partition("_")[0] if kinds else names[joint]
            style = {**joint_style(count), "lw": 1.1, "label": label}
            position.plot(log.time, log.q[:, first + joint] if scalar else np.full(log.ticks, np.nan), **style)
            velocity.plot(log.time, log.joint_velocity[:, joint], **style)
        position.set(title=f"Position{kind and ', '}{kind}", ylabel="rad")
        velocity.set(title=f"Velocity{kind and ', '}{kind}", ylabel="rad/s")
        finish(log, position, span=0.01)
        finish(log, velocity, span=0.02)
    for axes in grid[-1]:
        axes.set_xlabel("time, s")
    label_pushes(log, grid[0])
    legend_of_joints(grid[0, 1], len(next(iter(rows.values()))))
    return True


def _forces(figure: Figure, log: RunLog) -> bool:
    """Draw each contact's normal force, planned and measured, and its tangential force over its friction limit."""
    if not len(log.contact_frames):
        return False
    names, words = log.contact_frames.tolist(), friction_words(log)
    planned = np.einsum("nki,nki->nk", log.contact_forces_desired, log.contact_normals)
    forces = log.normal_forces, log.tangential_forces, log.friction_limits
    rows = draw_forces(figure, names, log.time, *forces, words, planned=planned)
    finish(log, *rows.flat)
    label_pushes(log, rows[0])
    return True


def _torques(figure: Figure, log: RunLog) -> bool:
    """Draw torques and their limits."""
    names: list[str] = log.joint_names.tolist()
    if not names:
        return False
    limit = log.effort_limit_over_time
    all_axes = draw_efforts(figure, "Torque", "N.m", names, log.time, log.tau, -limit, limit)
    finish(log, *all_axes)
    label_pushes(log, all_axes[:1])
    return True


def _timing(figure: Figure, log: RunLog) -> bool:
    parts = [
        (name, milliseconds, 1e3 * period, color)
        for name, milliseconds, period, color in (
            ("MPC update", log.mpc_ms, log.mpc_period_s, X),
            ("Whole-body tick", log.wbc_ms, log.control_period_s, Z),
            ("Estimator", np.zeros(0) if log.estimate_ms is None else log.estimate_ms, log.control_period_s, Y),
        )
        if len(milliseconds)
    ]
    if not parts:
        return False
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure.set_size_inches(4.8 * len(parts), 3.6)
    for axes, (name, milliseconds, period, color) in zip(
        figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True
    ):
        low, high = max(float(milliseconds.min()), 1e-4), max(float(milliseconds.max()), 1.1e-4)
        wide = high > 10.0 * low
        bins = (np.geomspace if wide else np.linspace)(0.95 * low, 1.05 * high, 60)
        axes.hist(milliseconds, bins=bins, color=color, alpha=0.85)
        if wide:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
        if high > 0.2 * period:
            axes.axvline(period, color=LIMIT, ls="--", lw=1.2, label=f"period {period:g} ms")
        p50, p99 = np.percentile(milliseconds, [50.0, 99.0])
        axes.axvline(float(p50), color=INK, lw=1.2, label=f"median {p50:.3g} ms")
        axes.axvline(float(p99), color=INK, lw=1.2, ls=":", label=f"99 % {p99:.3g} ms")
        axes.set(title=f"{name} (every {period:g} ms)", xlabel="duration, ms", ylabel="count")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3, columnspacing=1.2, handlelength=1.5)
    return True


def _estimate(figure: Figure, log: RunLog) -> bool:
    if log.estimate_q is None or log.estimate_v is None:
        return False
    figure.set_size_inches(8.0, 6.2)
    position, attitude, velocity = figure.subplots(3, 1, sharex=True)
    draw_xyz(position, log.time, 1e3 * (log.estimate_q[:, :3] - log.q[:, :3]))
    draw_xyz(velocity, log.time, 1e3 * (log.estimate_v[:, :3] - log.v[:, :3]), lw=0.9)
    tilt, yaw = tilt_and_yaw_deg(log.estimate_q[:, 3:7], log.q[:, 3:7])
    attitude.plot(log.time, tilt, color=X, label="tilt")
    attitude.plot(log.time, yaw, color=Y, label="yaw")
    position.set(title="Error of the estimated base position", ylabel="mm")
    attitude.set(title="Error of the estimated orientation", ylabel="deg")
    velocity.set(title="Error of the estimated velocity, base axes", ylabel="mm/s", xlabel="time, s")
    finish(log, position, attitude, velocity)
    label_pushes(log, [position])
    legend_above(position, attitude)
    return True


FIGURES: dict[str, Callable[[Figure, RunLog], bool]] = {
    "base": _base,
    "attitude": _attitude,
    "velocity": draw_velocity,
    "gait": draw_gait,
    "feet": draw_feet,
    "com": _com,
    "joints": _joints,
    "forces": _forces,
    "torques": _torques,
    "timing": _timing,
    "estimate": _estimate,
}
"""Figures of :func:`plot_run`: file name without ``.png`` -> drawing, which returns whether there was data."""
