"""Figures of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunLog, SolvedRun, push_intervals
from lgmpc.runs.figures import length_unit
from lgmpc.runs.intervals import intervals
from lgmpc.runs.log import CONTACT_STATES
from lgmpc.runs.metrics import rpy_deg, tilt_and_yaw_deg
from lgmpc.runs.walking import body_velocity, stride_mean
from lgmpc.typing import BoolArray
from lgmpc.viz import series
from lgmpc.viz.figure_files import (
    EXTRA,
    INK,
    LIMIT,
    SOFT,
    Drawing,
    Plots,
    X,
    Y,
    Z,
    draw_figures,
    figure_title,
    legend_above,
)
from lgmpc.viz.trajectory_plots import trajectory_drawings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DETAIL_STRIDES = 6.0
"""Number of gait cycles in the detailed views."""

_STATE_COLORS = {"stance": X, "early": Z, "late": Y, "missing": EXTRA, "lost": LIMIT}
"""Colours of the contact states in the gait diagram; swings are blank."""

_TARGET: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": "--"}


def plot_run(robot: Robot, run: Run | SolvedRun) -> Plots:
    """Draw the figures of a run: base, joints, forces, ...; of a closed loop gait and timing, of a solve convergence.

    Args:
        robot: the robot of the run.
        run: contents of the run folder.

    Returns:
        The figures with data.

    Raises:
        InputError: if the log has fewer than two ticks, or the trajectory contains NaN or infinity.
        MissingDependencyError: if matplotlib is not installed.
    """
    return draw_figures(run_drawings(robot, run), figure_title(run.result))


def run_drawings(robot: Robot, run: Run | SolvedRun) -> dict[str, Drawing]:
    """Return the drawings of a run by their names; each returns whether there was data.

    Raises:
        InputError: as of :func:`plot_run`.
    """
    if isinstance(run, SolvedRun):
        return trajectory_drawings(robot, run)
    if run.log.ticks < 2:
        raise InputError("run", f"{run.path} with {run.log.ticks} ticks", "a run of at least two ticks")
    return {name: _drawing(draw, run.log) for name, draw in FIGURES.items()}


def _drawing(draw: Callable[[Figure, RunLog], bool], log: RunLog) -> Drawing:
    return lambda figure: draw(figure, log)


def _base(figure: Figure, log: RunLog) -> bool:
    moved = log.base_pose[:, :2] - log.base_pose[0, :2]
    unit, scale = length_unit(float(np.abs(moved).max()))
    headings = ("Base displacement", unit), ("Base height above the ground", "mm"), ("Base tilt from upright", "deg")
    position, height, tilt = rows = series.stacked(figure, (8.0, 6.2), *headings)
    series.draw_xyz(position, log.time, scale * moved, ("x (forward)", "y (left)"))
    height.plot(log.time, 1e3 * log.above_ground(log.base_reference[:, :3]), **_TARGET, label="target")
    height.plot(log.time, 1e3 * log.base_height, color=Z, label="base")
    tilt.plot(log.time, log.tilt_deg, color=X)
    tilt.set_ylim(0.0, None)
    for axes, span in zip(rows, (2e-3 * scale, 2.0, 0.0), strict=True):
        series.finish(log, axes, span=span)
    series.label_pushes(log, [position])
    series.label_modes(log, height)
    legend_above(position, height)
    return True


def _attitude(figure: Figure, log: RunLog) -> bool:
    if not log.floating_base:
        return False
    headings = ("Base attitude", "deg"), ("Angular velocity, base axes", "rad/s")
    angles, rates = series.stacked(figure, (8.0, 4.8), *headings)
    series.draw_xyz(angles, log.time, rpy_deg(log.base_pose[:, 3:]), ("roll, x", "pitch, y", "yaw, z"))
    series.draw_xyz(rates, log.time, log.v[:, 3:6], lw=1.1)
    series.finish(log, angles, span=0.2)
    series.finish(log, rates, span=0.02)
    series.label_pushes(log, [angles])
    legend_above(angles)
    return True


def _velocity(figure: Figure, log: RunLog) -> bool:
    """Draw velocity and yaw rate: the command, the mean over each gait cycle, and the instantaneous value."""
    if not log.commanded:
        return False
    headings = ("Velocity ahead", "m/s"), ("Velocity to the left", "m/s"), ("Yaw rate", "rad/s")
    rows = series.stacked(figure, (9.6, 6.4), *headings)
    velocity, dt = body_velocity(log), float(np.median(np.diff(log.time)))
    window = max(1, min(round(float(log.gait_period_s.min()) / dt), log.ticks))
    mean = stride_mean(velocity, window)
    middle = log.time[: len(mean)] + 0.5 * (window - 1) * dt
    for column, (axes, color) in enumerate(zip(rows, (X, Y, Z), strict=True)):
        axes.plot(log.time, velocity[:, column], color=color, lw=0.6, alpha=0.45, label="instantaneous")
        axes.plot(middle, mean[:, column], color=color, label="mean over a gait cycle")
        axes.plot(log.time, log.command[:, column], **_TARGET, label="limited command")
        series.finish(log, axes, span=0.1)
    series.label_pushes(log, rows[:1])
    legend_above(rows[0])
    return True


def _gait(figure: Figure, log: RunLog) -> bool:
    """Draw a bar for each stance of each foot, coloured by its contact state, above the measured contact."""
    if not log.stepped:
        return False
    figure.set_size_inches(9.6, 1.6 + 0.62 * len(log.feet) * 2)
    whole, detail = figure.subplots(2, 1)
    for axes in (whole, detail):
        _draw_contact_rows(axes, log)
        series.finish(log, axes)
    whole.set_title("Stances, and below each the measured contact")
    detail.set(title="Detail", xlabel="time, s", xlim=_detail(log))
    legend_above(whole)
    return True


def _feet(figure: Figure, log: RunLog) -> bool:
    """Draw the height above ground of each foot's contact point and of its target, for some gait cycles."""
    if not log.stepped:
        return False
    feet = log.contact_frames.tolist()
    figure.set_size_inches(9.6, 1.0 + 1.4 * len(feet))
    rows = figure.subplots(len(feet), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    begin, end = _detail(log)
    shown = (log.time >= begin) & (log.time <= end)
    time, height = log.time[shown], log.contact_clearance[shown]
    rise = np.einsum("nki,nki->nk", log.swing_targets[shown] - log.contact_points[shown], log.contact_normals[shown])
    for k, (axes, name) in enumerate(zip(rows, feet, strict=True)):
        axes.plot(time, 1e3 * (height + rise)[:, k], **_TARGET, label="target")
        axes.plot(time, 1e3 * height[:, k], color=X, label="contact point")
        touching = log.closed[shown, k]
        axes.fill_between(time, 0.0, 1.0, touching, transform=axes.get_xaxis_transform(), color=SOFT, alpha=0.15, lw=0)
        axes.set_ylabel(f"{name}, mm")
        series.finish(log, axes, span=10.0)
        axes.set_xlim(begin, end)
    rows[0].set_title("Height of the feet, shaded during contact")
    rows[-1].set_xlabel("time, s")
    legend_above(rows[0])
    return True


def _detail(log: RunLog) -> tuple[float, float]:
    """Return an interval of some gait cycles: from before the first push while stepping, or from the first swing."""
    lifted = np.flatnonzero(~log.stance.all(axis=1))
    stride = float(log.gait_period_s[lifted[0]])
    begin = float(log.time[lifted[0]])
    pushes = [push.start for push in push_intervals(log) if push.start > begin]
    begin = max(float(log.time[0]), (pushes[0] if pushes else begin) - stride)
    return begin, min(begin + _DETAIL_STRIDES * stride, float(log.time[-1]))


def _draw_contact_rows(axes: Axes, log: RunLog) -> None:
    """Draw a row for each foot: bars coloured by its contact state, above the measured contact."""
    feet, touching = [*log.feet], log.touching
    for k in range(len(feet)):
        row = len(feet) - 1 - k
        for name, color in _STATE_COLORS.items():
            flags: BoolArray = log.contact_states == CONTACT_STATES.index(name)
            label = name if k == 0 and flags.any() else None
            axes.broken_barh(_stretches(log, flags[:, k]), (row - 0.22, 0.56), facecolors=color, label=label)
        axes.broken_barh(_stretches(log, touching[:, k]), (row - 0.4, 0.12), facecolors=SOFT)
    axes.set_yticks(range(len(feet)), feet[::-1])
    axes.set_ylim(-0.6, len(feet) - 0.4)
    axes.grid(visible=False, axis="y")


def _stretches(log: RunLog, flags: BoolArray) -> list[tuple[float, float]]:
    """Return start and duration of the intervals of ticks with a flag, s."""
    times = np.append(log.time, log.time[-1] + np.median(np.diff(log.time)))
    return [(float(times[a]), float(times[b] - times[a])) for a, b in intervals(flags)]


def _com(figure: Figure, log: RunLog) -> bool:
    figure.set_size_inches(9.6, 5.6)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.7, 1.0))
    first = figure.add_subplot(grid[0, 0])
    rows = [first, *(figure.add_subplot(grid[axis, 0], sharex=first) for axis in (1, 2))]
    unit, scale = length_unit(float(np.ptp(log.com[:, :2], axis=0).max()))
    for axis, (axes, color, name) in enumerate(zip(rows, (X, Y, Z), "xyz", strict=True)):
        each, factor = (unit, scale) if axis < 2 else ("mm", 1e3)
        axes.plot(log.time, factor * log.com_reference[:, axis], **_TARGET, label="target")
        axes.plot(log.time, factor * log.com[:, axis], color=color, label="centre of mass")
        axes.set_ylabel(f"{name}, {each}")
        series.finish(log, axes, span=2e-3 * factor)
    series.label_pushes(log, [first])
    first.set_title("Centre of mass and its target")
    legend_above(first)
    rows[2].set_xlabel("time, s")
    above = figure.add_subplot(grid[:, 1])
    moves = bool(np.ptp(log.com_reference[:, :2], axis=0).any())
    above.plot(*scale * log.com_reference[:, :2].T, **_TARGET, marker="" if moves else ".", label="target")
    above.plot(*scale * log.com[:, :2].T, color=X, label="centre of mass")
    above.set(title="Seen from above", xlabel=f"x, {unit}", ylabel=f"y, {unit}")
    above.set_aspect("equal", adjustable="datalim")
    return True


def _joints(figure: Figure, log: RunLog) -> bool:
    names: list[str] = log.joint_names.tolist()
    if not names:
        return False
    angles = log.q[:, 7 if log.floating_base else 0 :]
    if angles.shape[1] != len(names):  # a joint may have more coordinates than degrees of freedom
        angles = np.full(log.tau.shape, np.nan)
    columns = series.JointValues("Position", "rad", angles), series.JointValues("Velocity", "rad/s", log.joint_velocity)
    grid = series.draw_joints(figure, names, log.time, *columns)
    series.finish(log, *grid[:, 0], span=0.01)
    series.finish(log, *grid[:, 1], span=0.02)
    series.label_pushes(log, grid[0])
    return True


def _forces(figure: Figure, log: RunLog) -> bool:
    """Draw each contact's normal force, planned and measured, and its tangential force over its friction limit."""
    if not len(log.contact_frames):
        return False
    names, words = log.contact_frames.tolist(), series.friction_words(log)
    planned = np.einsum("nki,nki->nk", log.contact_forces_desired, log.contact_normals)
    forces = log.normal_forces, log.tangential_forces, log.friction_limits
    rows = series.draw_forces(figure, names, log.time, *forces, words, planned=planned)
    series.finish(log, *rows.flat)
    series.label_pushes(log, rows[0])
    return True


def _torques(figure: Figure, log: RunLog) -> bool:
    names: list[str] = log.joint_names.tolist()
    if not names:
        return False
    limit = log.effort_limit_over_time
    grid = series.draw_joints(figure, names, log.time, series.JointValues("Torque", "N.m", log.tau, -limit, limit))
    series.finish(log, *grid.flat)
    series.label_pushes(log, grid[0])
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
    kinds = ("base position", "mm"), ("orientation", "deg"), ("velocity, base axes", "mm/s")
    headings = ((f"Error of the estimated {name}", unit) for name, unit in kinds)
    position, attitude, velocity = rows = series.stacked(figure, (8.0, 6.2), *headings)
    series.draw_xyz(position, log.time, 1e3 * (log.estimate_q[:, :3] - log.q[:, :3]))
    angles = tilt_and_yaw_deg(log.estimate_q[:, 3:7], log.q[:, 3:7])
    series.draw_xyz(attitude, log.time, np.column_stack(angles), ("tilt", "yaw"))
    series.draw_xyz(velocity, log.time, 1e3 * (log.estimate_v[:, :3] - log.v[:, :3]), lw=0.9)
    series.finish(log, *rows)
    series.label_pushes(log, [position])
    legend_above(position, attitude)
    return True


FIGURES: dict[str, Callable[[Figure, RunLog], bool]] = {
    "base": _base,
    "attitude": _attitude,
    "velocity": _velocity,
    "gait": _gait,
    "feet": _feet,
    "com": _com,
    "joints": _joints,
    "forces": _forces,
    "torques": _torques,
    "timing": _timing,
    "estimate": _estimate,
}
"""Figures of :func:`plot_run`: file name without ``.png`` -> drawing, which returns whether there was data."""
